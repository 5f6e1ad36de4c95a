//! Puts an imagery layer into a file that is there, or another in its place. Heights are copied as
//! they are, not decoded.

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

use serde_json::Value;

use super::imagery::ImagerySections;
use super::sections::opening;
use crate::container::metadata::ImageryNote;
use crate::container::opening::{OPENING_BYTES, Opening};
use crate::container::sections::{IMAGERY, IMAGERY_PAGES, IMAGERY_TILES, METADATA, ROOT_PAGE, SectionEntry};
use crate::error::{Error, Result};
use crate::file::Identity;
use crate::progress::{Progress, Stage};
use crate::work_folder::WorkFolder;

/// Bytes copied between two cancellation checks.
const AT_ONCE: u64 = 64 << 20;

/// Writes the file that `work` is for anew, with this layer, and lets it take the place of the old
/// one: there is a whole file at any time. The file must be as it was when the folder was taken.
/// Returns its length. Fails with [`Error::Interrupted`] if `progress`, which hears of the bytes
/// copied, says so, and with the error of `inspect`, which is shown the whole file before it takes
/// that place.
pub fn put_imagery(
    work: &mut WorkFolder,
    imagery: &ImagerySections,
    note: &ImageryNote,
    inspect: &dyn Fn(&Path) -> Result<()>,
    progress: &dyn Progress,
) -> Result<u64> {
    let input = work.output().to_owned();
    let failed = |source| Error::io(&input, "read it", source);
    let mut file = File::open(&input).map_err(failed)?;
    let length = file.metadata().map_err(failed)?.len();
    // The layer was made for these heights, not for any others that have the name by now.
    let before = work.replaces().cloned();
    if Identity::of_open(&file).map(Some).map_err(failed)? != before {
        return Err(replaced(&input));
    }
    let mut start = vec![0; length.min(OPENING_BYTES) as usize];
    file.read_exact(&mut start).map_err(failed)?;
    let plan = Plan::new(&start, length, imagery, note).map_err(|error| error.at(&input))?;
    let path = work.path("assembled");
    if !plan
        .write(&mut file, &path, imagery, progress)
        .map_err(|source| work.failed("write the file", source))?
    {
        return Err(Error::Interrupted);
    }
    // An open file cannot be replaced on Windows.
    drop(file);
    inspect(&path)?;
    if Identity::of(&input).map(Some).map_err(failed)? != before {
        return Err(replaced(&input));
    }
    work.publish(&path)?;
    Ok(plan.opening.file_length)
}

fn replaced(file: &Path) -> Error {
    let how =
        "it has been replaced or written to while its imagery was made, and stays as it is now; begin again";
    Error::Changed { path: file.to_owned(), how: how.to_owned() }
}

/// The file to come.
struct Plan {
    opening: Opening,
    /// Its first sections.
    small: Vec<(u32, Vec<u8>)>,
    /// Sections of the old file that follow them as they are.
    copied: Vec<SectionEntry>,
}

impl Plan {
    fn new(start: &[u8], length: u64, imagery: &ImagerySections, note: &ImageryNote) -> Result<Self> {
        let old = Opening::decode(start, length)?;
        let first = |kind| -> Result<Vec<u8>> {
            let section = old.sections.iter().find(|section| section.kind == kind);
            let bytes = section.and_then(|s| start.get(s.offset as usize..s.end() as usize));
            let absent = || Error::format("section table", "root page and metadata", "others");
            bytes.map(<[u8]>::to_vec).ok_or_else(absent)
        };
        let metadata = with_note(&first(METADATA)?, note)?;
        let small =
            vec![(ROOT_PAGE, first(ROOT_PAGE)?), (METADATA, metadata), (IMAGERY, imagery.opening.clone())];
        let made_anew = [ROOT_PAGE, METADATA, IMAGERY, IMAGERY_PAGES, IMAGERY_TILES];
        let mut copied = old.sections.clone();
        copied.retain(|section| !made_anew.contains(&section.kind));
        copied.sort_by_key(|section| (section.offset, section.length));
        let large: Vec<(u32, u64)> =
            copied.iter().map(|section| (section.kind, section.length)).chain(imagery.large()).collect();
        let mut opening = opening(old.header, &small, &large)?;
        // Flags and checksums stay, of kinds that this program does not know as well.
        for (new, old) in opening.sections[small.len()..].iter_mut().zip(&copied) {
            (new.flags, new.crc) = (old.flags, old.crc);
        }
        Ok(Self { opening, small, copied })
    }

    /// Writes and syncs the file under its working name. False if told to stop.
    fn write(
        &self,
        old: &mut File,
        path: &Path,
        imagery: &ImagerySections,
        progress: &dyn Progress,
    ) -> io::Result<bool> {
        let mut out = BufWriter::with_capacity(1 << 20, File::create(path)?);
        out.write_all(&self.opening.encode())?;
        for (_, bytes) in &self.small {
            out.write_all(bytes)?;
        }
        let mut done = 0;
        for section in &self.copied {
            old.seek(SeekFrom::Start(section.offset))?;
            let mut left = section.length;
            while left > 0 {
                let bytes = io::copy(&mut (&mut *old).take(left.min(AT_ONCE)), &mut out)?;
                if bytes == 0 {
                    return Err(io::ErrorKind::UnexpectedEof.into());
                }
                left -= bytes;
                done += bytes;
                if !progress.goes_on(Stage::Write, done, self.opening.file_length) {
                    return Ok(false);
                }
            }
        }
        imagery.copy(&mut out)?;
        let out = out.into_inner().map_err(io::IntoInnerError::into_error)?;
        if out.metadata()?.len() != self.opening.file_length {
            return Err(io::Error::other("other bytes arrived than were written"));
        }
        out.sync_all()?;
        Ok(true)
    }
}

/// Metadata that tell of the layer; members that this program does not know stay.
fn with_note(metadata: &[u8], note: &ImageryNote) -> Result<Vec<u8>> {
    let bad = |error: serde_json::Error| {
        Error::format("metadata", "JSON as the specification says", error.to_string())
    };
    let mut value: Value = serde_json::from_slice(metadata).map_err(bad)?;
    let Some(members) = value.as_object_mut() else {
        return Err(Error::format("metadata", "a JSON object", "another value"));
    };
    members.insert("imagery".to_owned(), serde_json::to_value(note).map_err(bad)?);
    serde_json::to_vec(&value).map_err(bad)
}
