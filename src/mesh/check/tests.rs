//! The check against brute force: every mesh triangle cut by every triangle of the surface, by code
//! that shares nothing with it; and against answers by hand.

use std::ops::Range;

use proptest::prelude::*;

use super::*;
use crate::progress::Silent;

/// A terrain in memory: NaN where void.
struct Terrain {
    size: [u32; 2],
    samples: Vec<f64>,
    falls: bool,
}

impl Heights for Terrain {
    fn size(&self) -> [u32; 2] {
        self.size
    }

    fn window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Vec<f64>> {
        Ok(rows.flat_map(|y| columns.clone().map(move |x| self.at(x.into(), y.into()))).collect())
    }

    fn falls(&self) -> bool {
        self.falls
    }
}

/// A corner of the surface, or of a piece of it: column, row, height, validity.
type Corner = [f64; 4];

impl Terrain {
    fn at(&self, x: i64, y: i64) -> f64 {
        let [width, height] = self.size.map(i64::from);
        let is_within = (0..width).contains(&x) && (0..height).contains(&y);
        if is_within { self.samples[(y * width + x) as usize] } else { f64::NAN }
    }

    /// Height and validity that a corner of the surface has, if it has any.
    fn corner(&self, x: i64, y: i64) -> Corner {
        let own = self.at(x, y);
        if !own.is_nan() {
            return [x as f64, y as f64, own, 1.0];
        }
        let sign = if self.falls { -1.0 } else { 1.0 };
        let mut around: Vec<f64> = (0..9).map(|i| sign * self.at(x + i % 3 - 1, y + i / 3 - 1)).collect();
        around.retain(|height| !height.is_nan());
        around.sort_by(f64::total_cmp);
        let median = if around.is_empty() { 0.0 } else { sign * around[(around.len() - 1) / 2] };
        [x as f64, y as f64, median, 0.0]
    }

    /// The shown parts of all triangles of the surface.
    fn pieces(&self) -> Vec<Vec<Corner>> {
        let [width, height] = self.size.map(i64::from);
        let mut pieces = Vec::new();
        for (x, y) in (0..height - 1).flat_map(|y| (0..width - 1).map(move |x| (x, y))) {
            let [nw, ne, sw, se] =
                [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)].map(|(x, y)| self.corner(x, y));
            let both =
                if (x + y) % 2 == 0 { [[nw, ne, se], [nw, se, sw]] } else { [[nw, ne, sw], [ne, se, sw]] };
            pieces.extend(both.map(|triangle| cut(&triangle, |corner| corner[3] - 0.5)));
        }
        pieces.retain(|piece| piece.len() > 2);
        pieces
    }
}

/// The part of a polygon where a linear function of its corners is not below 0.
fn cut(polygon: &[Corner], side: impl Fn(&Corner) -> f64) -> Vec<Corner> {
    let mut out = Vec::new();
    for (i, a) in polygon.iter().enumerate() {
        let b = &polygon[(i + 1) % polygon.len()];
        let (at_a, at_b) = (side(a), side(b));
        // A point of contact counts, whatever rounding does to it.
        if at_a >= -1e-12 {
            out.push(*a);
        }
        if at_a * at_b < 0.0 {
            let t = at_a / (at_a - at_b);
            out.push([0, 1, 2, 3].map(|i| a[i] + t * (b[i] - a[i])));
        }
    }
    out
}

/// Twice the area of three places, by columns and rows.
fn turn(a: &[f64], b: &[f64], c: &[f64]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Largest distance of mesh and terrain, piece by piece.
fn largest(terrain: &Terrain, mesh: &[[[f64; 3]; 3]]) -> f64 {
    let pieces = terrain.pieces();
    let mut largest = 0.0_f64;
    for [a, b, c] in mesh {
        let area = turn(a, b, c);
        if area >= 0.0 {
            continue;
        }
        let weights = |p: &Corner| [turn(p, b, c) / area, turn(a, p, c) / area, turn(a, b, p) / area];
        for piece in &pieces {
            let mut common = piece.clone();
            for corner in 0..3 {
                common = cut(&common, |p| weights(p)[corner]);
            }
            for p in common {
                let [u, v, w] = weights(&p);
                largest = largest.max((u * a[2] + v * b[2] + w * c[2] - p[2]).abs());
            }
        }
    }
    largest
}

/// How many triangles have a sample, and how many have it inside.
fn over(mesh: &[[[f64; 3]; 3]], x: f64, y: f64) -> (usize, usize) {
    let mut counts = (0, 0);
    for [a, b, c] in mesh.iter().filter(|[a, b, c]| turn(a, b, c) < 0.0) {
        let p = [x, y];
        let turns = [turn(a, b, &p), turn(b, c, &p), turn(c, a, &p)];
        counts.0 += usize::from(turns.iter().all(|turn| *turn <= 0.0));
        counts.1 += usize::from(turns.iter().all(|turn| *turn < 0.0));
    }
    counts
}

/// Numbers that look random.
struct Random(u64);

impl Random {
    fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % end
    }

    fn terrain(&mut self, most: u64) -> Terrain {
        let size = [0, 1].map(|_| 2 + self.below(most) as u32);
        let voids = [0, 0, 10, 40, 80][self.below(5) as usize];
        let mut sample = || if self.below(100) < voids { f64::NAN } else { self.below(2000) as f64 / 16.0 };
        let samples = (0..size[0] * size[1]).map(|_| sample()).collect();
        Terrain { size, samples, falls: self.below(2) == 0 }
    }

    /// A place with coordinates in eighths, a little beyond the terrain too, or at a half sample.
    fn point(&mut self, size: [u32; 2], unit: u64) -> [f64; 3] {
        let [x, y] =
            size.map(|side| (self.below((u64::from(side) + 1) * unit + 1) as f64) / unit as f64 - 1.0);
        [x, y, self.below(2000) as f64 / 16.0]
    }
}

/// The corners of all triangles, and the numbers of three corners each.
fn indexed(mesh: &[[[f64; 3]; 3]]) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    (mesh.concat(), (0..mesh.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

fn report(terrain: &Terrain, mesh: &[[[f64; 3]; 3]], block: u32) -> Report {
    let (vertices, triangles) = indexed(mesh);
    let window = Rect { columns: 0..terrain.size[0], rows: 0..terrain.size[1] };
    let options = Options { window: Some(window), block, ..Options::default() };
    check(&vertices, &triangles, terrain, &options, &Silent).unwrap()
}

/// Fails unless the check finds what brute force finds, whatever the blocks.
fn same_as_brute_force(terrain: &Terrain, mesh: &[[[f64; 3]; 3]], block: u32) {
    let found = report(terrain, mesh, 256);
    assert_eq!(found, report(terrain, mesh, block));
    let true_largest = largest(terrain, mesh);
    assert!(
        (found.largest_m - true_largest).abs() < 1e-9 * (1.0 + true_largest),
        "{} {true_largest}",
        found.largest_m
    );
    let (mut uncovered, mut voids, mut twice, mut samples) = (0, 0, 0, 0);
    for y in 0..terrain.size[1] {
        for x in 0..terrain.size[0] {
            let (covers, inside) = over(mesh, x.into(), y.into());
            let is_void = terrain.at(x.into(), y.into()).is_nan();
            samples += u64::from(!is_void);
            uncovered += u64::from(!is_void && covers == 0);
            voids += u64::from(is_void && covers > 0);
            twice += u64::from(inside > 1);
        }
    }
    let counts = (found.samples, found.uncovered, found.covered_voids, found.twice);
    assert_eq!(counts, (samples, uncovered, voids, twice));
}

/// A mesh of the terrain's own triangles, cut at the outline.
fn exact(terrain: &Terrain) -> Vec<[[f64; 3]; 3]> {
    let place = |corner: &Corner| [corner[0], corner[1], corner[2]];
    let fan = |piece: Vec<Corner>| {
        (2..piece.len()).map(move |i| [0, i, i - 1].map(|i| place(&piece[i]))).collect::<Vec<_>>()
    };
    let mut mesh: Vec<_> = terrain.pieces().into_iter().flat_map(fan).collect();
    mesh.retain(|[a, b, c]| turn(a, b, c) != 0.0);
    mesh
}

/// A mesh over the whole terrain: its triangles are split at random places, and sides turned over.
fn random_mesh(random: &mut Random, size: [u32; 2], splits: u64) -> Vec<[[f64; 3]; 3]> {
    let [east, south] = size.map(|side| f64::from(side) - 1.0);
    let mut vertices = vec![[0.0, 0.0], [east, 0.0], [0.0, south], [east, south]];
    let mut triangles = vec![[0, 2, 3], [0, 3, 1]];
    for _ in 0..splits {
        let [a, b, c] = triangles.swap_remove(random.below(triangles.len() as u64) as usize);
        let mut weights = [0, 1, 2].map(|_| 1.0 + random.below(9) as f64);
        let sum: f64 = weights.iter().sum();
        weights = weights.map(|weight| weight / sum);
        let axis = |axis: usize| {
            let at = weights[0] * vertices[a][axis]
                + weights[1] * vertices[b][axis]
                + weights[2] * vertices[c][axis];
            if sum % 2.0 == 0.0 { at } else { (8.0 * at).round() / 8.0 }
        };
        let new: [f64; 2] = [axis(0), axis(1)];
        let d = vertices.len();
        let three = [[a, b, d], [b, c, d], [c, a, d]];
        vertices.push(new);
        let is_up = |t: &[usize; 3]| turn(&vertices[t[0]], &vertices[t[1]], &vertices[t[2]]) < -1e-3;
        if three.iter().all(is_up) {
            triangles.extend(three);
        } else {
            vertices.pop();
            triangles.push([a, b, c]);
        }
        let at = random.below(triangles.len() as u64) as usize;
        turn_over(&mut triangles, &vertices, at);
    }
    let heights: Vec<f64> = vertices.iter().map(|_| random.below(2000) as f64 / 16.0).collect();
    triangles.iter().map(|t| t.map(|i| [vertices[i][0], vertices[i][1], heights[i]])).collect()
}

/// Turns over the first side of a triangle if it can be.
fn turn_over(triangles: &mut [[usize; 3]], vertices: &[[f64; 2]], at: usize) {
    let [a, b, c] = triangles[at];
    let rotated = |[p, q, r]: [usize; 3]| [[p, q, r], [q, r, p], [r, p, q]];
    let found = triangles.iter().enumerate().find_map(|(other, &t)| {
        rotated(t).into_iter().find(|[p, q, _]| (*p, *q) == (b, a)).map(|[_, _, d]| (other, d))
    });
    let Some((other, d)) = found else { return };
    let both = [[a, d, c], [d, b, c]];
    if both.iter().all(|t| turn(&vertices[t[0]], &vertices[t[1]], &vertices[t[2]]) < -1e-3) {
        (triangles[at], triangles[other]) = (both[0], both[1]);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    /// Folded, overlapping, crossing and cracked meshes, of places of all kinds.
    #[test]
    fn heaps_of_triangles_are_checked_as_by_brute_force(seed in any::<u64>(), block in 1_u32..9) {
        let mut random = Random(seed);
        let terrain = random.terrain(7);
        let unit = [1, 2, 8][random.below(3) as usize];
        let count = 1 + random.below(12);
        let mesh: Vec<_> = (0..count).map(|_| [0; 3].map(|_| random.point(terrain.size, unit))).collect();
        same_as_brute_force(&terrain, &mesh, block);
    }

    #[test]
    fn whole_meshes_are_checked_as_by_brute_force(seed in any::<u64>(), block in 1_u32..9) {
        let mut random = Random(seed);
        let terrain = random.terrain(8);
        let splits = random.below(30);
        let mesh = random_mesh(&mut random, terrain.size, splits);
        let found = report(&terrain, &mesh, 256);
        prop_assert_eq!(&found, &report(&terrain, &mesh, block));
        let largest = largest(&terrain, &mesh);
        prop_assert!((found.largest_m - largest).abs() < 1e-9 * (1.0 + largest), "{} {}", found.largest_m, largest);
        prop_assert_eq!((found.uncovered, found.twice, found.outside), (0, 0, 0));
        prop_assert_eq!((found.flipped, found.vertical, found.degenerate), (0, 0, 0));
    }

    /// The terrain's own triangles are off by nothing, to the outline; a vertex that is moved by so
    /// much, by so much.
    #[test]
    fn a_moved_vertex_is_found(seed in any::<u64>(), block in 1_u32..9, by in -50_i32..50) {
        let mut random = Random(seed);
        let terrain = random.terrain(8);
        let mut mesh = exact(&terrain);
        prop_assume!(!mesh.is_empty());
        let found = report(&terrain, &mesh, block);
        prop_assert!(found.largest_m <= found.rounding_m && found.keeps(0.0), "{:?}", found);
        let alone = terrain.samples.iter().filter(|height| !height.is_nan()).count() as u64;
        prop_assert_eq!((found.uncovered, found.covered_voids, found.twice, found.compared), (0, 0, 0, alone));
        let place = mesh[random.below(mesh.len() as u64) as usize][random.below(3) as usize];
        for corner in mesh.iter_mut().flatten().filter(|corner| corner[..2] == place[..2]) {
            corner[2] += f64::from(by);
        }
        let found = report(&terrain, &mesh, block);
        prop_assert!((found.largest_m - f64::from(by).abs()).abs() <= found.rounding_m, "{:?}", found);
        if by != 0 {
            prop_assert_eq!(found.at, [place[0], place[1]]);
        }
    }
}

#[test]
fn the_other_diagonal_is_off_in_the_middle() {
    let terrain = Terrain { size: [2, 2], samples: vec![3.0, 10.0, 6.0, 1.0], falls: false };
    let [nw, ne, sw, se] = [[0.0, 0.0, 3.0], [1.0, 0.0, 10.0], [0.0, 1.0, 6.0], [1.0, 1.0, 1.0]];
    let found = report(&terrain, &[[nw, sw, ne], [ne, sw, se]], 256);
    // (3 - 10 - 6 + 1) / 2: at samples the mesh is exact.
    assert_eq!(
        (found.largest_m, found.at, found.largest_at_samples_m, found.rmse_m),
        (6.0, [0.5, 0.5], 0.0, 0.0)
    );
    let found = report(&terrain, &[[nw, sw, se], [nw, se, ne]], 256);
    assert_eq!((found.largest_m, found.smallest_angle_deg), (0.0, 45.0));
    assert!(found.is_sound(Allowed::default()) && found.keeps(0.0));
}

#[test]
fn a_flat_mesh_is_off_by_the_hill() {
    let samples = vec![0.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 0.0];
    let terrain = Terrain { size: [3, 3], samples, falls: false };
    let [nw, ne, sw, se] = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [2.0, 2.0, 0.0]];
    let mesh = [[nw, sw, se], [nw, se, ne]];
    let found = report(&terrain, &mesh, 1);
    assert_eq!((found.largest_m, found.at, found.compared, found.samples), (4.0, [1.0, 1.0], 9, 9));
    assert!((found.rmse_m - 4.0 / 3.0).abs() < 1e-12);
    assert!(found.keeps(4.0) && !found.keeps(3.999_999));
}

#[test]
fn triangles_that_are_none_are_counted() {
    let terrain = Terrain { size: [3, 3], samples: vec![0.0; 9], falls: false };
    let vertices = [
        [0.0, 0.0, 9.0],
        [2.0, 0.0, 9.0],
        [0.0, 2.0, 9.0],
        [1.0, 0.0, 5.0],
        [5.0, 5.0, 0.0],
        [0.0, 0.0, -3.0],
    ];
    let triangles = [[0, 1, 2], [0, 1, 3], [0, 0, 1], [0, 5, 1], [0, 2, 1], [0, 2, 1]];
    let found = check(&vertices, &triangles, &terrain, &Options::default(), &Silent).unwrap();
    assert_eq!((found.flipped, found.vertical, found.degenerate, found.unused_vertices), (1, 2, 1, 1));
    // The window ends with the mesh; its south-east half is not covered.
    assert_eq!((found.window.columns.clone(), found.window.rows.clone()), (0..3, 0..3));
    assert_eq!((found.uncovered, found.first_uncovered, found.twice), (3, Some([2, 1]), 0));
    assert!(!found.is_sound(Allowed { solid: true, outside: true }));
    let vertices = [[-4.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 9.0, 0.0]];
    let found = check(&vertices, &[[0, 2, 1], [0, 3, 1]], &terrain, &Options::default(), &Silent).unwrap();
    assert_eq!((found.outside, found.twice), (2, 1), "{found:?}");
}

#[test]
fn a_solid_may_have_a_floor_and_walls() {
    let terrain = Terrain { size: [2, 2], samples: vec![3.0, 10.0, 6.0, 1.0], falls: false };
    let [nw, ne, sw, se] = [[0.0, 0.0, 3.0], [1.0, 0.0, 10.0], [0.0, 1.0, 6.0], [1.0, 1.0, 1.0]];
    let down = |[x, y, _]: [f64; 3]| [x, y, -5.0];
    let mut mesh = vec![[nw, sw, se], [nw, se, ne], [nw, se, sw].map(down), [nw, ne, se].map(down)];
    for (a, b) in [(sw, nw), (nw, ne), (ne, se), (se, sw)] {
        mesh.extend([[a, b, down(a)], [b, down(b), down(a)]]);
    }
    let found = report(&terrain, &mesh, 256);
    assert_eq!((found.largest_m, found.flipped, found.vertical, found.degenerate), (0.0, 2, 8, 0));
    assert!(!found.is_sound(Allowed::default()) && found.is_sound(Allowed { solid: true, outside: false }));
}

/// The outline runs half way; the void sample has the lower median of those around it, of depths
/// that of the depths.
#[test]
fn voids_have_the_lower_median() {
    let samples = vec![1.0, 2.0, 4.0, 8.0, f64::NAN, 16.0, 32.0, 64.0, 128.0];
    let corner = [[0.0, 0.0, 0.0], [0.0, 0.75, 0.0], [0.75, 0.0, 0.0]];
    for (falls, fill) in [(false, 8.0), (true, 16.0)] {
        let terrain = Terrain { size: [3, 3], samples: samples.clone(), falls };
        // Along the diagonal from the corner (1) to the void, to the middle, where both count half;
        // but the side of the mesh is nearer: 3/8 of the way.
        let found = report(&terrain, &[corner], 256);
        let there = 1.0 + 0.375 * (fill - 1.0);
        let on_the_side = 1.0 + 0.75 * 7.0;
        let wanted = f64::max(there, on_the_side);
        assert_eq!((found.largest_m, found.covered_voids), (wanted, 0));
    }
}

#[test]
fn hostile_meshes_are_refused() {
    let terrain = Terrain { size: [3, 3], samples: vec![0.0; 9], falls: false };
    let good = [[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [2.0, 0.0, 0.0]];
    let of = |vertices: &[[f64; 3]], triangles: &[[u32; 3]]| {
        check(vertices, triangles, &terrain, &Options::default(), &Silent)
    };
    assert!(of(&good, &[[0, 1, 2]]).is_ok());
    for wrong in [f64::NAN, f64::INFINITY, -1e300, 1e13] {
        for axis in 0..3 {
            let mut vertices = good;
            vertices[1][axis] = wrong;
            let error = of(&vertices, &[[0, 1, 2]]).unwrap_err().to_string();
            assert!(error.contains("vertex 1"), "{error}");
        }
    }
    let error = of(&good, &[[0, 1, 2], [0, 1, 3]]).unwrap_err().to_string();
    assert!(error.contains("triangle 1") && error.contains("below 3"), "{error}");
    assert!(of(&good, &[]).is_err() && of(&[], &[]).is_err());
    let error = of(&good.map(|[x, y, z]| [x + 500.0, y, z]), &[[0, 1, 2]]).unwrap_err().to_string();
    assert!(error.contains("does not lie over"), "{error}");
    let window = Some(Rect { columns: 0..4, rows: 0..3 });
    let options = Options { window, ..Options::default() };
    assert!(check(&good, &[[0, 1, 2]], &terrain, &options, &Silent).is_err());
}

#[test]
fn huge_triangles_take_no_longer_than_the_raster_is_large() {
    let terrain = Terrain { size: [300, 200], samples: vec![1.0; 60_000], falls: false };
    let far = 1e11;
    let mesh = [[[-far, -far, 0.0], [0.5, far, 0.0], [far, -far, 0.0]]; 50];
    let begun = std::time::Instant::now();
    let found = report(&terrain, &mesh, 64);
    assert!(begun.elapsed().as_secs() < 30);
    assert_eq!((found.twice, found.uncovered, found.outside, found.largest_m), (60_000, 0, 50, 1.0));
    // Far more pieces than any mesh has are refused.
    let terrain = Terrain { size: [3000, 3000], samples: vec![1.0; 9_000_000], falls: false };
    let (vertices, triangles) = (mesh[0], vec![[0, 1, 2]; 100_000]);
    let options = Options { block: 8, ..Options::default() };
    assert!(matches!(check(&vertices, &triangles, &terrain, &options, &Silent), Err(Error::Limit { .. })));
}

#[test]
fn the_report_is_the_same_on_any_number_of_threads() {
    let mut random = Random(7);
    let size = [150, 130];
    let sample = |random: &mut Random| {
        if random.below(20) == 0 { f64::NAN } else { random.below(90_000) as f64 / 77.0 }
    };
    let terrain = Terrain {
        size,
        samples: (0..size[0] * size[1]).map(|_| sample(&mut random)).collect(),
        falls: false,
    };
    let mesh = random_mesh(&mut random, size, 3000);
    let wanted = report(&terrain, &mesh, 256);
    for (threads, block) in [(1, 16), (2, 7), (5, 33), (3, 1000)] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool.install(|| report(&terrain, &mesh, block)), wanted);
    }
}
