//! Selection on random quadtrees with random errors, random cameras and random sets of loaded
//! tiles, against brute force.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use proptest::prelude::*;
use relevo::TileId;
use relevo::container::{Header, Metric};
use relevo::sample::{Coding, SampleType};
use relevo::select::imagery::{Draw, Images, Layer, assign};
use relevo::select::levels::patch_box;
use relevo::select::neighbours::{edges_of_patch, edges_of_tile};
use relevo::select::{
    Box3, EdgeRule, Frame, Levels, Node, Options, Selection, TileTable, Tiles, View, select,
};

/// A generator that a seed fixes.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 >> 33
    }

    /// In 0..1.
    fn unit(&mut self) -> f64 {
        self.next() as f64 / f64::from(1_u32 << 31)
    }

    fn below(&mut self, n: u64) -> u64 {
        self.next() % n
    }
}

/// A whole quadtree in memory.
struct Forest {
    header: Header,
    nodes: HashMap<TileId, Node>,
    tables: HashMap<TileId, Arc<TileTable>>,
    loaded: HashSet<TileId>,
}

impl Tiles for Forest {
    fn header(&self) -> &Header {
        &self.header
    }

    fn node(&self, id: TileId) -> Option<Node> {
        self.nodes.get(&id).copied()
    }

    fn table(&self, id: TileId) -> Option<Arc<TileTable>> {
        self.loaded.contains(&id).then(|| Arc::clone(&self.tables[&id]))
    }
}

fn header(levels: u8, tile_log2: u8, patch_log2: u8) -> Header {
    let side = (1_u32 << (tile_log2 + levels)) + 1;
    Header {
        version: 2,
        width: side,
        height: side,
        tile_log2,
        patch_log2,
        levels,
        metric: Metric::Bound,
        coding: Coding::Integer { scale: 1.0, offset: 0.0 },
        source_type: SampleType::Int16,
        band_scale: 1.0,
        band_offset: 0.0,
        unit_metres: 1.0,
        quantisation_error: 0.0,
        nodata: None,
        transform: None,
        tile_count: 1,
    }
}

impl Forest {
    /// Errors are a few metres where the terrain is rough, next to nothing elsewhere; some leaves
    /// do not exist.
    fn new(random: &mut Random, levels: u8, tile_log2: u8, patch_log2: u8) -> Self {
        let header = header(levels, tile_log2, patch_log2);
        let mut forest =
            Self { header, nodes: HashMap::new(), tables: HashMap::new(), loaded: HashSet::new() };
        let holes = random.below(3) * 10;
        forest.grow(random, TileId::ROOT, holes);
        forest
    }

    /// Makes a tile and what is below it; false if nothing is there.
    fn grow(&mut self, random: &mut Random, id: TileId, holes: u64) -> bool {
        let (m, steps) = (self.header.patches(), self.header.steps());
        let count = (m * m) as usize;
        let mut children = 0;
        if id.level < self.header.levels {
            for quadrant in 0..4 {
                if self.grow(random, id.child(quadrant), holes) {
                    children |= 1 << quadrant;
                }
            }
            if children == 0 && id.level > 0 {
                return false;
            }
        } else if random.below(100) < holes {
            return false;
        }
        let mut table = TileTable {
            id,
            patches: m,
            steps,
            vertical: vec![0.0; count * steps as usize],
            horizontal: vec![0.0; count * steps as usize],
            low: vec![0.0; count],
            high: vec![0.0; count],
            drawable: vec![true; count],
        };
        for at in 0..count {
            let height = (random.unit() * 50.0) as f32;
            (table.low[at], table.high[at]) = (height, height + 20.0);
            let roughness = if random.below(6) == 0 { 8.0 } else { 0.05 };
            for k in 0..steps {
                let index = k as usize * count + at;
                let below = if k == 0 { 0.0 } else { table.vertical[index - count] };
                let mut error = below + if k > 0 { (random.unit() * roughness) as f32 } else { 0.0 };
                if id.level < self.header.levels {
                    error = error.max(self.below(&mut table, at, k));
                }
                table.vertical[index] = error;
                table.horizontal[index] = error / 2.0;
            }
        }
        let most = |plane: &[f32]| plane[..count].iter().copied().fold(0.0, f32::max);
        let node = Node {
            children,
            vertical: most(&table.vertical),
            horizontal: most(&table.horizontal),
            low: table.low.iter().copied().fold(f32::INFINITY, f32::min),
            high: table.high.iter().copied().fold(f32::NEG_INFINITY, f32::max),
        };
        self.nodes.insert(id, node);
        self.tables.insert(id, Arc::new(table));
        true
    }

    /// Error of the four patches below patch `at` at the step that step `k` is for them; takes over
    /// their heights.
    fn below(&self, table: &mut TileTable, at: usize, k: u32) -> f32 {
        let m = table.patches;
        let (x, y) = (2 * (at as u32 % m), 2 * (at as u32 / m));
        let mut error = 0.0_f32;
        for (px, py) in [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)] {
            let child = table.id.child(u8::from(px >= m) | u8::from(py >= m) << 1);
            let Some(inner) = self.tables.get(&child) else { continue };
            let there = ((py % m) * m + px % m) as usize;
            let step = (k + 1).min(table.steps - 1) as usize;
            error = error.max(inner.vertical[step * (m * m) as usize + there]);
            table.low[at] = table.low[at].min(inner.low[there]);
            table.high[at] = table.high[at].max(inner.high[there]);
        }
        error
    }

    fn load_all(&mut self) {
        self.loaded = self.nodes.keys().copied().collect();
    }

    /// Loads the root and some tiles whose parents are loaded.
    fn load_some(&mut self, random: &mut Random) {
        let mut ids: Vec<_> = self.nodes.keys().copied().collect();
        ids.sort();
        self.loaded.clear();
        for id in ids {
            let parent = id.parent().is_none_or(|parent| self.loaded.contains(&parent));
            if parent && (id.level == 0 || random.below(8) > 0) {
                self.loaded.insert(id);
            }
        }
    }

    fn space(&self, frame: &Frame, id: TileId) -> Box3 {
        let side = f64::from(self.header.tile() * self.header.spacing(id.level));
        let node = &self.nodes[&id];
        let (left, top) = (f64::from(id.x) * side, f64::from(id.y) * side);
        Box3::of_square(frame, left, top, side, node.low.into(), node.high.into())
    }
}

fn camera(random: &mut Random, forest: &Forest, frame: &Frame) -> View {
    let side = f64::from(forest.header.width);
    let mut place = |height: f64| {
        let (column, row) = ((random.unit() * 1.4 - 0.2) * side, (random.unit() * 1.4 - 0.2) * side);
        frame.position(column, row, height * random.unit())
    };
    let (eye, target) = (place(side), place(60.0));
    View::look_at(eye, target, 0.9, (640, 480), 0.5)
}

/// Samples of a tile's sides in lattice samples: left, top, side.
fn square(forest: &Forest, id: TileId) -> [u64; 3] {
    let (left, top) = forest.header.origin(id);
    [left, top, u64::from(forest.header.tile() * forest.header.spacing(id.level))]
}

/// The tiles that are drawn are a cut: no two overlap, and every leaf that is in the picture lies
/// under one.
fn assert_cut(forest: &Forest, selection: &Selection, frame: &Frame, view: &View) {
    let chosen: HashSet<_> = selection.tiles.iter().map(|tile| tile.id).collect();
    assert_eq!(chosen.len(), selection.tiles.len());
    for id in forest.nodes.keys() {
        let mut above = Some(*id);
        let mut covers = 0;
        while let Some(id) = above {
            covers += usize::from(chosen.contains(&id));
            above = id.parent();
        }
        assert!(covers <= 1, "{id} is covered {covers} times");
        let leaf = forest.nodes[id].children == 0;
        // Every box on the way down is seen if the leaf's is, since it holds it.
        assert!(covers == 1 || !leaf || !view.sees(&forest.space(frame, *id)), "{id} is not covered");
    }
}

/// Segments of all patches' edges: `(tile, patch, side, [x0, y0, x1, y1], edge number)`.
fn segments(forest: &Forest, selection: &Selection) -> Vec<(usize, usize, [u64; 4], u32)> {
    let m = selection.patches;
    let mut out = Vec::new();
    for (tile, chosen) in selection.tiles.iter().enumerate() {
        let [left, top, side] = square(forest, chosen.id);
        let patch = side / u64::from(m);
        for (y, x) in (0..m * m).map(|i| (i / m, i % m)) {
            let (x0, y0) = (left + u64::from(x) * patch, top + u64::from(y) * patch);
            let (x1, y1) = (x0 + patch, y0 + patch);
            let ends = [[x0, y0, x1, y0], [x1, y0, x1, y1], [x0, y1, x1, y1], [x0, y0, x0, y1]];
            for (ends, edge) in ends.into_iter().zip(edges_of_patch(tile as u32, &chosen.sides, m, x, y)) {
                out.push((tile, (y * m + x) as usize, ends, edge));
            }
        }
    }
    out
}

/// Patches have the same edge number if and only if their edges lie on one another (or on one edge
/// of a coarser tile).
fn assert_edges(forest: &Forest, selection: &Selection) {
    let segments = segments(forest, selection);
    let overlap = |a: &[u64; 4], b: &[u64; 4]| {
        let horizontal = a[1] == a[3];
        if horizontal != (b[1] == b[3]) {
            return false;
        }
        if horizontal {
            a[1] == b[1] && a[0] < b[2] && b[0] < a[2]
        } else {
            a[0] == b[0] && a[1] < b[3] && b[1] < a[3]
        }
    };
    let mut of_edge: HashMap<u32, Vec<usize>> = HashMap::new();
    let mut at_place: HashMap<[u64; 2], Vec<usize>> = HashMap::new();
    for (i, (.., ends, edge)) in segments.iter().enumerate() {
        assert!(*edge < selection.tiles.len() as u32 * edges_of_tile(selection.patches));
        of_edge.entry(*edge).or_default().push(i);
        // Every sample along it, so that overlapping ones meet.
        for t in 0..(ends[2] - ends[0]) + (ends[3] - ends[1]) {
            let place = if ends[1] == ends[3] {
                [2 * (ends[0] + t) + 1, 2 * ends[1]]
            } else {
                [2 * ends[0], 2 * (ends[1] + t) + 1]
            };
            at_place.entry(place).or_default().push(i);
        }
    }
    for members in at_place.values() {
        assert!(members.iter().all(|&i| segments[i].3 == segments[members[0]].3), "an edge with two numbers");
        assert!(members.len() <= 2);
    }
    for (edge, members) in of_edge {
        let longest = members
            .iter()
            .max_by_key(|&&i| segments[i].2[2] + segments[i].2[3] - segments[i].2[0] - segments[i].2[1]);
        let longest = segments[*longest.expect("one")].2;
        assert!(members.iter().all(|&i| overlap(&segments[i].2, &longest)), "edge {edge} is in two places");
    }
}

/// The exponent that an edge can have at least: that of the coarser tile.
fn limits(selection: &Selection, segments: &[(usize, usize, [u64; 4], u32)]) -> HashMap<u32, u8> {
    let mut limits = HashMap::new();
    for (tile, _, _, edge) in segments {
        let limit = limits.entry(*edge).or_insert(0);
        *limit = selection.tiles[*tile].exponent.max(*limit);
    }
    limits
}

/// What the rule of `select::levels` says, by rounds over everything.
fn reference(
    selection: &Selection,
    base: &[u8],
    segments: &[(usize, usize, [u64; 4], u32)],
    free: bool,
) -> (Vec<u8>, HashMap<u32, u8>) {
    let count = (selection.patches * selection.patches) as usize;
    let limits = limits(selection, segments);
    let mut least = vec![0_u8; base.len()];
    for _ in 0..if free { 0 } else { selection.rounds + 2 } {
        let mut edges = limits.clone();
        for (tile, patch, _, edge) in segments {
            let edge = edges.entry(*edge).or_default();
            *edge = (*edge).max(least[tile * count + patch].saturating_sub(1));
        }
        for (tile, patch, _, edge) in segments {
            let least = &mut least[tile * count + patch];
            *least = (*least).max(edges[edge]);
        }
    }
    let mut inner: Vec<_> = base.iter().zip(&least).map(|(&a, &b)| a.max(b)).collect();
    let finest = |inner: &[u8]| {
        let mut edges: HashMap<u32, u8> = HashMap::new();
        for (tile, patch, _, edge) in segments {
            let edge = edges.entry(*edge).or_insert(u8::MAX);
            *edge = (*edge).min(inner[tile * count + patch]);
        }
        edges
    };
    for _ in 0..selection.rounds + 2 {
        let edges = finest(&inner);
        for (tile, patch, _, edge) in segments {
            let inner = &mut inner[tile * count + patch];
            *inner = (*inner).min(edges[edge] + 1);
        }
    }
    let edges = finest(&inner);
    (inner, edges)
}

/// Base exponents, written anew.
fn base(selection: &Selection, frame: &Frame, view: &View, tolerance: f64) -> Vec<u8> {
    let (p, count) = (selection.patch_log2, (selection.patches * selection.patches) as usize);
    let mut out = Vec::new();
    for tile in &selection.tiles {
        for at in 0..count {
            let space = patch_box(&tile.table, tile.exponent, p, frame, at);
            let mut best = 0;
            for k in 0..=p {
                let i = usize::from(k) * count + at;
                let vertical = f64::from(tile.table.vertical[i]) * frame.exaggeration;
                let error = view.projected(&space, vertical, tile.table.horizontal[i].into());
                if !view.sees(&space) || error <= tolerance {
                    best = k;
                }
            }
            out.push(tile.exponent + best);
        }
    }
    out
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 120, ..ProptestConfig::default() })]

    #[test]
    fn a_selection_is_a_balanced_cut_within_the_tolerance(seed: u64, shape in 0..4_usize, partly: bool, tolerance in 0.3..8.0_f64) {
        let mut random = Random(seed);
        let (levels, tile_log2, patch_log2) = [(4, 4, 2), (4, 4, 3), (3, 5, 3), (5, 4, 4)][shape];
        let mut forest = Forest::new(&mut random, levels, tile_log2, patch_log2);
        if partly { forest.load_some(&mut random) } else { forest.load_all() }
        let frame = Frame { dx: 1.0, dy: 1.3, exaggeration: 1.5 };
        for _ in 0..3 {
            let view = camera(&mut random, &forest, &frame);
            let options = Options { tolerance, ..Options::default() };
            let selection = select(&forest, &frame, &view, &options);
            assert_cut(&forest, &selection, &frame, &view);
            assert_edges(&forest, &selection);
            prop_assert!(selection.tiles.iter().all(|tile| forest.loaded.contains(&tile.id)));
            prop_assert!(selection.wanted.iter().all(|wanted| !forest.loaded.contains(&wanted.id)));
            prop_assert!(selection.wanted.windows(2).all(|two| two[0].priority >= two[1].priority));
            if selection.wanted.is_empty() {
                prop_assert!(selection.promised <= tolerance, "{} px", selection.promised);
            } else {
                prop_assert!(partly);
            }
            for tile in &selection.tiles {
                prop_assert!(tile.sides.iter().all(|side| side.shift <= 1));
            }
            let segments = segments(&forest, &selection);
            let base = base(&selection, &frame, &view, tolerance);
            let levels = Levels::of(&selection, &frame, &view, tolerance, EdgeRule::Shared);
            let (inner, edges) = reference(&selection, &base, &segments, false);
            prop_assert_eq!(&levels.inner, &inner);
            for (edge, level) in &edges {
                prop_assert_eq!(levels.edges[*edge as usize], *level);
            }
            let limits = limits(&selection, &segments);
            let count = (selection.patches * selection.patches) as usize;
            for (tile, patch, _, edge) in &segments {
                let (chosen, at) = (&selection.tiles[*tile], tile * count + patch);
                let (inner, edge_level) = (levels.inner[at], edges[edge]);
                prop_assert!(inner - edge_level <= 1, "inner {} at an edge of {}", inner, edge_level);
                prop_assert!(edge_level >= limits[edge]);
                prop_assert!((chosen.exponent..=chosen.exponent + patch_log2).contains(&inner));
                // With everything there, nothing is drawn coarser than the tolerance allows.
                prop_assert!(!selection.wanted.is_empty() || inner <= base[at]);
            }
        }
    }

    /// Points of a box that are in the picture, moved by errors, move by no more pixels than
    /// promised.
    #[test]
    fn nothing_moves_farther_on_the_screen_than_projected(seed: u64) {
        let mut random = Random(seed);
        let mut between = |a: f64, b: f64| a + (b - a) * random.unit();
        for _ in 0..40 {
            let low = [between(-50.0, 50.0), between(-50.0, 50.0), between(-5.0, 5.0)];
            let high = [low[0] + between(0.1, 30.0), low[1] + between(0.1, 30.0), low[2] + between(0.0, 9.0)];
            let space = Box3 { low, high };
            let eye = [between(-80.0, 80.0), between(-80.0, 80.0), between(-3.0, 60.0)];
            let target = [between(low[0], high[0]), between(low[1], high[1]), between(low[2], high[2])];
            let view = View::look_at(eye, target, between(0.2, 2.0), (800, 500), 0.1);
            let (vertical, horizontal) = (between(0.0, 0.5), between(0.0, 0.5));
            let turn = between(0.0, 6.3);
            for _ in 0..60 {
                let p = [between(low[0], high[0]), between(low[1], high[1]), between(low[2], high[2])];
                let Some([x, y]) = view.pixel(p).filter(|[x, y]| (0.0..800.0).contains(x) && (0.0..500.0).contains(y)) else {
                    continue;
                };
                for (up, along) in [(vertical, 0.0), (-vertical, 0.0), (0.0, horizontal)] {
                    let q = [p[0] + along * turn.cos(), p[1] + along * turn.sin(), p[2] + up];
                    let promised = view.projected(&space, up.abs(), along);
                    // What is moved to behind the near plane is promised nothing.
                    let Some([u, v]) = view.pixel(q) else { continue };
                    let moved = (u - x).hypot(v - y);
                    prop_assert!(moved <= promised * (1.0 + 1e-9), "{moved} px, {promised} promised");
                }
            }
        }
    }

    #[test]
    fn the_papers_rule_keeps_all_vertices_of_the_coarser_tile(seed: u64, imbalance in 1..5_u8) {
        let mut random = Random(seed);
        let mut forest = Forest::new(&mut random, 4, 4, 2);
        forest.load_all();
        let frame = Frame { dx: 1.0, dy: 1.0, exaggeration: 1.0 };
        let view = camera(&mut random, &forest, &frame);
        let options = Options { tolerance: 1.0, rule: EdgeRule::Paper, imbalance, ..Options::default() };
        let selection = select(&forest, &frame, &view, &options);
        assert_cut(&forest, &selection, &frame, &view);
        assert_edges(&forest, &selection);
        let levels = Levels::of(&selection, &frame, &view, 1.0, EdgeRule::Paper);
        let base = base(&selection, &frame, &view, 1.0);
        prop_assert_eq!(&levels.inner, &base);
        let segments = segments(&forest, &selection);
        let limits = limits(&selection, &segments);
        let (m, count) = (selection.patches as usize, (selection.patches * selection.patches) as usize);
        for (i, (tile, patch, _, edge)) in segments.iter().enumerate() {
            let (x, y) = (patch % m, patch / m);
            let at_side = [y == 0, x + 1 == m, y + 1 == m, x == 0][i % 4];
            let others = segments.iter().filter(|other| other.3 == *edge).map(|other| base[other.0 * count + other.1]);
            let expected = if at_side { limits[edge] } else { others.min().expect("itself") };
            prop_assert_eq!(levels.edges[*edge as usize], expected);
            prop_assert!(limits[edge] - selection.tiles[*tile].exponent <= imbalance.min(2));
        }
    }

    #[test]
    fn no_more_tiles_than_allowed(seed: u64, most in 1..40_usize) {
        let mut random = Random(seed);
        let mut forest = Forest::new(&mut random, 4, 4, 2);
        forest.load_all();
        let frame = Frame { dx: 1.0, dy: 1.0, exaggeration: 1.0 };
        let view = camera(&mut random, &forest, &frame);
        let selection = select(&forest, &frame, &view, &Options { tolerance: 0.2, max_tiles: most, ..Options::default() });
        prop_assert!(selection.tiles.len() <= most);
        assert_cut(&forest, &selection, &frame, &view);
    }

    #[test]
    fn images_lie_on_every_place_once(seed: u64, depth in 0..7_u8, partly: bool) {
        let mut random = Random(seed);
        let mut forest = Forest::new(&mut random, 3, 5, 3);
        forest.load_all();
        let images = Album::new(&mut random, depth, partly);
        let frame = Frame { dx: 1.0, dy: 1.0, exaggeration: 1.0 };
        let view = camera(&mut random, &forest, &frame);
        let selection = select(&forest, &frame, &view, &Options::default());
        let layer = Layer { images: &images, texels: 64, magnification: 1.5 };
        let (draws, wanted) = assign(&selection, Some(layer), &frame, &view);
        let side = forest.header.tile();
        let mut area = vec![0; selection.tiles.len()];
        for (i, a) in draws.iter().enumerate() {
            let [west, north, east, south] = a.window;
            prop_assert!(west < east && north < south && east <= side && south <= side);
            area[a.tile as usize] += (east - west) * (south - north);
            let apart = |b: &Draw| {
                b.tile != a.tile || b.window[2] <= west || east <= b.window[0] || b.window[3] <= north || south <= b.window[1]
            };
            prop_assert!(draws[i + 1..].iter().all(apart));
            let id = selection.tiles[a.tile as usize].id;
            if let Some(image) = a.image {
                prop_assert!(images.ready.contains(&image));
                // Over the root square, in units of the smallest interval there can be.
                let whole = 1_u64 << 40;
                let interval = (whole >> id.level) / u64::from(side);
                let from = |x: u32, along: u32| (whole >> id.level) * u64::from(x) + interval * u64::from(along);
                let [x0, y0, x1, y1] = [from(id.x, west), from(id.y, north), from(id.x, east), from(id.y, south)];
                let of = whole >> image.level;
                prop_assert!(u64::from(image.x) * of <= x0 && x1 <= (u64::from(image.x) + 1) * of);
                prop_assert!(u64::from(image.y) * of <= y0 && y1 <= (u64::from(image.y) + 1) * of);
            } else {
                prop_assert!(partly || !images.children.contains_key(&TileId::ROOT));
            }
        }
        prop_assert!(area.iter().all(|&area| area == side * side));
        prop_assert!(wanted.iter().all(|wanted| !images.ready.contains(&wanted.id) && images.children.contains_key(&wanted.id)));
        let ids: HashSet<_> = wanted.iter().map(|wanted| wanted.id).collect();
        prop_assert_eq!(ids.len(), wanted.len());
        let (plain, none) = assign(&selection, None, &frame, &view);
        prop_assert!(plain.len() == selection.tiles.len() && none.is_empty());
    }
}

/// An imagery layer whose depth varies.
struct Album {
    children: HashMap<TileId, u8>,
    ready: HashSet<TileId>,
}

impl Album {
    fn new(random: &mut Random, depth: u8, partly: bool) -> Self {
        let mut album = Self { children: HashMap::new(), ready: HashSet::new() };
        let mut ids = vec![TileId::ROOT];
        while let Some(id) = ids.pop() {
            let children = if id.level < depth { random.below(16) as u8 | random.below(16) as u8 } else { 0 };
            album.children.insert(id, children);
            let parent = id.parent().is_none_or(|parent| album.ready.contains(&parent));
            if parent && (!partly || random.below(5) > 0) {
                album.ready.insert(id);
            }
            ids.extend((0..4).filter(|q| children >> q & 1 != 0).map(|q| id.child(q)));
        }
        album
    }
}

impl Images for Album {
    fn children(&self, id: TileId) -> Option<u8> {
        self.children.get(&id).copied()
    }

    fn ready(&self, id: TileId) -> bool {
        self.ready.contains(&id)
    }
}
