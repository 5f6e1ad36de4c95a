//! The tiles of a reader, decoded from their chunks.
//!
//! The scratch memory of a thread, and the memory of evicted tiles, are used again from tile to
//! tile.

use std::ops::Range;
use std::sync::{Arc, PoisonError};

use super::{Reader, check_crc};
use crate::codec;
use crate::codec::mask::Occupancy;
use crate::container::directory::{ChunkKind, TileEntry};
use crate::error::Result;
use crate::sample::{Coding, Lattice};
use crate::tile::TileId;

/// Scratch memory of one thread: the chunks of a tile, and what their decoding needs.
#[derive(Default)]
pub(super) struct Scratch {
    chunks: Vec<u8>,
    codec: codec::Scratch,
}

impl Reader {
    /// The samples of a tile. Ancestors that are not in the cache are decoded first and cached:
    /// reading tiles depth first decodes none twice.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// let tile = reader.read_tile(TileId::ROOT)?;
    /// assert_eq!((tile.n, tile.code.len(), tile.state.len()), (16, 17 * 17, 17 * 17));
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn read_tile(&self, id: TileId) -> Result<Arc<Lattice>> {
        if let Some(lattice) = self.lattices.find(id) {
            return Ok(lattice);
        }
        self.existing(id)?;
        self.lattices.get(id, &|id, parent, out| self.decode_tile(id, parent, out))
    }

    /// Reads the samples of a tile into `out`. The tile itself is not cached, its ancestors are:
    /// use it to read many tiles once each, such as all leaves, in memory of your own. After an
    /// error `out` is not defined.
    pub fn read_tile_into(&self, id: TileId, out: &mut Lattice) -> Result<()> {
        if let Some(lattice) = self.lattices.find(id) {
            copy(&lattice, out);
            return Ok(());
        }
        self.existing(id)?;
        self.lattices.decode(id, &|id, parent, out| self.decode_tile(id, parent, out), out)
    }

    /// How many tiles have been decoded since the file was opened.
    pub fn decoded_tiles(&self) -> u64 {
        self.lattices.decoded()
    }

    fn decode_tile(&self, id: TileId, parent: Option<&Lattice>, out: &mut Lattice) -> Result<()> {
        let entry = self.existing(id)?;
        let mut scratch = self.scratch();
        let rows = 0..self.header().tile() as usize + 1;
        let decoded = self.decode_at(&mut scratch, &entry, parent, &rows, out);
        self.keep_scratch(scratch);
        decoded
    }

    /// Scratch memory for one thread.
    pub(super) fn scratch(&self) -> Scratch {
        self.pool.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    /// Keeps scratch memory for another tile.
    pub(super) fn keep_scratch(&self, scratch: Scratch) {
        self.pool.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
    }

    /// Decodes some rows of a tile from its parent. Unless they are all rows, the tile must have a
    /// parent and no voids, and the parent the rows that these need.
    pub(super) fn decode_at(
        &self,
        scratch: &mut Scratch,
        entry: &TileEntry,
        parent: Option<&Lattice>,
        rows: &Range<usize>,
        out: &mut Lattice,
    ) -> Result<()> {
        let (n, coding) = (self.header().tile() as usize, self.header().coding);
        let (heights, mask) =
            self.heights_and_mask(entry, &mut scratch.chunks).map_err(|error| error.at(self.path()))?;
        shape(out, n, coding);
        let (root, is_whole) = (parent.is_none(), *rows == (0..n + 1));
        let of_parent = if is_whole { 0..n / 2 + 1 } else { codec::height::parent_rows(n, rows) };
        if let Some(parent) = parent {
            copy_even(parent, entry.id, &of_parent, out);
        }
        let scratch = &mut scratch.codec;
        if !is_whole && entry.has_valid {
            return codec::mask::decode_rows(mask, out, of_parent, scratch)
                .and_then(|()| codec::height::decode_rows(heights, out, coding, rows.clone(), scratch))
                .map_err(|error| self.in_tile(entry.id, error));
        }
        let occupancy = Occupancy { has_valid: entry.has_valid, has_void: entry.has_void };
        codec::mask::decode(mask, occupancy, out, root, scratch)
            .and_then(|()| codec::height::decode(heights, out, coding, root, scratch))
            .map_err(|error| self.in_tile(entry.id, error))
    }

    /// The heights and mask chunks, which are stored side by side, each checked against its CRC.
    fn heights_and_mask<'a>(
        &self,
        entry: &TileEntry,
        buffer: &'a mut Vec<u8>,
    ) -> Result<(&'a [u8], &'a [u8])> {
        let (start, heights, _) = entry.chunks.chunk(ChunkKind::Heights);
        let (_, mask, _) = entry.chunks.chunk(ChunkKind::Mask);
        let length = heights as usize + mask as usize;
        if buffer.len() < length {
            buffer.resize(length, 0);
        }
        let chunks = &mut buffer[..length];
        self.input.read_into(chunks, self.index.tiles.offset + start, "heights and mask")?;
        let (heights, mask) = chunks.split_at(heights as usize);
        for (kind, bytes) in [(ChunkKind::Heights, heights), (ChunkKind::Mask, mask)] {
            let (offset, _, crc) = entry.chunks.chunk(kind);
            let offset = self.index.tiles.offset + offset;
            check_crc(bytes, crc, || format!("tile {}, {} chunk at offset {offset}", entry.id, kind.name()))?;
        }
        Ok((heights, mask))
    }
}

/// Copies a lattice into the memory of another.
pub(super) fn copy(lattice: &Lattice, out: &mut Lattice) {
    out.n = lattice.n;
    out.code.clone_from(&lattice.code);
    out.low.clone_from(&lattice.low);
    out.state.clone_from(&lattice.state);
}

/// Gives a lattice the size of a tile. It may keep old samples: a decoder writes every one.
fn shape(lattice: &mut Lattice, n: usize, coding: Coding) {
    let count = (n + 1) * (n + 1);
    let lows = if coding.has_low() { count } else { 0 };
    if (lattice.n, lattice.code.len(), lattice.low.len(), lattice.state.len()) != (n, count, lows, count) {
        *lattice = Lattice::new(n, coding);
    }
}

/// Copies the samples of even column from the parent, in some even rows: `rows` has half their
/// numbers.
fn copy_even(parent: &Lattice, id: TileId, rows: &Range<usize>, lattice: &mut Lattice) {
    let half = lattice.n / 2;
    let (left, top) = ((id.x & 1) as usize * half, (id.y & 1) as usize * half);
    for row in rows.clone() {
        let (from, to) = (parent.at(left, top + row), lattice.at(0, 2 * row));
        let (source, target) = (from..=from + half, to..=to + lattice.n);
        spread(&parent.code[source.clone()], &mut lattice.code[target.clone()]);
        spread(&parent.state[source.clone()], &mut lattice.state[target.clone()]);
        if !lattice.low.is_empty() {
            spread(&parent.low[source], &mut lattice.low[target]);
        }
    }
}

/// Copies to every second place. The places between, which are decoded later, get the same values,
/// so that whole vectors can be stored.
fn spread<T: Copy>(source: &[T], target: &mut [T]) {
    let (pairs, last) = target.as_chunks_mut::<2>();
    for (pair, &source) in pairs.iter_mut().zip(source) {
        *pair = [source; 2];
    }
    if let ([last], Some(&source)) = (last, source.last()) {
        *last = source;
    }
}
