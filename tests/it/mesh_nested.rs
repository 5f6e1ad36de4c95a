//! The nested mesh against its definition: every triangle of the 4-8 hierarchy measured by brute
//! force over the whole raster, in a few lines that know no tiles.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::Path;

use proptest::prelude::*;
use relevo::container::Reader;
use relevo::mesh::Nested;
use relevo::pipeline::{self, BuildOptions, Silent};
use relevo::sample::SampleType;
use relevo::source::{Fingerprint, Samples, Source, SourceInfo, Window};
use relevo::{Rect, Result};

use crate::support::terrain::info;

type At = (i64, i64);

/// A window by its first and last column, and its first and last row.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    pub columns: (u32, u32),
    pub rows: (u32, u32),
}

impl Extent {
    pub fn rect(&self) -> Rect {
        Rect { columns: self.columns.0..self.columns.1 + 1, rows: self.rows.0..self.rows.1 + 1 }
    }
}

/// A raster in memory; NaN is void.
pub struct Raster {
    pub info: SourceInfo,
    heights: Vec<f64>,
}

impl Raster {
    fn new((width, height): (u32, u32), sample_type: SampleType, heights: Vec<f64>) -> Self {
        let info = SourceInfo { nodata: Some(-9999.0), block_rows: 1, ..info(width, height, sample_type) };
        Self { info, heights }
    }

    /// Height of the sample of the window that is nearest to a place.
    fn nearest(&self, (x, y): At, extent: &Extent) -> f64 {
        let within = |value: i64, (first, last): (u32, u32)| value.clamp(first.into(), last.into());
        let (x, y) = (within(x, extent.columns), within(y, extent.rows));
        self.heights[y as usize * self.info.width as usize + x as usize]
    }
}

impl std::fmt::Debug for Raster {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let SourceInfo { width, height, sample_type, .. } = self.info;
        write!(f, "{width} x {height} {sample_type:?} {:?}", self.heights)
    }
}

impl Source for Raster {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Window> {
        let heights = rows.flat_map(|y| {
            let width = self.info.width;
            columns.clone().map(move |x| self.heights[(y * width + x) as usize])
        });
        let heights = heights.map(|z| if z.is_nan() { -9999.0 } else { z });
        let samples = match self.info.sample_type {
            SampleType::Int16 => Samples::Int16(heights.map(|z| z as i16).collect()),
            SampleType::Float32 => Samples::Float32(heights.map(|z| z as f32).collect()),
            _ => Samples::Float64(heights.collect()),
        };
        Ok(Window { samples, mask: None })
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        Ok(Fingerprint { files: Vec::new() })
    }
}

fn turn(a: At, b: At, p: At) -> i64 {
    (b.0 - a.0) * (p.1 - a.1) - (b.1 - a.1) * (p.0 - a.0)
}

/// Samples of the window in a triangle.
fn samples([a, b, c]: [At; 3], extent: &Extent) -> Vec<At> {
    let (west, east) = (a.0.min(b.0).min(c.0), a.0.max(b.0).max(c.0));
    let (north, south) = (a.1.min(b.1).min(c.1), a.1.max(b.1).max(c.1));
    let all = (north..=south).flat_map(|y| (west..=east).map(move |x| (x, y)));
    all.filter(|&p| {
        let signs = [turn(a, b, p), turn(b, c, p), turn(c, a, p)];
        let is_in = signs.iter().all(|&s| s >= 0) || signs.iter().all(|&s| s <= 0);
        let within =
            |value: i64, (first, last): (u32, u32)| (i64::from(first)..=last.into()).contains(&value);
        is_in && within(p.0, extent.columns) && within(p.1, extent.rows)
    })
    .collect()
}

/// True if a triangle has an area in the window: if the middle of a cell's quarter lies in both.
fn has_area(corners: [At; 3], extent: &Extent) -> bool {
    let common = |value: fn(At) -> i64, (first, last): (u32, u32)| {
        let values = corners.map(value);
        let (least, most) = (values.iter().min().unwrap(), values.iter().max().unwrap());
        *least.max(&first.into())..*most.min(&last.into())
    };
    let (columns, rows) = (common(|p| p.0, extent.columns), common(|p| p.1, extent.rows));
    let cells = rows.flat_map(|y| columns.clone().map(move |x| (6 * x, 6 * y)));
    let [a, b, c] = corners.map(|(x, y)| (6 * x, 6 * y));
    cells.flat_map(|(x, y)| [(x + 3, y + 1), (x + 1, y + 3), (x + 5, y + 3), (x + 3, y + 5)]).any(|p| {
        let signs = [turn(a, b, p), turn(b, c, p), turn(c, a, p)];
        signs.iter().all(|&s| s > 0) || signs.iter().all(|&s| s < 0)
    })
}

/// What a triangle is off by; infinite if it is part valid and part void, `None` if it is all void.
fn off(raster: &Raster, corners: [At; 3], extent: &Extent) -> Option<f64> {
    let heights = corners.map(|corner| raster.nearest(corner, extent));
    let inside = samples(corners, extent);
    let all = inside.iter().map(|&p| raster.nearest(p, extent)).chain(heights);
    let (void, valid): (Vec<f64>, Vec<f64>) = all.partition(|z| z.is_nan());
    if valid.is_empty() || !has_area(corners, extent) {
        return None;
    }
    if !void.is_empty() {
        return Some(f64::INFINITY);
    }
    let [a, b, c] = corners;
    let total = turn(a, b, c) as f64;
    let far = inside.iter().map(|&p| {
        let weights = [turn(p, b, c) as f64, turn(a, p, c) as f64, turn(a, b, p) as f64];
        let plane: f64 = weights.iter().zip(heights).map(|(w, z)| w * z).sum::<f64>() / total;
        (raster.nearest(p, extent) - plane).abs()
    });
    Some(far.fold(0.0, f64::max))
}

/// The mesh by its definition: a vertex is in if a triangle that it splits is off by more than
/// `error`, or if it is the right angle of a triangle whose vertex is in.
fn expected(raster: &Raster, side: i64, extent: &Extent, error: f64) -> BTreeSet<[At; 3]> {
    let mut splits: BTreeMap<At, Vec<[At; 3]>> = BTreeMap::new();
    let roots = [[(0, 0), (side, 0), (side, side)], [(side, side), (0, side), (0, 0)]];
    let mut stack = roots.to_vec();
    while let Some([a, apex, b]) = stack.pop() {
        if (a.0 - b.0).abs().max((a.1 - b.1).abs()) < 2 {
            continue;
        }
        let middle = ((a.0 + b.0) / 2, (a.1 + b.1) / 2);
        splits.entry(middle).or_default().push([a, apex, b]);
        stack.extend([[apex, middle, a], [b, middle, apex]]);
    }
    let mut is_in: BTreeSet<At> = BTreeSet::new();
    let needs = |triangle: &[At; 3]| off(raster, *triangle, extent).is_some_and(|off| off > error);
    let mut waiting: Vec<At> =
        splits.iter().filter(|(_, of)| of.iter().any(needs)).map(|(&v, _)| v).collect();
    while let Some(vertex) = waiting.pop() {
        if is_in.insert(vertex) {
            waiting.extend(splits.get(&vertex).into_iter().flatten().map(|[_, apex, _]| *apex));
        }
    }
    let mut drawn = BTreeSet::new();
    let mut stack = roots.to_vec();
    while let Some([a, apex, b]) = stack.pop() {
        let middle = ((a.0 + b.0) / 2, (a.1 + b.1) / 2);
        let can_split = (a.0 - b.0).abs().max((a.1 - b.1).abs()) >= 2;
        if can_split && is_in.contains(&middle) {
            stack.extend([[apex, middle, a], [b, middle, apex]]);
        } else {
            let mut corners = [a, apex, b];
            corners.sort_unstable();
            drawn.insert(corners);
        }
    }
    drawn
}

struct Drawn {
    places: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

fn draw(path: &Path, extent: Extent, error: f64) -> Drawn {
    let reader = Reader::open(path).expect("open");
    let mesh = Nested::new(&reader, Some(&extent.rect()), error, &Silent).expect("mesh");
    let mut drawn = Drawn { places: Vec::new(), triangles: Vec::new() };
    mesh.each_vertex(&mut |places| {
        drawn.places.extend_from_slice(places);
        Ok(())
    })
    .expect("vertices");
    let out = &mut |triangles: &[[u32; 3]]| {
        drawn.triangles.extend_from_slice(triangles);
        Ok(())
    };
    mesh.each_triangle(out, &Silent).expect("triangles");
    assert_eq!(drawn.places.len() as u64, mesh.vertex_count());
    assert_eq!(drawn.triangles.len() as u64, mesh.triangle_count());
    drawn
}

/// What every mesh must be: conforming, upward, without unused or double vertices; its border
/// lies on the sides of the window or on outlines of voids.
fn check_shape(mesh: &Drawn, raster: &Raster, extent: &Extent) {
    let key = |place: &[f64; 3]| ((2.0 * place[0]) as i64, (2.0 * place[1]) as i64);
    let places: BTreeSet<At> = mesh.places.iter().map(key).collect();
    assert_eq!(places.len(), mesh.places.len(), "two vertices in one place");
    let used: BTreeSet<u32> = mesh.triangles.iter().flatten().copied().collect();
    assert_eq!(used.len(), mesh.places.len(), "a vertex that no triangle has");
    let at = |number: u32| key(&mesh.places[number as usize]);
    let mut edges: BTreeMap<(u32, u32), u32> = BTreeMap::new();
    let mut area = 0;
    for &[a, b, c] in &mesh.triangles {
        let twice = turn(at(a), at(b), at(c));
        assert!(twice < 0, "rows run south: a negative area is counter-clockwise from above");
        area -= twice;
        for edge in [(a, b), (b, c), (c, a)] {
            *edges.entry(edge).or_default() += 1;
        }
    }
    for (&(a, b), &count) in &edges {
        assert_eq!(count, 1, "a side twice in one sense");
        if edges.contains_key(&(b, a)) {
            continue;
        }
        let (p, q) = (at(a), at(b));
        let on = |value: fn(At) -> i64, line: u32| {
            value(p) == 2 * i64::from(line) && value(q) == 2 * i64::from(line)
        };
        let (columns, rows) = (extent.columns, extent.rows);
        let on_window =
            on(|p| p.0, columns.0) || on(|p| p.0, columns.1) || on(|p| p.1, rows.0) || on(|p| p.1, rows.1);
        let is_outline = [p, q].iter().all(|p| p.0 % 2 != 0 || p.1 % 2 != 0);
        assert!(on_window || is_outline, "a border inside: {p:?} {q:?}");
    }
    // The area that is shown at full resolution.
    let mut shown = 0;
    for y in i64::from(extent.rows.0)..extent.rows.1.into() {
        for x in i64::from(extent.columns.0)..extent.columns.1.into() {
            let corners = if (x + y) % 2 == 0 {
                [[(x, y), (x + 1, y), (x + 1, y + 1)], [(x, y), (x + 1, y + 1), (x, y + 1)]]
            } else {
                [[(x, y), (x + 1, y), (x, y + 1)], [(x + 1, y), (x + 1, y + 1), (x, y + 1)]]
            };
            for triangle in corners {
                let valid = triangle.iter().filter(|&&p| !raster.nearest(p, extent).is_nan()).count();
                shown += [0, 1, 3, 4][valid];
            }
        }
    }
    assert_eq!(area, shown, "the area that is drawn");
}

fn compare(raster: &Raster, extent: Extent, error: f64, folder: &Path) {
    let path = folder.join("terrain.rlv");
    let options = BuildOptions { tile: 16, patch: 4, ..BuildOptions::default() };
    pipeline::build(raster, &path, &options, &Silent).expect("build");
    let mesh = draw(&path, extent, error);
    std::fs::remove_file(&path).expect("remove");
    check_shape(&mesh, raster, &extent);
    let header_side = raster.info.width.max(raster.info.height) - 1;
    let side = 16 * i64::from(header_side.div_ceil(16).next_power_of_two().max(1));
    let expected = expected(raster, side, &extent, error);
    let key = |number: u32| {
        let place = mesh.places[number as usize];
        (place[0] as i64, place[1] as i64)
    };
    let inside = |p: &At| {
        let within =
            |value: i64, (first, last): (u32, u32)| (i64::from(first)..=last.into()).contains(&value);
        within(p.0, extent.columns) && within(p.1, extent.rows)
    };
    // Triangles that are not cut, and the height of their corners.
    let whole =
        |triangle: &&[At; 3]| triangle.iter().all(|p| inside(p) && !raster.nearest(*p, &extent).is_nan());
    let expected: BTreeSet<[At; 3]> = expected.iter().filter(whole).copied().collect();
    let mut found = BTreeSet::new();
    for triangle in &mesh.triangles {
        let mut corners = triangle.map(key);
        corners.sort_unstable();
        let is_whole = triangle.iter().all(|&number| {
            let place = mesh.places[number as usize];
            place[0].fract() == 0.0 && place[1].fract() == 0.0
        });
        if is_whole && expected.contains(&corners) {
            found.insert(corners);
            for &number in triangle {
                let place = mesh.places[number as usize];
                assert_eq!(place[2], raster.nearest(key(number), &extent), "height at {place:?}");
            }
        }
    }
    let missing: Vec<_> = expected.difference(&found).collect();
    assert!(missing.is_empty(), "triangles that are not drawn: {missing:?}");
}

prop_compose! {
    /// Rough or smooth terrain with spikes, cliffs and voids.
    pub fn terrain()(
        size in (2_u32..60, 2_u32..60), kind in 0_usize..3, rough in 0.0_f64..3.0, voids in 0_u32..3,
        seed: u64, window: [u32; 4], full: bool, error in 0.0_f64..20.0,
    ) -> (Raster, Extent, f64) {
        let hash = |x: u32, y: u32, salt: u64| {
            let mut state = seed ^ salt ^ (u64::from(x) << 32 | u64::from(y)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            state = (state ^ state >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            state = (state ^ state >> 32).wrapping_mul(0x94D0_49BB_1331_11EB);
            state >> 33
        };
        let sample_type = [SampleType::Int16, SampleType::Float32, SampleType::Float64][kind];
        let heights = (0..size.1).flat_map(|y| (0..size.0).map(move |x| (x, y))).map(|(x, y)| {
            let (u, v) = (f64::from(x), f64::from(y));
            let mut z = 40.0 * (u / 13.0).sin() * (v / 9.0).cos() + rough * (hash(x, y, 1) % 16) as f64;
            if hash(x, y, 2).is_multiple_of(97) { z += 150.0; }
            if u + 2.0 * v > 70.0 { z += 60.0; }
            let void = (voids > 0 && hash(x / 5, y / 4, 3).is_multiple_of(9)) || (voids > 1 && hash(x, y, 4).is_multiple_of(41));
            match (void, sample_type) {
                (true, _) => f64::NAN,
                (_, SampleType::Int16) => z.round(),
                (_, SampleType::Float32) => f64::from(z as f32),
                _ => z,
            }
        }).collect::<Vec<_>>();
        let cut = |a: u32, b: u32, size: u32| {
            let (a, b) = (a % size, b % size);
            if full || a == b { (0, size - 1) } else { (a.min(b), a.max(b)) }
        };
        let extent = Extent { columns: cut(window[0], window[1], size.0), rows: cut(window[2], window[3], size.1) };
        let mut heights = heights;
        heights[0] = 1.0;
        (Raster::new(size, sample_type, heights), extent, (4.0 * error).round() / 4.0)
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(250))]
    #[test]
    fn the_mesh_is_what_its_definition_says((raster, extent, error) in terrain()) {
        let folder = tempfile::tempdir().expect("folder");
        compare(&raster, extent, error, folder.path());
    }
}
