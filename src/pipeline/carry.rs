//! What a window leaves for a merge: child summaries whose parent it cannot finish, and the borders
//! of tiles that tiles outside the window look at.
//!
//! [`CarryFile`] is where these items are written, in the work folder. [`Carried`] finds them
//! again, by level and row of tiles, in the files of several pieces or in the state of a build that
//! is resumed. An item is a head of 18 bytes (kind, level, column, row, length, CRC; little endian)
//! and a zstd frame.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use wincode::{SchemaRead, SchemaWrite};

use crate::error::{Error, Result};
use crate::pipeline::child_summary::{self, ChildSummary};
use crate::pipeline::encoding::{decode, encode};
use crate::pipeline::plan::Plan;
use crate::pipeline::tile_work::TileWork;
use crate::sample::Lattice;
use crate::tile::TileId;

/// Bytes of a [`Head`].
const HEAD: usize = 18;
/// Bytes of a frame, at most: a tile of 1024 intervals, not compressed.
const MOST: usize = 64 << 20;
/// Items that are encoded before they are written: as many are in memory as bytes.
pub const AT_ONCE: usize = 16;

/// What an item is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    /// The [`ChildSummary`] of the tile.
    Summary,
    /// The tile's border samples.
    Border,
}

/// What stands before the frame of an item.
#[derive(SchemaRead, SchemaWrite)]
struct Head {
    kind: u8,
    level: u8,
    x: u32,
    y: u32,
    length: u32,
    crc: u32,
}

/// An item before it is written.
pub enum Item<'a> {
    /// What a finished tile leaves for its parent.
    Summary(TileId, &'a ChildSummary),
    /// The same, taken out of its parent, which is not finished.
    Part(TileId, &'a TileWork<'a>),
    /// The border of a finished tile.
    Border(TileId, &'a Lattice),
}

impl Item<'_> {
    /// The item as bytes: head and frame.
    pub fn encode(&self) -> Result<Vec<u8>> {
        let (kind, id, frame) = match self {
            Self::Summary(id, summary) => (Kind::Summary, id, summary.encode()?),
            Self::Part(id, parent) => {
                let quadrant = (id.y % 2 * 2 + id.x % 2) as u8;
                let summary = parent.summary(quadrant);
                let summary = summary
                    .ok_or_else(|| Error::internal(format!("tile {id} has left nothing to its parent")))?;
                (Kind::Summary, id, summary.encode()?)
            }
            Self::Border(id, lattice) => (Kind::Border, id, child_summary::encode_border(lattice)?),
        };
        let TileId { level, x, y } = *id;
        let (length, crc) = (frame.len() as u32, crc32fast::hash(&frame));
        let mut out = encode(&Head { kind: kind as u8, level, x, y, length, crc })?;
        out.extend_from_slice(&frame);
        Ok(out)
    }
}

/// Hands items to `put` as bytes, in their order. [`AT_ONCE`] at a time are encoded on all threads.
pub fn encode_each(items: &[Item<'_>], put: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
    for items in items.chunks(AT_ONCE) {
        let parts = items.par_iter().map(Item::encode).collect::<Result<Vec<_>>>()?;
        parts.iter().try_for_each(|part| put(part))?;
    }
    Ok(())
}

/// The file in the work folder that items are appended to.
pub struct CarryFile {
    path: PathBuf,
    file: BufWriter<File>,
    end: u64,
}

impl CarryFile {
    /// Begins a file.
    pub fn create(path: PathBuf) -> Result<Self> {
        let file = File::create(&path).map_err(|source| Error::io(&path, "write it", source))?;
        Ok(Self { path, file: BufWriter::new(file), end: 0 })
    }

    /// Appends items.
    pub fn append(&mut self, items: &[Item<'_>]) -> Result<()> {
        encode_each(items, &mut |bytes| self.put(bytes))
    }

    /// Appends an item that has been encoded.
    pub fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_all(bytes).map_err(|source| Error::io(&self.path, "write it", source))?;
        self.end += bytes.len() as u64;
        Ok(())
    }

    /// Writes out what is buffered. Returns the length of the file, and a handle to sync it by.
    pub fn mark(&mut self) -> Result<(u64, File)> {
        let failed = |source| Error::io(&self.path, "write it", source);
        self.file.flush().map_err(failed)?;
        Ok((self.end, self.file.get_ref().try_clone().map_err(failed)?))
    }
}

/// Where an item lies.
struct Place {
    x: u32,
    file: usize,
    offset: u64,
    length: usize,
    crc: u32,
}

/// The items that other builds have left, by kind, level and row of tiles.
#[derive(Default)]
pub struct Carried {
    files: Vec<(PathBuf, File)>,
    rows: BTreeMap<(Kind, u8, u32), Vec<Place>>,
}

impl Carried {
    /// Adds the items between two offsets of a file.
    pub fn add(&mut self, path: &Path, from: u64, to: u64) -> Result<()> {
        let mut file = crate::file::open(path).map_err(|source| Error::io(path, "open", source))?;
        let number = self.files.len();
        let mut offset = from;
        while offset < to {
            let mut head = [0; HEAD];
            file.seek(SeekFrom::Start(offset))
                .and_then(|_| file.read_exact(&mut head))
                .map_err(|source| Error::io(path, format!("read {HEAD} bytes at offset {offset}"), source))?;
            let (row, place) = Self::head(&head, number, offset).map_err(|error| error.at(path))?;
            offset = place.offset + place.length as u64;
            self.rows.entry(row).or_default().push(place);
        }
        if offset != to {
            let place = format!("items up to offset {to}");
            return Err(Error::format(place, "the last to end there", format!("an end at {offset}")).at(path));
        }
        self.files.push((path.to_owned(), file));
        Ok(())
    }

    fn head(head: &[u8; HEAD], file: usize, at: u64) -> Result<((Kind, u8, u32), Place)> {
        let Head { kind, level, x, y, length, crc } = decode(head, "head of an item")?;
        let kind = match kind {
            0 => Kind::Summary,
            1 => Kind::Border,
            other => return Err(Error::format(format!("item at offset {at}"), "kind 0 or 1", other)),
        };
        let length = length as usize;
        if length > MOST {
            return Err(Error::format(format!("item at offset {at}"), format!("up to {MOST} bytes"), length));
        }
        Ok(((kind, level, y), Place { x, file, offset: at + HEAD as u64, length, crc }))
    }

    /// Summaries of the tiles of a row, from west to east; they are gone then.
    pub fn take_summaries(&mut self, level: u8, y: u32, plan: &Plan) -> Result<Vec<(u32, ChildSummary)>> {
        self.take((Kind::Summary, level, y), |frame| ChildSummary::decode(frame, plan))
    }

    /// Rims of the tiles of a row.
    pub fn take_borders(&mut self, level: u8, y: u32, plan: &Plan) -> Result<Vec<(u32, Lattice)>> {
        self.take((Kind::Border, level, y), |frame| child_summary::decode_border(frame, plan))
    }

    fn take<T: Send>(
        &mut self,
        row: (Kind, u8, u32),
        decode: impl Fn(&[u8]) -> Result<T> + Sync,
    ) -> Result<Vec<(u32, T)>> {
        let mut frames = BTreeMap::new();
        for place in self.rows.remove(&row).unwrap_or_default() {
            let Some((path, file)) = self.files.get_mut(place.file) else { continue };
            let mut frame = vec![0; place.length];
            file.seek(SeekFrom::Start(place.offset))
                .and_then(|_| file.read_exact(&mut frame))
                .map_err(|source| Error::io(&*path, format!("read {} bytes", place.length), source))?;
            if crc32fast::hash(&frame) != place.crc {
                let what = format!("item at offset {}", place.offset);
                return Err(Error::format(what, "the bytes that were written", "others").at(path));
            }
            // Two pieces may have left the same border.
            frames.insert(place.x, (frame, place.file));
        }
        let frames: Vec<_> = frames.into_iter().collect();
        let files = &self.files;
        let decoded = |(x, (frame, file)): (u32, (Vec<u8>, usize))| match decode(&frame) {
            Ok(item) => Ok((x, item)),
            Err(error) => {
                Err(files.get(file).map(|(path, _)| path).into_iter().fold(error, |e, path| e.at(path)))
            }
        };
        frames.into_par_iter().map(decoded).collect()
    }
}
