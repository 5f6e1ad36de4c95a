//! [`State`]: all that is needed to resume a build, or to merge a finished window, as it stands in
//! the work folder.
//!
//! Chunks, list of tiles and carry file lie beside it; the state says how far they count. It is a
//! head of 20 bytes (magic, version, length and CRC of what follows; little endian), the
//! [`encoding`](super::encoding) of [`State`], and the items that were in the sweep (see `carry`).

use std::path::Path;

use wincode::{SchemaRead, SchemaWrite};

use crate::error::{Error, Result};
use crate::file;
use crate::pipeline::carry::Carried;
use crate::pipeline::encoding::{decode, encode};
use crate::pipeline::options::BuildOptions;
use crate::pipeline::statistics::StatisticsBuilder;
use crate::rect::Rect;
use crate::source::{Fingerprint, SourceInfo};
use crate::work_folder::{Mark, state_path};

const MAGIC: &[u8; 8] = b"RLVSTATE";
/// Goes up with every change to the state, the carried items, the list of tiles, or the chunks.
const VERSION: u32 = 5;
const HEAD: usize = 20;
/// Bytes of a state, at most: rows of the widest raster stand in it.
const MOST: u64 = 1 << 36;

/// What a build is of, and how far it is.
#[derive(Clone, Debug, PartialEq, SchemaRead, SchemaWrite)]
pub struct State {
    /// How far the files count.
    pub mark: Mark,
    /// The program that wrote it.
    pub tool: String,
    /// The source as it was.
    pub fingerprint: Fingerprint,
    /// What it says of itself.
    pub info: SourceInfo,
    /// What the build was asked for.
    pub options: BuildOptions,
    /// Which leaf tiles it is to make.
    pub window: Rect,
    /// Windows of the passes of a low-memory build, each in a folder of its own; empty if it is
    /// built in one go.
    pub passes: Vec<Rect>,
    /// Largest height, if the options ask for a precision.
    pub largest: f64,
    /// Rows of leaf tiles from the window's first up to this one are finished.
    pub next: u32,
    /// Name and length of the carry file.
    pub carry: (String, u64),
    /// What has been counted.
    pub statistics: StatisticsBuilder,
}

impl State {
    /// The state file up to what stood in the sweep.
    pub fn encode(&self) -> Result<Vec<u8>> {
        let body = encode(self)?;
        let length = u32::try_from(body.len())
            .map_err(|_| Error::limit("bytes of the state of a build", body.len() as u64, u32::MAX.into()))?;
        let mut out = Vec::with_capacity(HEAD + body.len());
        out.extend_from_slice(MAGIC);
        for word in [VERSION, length, crc32fast::hash(&body)] {
            out.extend_from_slice(&word.to_le_bytes());
        }
        out.extend_from_slice(&body);
        Ok(out)
    }

    /// Reads the state of a folder, and adds the items in it and in the carry file to `carried`.
    pub fn read(folder: &Path, carried: &mut Carried) -> Result<Self> {
        let path = state_path(folder);
        let bytes = file::read(&path, MOST).map_err(|source| Error::io(&path, "read it", source))?;
        let (state, items) = Self::decode(&bytes).map_err(|error| error.at(&path))?;
        carried.add(&path, items as u64, bytes.len() as u64)?;
        if state.carry.1 > 0 {
            carried.add(&folder.join(&state.carry.0), 0, state.carry.1)?;
        }
        Ok(state)
    }

    /// The state, and the offset of its items.
    fn decode(bytes: &[u8]) -> Result<(Self, usize)> {
        let head = bytes.first_chunk::<HEAD>().filter(|head| head.starts_with(MAGIC));
        let Some(head) = head else {
            return Err(Error::format("first bytes", "the state of a build", "something else"));
        };
        let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        if word(8) != VERSION {
            let expected =
                format!("{VERSION}: finish it with the program that began it, or begin anew by `force`");
            return Err(Error::format("version of the state", expected, word(8)));
        }
        let end = HEAD + word(12) as usize;
        let body = bytes.get(HEAD..end).filter(|body| crc32fast::hash(body) == word(16));
        let Some(body) = body else {
            return Err(Error::format(
                "state",
                "the bytes that were written",
                "damaged ones; begin anew by `force`",
            ));
        };
        Ok((decode(body, "state")?, end))
    }

    /// Fails, saying what differs, unless a build of this source and these options gives the same
    /// file.
    pub fn check_same(&self, now: &State, folder: &Path) -> Result<()> {
        let differs = if self.fingerprint != now.fingerprint {
            Some(format!("the input has changed since: {}", difference(&self.fingerprint, &now.fingerprint)))
        } else if let Some(what) = self.options.difference(&now.options) {
            // Before what the input says: some options are about that.
            Some(format!("the options have changed since: {what}"))
        } else if encode(&self.info)? != encode(&now.info)? {
            Some("the input says other things of itself than it did".to_owned())
        } else if self.window != now.window {
            Some(format!("the window was {}, now it is {}", self.window, now.window))
        } else {
            None
        };
        let Some(differs) = differs.or_else(|| {
            (self.tool != now.tool).then(|| format!("{} began it, and this is {}", self.tool, now.tool))
        }) else {
            return Ok(());
        };
        Err(Error::usage(format!(
            "{}: cannot go on with this build: {differs}; `force` begins anew",
            folder.display()
        )))
    }
}

/// The first file that is not as it was.
pub fn difference(before: &Fingerprint, now: &Fingerprint) -> String {
    let changed = before.files.iter().zip(&now.files).find(|(a, b)| a != b);
    match changed {
        Some((a, b)) if a.name != b.name => format!("it was {}, now it is {}", a.name, b.name),
        Some((a, b)) if a.bytes != b.bytes => format!("{} had {} bytes, now {}", a.name, a.bytes, b.bytes),
        Some((a, _)) => format!("{} was written to", a.name),
        None => format!("it was {} files, now {}", before.files.len(), now.files.len()),
    }
}

#[cfg(test)]
mod tests;
