//! Selections and levels made by hand: any cut of the quadtree whose neighbours differ by a level,
//! any levels that the rules allow.

use std::sync::Arc;

use relevo::TileId;
use relevo::container::Reader;
use relevo::select::neighbours::{edges_of_patch, edges_of_tile};
use relevo::select::{Chosen, EdgeRule, Frame, Levels, Selection, Side};

use super::truth::tile_data;

/// Numbers in a row that depend on nothing but the first.
pub struct Random(pub u64);

impl Random {
    pub fn below(&mut self, n: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % n
    }

    pub fn unit(&mut self) -> f64 {
        self.below(1 << 30) as f64 / f64::from(1 << 30)
    }
}

/// A cut of the quadtree: `splits` tiles in turn are replaced by their children, and what that
/// calls for.
pub fn cut(reader: &Reader, splits: u64, random: &mut Random) -> Vec<TileId> {
    let mut tiles = vec![TileId::ROOT];
    for _ in 0..splits {
        let at = tiles[random.below(tiles.len() as u64) as usize];
        split(reader, &mut tiles, at);
    }
    tiles.sort_unstable_by_key(|id| (id.level, id.y, id.x));
    tiles
}

/// The tile of the cut on the other side of a tile's side (north, east, south, west), if it is of
/// its level or coarser.
fn across(tiles: &[TileId], id: TileId, side: usize) -> Option<TileId> {
    let (dx, dy) = [(0, -1), (1, 0), (0, 1), (-1, 0)][side];
    let (x, y) = (i64::from(id.x) + dx, i64::from(id.y) + dy);
    if x < 0 || y < 0 || x >> id.level != 0 || y >> id.level != 0 {
        return None;
    }
    let same = TileId::new(id.level, x as u32, y as u32);
    std::iter::successors(Some(same), |tile| tile.parent()).find(|tile| tiles.contains(tile))
}

fn split(reader: &Reader, tiles: &mut Vec<TileId>, id: TileId) {
    let entry = reader.entry(id).expect("entry").expect("tile");
    if entry.is_leaf() || !tiles.contains(&id) {
        return;
    }
    for side in 0..4 {
        while let Some(coarse) = across(tiles, id, side).filter(|other| other.level < id.level) {
            split(reader, tiles, coarse);
        }
    }
    tiles.retain(|tile| *tile != id);
    tiles.extend(entry.child_ids());
}

/// The selection of some tiles.
pub fn selection(reader: &Reader, frame: &Frame, tiles: &[TileId]) -> Selection {
    let header = reader.header();
    let m = header.patches();
    let place = |id: TileId| tiles.iter().position(|tile| *tile == id).expect("a tile of the cut") as u32;
    let first = |tile: u32, side: usize| {
        let all = m * (m + 1);
        tile * edges_of_tile(m) + [0, all + m * m, m * m, all][side]
    };
    let exponent = |id: TileId| header.levels - id.level;
    let sides = |id: TileId| {
        std::array::from_fn(|side| {
            let own = Side { first: first(place(id), side), local: 0, shift: 0, limit: exponent(id) };
            match across(tiles, id, side) {
                Some(other) if other.level < id.level || place(other) < place(id) => {
                    let shift = id.level - other.level;
                    let along = if side % 2 == 0 { id.x } else { id.y };
                    let local = along & ((1 << shift) - 1);
                    Side { first: first(place(other), (side + 2) % 4), local, shift, limit: exponent(other) }
                }
                _ => own,
            }
        })
    };
    let chosen = |&id: &TileId| {
        let table = Arc::new(tile_data(reader, frame, id).table);
        Chosen { id, exponent: exponent(id), sides: sides(id), table }
    };
    Selection {
        tiles: tiles.iter().map(chosen).collect(),
        patches: m,
        patch_log2: header.patch_log2,
        ..Selection::default()
    }
}

/// What the rules need to know of the patches of a selection.
struct Patches {
    /// Numbers of the edges of each.
    edges: Vec<[usize; 4]>,
    /// Least exponent of each.
    least: Vec<u8>,
    /// Least exponent of each edge.
    limit: Vec<u8>,
}

impl Patches {
    fn of(selection: &Selection) -> Self {
        let m = selection.patches;
        let numbers = selection.tiles.len() * edges_of_tile(m) as usize;
        let mut all = Self { edges: Vec::new(), least: Vec::new(), limit: vec![0; numbers] };
        for (tile, chosen) in selection.tiles.iter().enumerate() {
            for (x, y) in (0..m * m).map(|patch| (patch % m, patch / m)) {
                let edges = edges_of_patch(tile as u32, &chosen.sides, m, x, y).map(|edge| edge as usize);
                let border = [y == 0, x + 1 == m, y + 1 == m, x == 0];
                for (i, &edge) in edges.iter().enumerate() {
                    let own = if border[i] { chosen.sides[i].limit } else { chosen.exponent };
                    all.limit[edge] = all.limit[edge].max(own);
                }
                all.least.push(chosen.exponent);
                all.edges.push(edges);
            }
        }
        all
    }

    /// Of each edge, from what its patches have.
    fn join(&self, of: &[u8], start: u8, join: fn(u8, u8) -> u8) -> Vec<u8> {
        let mut out = vec![start; self.limit.len()];
        for (edges, &own) in self.edges.iter().zip(of) {
            for &edge in edges {
                out[edge] = join(out[edge], own);
            }
        }
        out
    }

    /// Applies a rule, which is given what edges have, to all patches until nothing changes.
    fn settle(
        &self,
        mut of: Vec<u8>,
        joined: impl Fn(&[u8]) -> Vec<u8>,
        rule: impl Fn(&[u8], u8, [usize; 4]) -> u8,
    ) -> Vec<u8> {
        loop {
            let edges_have = joined(&of);
            let after: Vec<u8> =
                of.iter().zip(&self.edges).map(|(&own, &edges)| rule(&edges_have, own, edges)).collect();
            if after == of {
                return of;
            }
            of = after;
        }
    }
}

/// Levels that the rule allows, from any base.
pub fn levels(selection: &Selection, rule: EdgeRule, base: &mut dyn FnMut(usize, u32) -> u8) -> Levels {
    let (m, p) = (selection.patches, selection.patch_log2);
    let patches = Patches::of(selection);
    let tiles = selection.tiles.iter().enumerate();
    let all = tiles.flat_map(|(tile, chosen)| (0..m * m).map(move |patch| (tile, patch, chosen.exponent)));
    let mut inner: Vec<u8> = all.map(|(tile, patch, exponent)| exponent + base(tile, patch).min(p)).collect();
    if rule == EdgeRule::Paper {
        let mut edges = patches.join(&inner, 255, u8::min);
        for side in selection.tiles.iter().flat_map(|chosen| &chosen.sides) {
            for j in 0..m {
                edges[side.edge(j, m) as usize] = side.limit;
            }
        }
        return Levels { inner, edges };
    }
    let greatest = |of: &[u8]| patches.join(of, 0, u8::max);
    let least = patches.settle(patches.least.clone(), greatest, |greatest, own, edges| {
        edges.iter().fold(own, |most, &e| most.max(patches.limit[e]).max(greatest[e].saturating_sub(1)))
    });
    for (inner, least) in inner.iter_mut().zip(&least) {
        *inner = (*inner).max(*least);
    }
    let smallest = |of: &[u8]| patches.join(of, 255, u8::min);
    let inner = patches.settle(inner, smallest, |smallest, own, edges| {
        edges.iter().fold(own, |all, &e| all.min(smallest[e] + 1))
    });
    let edges = patches.join(&inner, 255, u8::min);
    for (patch, of) in patches.edges.iter().enumerate() {
        assert!(inner[patch] <= patches.least[patch] + p);
        let fits = |e: usize| {
            edges[e] >= patches.limit[e] && edges[e] + 1 >= inner[patch] && edges[e] <= inner[patch]
        };
        assert!(of.iter().all(|&e| fits(e)));
    }
    Levels { inner, edges }
}
