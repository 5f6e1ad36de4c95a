//! The record of a batch, a file beside its outputs with one JSON object a line: a batch that is
//! killed loses at most its last line.

use std::collections::HashMap;
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use relevo::Error;
use relevo::source::{FileStamp, Fingerprint};
use serde::{Deserialize, Serialize};

/// Name of the record in the output folder.
pub const NAME: &str = "relevo-each.jsonl";

/// A finished output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Stamp of the output when it was finished.
    pub output: FileStamp,
    /// Fingerprint of the input at that time.
    pub input: Fingerprint,
    /// All options that change the output, as text.
    pub options: String,
    /// Warnings of the build.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

/// An input that failed, and its error.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Failed<'a> {
    failed: &'a str,
    error: &'a str,
}

/// The record of a folder.
pub struct Record {
    path: PathBuf,
    file: Mutex<File>,
    done: HashMap<String, Entry>,
}

impl Record {
    /// Opens the record of a folder or begins one. Incomplete lines are ignored, so that their
    /// outputs are made again.
    pub fn open(folder: &Path) -> Result<Self, Error> {
        let path = folder.join(NAME);
        let failed = |source| Error::io(&path, "keep a record of the batch in it", source);
        let text = match fs::read(&path) {
            Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => String::new(),
            Err(error) => return Err(failed(error)),
        };
        let entries = text.lines().filter_map(|line| serde_json::from_str::<Entry>(line).ok());
        let done = entries.map(|entry| (entry.output.name.clone(), entry)).collect();
        let mut file = OpenOptions::new().create(true).append(true).open(&path).map_err(failed)?;
        if !text.is_empty() && !text.ends_with('\n') {
            file.write_all(b"\n").map_err(failed)?;
        }
        Ok(Self { path: path.clone(), file: Mutex::new(file), done })
    }

    /// True if the output is unchanged and was made from this input with these options.
    pub fn has(&self, output: &Path, input: &Fingerprint, options: &str) -> bool {
        let Ok(stamp) = FileStamp::of(output) else { return false };
        let entry = self.done.get(&stamp.name);
        entry.is_some_and(|e| e.output == stamp && e.input == *input && e.options == options)
    }

    /// Adds a finished output.
    pub fn add(
        &self,
        output: &Path,
        input: Fingerprint,
        options: &str,
        warnings: &[String],
    ) -> Result<(), Error> {
        let (options, warnings) = (options.to_owned(), warnings.to_vec());
        self.write(&Entry { output: FileStamp::of(output)?, input, options, warnings })
    }

    /// Adds a failed input, which is tried again when the batch is resumed.
    pub fn add_failed(&self, input: &Path, error: &str) -> Result<(), Error> {
        self.write(&Failed { failed: &input.to_string_lossy(), error })
    }

    /// Appends a line.
    fn write(&self, entry: &impl Serialize) -> Result<(), Error> {
        let mut line = serde_json::to_string(entry)
            .map_err(|error| Error::usage(format!("the record of the batch cannot be written: {error}")))?;
        line.push('\n');
        let mut file = self.file.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        file.write_all(line.as_bytes()).map_err(|source| Error::io(&self.path, "write it", source))
    }
}
