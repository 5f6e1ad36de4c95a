//! What a picture is off by: as measured in the plainest way, and never more than the tables
//! promise.

use crate::support::selection::{Random, cut, levels, selection};
use crate::support::terrain::{self, Kind, Memory};
use crate::support::truth::{Built, Drawn, Truth, fixture, nearest, open, tile_data};
use rayon::prelude::*;
use relevo::TileId;
use relevo::container::Reader;
use relevo::observed::{Observed, observe};
use relevo::sample::SampleType;
use relevo::select::neighbours::edges_of_patch;
use relevo::select::pattern::Meshes;
use relevo::select::{Box3, EdgeRule, Frame, Levels, Selection, View};
use relevo::source::{Samples, Source};
use std::collections::BTreeMap;

const RULES: [EdgeRule; 2] = [EdgeRule::Shared, EdgeRule::Paper];

/// A scene to be measured.
struct Scene<'a> {
    built: &'a Built,
    truth: &'a Truth,
    outline: &'a [[[f64; 2]; 2]],
    frame: Frame,
    view: View,
    selection: &'a Selection,
    levels: &'a Levels,
    rule: EdgeRule,
}

/// What one vertex shows.
#[derive(Clone, Copy, Debug)]
struct Shown {
    pixels: f64,
    misdrawn: bool,
}

impl Scene<'_> {
    fn pixels(&self, a: [f64; 3], b: [f64; 3]) -> f64 {
        let [a, b] = [a, b].map(|p| self.view.relative(p));
        let at = |p: [f64; 3]| (self.view.lambda() * p[0] / p[2], self.view.lambda() * p[1] / p[2]);
        if b[2] <= 0.0 { f64::INFINITY } else { (at(a).0 - at(b).0).hypot(at(a).1 - at(b).1) }
    }

    fn in_picture(&self, p: [f64; 3]) -> bool {
        let (width, height) = (f64::from(self.view.width), f64::from(self.view.height));
        self.view.pixel(p).is_some_and(|[x, y]| (0.0..=width).contains(&x) && (0.0..=height).contains(&y))
    }

    /// The triangles of a patch of a tile of the selection.
    fn triangles(
        &self,
        tile: usize,
        patch: u32,
        meshes: &Meshes,
        data: &relevo::select::TileData,
    ) -> Vec<Drawn> {
        let (header, chosen) = (self.built.reader.header(), &self.selection.tiles[tile]);
        let (m, p) = (header.patches(), header.patch_log2);
        let (x, y) = (patch % m, patch / m);
        if !data.table.drawable[patch as usize] {
            return Vec::new();
        }
        let inner = self.levels.inner[tile * (m * m) as usize + patch as usize] - chosen.exponent;
        let outer = edges_of_patch(tile as u32, &chosen.sides, m, x, y)
            .map(|edge| self.levels.edges[edge as usize].saturating_sub(chosen.exponent));
        let odd = (chosen.id.x * m + x + chosen.id.y * m + y) % 2 == 1;
        let origin = header.origin(chosen.id);
        let spacing = u64::from(header.spacing(chosen.id.level));
        Meshes::pieces(p, inner, outer, odd, self.rule)
            .flat_map(|piece| meshes.triangles(piece))
            .map(|corners| Drawn::new(data, origin, spacing, (x << p, y << p), corners))
            .collect()
    }

    /// One vertex; `None` if it is not in the picture or nothing is there.
    fn vertex(&self, (column, row): (u64, u64), triangles: &[Drawn]) -> Option<Shown> {
        let (z, valid) = self.truth.sample(column, row);
        let point = (4 * column, 4 * row);
        let over = triangles.iter().find_map(|drawn| Some(drawn.at(drawn.weights(point)?)));
        let drawn = over.filter(|(validity, _)| *validity >= 0.5).map(|(_, z)| z);
        let place = |z| self.frame.position(column as f64, row as f64, z);
        let shown = match (valid, drawn) {
            (false, None) => return None,
            (true, Some(drawn)) => (place(z), vec![place(drawn)], false),
            (_, drawn) => {
                let z = drawn.unwrap_or(z);
                let from = [column as f64, row as f64];
                let (metres, _) = nearest(self.outline, &self.frame, from);
                // Several points may be as near; the largest shift counts.
                let points = self.outline.iter().filter_map(|segment| {
                    let (other, point) = nearest(std::slice::from_ref(segment), &self.frame, from);
                    (other <= metres * (1.0 + 1e-9)).then(|| self.frame.position(point[0], point[1], z))
                });
                (place(z), points.collect(), true)
            }
        };
        let pixels = shown.1.iter().map(|&to| self.pixels(shown.0, to)).fold(0.0, f64::max);
        self.in_picture(shown.0).then_some(Shown { pixels, misdrawn: shown.2 })
    }

    /// The plain way: every vertex of every tile, every triangle of its patch.
    fn naive(&self) -> (u64, u64, BTreeMap<(u32, u32), f64>) {
        let header = self.built.reader.header();
        let meshes = Meshes::new(header.patch_log2);
        let m = header.patches();
        let tiles: Vec<_> = (0..self.selection.tiles.len())
            .into_par_iter()
            .map(|tile| {
                let id = self.selection.tiles[tile].id;
                let data = tile_data(&self.built.reader, &self.frame, id);
                let side = u64::from(header.patch()) * u64::from(header.spacing(id.level));
                let (left, top) = header.origin(id);
                let mut found = (0, 0, BTreeMap::new());
                for patch in 0..m * m {
                    let triangles = self.triangles(tile, patch, &meshes, &data);
                    let range = |start: u64, i: u32| {
                        let from = start + u64::from(i) * side;
                        from..from + side + u64::from(i + 1 == m)
                    };
                    for row in range(top, patch / m) {
                        for column in range(left, patch % m) {
                            let Some(shown) = self.vertex((column, row), &triangles) else { continue };
                            found.0 += 1;
                            found.1 += u64::from(shown.misdrawn);
                            let worst: &mut f64 = found.2.entry((tile as u32, patch)).or_default();
                            *worst = worst.max(shown.pixels);
                        }
                    }
                }
                found
            })
            .collect();
        tiles.into_iter().fold((0, 0, BTreeMap::new()), |mut all, (vertices, misdrawn, patches)| {
            all.2.extend(patches);
            (all.0 + vertices, all.1 + misdrawn, all.2)
        })
    }

    fn observed(&self) -> Observed {
        observe(&self.built.reader, self.selection, self.levels, &self.frame, &self.view, self.rule)
            .expect("observed")
    }

    /// What the tables promise of the patches that are drawn.
    fn promised(&self) -> f64 {
        promised(&self.built.reader, self.selection, self.levels, &self.frame, &self.view)
    }

    fn check(&self) -> Observed {
        let observed = self.observed();
        let (vertices, misdrawn, patches) = self.naive();
        assert_eq!((observed.vertices, observed.misdrawn_vertices), (vertices, misdrawn), "{:?}", self.view);
        let close = |a: f64, b: f64| a == b || (a - b).abs() <= 1e-9 * a.max(b) + 1e-9;
        for patch in &observed.patches {
            let naive = patches.get(&(patch.tile, patch.patch)).copied().unwrap_or(-1.0);
            assert!(close(naive, patch.pixels), "{patch:?}, naively {naive}");
        }
        assert_eq!(observed.patches.len(), patches.len());
        let worst = patches.values().fold(0.0, |a: f64, &b| a.max(b));
        assert!(close(worst, observed.pixels), "{} is not {worst}", observed.pixels);
        if self.rule == EdgeRule::Shared {
            let promised = self.promised();
            assert!(observed.pixels <= promised * (1.0 + 1e-9) + 1e-9, "{observed:?}: promised {promised}");
        }
        observed
    }
}

fn promised(reader: &Reader, selection: &Selection, levels: &Levels, frame: &Frame, view: &View) -> f64 {
    let header = reader.header();
    let (m, mut worst) = (header.patches(), 0.0_f64);
    for (tile, chosen) in selection.tiles.iter().enumerate() {
        let (left, top) = header.origin(chosen.id);
        let side = f64::from(header.patch()) * f64::from(header.spacing(chosen.id.level));
        for patch in 0..(m * m) as usize {
            let (x, y) = ((patch % m as usize) as f64, (patch / m as usize) as f64);
            let (low, high) = (f64::from(chosen.table.low[patch]), f64::from(chosen.table.high[patch]));
            let space =
                Box3::of_square(frame, left as f64 + x * side, top as f64 + y * side, side, low, high);
            if view.sees(&space) {
                let step = levels.inner[tile * (m * m) as usize + patch] - chosen.exponent;
                let at = usize::from(step) * (m * m) as usize + patch;
                let vertical = f64::from(chosen.table.vertical[at]) * frame.exaggeration;
                worst = worst.max(view.projected(&space, vertical, chosen.table.horizontal[at].into()));
            }
        }
    }
    worst
}

/// A camera somewhere over the raster.
fn camera(reader: &Reader, frame: &Frame, random: &mut Random) -> View {
    let header = reader.header();
    let root = reader.entry(TileId::ROOT).expect("entry").expect("root");
    let (low, high) = (f64::from(root.min_m), f64::from(root.max_m));
    let mut size = (f64::from(header.width) * frame.dx).max(f64::from(header.height) * frame.dy);
    if random.below(2) == 0 {
        // So far away that no error reaches the eye.
        size = size.max(20.0 * frame.exaggeration * (high - low));
    }
    let mut at = |above: f64| {
        let (column, row) =
            (random.unit() * f64::from(header.width), random.unit() * f64::from(header.height));
        frame.position(column, row, low + (high - low) * random.unit() + above)
    };
    let (target, mut eye) = (at(0.0), at(0.2 * size));
    eye[1] -= 0.3 * size;
    View::look_at(eye, target, 0.9, (640, 400), 0.01 * size)
}

/// Many cuts, levels and cameras of one raster.
fn scenes(source: &dyn Source, (tile, patch): (u32, u32), exaggeration: f64, count: u64) {
    let built = Built::new(source, tile, patch);
    let truth = Truth::of(&built.reader);
    let outline = truth.outline();
    let frame = Frame { exaggeration, ..Frame::of(&built.reader) };
    let mut random = Random(u64::from(tile * 7 + patch) + count);
    let (mut vertices, mut promises) = (0, 0);
    for scene in 0..count {
        let tiles = if scene == 0 {
            built.reader.tiles(built.reader.header().levels / 2).expect("tiles")
        } else {
            cut(&built.reader, random.below(12), &mut random)
        };
        let selection = selection(&built.reader, &frame, &tiles);
        let rule = RULES[(scene % 3 / 2) as usize];
        let uniform = (scene == 0).then_some(1);
        let levels = levels(&selection, rule, &mut |_, _| uniform.unwrap_or_else(|| random.below(7) as u8));
        let view = camera(&built.reader, &frame, &mut random);
        let (selection, levels) = (&selection, &levels);
        let scene =
            Scene { built: &built, truth: &truth, outline: &outline, frame, view, selection, levels, rule };
        vertices += scene.check().vertices;
        promises += usize::from(scene.promised().is_finite());
    }
    assert!(vertices > 0 && promises > 0, "{vertices} vertices, {promises} finite promises");
}

#[test]
fn observed_is_what_every_vertex_shows_around_holes() {
    for (i, kind) in Kind::ALL.into_iter().enumerate() {
        scenes(&terrain::int16(66, 41, kind, i as u64), [(16, 4), (16, 8), (16, 16), (32, 8)][i % 4], 1.0, 6);
    }
    scenes(&terrain::smooth(90, 60, SampleType::Float64, true), (16, 4), 1.0, 6);
}

/// The fixture with its valleys and a few lakes void.
fn holed() -> Memory {
    let rmnp = open(&fixture("rmnp_dem_uint16.tif"));
    let info = rmnp.info().clone();
    let samples = rmnp.read_window(0..info.width, 0..info.height).expect("samples").samples;
    let Samples::Uint16(heights) = &samples else { unreachable!("the fixture is of 16 bits") };
    let lake = |i: usize| {
        let (x, y) = (i % info.width as usize, i / info.width as usize);
        (x / 9 + y / 7).is_multiple_of(5) && !terrain::noise(1, x as u32 / 4, y as u32 / 3).is_multiple_of(3)
    };
    let mask = heights.iter().enumerate().map(|(i, &z)| u8::from(z > 2600 && !lake(i))).collect();
    Memory { info, samples, mask: Some(mask) }
}

#[test]
fn observed_is_what_every_vertex_shows_of_real_terrain() {
    for exaggeration in [1.0, 3.0] {
        scenes(&*open(&fixture("rmnp_dem_uint16.tif")), (16, 8), exaggeration, 6);
        scenes(&holed(), (32, 8), exaggeration, 6);
    }
    scenes(&*open(&fixture("co_elevation_float32_lzw.tif")), (64, 8), 3.0, 3);
}

#[test]
fn squares_without_a_tile_count_where_something_is_drawn_over_them() {
    // One patch is as large as a tile, so a coarse cell covers leaves that do not exist.
    for seed in 0..4 {
        scenes(&terrain::int16(200, 150, Kind::OneValid, seed), (16, 16), 1.0, 3);
        scenes(&terrain::int16(200, 90, Kind::Diagonal, seed), (16, 16), 1.0, 3);
    }
}

#[test]
fn levels_of_another_selection_are_refused() {
    let built = Built::new(&terrain::int16(66, 41, Kind::Rough, 1), 16, 4);
    let frame = Frame::of(&built.reader);
    let chosen = selection(&built.reader, &frame, &[TileId::ROOT]);
    let mut levels = levels(&chosen, EdgeRule::Shared, &mut |_, _| 1);
    let view = camera(&built.reader, &frame, &mut Random(1));
    let measure = |levels: &Levels| observe(&built.reader, &chosen, levels, &frame, &view, EdgeRule::Shared);
    assert!(measure(&levels).is_ok());
    levels.edges.clear();
    assert!(measure(&levels).is_err());
    levels.inner.pop();
    assert!(measure(&levels).is_err());
}
