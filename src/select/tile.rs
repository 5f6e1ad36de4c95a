//! What selection and a renderer keep of a tile: its row of the index, its error table in metres of the frame, its heights.

use super::view::{Box3, Frame};
use crate::codec::table::ErrorTable;
use crate::container::{Header, TileEntry};
use crate::error::{Error, Result};
use crate::error_code::metres_from_code;
use crate::geo::Geo;
use crate::sample::{Lattice, VALID};
use crate::tile::TileId;

/// What the index says about a tile, in metres of the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// Bit `q` is set if child `q` exists.
    pub children: u8,
    /// Vertical error at full resolution of the tile, metres, not exaggerated.
    pub vertical: f32,
    /// Horizontal error likewise, in metres of the frame.
    pub horizontal: f32,
    /// Lowest height, metres.
    pub low: f32,
    /// Greatest height, metres.
    pub high: f32,
}

/// Error tables of a loaded tile, covering every mesh that [`super::pattern`] draws.
#[derive(Clone, Debug, PartialEq)]
pub struct TileTable {
    /// Which tile.
    pub id: TileId,
    /// Patches on a side.
    pub patches: u32,
    /// Steps, `p + 1`.
    pub steps: u32,
    /// Vertical errors in metres, by step, patch row, patch column; not exaggerated.
    pub vertical: Vec<f32>,
    /// Horizontal errors in metres of the frame, likewise.
    pub horizontal: Vec<f32>,
    /// Lowest height of each patch in metres, of all that lies below it.
    pub low: Vec<f32>,
    /// Greatest.
    pub high: Vec<f32>,
    /// Patches that have a valid sample; the others are not drawn.
    pub drawable: Vec<bool>,
}

/// A tile, ready to be uploaded.
#[derive(Clone, Debug, PartialEq)]
pub struct TileData {
    /// What selection needs of it.
    pub table: TileTable,
    /// Intervals on a side, T.
    pub n: u32,
    /// Heights in metres, `(T + 1)^2`, row by row from the north-west; void samples have their fill.
    pub heights: Vec<f32>,
    /// 1 where a sample is valid, 0 where it is void.
    pub valid: Vec<u8>,
}

impl TileData {
    /// A decoded tile with its error table. Fails if the table is not of this tile's size.
    pub fn new(
        _header: &Header,
        _geo: &Geo,
        _frame: &Frame,
        _entry: &TileEntry,
        _lattice: &Lattice,
        _table: &ErrorTable,
    ) -> Result<Self> {
        Err(Error::usage("not yet"))
    }
}
