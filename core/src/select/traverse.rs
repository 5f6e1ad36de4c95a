//! The choice of tiles: a cut of the quadtree, refined where the projected error is largest.

use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashMap};
use std::sync::Arc;

use super::levels::{Net, base_of_tile};
use super::neighbours::{self, Side};
use super::pattern::EdgeRule;
use super::selection::{Chosen, Selection, Wanted};
use super::tile::{Node, TileTable};
use super::view::{Box3, Frame, View};
use crate::container::Header;
use crate::tile::TileId;

/// The tiles as selection sees them: rows of the index, and tables of the loaded tiles.
pub trait Tiles {
    /// The file's header: sizes of tiles and patches, and the leaf level.
    fn header(&self) -> &Header;
    /// The row of a tile; `None` if the tile does not exist, or its row is not known because the
    /// index page is not loaded. Rows of the children of a loaded tile must be known.
    fn node(&self, id: TileId) -> Option<Node>;
    /// The table of a tile that can be drawn now.
    fn table(&self, id: TileId) -> Option<Arc<TileTable>>;
}

/// The options of a selection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Largest projected error in pixels.
    pub tolerance: f64,
    /// How steps of shared edges are chosen.
    pub rule: EdgeRule,
    /// Levels by which drawn tiles that share an edge may differ, at least 1. With
    /// [`EdgeRule::Shared`] 1 is used in any case: only then can the patches of every tile differ
    /// from their neighbours by one step. With [`EdgeRule::Paper`] it is at most p.
    pub imbalance: u8,
    /// Most tiles that may be drawn. Refinement takes the largest projected errors first and ends
    /// there.
    pub max_tiles: usize,
}

impl Default for Options {
    /// A tolerance of one pixel, any number of tiles.
    fn default() -> Self {
        Self { tolerance: 1.0, rule: EdgeRule::Shared, imbalance: 1, max_tiles: usize::MAX }
    }
}

/// Chooses tiles: from the root down, the one with the largest projected error first, until all are
/// within the tolerance.
///
/// A tile is drawn in place of its children unless all of them that are in the view are loaded. A
/// tile is split only together with coarser neighbours, as `imbalance` asks, and with
/// [`EdgeRule::Shared`] a tile is split too if a neighbour's patches need finer vertices on the
/// common edge than it has.
pub fn select(tiles: &impl Tiles, frame: &Frame, view: &View, options: &Options) -> Selection {
    let header = tiles.header();
    let imbalance = match options.rule {
        EdgeRule::Shared => 1,
        EdgeRule::Paper => options.imbalance.clamp(1, header.patch_log2),
    };
    let mut cut = Cut {
        tiles,
        frame,
        view,
        options: Options { imbalance, ..*options },
        planes: view.planes(),
        leaves: HashMap::new(),
        wanted: HashMap::new(),
        queue: BinaryHeap::new(),
    };
    cut.start();
    cut.refine();
    if options.rule == EdgeRule::Shared {
        cut.refine_for_neighbours();
    }
    cut.finish()
}

/// A tile of the cut.
struct Leaf {
    node: Node,
    table: Arc<TileTable>,
    /// Projected error at full resolution.
    error: f64,
    /// Base exponents of its patches; empty until they are needed.
    base: Vec<u8>,
}

struct Cut<'a, T> {
    tiles: &'a T,
    frame: &'a Frame,
    view: &'a View,
    options: Options,
    planes: [([f64; 3], f64); 5],
    /// The tiles of the cut that are in the view.
    leaves: HashMap<TileId, Leaf>,
    wanted: HashMap<TileId, f64>,
    queue: BinaryHeap<Queued>,
}

/// A tile above the tolerance.
#[derive(PartialEq)]
struct Queued {
    error: f64,
    id: TileId,
}

impl Eq for Queued {}

impl PartialOrd for Queued {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Queued {
    fn cmp(&self, other: &Self) -> Ordering {
        self.error.total_cmp(&other.error).then_with(|| other.id.cmp(&self.id))
    }
}

impl<T: Tiles> Cut<'_, T> {
    fn header(&self) -> &Header {
        self.tiles.header()
    }

    /// The box of a tile, with everything below it.
    fn space(&self, id: TileId, node: &Node) -> Box3 {
        let side = f64::from(self.header().tile()) * f64::from(self.header().spacing(id.level));
        let (left, top) = (f64::from(id.x) * side, f64::from(id.y) * side);
        Box3::of_square(self.frame, left, top, side, node.low.into(), node.high.into())
    }

    fn start(&mut self) {
        let Some(node) = self.tiles.node(TileId::ROOT) else {
            self.wanted.insert(TileId::ROOT, f64::INFINITY);
            return;
        };
        if !self.space(TileId::ROOT, &node).is_inside(&self.planes) {
            return;
        }
        match self.tiles.table(TileId::ROOT) {
            Some(table) => self.insert(TileId::ROOT, node, table),
            None => self.want(TileId::ROOT, f64::INFINITY),
        }
    }

    fn insert(&mut self, id: TileId, node: Node, table: Arc<TileTable>) {
        let vertical = f64::from(node.vertical) * self.frame.exaggeration;
        let error = self.view.projected(&self.space(id, &node), vertical, node.horizontal.into());
        if error > self.options.tolerance && node.children != 0 {
            self.queue.push(Queued { error, id });
        }
        self.leaves.insert(id, Leaf { node, table, error, base: Vec::new() });
    }

    fn want(&mut self, id: TileId, priority: f64) {
        let known = self.wanted.entry(id).or_insert(priority);
        *known = known.max(priority);
    }

    /// Splits the tiles above the tolerance.
    fn refine(&mut self) {
        while let Some(Queued { error, id }) = self.queue.pop() {
            if self.leaves.contains_key(&id) {
                self.split(id, error);
            }
        }
    }

    /// Replaces a leaf by its children, after the neighbours that would be too coarse. Returns
    /// false, and keeps the leaf, if something that this needs is not loaded.
    fn split(&mut self, id: TileId, urgency: f64) -> bool {
        let Some(leaf) = self.leaves.get(&id) else { return false };
        let (node, urgency) = (leaf.node, urgency.max(leaf.error));
        if node.children == 0 {
            return false;
        }
        // Wanted tiles will be drawn: children that would exceed the number of tiles are not wanted
        // either.
        let inside = |child: &TileId| {
            self.tiles.node(*child).is_none_or(|row| self.space(*child, &row).is_inside(&self.planes))
        };
        let ids = (0..4).filter(|q| node.children >> q & 1 != 0).map(|q| id.child(q));
        let more = ids.filter(|child| !self.wanted.contains_key(child)).filter(inside).count();
        if self.leaves.len() + self.wanted.len() + more > self.options.max_tiles.saturating_add(1) {
            return false;
        }
        let mut children = Vec::with_capacity(4);
        let mut missing = false;
        for quadrant in (0..4).filter(|q| node.children >> q & 1 != 0) {
            let child = id.child(quadrant);
            let Some(row) = self.tiles.node(child) else {
                self.want(child, urgency);
                missing = true;
                continue;
            };
            if !self.space(child, &row).is_inside(&self.planes) {
                continue;
            }
            if let Some(table) = self.tiles.table(child) {
                children.push((child, row, table));
            } else {
                self.want(child, urgency);
                missing = true;
            }
        }
        for side in 0..4 {
            while let Some(coarse) =
                self.coarser(id, side).filter(|c| c.level + self.options.imbalance <= id.level)
            {
                if !self.split(coarse, urgency) {
                    missing = true;
                    break;
                }
            }
        }
        if missing || self.leaves.len() + children.len() > self.options.max_tiles.saturating_add(1) {
            return false;
        }
        self.leaves.remove(&id);
        for (child, row, table) in children {
            self.insert(child, row, table);
        }
        true
    }

    /// The drawn tile beyond a side of a tile, if it is not finer.
    fn coarser(&self, id: TileId, side: usize) -> Option<TileId> {
        let mut beyond = neighbour(id, side)?;
        loop {
            if self.leaves.contains_key(&beyond) {
                return Some(beyond);
            }
            beyond = beyond.parent()?;
        }
    }

    /// Splits tiles whose neighbours need finer vertices on the common edge.
    fn refine_for_neighbours(&mut self) {
        let m = self.header().patches();
        // Tiles that could not be split.
        let mut stuck = Vec::new();
        loop {
            let patch_log2 = self.header().patch_log2;
            let chosen = self.chosen();
            let mut base = Vec::with_capacity(chosen.len() * (m * m) as usize);
            for tile in &chosen {
                if let Some(leaf) = self.leaves.get_mut(&tile.id) {
                    if leaf.base.is_empty() {
                        leaf.base =
                            base_of_tile(tile, patch_log2, self.frame, self.view, self.options.tolerance);
                    }
                    base.extend(&leaf.base);
                }
            }
            let mut coarse = Net::new(&chosen, m).too_coarse(base);
            for edge in &mut coarse {
                *edge /= neighbours::edges_of_tile(m);
            }
            coarse.dedup();
            let ids: Vec<_> = coarse.into_iter().map(|tile| chosen[tile as usize].id).collect();
            let mut changed = false;
            for id in ids {
                if !self.leaves.contains_key(&id) || stuck.contains(&id) {
                    continue;
                }
                // Its projected error is at most about the tolerance; tiles above the tolerance
                // come first.
                if self.split(id, self.options.tolerance) {
                    changed = true;
                } else {
                    stuck.push(id);
                }
            }
            if !changed {
                return;
            }
            // A child of a split tile may be above the tolerance itself: its error is not that of
            // its patches at the edge.
            self.refine();
        }
    }

    /// The tiles of the cut in order, with their sides.
    fn chosen(&self) -> Vec<Chosen> {
        let mut ids: Vec<_> = self.leaves.keys().copied().collect();
        ids.sort_unstable_by_key(|id| (id.level, id.y, id.x));
        let number: HashMap<_, _> = ids.iter().enumerate().map(|(i, &id)| (id, i as u32)).collect();
        let (m, levels) = (self.header().patches(), self.header().levels);
        let exponent = |id: TileId| levels.saturating_sub(id.level);
        let first = |tile: u32, side: usize| {
            let line = [0, m * (m + 1) + m * m, m * m, m * (m + 1)][side];
            tile * neighbours::edges_of_tile(m) + line
        };
        let side = |tile: u32, id: TileId, side: usize| {
            let own = Side { first: first(tile, side), local: 0, shift: 0, limit: exponent(id) };
            let Some(other) = self.coarser(id, side) else { return own };
            let beyond = number[&other];
            let shift = id.level - other.level;
            if shift == 0 && beyond > tile {
                return own;
            }
            let along = if side.is_multiple_of(2) { id.x } else { id.y };
            let local = along & ((1 << shift) - 1);
            Side { first: first(beyond, (side + 2) % 4), local, shift, limit: exponent(other) }
        };
        let tile = |(i, &id): (usize, &TileId)| Chosen {
            id,
            exponent: exponent(id),
            sides: std::array::from_fn(|at| side(i as u32, id, at)),
            table: Arc::clone(&self.leaves[&id].table),
        };
        ids.iter().enumerate().map(tile).collect()
    }

    fn finish(self) -> Selection {
        let tiles = self.chosen();
        let mut wanted: Vec<_> = self.wanted.iter().map(|(&id, &priority)| Wanted { id, priority }).collect();
        wanted.sort_unstable_by(|a, b| b.priority.total_cmp(&a.priority).then_with(|| a.id.cmp(&b.id)));
        let patch_log2 = self.header().patch_log2;
        let exponents = tiles.iter().map(|tile| u32::from(tile.exponent));
        let (least, most) = (exponents.clone().min().unwrap_or(0), exponents.max().unwrap_or(0));
        Selection {
            patches: self.header().patches(),
            patch_log2,
            rounds: most + u32::from(patch_log2) - least + 1,
            promised: self.leaves.values().fold(0.0, |most, leaf| leaf.error.max(most)),
            wanted,
            tiles,
        }
    }
}

/// The tile of the same level beyond a side; `None` outside of the root square.
fn neighbour(id: TileId, side: usize) -> Option<TileId> {
    let (x, y) = match side {
        0 => (Some(id.x), id.y.checked_sub(1)),
        1 => (id.x.checked_add(1), Some(id.y)),
        2 => (Some(id.x), id.y.checked_add(1)),
        _ => (id.x.checked_sub(1), Some(id.y)),
    };
    let (x, y) = (x?, y?);
    (x >> id.level == 0 && y >> id.level == 0).then(|| TileId::new(id.level, x, y))
}
