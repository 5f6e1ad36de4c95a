//! What a build leaves for another: quarters whose parent it cannot finish, and the rims of tiles that others look at.
//!
//! [`SeamFile`] is where they are written, item by item, in the work folder; [`Seams`] is where they are found again, by level and
//! row of tiles, wherever they lie: in the files of several pieces, or in the state of a build that is resumed. An item is a head of
//! 18 bytes (kind, level, column, row, length, CRC; little endian) and a frame.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::pipeline::bytes::Reader;
use crate::pipeline::plan::Plan;
use crate::pipeline::quarter::{self, Quarter};
use crate::pipeline::work::Work;
use crate::sample::Lattice;
use crate::tile::TileId;

const HEAD: usize = 18;
/// A frame is never longer: a tile of 1024 intervals, unpacked.
const MOST: usize = 64 << 20;
/// Items that are in memory as bytes at a time.
pub const AT_ONCE: usize = 16;

/// What an item is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    /// A [`Quarter`] of the tile, for its parent.
    Quarter,
    /// The tile's border samples.
    Rim,
}

/// An item before it is written.
pub enum Item<'a> {
    /// What a finished tile leaves for its parent.
    Quarter(TileId, &'a Quarter),
    /// The same, taken out of its parent, which is not finished.
    Part(TileId, &'a Work),
    /// The rim of a finished tile.
    Rim(TileId, &'a Lattice),
}

impl Item<'_> {
    /// Head and frame.
    pub fn encode(&self) -> Result<Vec<u8>> {
        let (kind, id, frame) = match self {
            Self::Quarter(id, quarter) => (Kind::Quarter, id, quarter.encode()?),
            Self::Part(id, parent) => {
                let quadrant = (id.y % 2 * 2 + id.x % 2) as u8;
                let quarter = parent.quarter(quadrant);
                let quarter = quarter.ok_or_else(|| Error::usage(format!("tile {id} has left nothing")))?;
                (Kind::Quarter, id, quarter.encode()?)
            }
            Self::Rim(id, lattice) => (Kind::Rim, id, quarter::encode_rim(lattice)?),
        };
        let mut out = Vec::with_capacity(HEAD + frame.len());
        out.extend_from_slice(&[kind as u8, id.level]);
        for word in [id.x, id.y, frame.len() as u32, crc32fast::hash(&frame)] {
            out.extend_from_slice(&word.to_le_bytes());
        }
        out.extend_from_slice(&frame);
        Ok(out)
    }
}

/// Gives `put` items as bytes, in their order; some at a time are encoded on all threads.
pub fn encode_each(items: &[Item<'_>], put: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<()> {
    for items in items.chunks(AT_ONCE) {
        let parts = items.par_iter().map(Item::encode).collect::<Result<Vec<_>>>()?;
        parts.iter().try_for_each(|part| put(part))?;
    }
    Ok(())
}

/// A file that items are appended to.
pub struct SeamFile {
    path: PathBuf,
    file: BufWriter<File>,
    end: u64,
}

impl SeamFile {
    /// Begins a file.
    pub fn create(path: PathBuf) -> Result<Self> {
        let file = File::create(&path).map_err(|source| Error::io(&path, "write it", source))?;
        Ok(Self { path, file: BufWriter::new(file), end: 0 })
    }

    /// Appends items.
    pub fn append(&mut self, items: &[Item<'_>]) -> Result<()> {
        encode_each(items, &mut |bytes| self.put(bytes))
    }

    /// Appends an item that is encoded.
    pub fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_all(bytes).map_err(|source| Error::io(&self.path, "write it", source))?;
        self.end += bytes.len() as u64;
        Ok(())
    }

    /// Writes out what is buffered; gives the length and a handle to sync.
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

/// Items by kind, level and row.
#[derive(Default)]
pub struct Seams {
    files: Vec<(PathBuf, File)>,
    rows: BTreeMap<(Kind, u8, u32), Vec<Place>>,
}

impl Seams {
    /// Finds the items between two offsets of a file.
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
        let mut from = Reader::new(&head[2..]);
        let kind = match head[0] {
            0 => Kind::Quarter,
            1 => Kind::Rim,
            other => return Err(Error::format(format!("item at offset {at}"), "kind 0 or 1", other)),
        };
        let (x, y) = (from.word()?, from.word()?);
        let (length, crc) = (from.number(MOST)?, from.word()?);
        Ok(((kind, head[1], y), Place { x, file, offset: at + HEAD as u64, length, crc }))
    }

    /// Quarters of the tiles of a row, from west to east; they are gone then.
    pub fn take_quarters(&mut self, level: u8, y: u32, plan: &Plan) -> Result<Vec<(u32, Quarter)>> {
        self.take((Kind::Quarter, level, y), |frame| Quarter::decode(frame, plan))
    }

    /// Rims of the tiles of a row.
    pub fn take_rims(&mut self, level: u8, y: u32, plan: &Plan) -> Result<Vec<(u32, Lattice)>> {
        self.take((Kind::Rim, level, y), |frame| quarter::decode_rim(frame, plan))
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
            // A rim may have been left twice: the same both times.
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
