//! The tiles of imagery that lie on the tiles of terrain (papers 000, section 3.3, and 001, section
//! 3.2).
//!
//! Both quadtrees span the same root square. One image may lie on many tiles (n-1), on one (1-1),
//! or many on one (1-n): then the tile is drawn once for each, as *virtual tiles* over the same
//! heights.

use super::selection::{Chosen, Selection};
use super::view::{Box3, Frame, View};
use crate::tile::TileId;

/// The tiles of an imagery layer as selection sees them.
pub trait Images {
    /// Bits of the children that exist; `None` if the tile does not exist or is not known.
    fn children(&self, id: TileId) -> Option<u8>;
    /// True if the tile is loaded and can be drawn.
    fn ready(&self, id: TileId) -> bool;
}

/// A tile of a selection, or a part of it, with the image that lies on it: a virtual tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Draw {
    /// Index in [`Selection::tiles`].
    pub tile: u32,
    /// West, north, east, south in intervals of the tile, `0..=T`. Every point of the tile is in
    /// one window: patches that meet several are drawn for each, and show fragments of their own
    /// window only.
    pub window: [u32; 4],
    /// The image; its square holds the window. `None`: no image is loaded there.
    pub image: Option<TileId>,
}

/// An image that is not loaded and would be used if it were.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WantedImage {
    /// The image.
    pub id: TileId,
    /// Screen pixels of one texel of the image drawn in its place.
    pub priority: f64,
}

/// The layer to choose from.
#[derive(Clone, Copy)]
pub struct Layer<'a> {
    /// Its tiles.
    pub images: &'a dyn Images,
    /// Texels along a side of an image, gutters not counted.
    pub texels: u32,
    /// Most screen pixels of a texel (1.5 in the papers).
    pub magnification: f64,
}

impl std::fmt::Debug for Layer<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Layer")
            .field("texels", &self.texels)
            .field("magnification", &self.magnification)
            .finish_non_exhaustive()
    }
}

/// Lays images on the tiles of a selection: everywhere the coarsest image whose texels are small
/// enough on the screen, or the finest that is loaded. Without a layer there is one draw for each
/// tile. Wanted images come the most urgent first, each once.
pub fn assign(
    selection: &Selection,
    layer: Option<Layer<'_>>,
    frame: &Frame,
    view: &View,
) -> (Vec<Draw>, Vec<WantedImage>) {
    let tile_log2 = selection.patch_log2 + selection.patches.trailing_zeros() as u8;
    let mut laying = Laying { layer, frame, view, tile_log2, draws: Vec::new(), wanted: Vec::new() };
    for (tile, chosen) in selection.tiles.iter().enumerate() {
        laying.tile(tile as u32, chosen);
    }
    let Laying { draws, mut wanted, .. } = laying;
    // Of equal ids the most urgent comes first and stays.
    wanted.sort_unstable_by(|a, b| a.id.cmp(&b.id).then_with(|| b.priority.total_cmp(&a.priority)));
    wanted.dedup_by_key(|wanted| wanted.id);
    wanted.sort_by(|a, b| b.priority.total_cmp(&a.priority));
    (draws, wanted)
}

struct Laying<'a> {
    layer: Option<Layer<'a>>,
    frame: &'a Frame,
    view: &'a View,
    tile_log2: u8,
    draws: Vec<Draw>,
    wanted: Vec<WantedImage>,
}

/// A part of a drawn tile for which an image is chosen.
#[derive(Clone, Copy)]
struct Part<'a> {
    tile: u32,
    chosen: &'a Chosen,
    window: [u32; 4],
}

impl Laying<'_> {
    fn tile(&mut self, tile: u32, chosen: &Chosen) {
        let side = 1_u32 << self.tile_log2;
        let part = Part { tile, chosen, window: [0, 0, side, side] };
        let Some(layer) = self.layer else { return self.draw(part, None) };
        // From the root of the images down to the one as large as the tile; then on, with parts of
        // the tile.
        let mut image = TileId::ROOT;
        let mut best = None;
        while layer.images.children(image).is_some() {
            let ready = layer.images.ready(image);
            if ready {
                best = Some(image);
            }
            let pixels = self.pixels(part, image);
            if pixels <= layer.magnification {
                if !ready {
                    self.wanted.push(WantedImage { id: image, priority: pixels });
                }
                return self.draw(part, best);
            }
            if !ready {
                self.wanted.push(WantedImage { id: image, priority: pixels });
            }
            if image.level == chosen.id.level {
                return self.parts(part, image, best);
            }
            let up = chosen.id.level - image.level - 1;
            let next = TileId::new(image.level + 1, chosen.id.x >> up, chosen.id.y >> up);
            if layer.images.children(next).is_none() {
                return self.draw(part, best);
            }
            image = next;
        }
        self.draw(part, best);
    }

    /// Lays the children of `image`, which covers the part and is too coarse, on the quadrants of
    /// the part.
    fn parts(&mut self, part: Part<'_>, image: TileId, best: Option<TileId>) {
        let Some(layer) = self.layer else { return };
        let [west, north, east, _] = part.window;
        let half = (east - west) / 2;
        let children = layer.images.children(image).unwrap_or(0);
        // An image smaller than an interval of the tile is not used.
        if children == 0 || half == 0 {
            return self.draw(part, best);
        }
        let from = self.draws.len();
        for quadrant in 0..4_u8 {
            let (x, y) = (west + half * u32::from(quadrant & 1), north + half * u32::from(quadrant >> 1));
            let quarter = Part { window: [x, y, x + half, y + half], ..part };
            let child = image.child(quadrant);
            if children >> quadrant & 1 == 0 {
                self.draw(quarter, best);
                continue;
            }
            let ready = layer.images.ready(child);
            let pixels = self.pixels(quarter, child);
            if !ready {
                self.wanted.push(WantedImage { id: child, priority: 2.0 * pixels });
            }
            let best = if ready { Some(child) } else { best };
            if pixels <= layer.magnification {
                self.draw(quarter, best);
            } else {
                self.parts(quarter, child, best);
            }
        }
        // Four quarters with one and the same image are one part.
        let same = |draw: &Draw| draw.image == best && draw.window[2] - draw.window[0] == half;
        if self.draws.len() - from == 4 && self.draws[from..].iter().all(same) {
            self.draws.truncate(from);
            self.draw(part, best);
        }
    }

    fn draw(&mut self, part: Part<'_>, image: Option<TileId>) {
        self.draws.push(Draw { tile: part.tile, window: part.window, image });
    }

    /// Most screen pixels of a texel of an image on a part of a tile.
    fn pixels(&self, part: Part<'_>, image: TileId) -> f64 {
        let Some(layer) = self.layer else { return 0.0 };
        let chosen = part.chosen;
        let step = f64::from(1_u32 << chosen.exponent);
        let side = f64::from(1_u32 << self.tile_log2);
        let left = (f64::from(chosen.id.x) * side + f64::from(part.window[0])) * step;
        let top = (f64::from(chosen.id.y) * side + f64::from(part.window[1])) * step;
        let wide = f64::from(part.window[2] - part.window[0]) * step;
        let height = |of: &[f32], pick: fn(f64, f64) -> f64| {
            of.iter().map(|&z| f64::from(z)).reduce(pick).unwrap_or(0.0)
        };
        let space = Box3::of_square(
            self.frame,
            left,
            top,
            wide,
            height(&chosen.table.low, f64::min),
            height(&chosen.table.high, f64::max),
        );
        // The root square has the same number of samples at each level: those of this tile's level
        // times its step.
        let root = side * step * 2_f64.powi(chosen.id.level.into());
        let texel = root / (f64::from(layer.texels) * 2_f64.powi(image.level.into()));
        let metres = texel * self.frame.dx.max(self.frame.dy);
        let depth = self.view.near.max(space.distance(self.view.eye));
        self.view.lambda() * metres / depth
    }
}
