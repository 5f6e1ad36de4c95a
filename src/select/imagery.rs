//! Which tile of imagery lies on which tile of terrain (papers 000, section 3.3, and 001, section 3.2).
//!
//! Both quadtrees span the same root square. One image may lie on many tiles (n-1), on one (1-1), or many on one (1-n): then
//! the tile is drawn once for each, as *virtual tiles* over the same heights.

use super::traverse::Selection;
use super::view::{Frame, View};
use crate::tile::TileId;

/// What selection may know of an imagery layer.
pub trait Images {
    /// Bits of the children that exist; `None` if the tile does not exist or is not known.
    fn children(&self, id: TileId) -> Option<u8>;
    /// True if it can be drawn now.
    fn ready(&self, id: TileId) -> bool;
}

/// A tile of a selection, or a part of it, with the image that lies on it: a virtual tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Draw {
    /// Index in [`Selection::tiles`].
    pub tile: u32,
    /// West, north, east, south in intervals of the tile, `0..=T`. Every point of the tile is in one window: patches that
    /// meet several are drawn for each, and show fragments of their own window only.
    pub window: [u32; 4],
    /// The image; its square holds the window. `None`: none is there.
    pub image: Option<TileId>,
}

/// An image that is not loaded and would be used if it were.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WantedImage {
    /// Which.
    pub id: TileId,
    /// Screen pixels of one of its parent's texels.
    pub priority: f64,
}

/// Lays images on the tiles of a selection: the coarsest whose texels are at most `magnification` pixels on the screen (papers: 1.5).
/// `texels` is the side of an image. Without a layer, one draw for each tile.
pub fn assign(
    _selection: &Selection,
    _images: Option<(&dyn Images, u32)>,
    _frame: &Frame,
    _view: &View,
    _magnification: f64,
) -> (Vec<Draw>, Vec<WantedImage>) {
    (Vec::new(), Vec::new())
}
