//! The one error type of the library, sorted by whose fault it is.
//!
//! A message says what is wrong, where (file and place in it), what was expected, and what to do.
//! Names and texts of files go through [`printable`]: a message is one line and has no control
//! characters. Nothing here prints; the command line does, once.

use std::io;
use std::path::{Path, PathBuf};

use crate::text::printable;

/// `Result` with [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// An error, by whose fault it is.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused: a missing file, a full disk, no permission.
    #[error("{}cannot {}: {source}", prefix(.path), printable(.action))]
    Io {
        /// The file in question.
        path: PathBuf,
        /// What was tried, as a verb phrase: `open`, `read 512 bytes at offset 40`.
        action: String,
        /// The system's own words.
        source: io::Error,
    },
    /// The file is damaged or is not what its name says.
    #[error("{}{}: expected {}, got {}", prefix(.path), printable(.place), printable(.expected), printable(.got))]
    Format {
        /// The file; empty while the bytes are not known to come from one.
        path: PathBuf,
        /// Where in it: a tag, a chunk, an offset.
        place: String,
        /// What a sound file has there.
        expected: String,
        /// What this one has.
        got: String,
    },
    /// The file is fine, this program cannot read it (or not as it was built).
    #[error("{}{}: {}", prefix(.path), printable(.what), printable(.hint))]
    Unsupported {
        /// The file in question.
        path: PathBuf,
        /// The feature by name: `LERC compression`.
        what: String,
        /// What to do: `build with --features gdal`.
        hint: String,
    },
    /// A number is larger than this program accepts.
    #[error("{}{} is {got}, more than the limit of {max}", prefix(.path), printable(.what))]
    Limit {
        /// The file in question; empty if there is none.
        path: PathBuf,
        /// The quantity by name.
        what: String,
        /// Its value.
        got: u64,
        /// The largest accepted.
        max: u64,
    },
    /// The system has no memory left for something.
    #[error("{}not enough memory for {} ({bytes} bytes)", prefix(.path), printable(.what))]
    OutOfMemory {
        /// The file in question; empty if there is none.
        path: PathBuf,
        /// What it was for.
        what: String,
        /// Bytes that were asked for.
        bytes: u64,
    },
    /// A file is another than it was when the work began.
    #[error("{}{}", prefix(.path), printable(.how))]
    Changed {
        /// The file.
        path: PathBuf,
        /// How it shows, and what to do.
        how: String,
    },
    /// The output is there already.
    #[error("{}it exists already; use `force` to replace it", prefix(.path))]
    Exists {
        /// The output.
        path: PathBuf,
    },
    /// The work folder of the output holds an unfinished build.
    #[error("{}it holds an unfinished build of {}; `resume` goes on with it, `force` begins anew", prefix(.folder), printable(&.output.display().to_string()))]
    Unfinished {
        /// The work folder.
        folder: PathBuf,
        /// The output.
        output: PathBuf,
    },
    /// The program is at fault: what it relies on does not hold.
    #[error("{}: this is a fault of the program; please report it", printable(.what))]
    Internal {
        /// What does not hold.
        what: String,
    },
    /// The request makes no sense: options that exclude one another, a level that is not there.
    #[error("{}", printable(.what))]
    Usage {
        /// What is wrong with it and what to do.
        what: String,
    },
    /// The user asked to stop.
    #[error("interrupted")]
    Interrupted,
}

impl Error {
    /// An [`Error::Io`].
    pub fn io(path: impl Into<PathBuf>, action: impl Into<String>, source: io::Error) -> Self {
        Self::Io { path: path.into(), action: action.into(), source }
    }

    /// An [`Error::Format`] without a path; [`Error::at`] adds it where it is known.
    pub fn format(place: impl Into<String>, expected: impl ToString, got: impl ToString) -> Self {
        Self::Format {
            path: PathBuf::new(),
            place: place.into(),
            expected: expected.to_string(),
            got: got.to_string(),
        }
    }

    /// An [`Error::Unsupported`] without a path.
    pub fn unsupported(what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Unsupported { path: PathBuf::new(), what: what.into(), hint: hint.into() }
    }

    /// An [`Error::Limit`] without a path.
    pub fn limit(what: impl Into<String>, got: u64, max: u64) -> Self {
        Self::Limit { path: PathBuf::new(), what: what.into(), got, max }
    }

    /// An [`Error::Usage`].
    pub fn usage(what: impl Into<String>) -> Self {
        Self::Usage { what: what.into() }
    }

    /// An [`Error::OutOfMemory`] without a path.
    pub fn out_of_memory(what: impl Into<String>, bytes: u64) -> Self {
        Self::OutOfMemory { path: PathBuf::new(), what: what.into(), bytes }
    }

    /// An [`Error::Internal`].
    pub fn internal(what: impl Into<String>) -> Self {
        Self::Internal { what: what.into() }
    }

    /// The message without the file.
    pub fn reason(&self) -> String {
        match self {
            Self::Io { action, source, .. } => format!("cannot {action}: {source}"),
            Self::Format { place, expected, got, .. } => format!("{place}: expected {expected}, got {got}"),
            Self::Unsupported { what, hint, .. } => format!("{what}: {hint}"),
            Self::Limit { what, got, max, .. } => format!("{what} is {got}, more than the limit of {max}"),
            Self::OutOfMemory { what, bytes, .. } => format!("not enough memory for {what} ({bytes} bytes)"),
            Self::Changed { how, .. } => how.clone(),
            _ => self.to_string(),
        }
    }

    /// The same error with the file it concerns, unless it names a file already.
    #[must_use]
    pub fn at(mut self, file: &Path) -> Self {
        match &mut self {
            Self::Io { path, .. }
            | Self::Format { path, .. }
            | Self::Unsupported { path, .. }
            | Self::Limit { path, .. }
            | Self::OutOfMemory { path, .. }
            | Self::Changed { path, .. }
                if path.as_os_str().is_empty() =>
            {
                file.clone_into(path);
            }
            _ => {}
        }
        self
    }
}

/// `path: `, or nothing for an empty path.
fn prefix(path: &Path) -> String {
    if path.as_os_str().is_empty() {
        String::new()
    } else {
        format!("{}: ", printable(&path.display().to_string()))
    }
}
