//! The numbers of the edges that drawn tiles share.
//!
//! All drawn tiles have `m x m` patches. Tile `i` of a selection owns the edge numbers from
//! `i * 2m(m + 1)` on: first the `m(m + 1)` edges that run west to east, edge (x, y) at
//! `y * m + x`, `y` in `0..=m`; then those from north to south, at `m(m + 1) + x * m + y`, `x` in
//! `0..=m`. Along a side that it shares with another drawn tile, both use the numbers of one of
//! them: of the coarser tile, or of the first in the selection if both are of one level.

/// A side of a drawn tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Side {
    /// Number of the first edge of the owner's side.
    pub first: u32,
    /// Position of this side within the owner's side, counted in tiles of this size.
    pub local: u32,
    /// How many levels coarser the owner is; 0 if it is this tile or one of its level.
    pub shift: u8,
    /// No edge of this side may have a step exponent below this: the coarser tile has no finer
    /// vertices.
    pub limit: u8,
}

impl Side {
    /// Number of the edge of the `j`-th of `m` patches along this side, from the west or the north.
    pub fn edge(&self, j: u32, m: u32) -> u32 {
        self.first + ((self.local * m + j) >> self.shift)
    }
}

/// How many edges a tile owns.
pub fn edges_of_tile(m: u32) -> u32 {
    2 * m * (m + 1)
}

/// Numbers of the edges of patch (x, y): north, east, south, west. `tile` is the index in the
/// selection.
pub fn edges_of_patch(tile: u32, sides: &[Side; 4], m: u32, x: u32, y: u32) -> [u32; 4] {
    let base = tile * edges_of_tile(m);
    let across = |x: u32, y: u32| base + y * m + x;
    let down = |x: u32, y: u32| base + m * (m + 1) + x * m + y;
    [
        if y == 0 { sides[0].edge(x, m) } else { across(x, y) },
        if x + 1 == m { sides[1].edge(y, m) } else { down(x + 1, y) },
        if y + 1 == m { sides[2].edge(x, m) } else { across(x, y + 1) },
        if x == 0 { sides[3].edge(y, m) } else { down(x, y) },
    ]
}
