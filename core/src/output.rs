//! Output files: never written over an input, and under their names only when they are complete.

use std::collections::HashMap;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// Input files: no output may be one of them.
#[derive(Debug, Default)]
pub struct Inputs {
    /// The files by their names with links followed, if they exist.
    names: HashMap<PathBuf, PathBuf>,
    /// The files by device and number, on systems that have these: for hard links, and names that
    /// differ only in ways the system ignores.
    entries: HashMap<(u64, u64), PathBuf>,
}

#[cfg(unix)]
fn entry(path: &Path) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    fs::metadata(path).ok().map(|found| (found.dev(), found.ino()))
}

/// Other systems have only the name.
#[cfg(not(unix))]
fn entry(_: &Path) -> Option<(u64, u64)> {
    None
}

impl Inputs {
    /// The inputs `files`.
    pub fn new<'a>(files: impl IntoIterator<Item = &'a PathBuf>) -> Self {
        let mut inputs = Self::default();
        for file in files {
            if let Ok(name) = fs::canonicalize(file) {
                inputs.names.insert(name, file.clone());
            }
            if let Some(entry) = entry(file) {
                inputs.entries.insert(entry, file.clone());
            }
        }
        inputs
    }

    /// Fails if an output is one of the files, by any name, or if one of them lies inside the place
    /// of the output or of its work folder, where it would be lost.
    ///
    /// # Errors
    /// [`Error::Usage`].
    pub fn check(&self, output: &Path) -> Result<()> {
        let name = fs::canonicalize(output).ok();
        let same = name.as_ref().and_then(|name| self.names.get(name));
        if let Some(input) = same.or_else(|| self.entries.get(&entry(output)?)) {
            return Err(Error::usage(format!(
                "{}: input and output are the same file ({} is read); name another output",
                output.display(),
                input.display()
            )));
        }
        let mut work = output.as_os_str().to_owned();
        work.push(".work");
        let folders = [name, fs::canonicalize(work).ok()];
        for folder in folders.iter().flatten().filter(|folder| folder.is_dir()) {
            if let Some((_, input)) = self.names.iter().find(|(name, _)| name.starts_with(folder)) {
                return Err(Error::usage(format!(
                    "{}: {} is read, and lies in {}, which would be replaced; name another output",
                    output.display(),
                    input.display(),
                    folder.display()
                )));
            }
        }
        Ok(())
    }
}

/// [`Inputs::check`] of one output.
pub fn check_apart(output: &Path, inputs: &[PathBuf]) -> Result<()> {
    Inputs::new(inputs).check(output)
}

/// A new file under a temporary name beside its own, which it gets when it is complete. If it is
/// dropped before, it is removed. A file left by a program that was killed is removed by the next
/// program that makes a file of that name.
#[derive(Debug)]
pub struct NewFile {
    path: PathBuf,
    temporary: PathBuf,
    file: File,
    force: bool,
    committed: bool,
}

impl NewFile {
    /// Begins a file.
    ///
    /// # Errors
    /// [`Error::Usage`] if there is a file of that name already, unless `force`, or anything else
    /// than a file.
    pub fn create(path: impl Into<PathBuf>, force: bool) -> Result<Self> {
        let path = replaceable(path.into(), force)?;
        let Some(name) = path.file_name() else {
            return Err(Error::usage(format!("{}: this is no file name", path.display())));
        };
        let mut start = std::ffi::OsString::from(".");
        start.push(name);
        sweep(&path, &start);
        for attempt in 0_u32.. {
            let mut name = start.clone();
            name.push(format!(".{}-{attempt}.part", std::process::id()));
            let temporary = path.with_file_name(name);
            match OpenOptions::new().read(true).write(true).create_new(true).open(&temporary) {
                Ok(file) => {
                    // If files cannot be locked here, files of killed programs stay.
                    let _ = file.try_lock();
                    return Ok(Self { path, temporary, file, force, committed: false });
                }
                Err(error) if error.kind() == ErrorKind::AlreadyExists && attempt < 1000 => {}
                Err(error) => return Err(Error::io(path, "create the file", error)),
            }
        }
        Err(Error::usage(format!("{}: no free name for a temporary file beside it", path.display())))
    }

    /// The path that it will have.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Moves to byte `position`.
    pub fn seek(&mut self, position: u64) -> Result<()> {
        let sought = self.file.seek(SeekFrom::Start(position));
        sought.map(drop).map_err(|error| Error::io(&self.path, format!("seek to byte {position}"), error))
    }

    /// Writes all of `bytes`.
    pub fn put(&mut self, bytes: &[u8]) -> Result<()> {
        let written = self.file.write_all(bytes);
        written.map_err(|error| Error::io(&self.path, format!("write {} bytes", bytes.len()), error))
    }

    /// Syncs the file, and renames it to its own name.
    pub fn commit(mut self) -> Result<()> {
        self.file.sync_all().map_err(|error| Error::io(&self.path, "write to disk", error))?;
        let failed = |error| Error::io(&self.path, "give the finished file its name", error);
        if self.force {
            fs::rename(&self.temporary, &self.path).map_err(failed)?;
        } else {
            // A hard link never replaces a file that has appeared meanwhile; on file systems
            // without links there is a test and a rename.
            match fs::hard_link(&self.temporary, &self.path) {
                Ok(()) => {
                    let _ = fs::remove_file(&self.temporary);
                }
                Err(error) if error.kind() == ErrorKind::AlreadyExists => return Err(exists(&self.path)),
                Err(_) if fs::symlink_metadata(&self.path).is_ok() => return Err(exists(&self.path)),
                Err(_) => fs::rename(&self.temporary, &self.path).map_err(failed)?,
            }
        }
        self.committed = true;
        Ok(())
    }
}

impl Write for NewFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for NewFile {
    fn drop(&mut self) {
        if !self.committed {
            // If it cannot be removed, there is nothing to do or say.
            let _ = fs::remove_file(&self.temporary);
        }
    }
}

/// Writes a whole file. A file of that name stays unless `force`, and stays complete until it is
/// replaced.
pub fn write(path: &Path, bytes: &[u8], force: bool) -> Result<()> {
    let mut file = NewFile::create(path, force)?;
    file.put(bytes)?;
    file.commit()
}

/// The path of an output with links followed. Fails if it may not be replaced.
fn replaceable(path: PathBuf, force: bool) -> Result<PathBuf> {
    let Ok(there) = fs::symlink_metadata(&path) else { return Ok(path) };
    if !force {
        return Err(exists(&path));
    }
    if there.is_file() {
        return Ok(path);
    }
    match fs::metadata(&path) {
        Ok(found) if found.is_file() => {
            fs::canonicalize(&path).map_err(|error| Error::io(&path, "resolve", error))
        }
        Ok(_) => Err(Error::usage(format!(
            "{} exists and is no regular file; name another output",
            path.display()
        ))),
        Err(_) => Err(dangling(&path)),
    }
}

/// The error of an output whose name is a link that leads to nothing.
pub fn dangling(path: &Path) -> Error {
    Error::usage(format!("{} is a link that leads nowhere; remove it or name another output", path.display()))
}

fn exists(path: &Path) -> Error {
    Error::Exists { path: path.to_owned() }
}

/// Removes files that killed programs have left beside an output: those that no program holds
/// locked.
fn sweep(path: &Path, start: &std::ffi::OsStr) {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let rest = name.as_encoded_bytes().strip_prefix(start.as_encoded_bytes());
        let numbers = rest.and_then(|rest| rest.strip_prefix(b".")?.strip_suffix(b".part"));
        let is_ours = numbers.is_some_and(|numbers| {
            let mut parts = numbers.split(|&byte| byte == b'-');
            let number =
                |part: Option<&[u8]>| part.is_some_and(|p| !p.is_empty() && p.iter().all(u8::is_ascii_digit));
            number(parts.next()) && number(parts.next()) && parts.next().is_none()
        });
        if !is_ours || !entry.file_type().is_ok_and(|kind| kind.is_file()) {
            continue;
        }
        // A file that cannot be removed stays.
        if let Ok(file) = OpenOptions::new().write(true).open(entry.path()) {
            match file.try_lock() {
                Ok(()) => drop(fs::remove_file(entry.path())),
                Err(TryLockError::WouldBlock | TryLockError::Error(_)) => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).expect("folder");
        let mut names: Vec<_> =
            entries.map(|entry| entry.expect("entry").file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_has_its_name_only_when_it_is_whole() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a");
        let mut file = NewFile::create(&path, false).expect("file");
        file.put(b"one").expect("write");
        assert!(!path.exists());
        drop(file);
        assert!(names(folder.path()).is_empty());
        write(&path, b"two", false).expect("write");
        let message = write(&path, b"three", false).expect_err("there").to_string();
        assert!(message.contains("exists already"), "{message}");
        write(&path, b"four", true).expect("write");
        assert_eq!(fs::read(&path).expect("read"), b"four");
        // One that has come to be there meanwhile.
        let other = folder.path().join("b");
        let file = NewFile::create(&other, false).expect("file");
        fs::write(&other, "mine").expect("write");
        assert!(file.commit().is_err());
        assert_eq!(fs::read(&other).expect("read"), b"mine");
        assert_eq!(names(folder.path()), ["a", "b"]);
    }

    #[test]
    fn what_a_killed_program_left_is_removed() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a.tif");
        for name in [".a.tif.1-0.part", ".a.tif.x-0.part", ".b.tif.1-0.part", ".a.tif.part"] {
            fs::write(folder.path().join(name), "left").expect("write");
        }
        let running = NewFile::create(&path, false).expect("file");
        let second = NewFile::create(&path, false).expect("file");
        second.commit().expect("commit");
        assert!(running.commit().is_err());
        assert_eq!(names(folder.path()), [".a.tif.part", ".a.tif.x-0.part", ".b.tif.1-0.part", "a.tif"]);
    }

    #[cfg(unix)]
    #[test]
    fn an_output_is_no_input_whatever_it_is_called() {
        let folder = tempfile::tempdir().expect("folder");
        let path = |name: &str| folder.path().join(name);
        fs::write(path("dem"), "x").expect("write");
        fs::hard_link(path("dem"), path("hard")).expect("link");
        std::os::unix::fs::symlink("dem", path("soft")).expect("link");
        std::os::unix::fs::symlink("gone", path("nowhere")).expect("link");
        fs::create_dir(path("out.work")).expect("folder");
        fs::write(path("out.work/piece"), "x").expect("write");
        let inputs = [path("dem"), path("out.work/piece"), path("absent")];
        for output in ["dem", "hard", "soft", "./dem", "out.work/../dem", "out"] {
            assert!(check_apart(&path(output), &inputs).is_err(), "{output}");
        }
        assert!(check_apart(&path("other"), &inputs).is_ok());
        for bad in ["out.work", "nowhere"] {
            assert!(NewFile::create(path(bad), true).is_err(), "{bad}");
        }
        // A link is followed, not replaced.
        write(&path("soft"), b"y", true).expect("write");
        assert_eq!(fs::read(path("dem")).expect("read"), b"y");
    }
}
