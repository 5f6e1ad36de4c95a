//! [`WorkFolder`]: locked while a build runs, removed when it ends.
//!
//! Everything that a build writes lies in the folder until one rename gives the finished file its
//! name. A build that has written its state leaves the folder behind if it fails, so that it can be
//! resumed. A folder without a state is cleaned and used again. A folder that no build made is left
//! alone.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::file::Identity;
use crate::output;

const LOCK: &str = "relevo.lock";
/// What a build needs to be resumed; a folder without it holds nothing of worth.
const STATE: &str = "state";
/// A build that ends may take its folder away between our steps; then they are taken again.
const ATTEMPTS: usize = 10;

/// What to do with the work of an earlier build of the same output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Earlier {
    /// Refuse to begin: it may be worth something.
    Refuse,
    /// Throw it away.
    Discard,
    /// Go on from it, if there is any.
    Resume,
}

/// A locked work folder. Dropping it removes it with all that is in it, unless a state has been
/// written.
pub struct WorkFolder {
    output: PathBuf,
    folder: PathBuf,
    force: bool,
    lock: Option<File>,
    keep: bool,
    /// What had the output's name when the folder was taken.
    replaces: Option<Identity>,
}

impl WorkFolder {
    /// Makes or takes over the folder. Fails if the output exists (unless `force`) or another build
    /// holds the folder.
    pub fn take(output: &Path, force: bool, earlier: Earlier) -> Result<Self> {
        let output = resolve(output, force)?;
        let folder = folder_of(&output);
        for _ in 0..ATTEMPTS {
            if let Some(lock) = take(&folder, &output)? {
                // Kept until it is known that nothing in it is of worth.
                let replaces = Identity::of(&output).ok();
                let mut work = Self { output, folder, force, lock: Some(lock), keep: true, replaces };
                let resumable = state_path(&work.folder).is_file();
                if resumable && earlier == Earlier::Refuse {
                    return Err(unfinished(&work));
                }
                work.keep = resumable && earlier == Earlier::Resume;
                if !work.keep {
                    work.clean().map_err(|source| {
                        Error::io(&work.folder, "clean what an earlier build left", source)
                    })?;
                }
                return Ok(work);
            }
        }
        Err(busy(&output, &folder))
    }

    /// True if an earlier build left a state to go on from.
    pub fn has_state(&self) -> bool {
        state_path(&self.folder).is_file()
    }

    /// Puts a state in the place of the one before, whole and synced. From now on the folder
    /// outlives a failed build.
    pub fn write_state(&mut self, state: &[u8]) -> Result<()> {
        let mut new = NewState::create(&self.folder)?;
        new.append(state)?;
        new.publish()?;
        self.keep = true;
        Ok(())
    }

    /// Keeps the folder if the build fails: somebody else writes its state.
    pub fn keep(&mut self) {
        self.keep = true;
    }

    /// Nothing in the folder is of worth: it goes with the build.
    pub fn discard(&mut self) {
        self.keep = false;
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The output.
    pub fn output(&self) -> &Path {
        &self.output
    }

    /// The file that had the output's name when the folder was taken, as it was then.
    pub(crate) fn replaces(&self) -> Option<&Identity> {
        self.replaces.as_ref()
    }

    /// A path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Gives a finished file of the folder the output's name; the folder is of no more use then.
    /// Without `force` a file that has come to be there stays.
    pub fn publish(&mut self, file: &Path) -> Result<()> {
        self.give_name(file)?;
        self.keep = false;
        Ok(())
    }

    /// Gives the folder itself the output's name: a piece.
    pub fn publish_folder(mut self) -> Result<()> {
        let output = self.output.clone();
        if self.force && is_piece(&output) {
            fs::remove_dir_all(&output).map_err(|source| Error::io(&output, "replace it", source))?;
        }
        if fs::symlink_metadata(&output).is_ok() {
            return Err(exists(&output));
        }
        let failed = |source| Error::io(&output, "give the finished piece its name", source);
        // An open file cannot be moved on Windows; nobody else begins a build of an output that is
        // about to be.
        let _ = fs::remove_file(self.folder.join(LOCK));
        self.lock = None;
        fs::rename(&self.folder, &output).map_err(failed)?;
        sync_folder(parent(&output)).map_err(|source| Error::io(&output, "sync its folder", source))
    }

    fn give_name(&self, file: &Path) -> Result<()> {
        if self.force {
            fs::rename(file, &self.output)
                .map_err(|source| self.failed("give the finished file its name", source))?;
        } else {
            self.publish_new(file)?;
        }
        sync_folder(parent(&self.output)).map_err(|source| Error::io(&self.output, "sync its folder", source))
    }

    fn publish_new(&self, file: &Path) -> Result<()> {
        // A link never replaces; a rename does. File systems without links get the check and the
        // rename.
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
        // What is left to go on from, the state of a build and of those around it says.
        Error::io(&self.output, format!("{action} (no output was written)"), source)
    }

    /// Removes everything but the lock; the state first, since it counts on the rest.
    fn clean(&self) -> io::Result<()> {
        match fs::remove_file(state_path(&self.folder)) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            _ => {}
        }
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
        if self.keep {
            return;
        }
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

/// The work folder of an output.
fn folder_of(output: &Path) -> PathBuf {
    let mut name = OsString::from(output);
    name.push(".work");
    PathBuf::from(name)
}

/// The state file of a work folder, or of a piece.
pub fn state_path(folder: &Path) -> PathBuf {
    folder.join(STATE)
}

/// The work folder of an output, if an unfinished build left a state there from which it can be
/// resumed.
pub fn resumable(output: &Path) -> Option<PathBuf> {
    // The folder of a link's output lies beside what the link leads to.
    let linked = output.is_symlink().then(|| fs::canonicalize(output).ok()).flatten();
    let folder = folder_of(linked.as_deref().unwrap_or(output));
    state_path(&folder).is_file().then_some(folder)
}

/// Opens a file of a work folder for writing and for reading back. `new`: creates it, or empties
/// it.
pub(crate) fn open_file(path: &Path, new: bool) -> io::Result<File> {
    OpenOptions::new().create(new).truncate(new).read(true).write(true).open(path)
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
        Ok(_) if is_piece(output) => {
            if force {
                Ok(output.to_owned())
            } else {
                Err(exists(output))
            }
        }
        Ok(found) if !found.is_file() => Err(Error::usage(format!(
            "{} exists and is no regular file; name another output",
            output.display()
        ))),
        Ok(_) if !force => Err(exists(output)),
        Ok(_) => fs::canonicalize(output).map_err(|source| Error::io(output, "resolve", source)),
        // A rename would fail there when all the work is done, or put the file where nobody looks
        // for it.
        Err(error) if error.kind() == ErrorKind::NotFound && fs::symlink_metadata(output).is_ok() => {
            Err(output::dangling(output))
        }
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(output.to_owned()),
        Err(source) => Err(Error::io(output, "look at", source)),
    }
}

fn exists(output: &Path) -> Error {
    Error::Exists { path: output.to_owned() }
}

/// True for a folder that a finished window was given as its output.
fn is_piece(path: &Path) -> bool {
    state_path(path).is_file()
}

/// The next state of a folder while it is written: under another name, so that there is a whole one
/// at any time.
pub struct NewState {
    folder: PathBuf,
    file: BufWriter<File>,
}

impl NewState {
    /// Begins it. There must be one at a time only.
    pub fn create(folder: &Path) -> Result<Self> {
        match File::create(folder.join("state.new")) {
            Ok(file) => Ok(Self { folder: folder.to_owned(), file: BufWriter::new(file) }),
            Err(source) => Err(state_failed(folder, source)),
        }
    }

    /// Adds to it.
    pub fn append(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_all(bytes).map_err(|source| state_failed(&self.folder, source))
    }

    /// An error of the system while it was being made.
    pub fn failed(&self, action: &str, source: io::Error) -> Error {
        Error::io(&self.folder, action, source)
    }

    /// Syncs it, and puts it in the place of the one before.
    pub fn publish(self) -> Result<()> {
        let Self { folder, file } = self;
        let publish = || -> io::Result<()> {
            let file = file.into_inner()?;
            file.sync_all()?;
            drop(file);
            fs::rename(folder.join("state.new"), state_path(&folder))?;
            sync_folder(&folder)
        };
        publish().map_err(|source| state_failed(&folder, source))
    }
}

fn state_failed(folder: &Path, source: io::Error) -> Error {
    Error::io(state_path(folder), "write the state of the build", source)
}

fn unfinished(work: &WorkFolder) -> Error {
    Error::Unfinished { folder: work.folder.clone(), output: work.output.clone() }
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
