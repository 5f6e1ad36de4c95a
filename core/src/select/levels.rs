//! The step of every patch and of every edge of a selection.
//!
//! Steps are counted as *exponents*: spacing `2^e` samples of the lattice, so `e = L - level + k`
//! for step `k` of a tile. Exponents of different tiles compare.
//!
//! [`EdgeRule::Shared`]: the base exponent of a patch is the greatest whose projected error is
//! within the tolerance (of a patch outside the view, the greatest that exists). Then, in order,
//! 1. no patch may be finer than its edges allow: `least(patch) = max over its edges of
//!    max(limit(edge), greatest least of the edge's patches - 1)`, to the fixed point, and `inner =
//!    max(base, least)`. It changes nothing once all tiles that selection wants are loaded;
//! 2. patches of an edge differ by one at most: `inner(patch) = min(inner, 1 + least inner of the
//!    edge's patches)`, to the fixed point;
//! 3. an edge has the least `inner` of its patches.
//!
//! Each fixed point is reached after at most [`super::Selection::rounds`] rounds over all patches
//! and edges: exponents of one selection differ by no more, and one round carries a bound one patch
//! further.
//!
//! [`EdgeRule::Paper`]: `inner` is the base; an edge between patches of a tile has the least of the
//! two, an edge at a side has the side's `limit`.

use super::neighbours::{edges_of_patch, edges_of_tile};
use super::pattern::EdgeRule;
use super::selection::{Chosen, Selection};
use super::tile::TileTable;
use super::view::{Box3, Frame, View};

/// The exponent of an edge without a patch.
const NONE: u8 = u8::MAX;

/// Steps of all patches and edges, as exponents.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Levels {
    /// `[tile * m^2 + patch]`.
    pub inner: Vec<u8>,
    /// By edge number; see [`super::neighbours`]. 255 where no patch uses the number.
    pub edges: Vec<u8>,
}

impl Levels {
    /// Levels of a selection.
    pub fn of(selection: &Selection, frame: &Frame, view: &View, tolerance: f64, rule: EdgeRule) -> Self {
        let base = selection
            .tiles
            .iter()
            .flat_map(|tile| base_of_tile(tile, selection.patch_log2, frame, view, tolerance))
            .collect();
        Self::from_base(selection, base, rule)
    }

    /// Levels of a selection from base exponents, `[tile * m^2 + patch]`.
    pub fn from_base(selection: &Selection, base: Vec<u8>, rule: EdgeRule) -> Self {
        let net = Net::new(&selection.tiles, selection.patches);
        match rule {
            EdgeRule::Shared => {
                let inner = net.coarsened(base);
                net.balanced(inner)
            }
            EdgeRule::Paper => net.paper(base),
        }
    }
}

/// The box of patch `at` of a tile.
pub fn patch_box(table: &TileTable, exponent: u8, patch_log2: u8, frame: &Frame, at: usize) -> Box3 {
    let m = table.patches as usize;
    let side = f64::from(1_u32 << patch_log2) * f64::from(1_u32 << exponent);
    let corner = |tile: u32, patch: usize| (f64::from(tile) * m as f64 + patch as f64) * side;
    let (left, top) = (corner(table.id.x, at % m), corner(table.id.y, at / m));
    Box3::of_square(frame, left, top, side, table.low[at].into(), table.high[at].into())
}

/// Base exponents of a tile's patches.
pub(super) fn base_of_tile(
    tile: &Chosen,
    patch_log2: u8,
    frame: &Frame,
    view: &View,
    tolerance: f64,
) -> Vec<u8> {
    let table = &*tile.table;
    let count = (table.patches * table.patches) as usize;
    let planes = view.planes();
    (0..count)
        .map(|at| {
            let space = patch_box(table, tile.exponent, patch_log2, frame, at);
            if !table.drawable[at] || !space.is_inside(&planes) {
                return tile.exponent + patch_log2;
            }
            let scale = view.pixel_scale(&space);
            let fits = |&k: &u8| {
                let at = usize::from(k) * count + at;
                let vertical = f64::from(table.vertical[at]) * frame.exaggeration;
                scale.pixels(vertical, table.horizontal[at].into()) <= tolerance
            };
            tile.exponent + (1..=patch_log2).rev().find(fits).unwrap_or(0)
        })
        .collect()
}

/// The patches and edges of drawn tiles.
pub(super) struct Net {
    /// Numbers of the edges of each patch: north, east, south, west.
    edges: Vec<[u32; 4]>,
    /// Least exponent of each edge, by edge number.
    limits: Vec<u8>,
    /// Patches along the side of a tile.
    patches: u32,
}

impl Net {
    /// The net of tiles with `m` patches on a side.
    pub fn new(tiles: &[Chosen], m: u32) -> Self {
        let mut edges = Vec::with_capacity(tiles.len() * (m * m) as usize);
        let mut limits = vec![0; tiles.len() * edges_of_tile(m) as usize];
        for (tile, chosen) in tiles.iter().enumerate() {
            let own = tile * edges_of_tile(m) as usize;
            limits[own..own + edges_of_tile(m) as usize].fill(chosen.exponent);
            for (y, x) in (0..m * m).map(|i| (i / m, i % m)) {
                edges.push(edges_of_patch(tile as u32, &chosen.sides, m, x, y));
            }
        }
        Self { edges, limits, patches: m }
    }

    /// Edges that would have to be finer than their limit, from base exponents.
    pub fn too_coarse(&self, base: Vec<u8>) -> Vec<u32> {
        let free = self.balanced(base).edges;
        let below = |(edge, &limit): (usize, &u8)| (free[edge] < limit).then_some(edge as u32);
        self.limits.iter().enumerate().filter_map(below).collect()
    }

    /// Base exponents, raised to what the limits of the edges allow.
    fn coarsened(&self, mut inner: Vec<u8>) -> Vec<u8> {
        let mut edges = self.limits.clone();
        let mut least = vec![0_u8; inner.len()];
        self.sweep(|patch, numbers| {
            let bound = numbers.iter().fold(0, |bound, &edge| edges[edge as usize].max(bound));
            let changed = bound > least[patch];
            least[patch] = bound;
            for &edge in numbers {
                let edge = &mut edges[edge as usize];
                *edge = (*edge).max(bound.saturating_sub(1));
            }
            changed
        });
        for (inner, least) in inner.iter_mut().zip(least) {
            *inner = (*inner).max(least);
        }
        inner
    }

    /// Exponents lowered until no two at an edge differ by more than one, and the exponents of
    /// edges.
    fn balanced(&self, mut inner: Vec<u8>) -> Levels {
        let mut edges = vec![NONE; self.limits.len()];
        for (numbers, &inner) in self.edges.iter().zip(&inner) {
            for &edge in numbers {
                edges[edge as usize] = edges[edge as usize].min(inner);
            }
        }
        self.sweep(|patch, numbers| {
            let bound =
                numbers.iter().fold(NONE, |bound, &edge| edges[edge as usize].min(bound)).saturating_add(1);
            let changed = bound < inner[patch];
            if changed {
                inner[patch] = bound;
                for &edge in numbers {
                    edges[edge as usize] = edges[edge as usize].min(bound);
                }
            }
            changed
        });
        Levels { inner, edges }
    }

    /// The levels of [`EdgeRule::Paper`].
    fn paper(&self, inner: Vec<u8>) -> Levels {
        let (m, own) = (self.patches, edges_of_tile(self.patches));
        // Both kinds of a tile's edges count lines 0..=m first: the first and the last line are
        // sides.
        let is_side = |edge: u32| matches!(edge % own % (own / 2) / m, line if line == 0 || line == m);
        let mut edges = vec![NONE; self.limits.len()];
        for (numbers, &inner) in self.edges.iter().zip(&inner) {
            for &edge in numbers {
                let at = edge as usize;
                edges[at] = if is_side(edge) { self.limits[at] } else { edges[at].min(inner) };
            }
        }
        Levels { inner, edges }
    }

    /// Visits all patches, to and fro, until a round changes nothing.
    fn sweep(&self, mut visit: impl FnMut(usize, &[u32; 4]) -> bool) {
        loop {
            let mut changed = false;
            for (patch, numbers) in self.edges.iter().enumerate() {
                changed |= visit(patch, numbers);
            }
            for (patch, numbers) in self.edges.iter().enumerate().rev() {
                changed |= visit(patch, numbers);
            }
            if !changed {
                return;
            }
        }
    }
}
