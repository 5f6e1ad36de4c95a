//! A single tile, read without its ancestors being kept.
//!
//! A tile is decoded from the quarter of its parent that it covers, and that quarter from a part of
//! the grandparent: of the ancestors without voids only some rows are decoded. (Voids are
//! interpolated across the whole tile before anything is predicted, so a tile with voids needs all
//! of its rows.) What is decoded so can serve no sibling, so it is not cached, and two lattices
//! hold all tiles of the path in turn.

use std::ops::Range;
use std::sync::Arc;

use super::{Reader, tiles};
use crate::codec::height::parent_rows;
use crate::container::directory::TileEntry;
use crate::error::Result;
use crate::sample::Lattice;
use crate::tile::TileId;

/// A tile to decode, and which of its rows.
type Part = (TileEntry, Range<usize>);

impl Reader {
    /// Reads the samples of a single tile into `out`. Neither the tile nor its ancestors are
    /// cached, and of the ancestors without voids only the rows that the tile needs are decoded:
    /// use it where no other tile near this one is read soon; else [`Reader::read_tile`] is faster.
    /// After an error `out` is not defined.
    ///
    /// ```
    /// # use relevo_core::Reader;
    /// # use relevo_core::sample::Lattice;
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// let leaf = reader.leaves()?[0];
    /// let mut tile = Lattice::default();
    /// reader.read_tile_alone(leaf, &mut tile)?;
    /// assert!(tile.code == reader.read_tile(leaf)?.code);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn read_tile_alone(&self, id: TileId, out: &mut Lattice) -> Result<()> {
        if let Some(lattice) = self.lattices.find(id) {
            tiles::copy(&lattice, out);
            return Ok(());
        }
        let (path, cached) = self.route(id)?;
        let mut other = self.lattices.pooled();
        let mut scratch = self.scratch();
        let mut decode = || {
            // The last tile is decoded into `out`, the one before into `other`, and so on.
            let (mut to, mut from) =
                if path.len() % 2 == 1 { (&mut *out, &mut other) } else { (&mut other, &mut *out) };
            let mut parent = cached.as_deref();
            for (entry, rows) in path.iter().rev() {
                self.decode_at(&mut scratch, entry, parent, rows, to)?;
                std::mem::swap(&mut to, &mut from);
                parent = Some(from);
            }
            Ok(())
        };
        let decoded = decode();
        self.keep_scratch(scratch);
        self.lattices.pool(other);
        self.lattices.count(path.len() as u64);
        decoded
    }

    /// What has to be decoded for a tile, the tile first; and the ancestor that is cached and from
    /// which the last of it is decoded.
    fn route(&self, id: TileId) -> Result<(Vec<Part>, Option<Arc<Lattice>>)> {
        let n = self.header().tile() as usize;
        let (mut path, mut at, mut rows) = (Vec::new(), id, 0..n + 1);
        loop {
            let entry = self.existing(at)?;
            if entry.has_void || at.parent().is_none() {
                rows = 0..n + 1;
            }
            let needed = if entry.has_void { 0..n / 2 + 1 } else { parent_rows(n, &rows) };
            path.push((entry, rows));
            let Some(parent) = at.parent() else { return Ok((path, None)) };
            if let Some(lattice) = self.lattices.find(parent) {
                return Ok((path, Some(lattice)));
            }
            let top = (at.y & 1) as usize * (n / 2);
            rows = top + needed.start..top + needed.end;
            at = parent;
        }
    }
}
