//! The leaves under a drawn tile that are in the view.

use crate::container::{Header, Reader, TileEntry};
use crate::error::Result;
use crate::sample::VALID;
use crate::select::view::{Box3, Frame, View};
use crate::tile::TileId;

/// A square of full resolution.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leaf {
    /// The tile, or the square of a missing one.
    pub id: TileId,
    /// False if the tile does not exist: the square is void.
    pub exists: bool,
}

/// A walk over the leaves, including the missing tiles over which a surface is drawn.
pub(super) struct Walk<'a> {
    pub reader: &'a Reader,
    pub frame: &'a Frame,
    pub view: &'a View,
    /// Lowest and greatest height of the drawn tile.
    pub range: (f64, f64),
}

impl Walk<'_> {
    /// Visits the leaves under a tile.
    pub fn visit(
        &self,
        entry: &TileEntry,
        is_drawn: &dyn Fn(TileId) -> bool,
        found: &mut dyn FnMut(Leaf) -> Result<()>,
    ) -> Result<()> {
        if !self.sees(entry.id) {
            return Ok(());
        }
        if entry.is_leaf() {
            return found(Leaf { id: entry.id, exists: true });
        }
        for quadrant in 0..4 {
            let id = entry.id.child(quadrant);
            match self.reader.entry(id)? {
                Some(child) if entry.has_child(quadrant) => self.visit(&child, is_drawn, found)?,
                _ => self.visit_empty(id, is_drawn, found)?,
            }
        }
        Ok(())
    }

    fn visit_empty(
        &self,
        id: TileId,
        is_drawn: &dyn Fn(TileId) -> bool,
        found: &mut dyn FnMut(Leaf) -> Result<()>,
    ) -> Result<()> {
        if !self.sees(id) || !is_drawn(id) {
            return Ok(());
        }
        if id.level >= self.reader.header().levels {
            return found(Leaf { id, exists: false });
        }
        (0..4).try_for_each(|quadrant| self.visit_empty(id.child(quadrant), is_drawn, found))
    }

    fn sees(&self, id: TileId) -> bool {
        let header = self.reader.header();
        let (left, top) = header.origin(id);
        let side = f64::from(header.tile()) * f64::from(header.spacing(id.level));
        let (low, high) = self.range;
        self.view.sees(&Box3::of_square(self.frame, left as f64, top as f64, side, low, high))
    }
}

/// Heights of the vertices of a leaf in metres, NaN where void.
pub(super) fn heights(reader: &Reader, header: &Header, leaf: Leaf, out: &mut Vec<f64>) -> Result<()> {
    out.clear();
    if !leaf.exists {
        out.resize((header.tile() as usize + 1).pow(2), f64::NAN);
        return Ok(());
    }
    let lattice = reader.read_tile(leaf.id)?;
    let height = |(at, (&code, &state)): (usize, (&i32, &u8))| {
        if state == VALID { header.metres_of(code, lattice.low_at(at)) } else { f64::NAN }
    };
    out.extend(lattice.code.iter().zip(&lattice.state).enumerate().map(height));
    Ok(())
}
