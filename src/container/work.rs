//! The work folder of a build, `<output>.work` beside the output: locked while a build runs, gone when it ends.
//!
//! Everything that a build writes lies in it until one rename gives the finished file its name. A folder whose build
//! died is cleaned and used again; one that is no work folder is left alone.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

const LOCK: &str = "relevo.lock";
/// A build that ends may take its folder away between our steps; then they are taken again.
const ATTEMPTS: usize = 10;

/// A locked work folder; dropping it removes it with all that is in it.
pub(super) struct WorkFolder {
    output: PathBuf,
    folder: PathBuf,
    force: bool,
    lock: Option<File>,
}

impl WorkFolder {
    /// Makes or takes over the folder. Fails if the output exists (unless `force`) or another build holds the folder.
    pub fn create(output: &Path, force: bool) -> Result<Self> {
        let output = resolve(output, force)?;
        let mut name = OsString::from(&output);
        name.push(".work");
        let folder = PathBuf::from(name);
        for _ in 0..ATTEMPTS {
            if let Some(lock) = take(&folder, &output)? {
                let work = Self { output, folder, force, lock: Some(lock) };
                work.clean()
                    .map_err(|source| Error::io(&work.folder, "clean what an earlier build left", source))?;
                return Ok(work);
            }
        }
        Err(busy(&output, &folder))
    }

    /// The output.
    pub fn output(&self) -> &Path {
        &self.output
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Gives a finished file of the folder the output's name. Without `force` a file that has come to be there stays.
    pub fn publish(&self, file: &Path) -> Result<()> {
        if self.force {
            fs::rename(file, &self.output)
                .map_err(|source| self.failed("give the finished file its name", source))?;
        } else {
            self.publish_new(file)?;
        }
        sync_folder(parent(&self.output)).map_err(|source| Error::io(&self.output, "sync its folder", source))
    }

    fn publish_new(&self, file: &Path) -> Result<()> {
        // A link never replaces; a rename does. File systems without links get the check and the rename.
        match fs::hard_link(file, &self.output) {
            Ok(()) => return Ok(()),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => return Err(exists(&self.output)),
            Err(_) => {}
        }
        if fs::symlink_metadata(&self.output).is_ok() {
            return Err(exists(&self.output));
        }
        fs::rename(file, &self.output)
            .map_err(|source| self.failed("give the finished file its name", source))
    }

    /// An error of the system while the output was being made.
    pub fn failed(&self, action: &str, source: io::Error) -> Error {
        Error::io(&self.output, format!("{action} (nothing was left behind)"), source)
    }

    /// Removes everything but the lock.
    fn clean(&self) -> io::Result<()> {
        for entry in fs::read_dir(&self.folder)? {
            let entry = entry?;
            if entry.file_name() == LOCK {
                continue;
            }
            if entry.file_type()?.is_dir() {
                fs::remove_dir_all(entry.path())?;
            } else {
                fs::remove_file(entry.path())?;
            }
        }
        Ok(())
    }
}

impl Drop for WorkFolder {
    fn drop(&mut self) {
        // What cannot be removed stays; the next build of this output cleans it.
        let _ = self.clean();
        if cfg!(windows) {
            // An open file cannot be removed there.
            self.lock = None;
        }
        let _ = fs::remove_file(self.folder.join(LOCK));
        let _ = fs::remove_dir(&self.folder);
        self.lock = None;
    }
}

/// The output's path with links followed, after a look at what is there.
fn resolve(output: &Path, force: bool) -> Result<PathBuf> {
    if output.file_name().is_none() {
        return Err(Error::usage(format!("{} is no name for a file", output.display())));
    }
    let folder = parent(output);
    let found =
        fs::metadata(folder).map_err(|source| Error::io(folder, "write a file in this folder", source))?;
    if !found.is_dir() {
        return Err(Error::io(folder, "write a file in this folder", ErrorKind::NotADirectory.into()));
    }
    match fs::metadata(output) {
        Ok(found) if !found.is_file() => Err(Error::usage(format!(
            "{} exists and is no regular file; name another output",
            output.display()
        ))),
        Ok(_) if !force => Err(exists(output)),
        Ok(_) => fs::canonicalize(output).map_err(|source| Error::io(output, "resolve", source)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(output.to_owned()),
        Err(source) => Err(Error::io(output, "look at", source)),
    }
}

fn exists(output: &Path) -> Error {
    Error::usage(format!("{} exists; use --force to replace it", output.display()))
}

fn busy(output: &Path, folder: &Path) -> Error {
    let (output, folder) = (output.display(), folder.display());
    Error::usage(format!(
        "another build is writing {output} (it holds {folder}); wait for it or name another output"
    ))
}

/// The folder that a path lies in.
fn parent(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Makes the folder and locks it; `None` if it went away meanwhile.
fn take(folder: &Path, output: &Path) -> Result<Option<File>> {
    let failed = |source| Error::io(folder, "make the work folder", source);
    match fs::create_dir(folder) {
        Ok(()) => {}
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {
            if !is_work_folder(folder).map_err(failed)? {
                let folder = folder.display();
                return Err(Error::usage(format!(
                    "{folder} is in the way and no build made it; move it elsewhere"
                )));
            }
        }
        Err(source) => return Err(failed(source)),
    }
    let path = folder.join(LOCK);
    let lock = match OpenOptions::new().create(true).truncate(false).write(true).open(&path) {
        Ok(lock) => lock,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(source) => return Err(failed(source)),
    };
    match lock.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => return Err(busy(output, folder)),
        // A file system without locks: two builds of one output are then the user's to avoid.
        Err(TryLockError::Error(error)) if error.kind() == ErrorKind::Unsupported => {}
        Err(TryLockError::Error(source)) => return Err(failed(source)),
    }
    Ok(is_same(&lock, &path).then_some(lock))
}

/// True for a folder that holds a lock or nothing; a folder that vanishes meanwhile counts as one.
fn is_work_folder(folder: &Path) -> io::Result<bool> {
    let kind = match fs::symlink_metadata(folder) {
        Ok(found) => found.file_type(),
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(true),
        Err(error) => return Err(error),
    };
    if !kind.is_dir() {
        return Ok(false);
    }
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries.collect::<io::Result<Vec<_>>>()?,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(true),
        Err(error) => return Err(error),
    };
    Ok(entries.is_empty() || entries.iter().any(|entry| entry.file_name() == LOCK))
}

/// True if the open file is still the one of that name.
#[cfg(unix)]
fn is_same(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), fs::metadata(path)) {
        (Ok(open), Ok(named)) => (open.dev(), open.ino()) == (named.dev(), named.ino()),
        _ => false,
    }
}

/// Elsewhere an open file keeps its name.
#[cfg(not(unix))]
fn is_same(_: &File, _: &Path) -> bool {
    true
}

/// Makes a rename last.
#[cfg(unix)]
fn sync_folder(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// Elsewhere folders cannot be synced.
#[cfg(not(unix))]
fn sync_folder(_: &Path) -> io::Result<()> {
    Ok(())
}
