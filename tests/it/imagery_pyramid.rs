//! The pyramid of pictures, held against what its documentation says, texel by texel, in float64
//! and without any cleverness.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use proptest::prelude::*;
use relevo::geo::{Crs, Geo};
use relevo::imagery::{self, GUTTER, Resolution, TexelGrid, TileSink};
use relevo::limits::Limits;
use relevo::pipeline::Silent;
use relevo::source::picture::{self, Picture, PictureInfo, PictureNote, PictureOptions, Pixels};
use relevo::source::{self, Fingerprint};
use relevo::texel::{Colour, Texels};
use relevo::{Error, TileId};

use crate::support::progress::While;

/// A lattice that fills its root square, whatever it is.
const ALL: (u32, u32) = (u32::MAX, u32::MAX);
const TILE: u32 = 64;

/// A picture in memory.
#[derive(Clone)]
struct Painting {
    info: PictureInfo,
    colour: Vec<u8>,
    alpha: Option<Vec<u8>>,
}

impl Picture for Painting {
    fn info(&self) -> &PictureInfo {
        &self.info
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> relevo::Result<Pixels> {
        let (width, channels) = (self.info.width as usize, self.info.kind.channels());
        let cut = |values: &[u8], n: usize| -> Vec<u8> {
            let row =
                |y: u32| &values[(y as usize * width + columns.start as usize) * n..][..columns.len() * n];
            rows.clone().flat_map(row).copied().collect()
        };
        let alpha = self.alpha.as_ref().map(|alpha| cut(alpha, 1));
        Ok(Pixels {
            colour: cut(&self.colour, channels),
            alpha: alpha.filter(|a| a.iter().any(|&a| a < 255)),
        })
    }

    fn fingerprint(&self) -> relevo::Result<Fingerprint> {
        Ok(Fingerprint { files: Vec::new() })
    }
}

/// Numbers that look random and are the same each time.
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 >> 33
    }
}

fn painting(size: (u32, u32), kind: Colour, sheer: bool, transform: [f64; 6], seed: u64) -> Painting {
    let mut dice = Dice(seed);
    let count = (size.0 * size.1) as usize;
    let colour = (0..count * kind.channels()).map(|_| dice.next() as u8).collect();
    // Patches of full and of no alpha, and some in between.
    let alpha = (0..count).map(|index| {
        let (x, y) = (index as u32 % size.0, index as u32 / size.0);
        match ((x / 9 * 7 + y / 5 * 11 + seed as u32) % 5, dice.next()) {
            (0, _) => 0,
            (1, random) => random as u8,
            _ => 255,
        }
    });
    let alpha = sheer.then(|| alpha.collect());
    let geo = Geo { transform: Some(transform), ..Geo::default() };
    let note = PictureNote { name: format!("painting {seed}"), ..PictureNote::default() };
    Painting {
        info: PictureInfo {
            width: size.0,
            height: size.1,
            kind,
            has_alpha: alpha.is_some(),
            geo,
            note,
            warnings: Vec::new(),
        },
        colour,
        alpha,
    }
}

/// All tiles of a pyramid.
#[derive(Default)]
struct Shelf(Mutex<BTreeMap<TileId, (u8, Texels)>>);

impl TileSink for Shelf {
    fn tile(&self, id: TileId, children: u8, texels: Texels) -> relevo::Result<()> {
        let before = self.0.lock().expect("alone").insert(id, (children, texels));
        assert!(before.is_none(), "{id} twice");
        Ok(())
    }
}

type Tiles = BTreeMap<TileId, (u8, Texels)>;

/// Over a lattice whose sample (c, r) stands at world (c, -r), unless `geo` says otherwise.
fn build(pictures: &[Painting], geo: &Geo, intervals: u64) -> relevo::Result<Tiles> {
    build_over(pictures, geo, intervals, ALL)
}

fn build_over(
    pictures: &[Painting],
    geo: &Geo,
    intervals: u64,
    samples: (u32, u32),
) -> relevo::Result<Tiles> {
    let pictures: Vec<Box<dyn Picture>> =
        pictures.iter().map(|picture| Box::new(picture.clone()) as Box<dyn Picture>).collect();
    let shelf = Shelf::default();
    let grid = TexelGrid { tile: TILE, intervals, samples };
    let report = imagery::build(
        &pictures,
        geo,
        &grid,
        Resolution::Closest,
        &shelf,
        &While::new(|done, total| {
            assert!(done <= total);
            true
        }),
    )?;
    let tiles = shelf.0.into_inner().expect("alone");
    for (level, &count) in report.tiles.iter().enumerate() {
        assert_eq!(tiles.keys().filter(|id| usize::from(id.level) == level).count() as u64, count);
    }
    Ok(tiles)
}

fn lattice() -> Geo {
    Geo { transform: Some([-0.5, 1.0, 0.0, 0.5, 0.0, -1.0]), ..Geo::default() }
}

fn linear(byte: u8) -> f64 {
    let v = f64::from(byte) / 255.0;
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

fn coded(v: f64) -> f64 {
    255.0 * if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// Light of some pixels.
struct Sum<'a> {
    picture: &'a Painting,
    light: Vec<f64>,
    opacity: f64,
    total: f64,
}

impl Sum<'_> {
    /// Adds a pixel, or the nearest one.
    fn add(&mut self, c: f64, r: f64, weight: f64) {
        let Painting { info, colour, alpha } = self.picture;
        let column = c.clamp(0.0, f64::from(info.width) - 1.0) as usize;
        let row = r.clamp(0.0, f64::from(info.height) - 1.0) as usize;
        let index = row * info.width as usize + column;
        let alpha = alpha.as_ref().map_or(1.0, |alpha| f64::from(alpha[index]) / 255.0);
        let channels = self.light.len();
        for (sum, &byte) in self.light.iter_mut().zip(&colour[index * channels..]) {
            *sum += weight * alpha * linear(byte);
        }
        self.opacity += weight * alpha;
        self.total += weight;
    }

    /// Linear between pixel centres.
    fn add_point(&mut self, (u, v): (f64, f64)) {
        let (u, v) = (u - 0.5, v - 0.5);
        for (c, r) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let (c, r) = (u.floor() + c, v.floor() + r);
            self.add(c, r, (1.0 - (u - c).abs()) * (1.0 - (v - r).abs()));
        }
    }

    /// All pixels by their share in a rectangle, of each axis by itself.
    fn add_rectangle(&mut self, centre: (f64, f64), half: (f64, f64)) {
        let share = |at: u32, centre: f64, half: f64| {
            (f64::from(at + 1).min(centre + half) - f64::from(at).max(centre - half)).max(0.0)
        };
        for r in 0..self.picture.info.height {
            for c in 0..self.picture.info.width {
                let weight = share(c, centre.0, half.0) * share(r, centre.1, half.1);
                if weight > 0.0 {
                    self.add(f64::from(c), f64::from(r), weight);
                }
            }
        }
    }
}

/// Colour (0 to 255) and alpha (0 to 1) of a texel; `None` if that hangs on the last digits.
fn oracle(picture: &Painting, geo: &Geo, texel: f64, i: f64, j: f64) -> Option<(Vec<f64>, f64)> {
    let pixel = |i: f64, j: f64| {
        let (x, y) = geo.world_from_sample(i * texel, j * texel);
        // Samples stand at pixel centres, of pictures, too.
        let (u, v) = picture.info.geo.sample_from_world(x, y).expect("plane");
        (u + 0.5, v + 0.5)
    };
    let (w, h) = (f64::from(picture.info.width), f64::from(picture.info.height));
    let centre = pixel(i + 0.5, j + 0.5);
    let near = |value: f64, edge: f64| (value - edge).abs() < 1e-5;
    if near(centre.0, 0.0) || near(centre.0, w) || near(centre.1, 0.0) || near(centre.1, h) {
        return None;
    }
    let mut sum = Sum { picture, light: vec![0.0; picture.info.kind.channels()], opacity: 0.0, total: 0.0 };
    if centre.0 < 0.0 || centre.1 < 0.0 || centre.0 > w || centre.1 > h {
        return Some((sum.light, 0.0));
    }
    let (corner, right, down) = (pixel(i, j), pixel(i + 1.0, j), pixel(i, j + 1.0));
    let (a, d) = (right.0 - corner.0, right.1 - corner.1);
    let (b, e) = (down.0 - corner.0, down.1 - corner.1);
    if d.abs() < 1e-9 && b.abs() < 1e-9 {
        // Over the texel's width, or over one pixel: outside does not count.
        sum.add_rectangle(centre, (a.abs().max(1.0) / 2.0, e.abs().max(1.0) / 2.0));
    } else {
        let (m, n) = (a.hypot(d).ceil().max(1.0), b.hypot(e).ceil().max(1.0));
        for at in 0..(m * n) as usize {
            let (x, y) = ((at % m as usize) as f64, (at / m as usize) as f64);
            sum.add_point(pixel(i + (x + 0.5) / m, j + (y + 0.5) / n));
        }
    }
    let Sum { light, opacity, total, .. } = sum;
    let colour = light.iter().map(|light| if opacity > 0.0 { coded(light / opacity) } else { 0.0 });
    Some((colour.collect(), opacity / total))
}

/// Colour and alpha of a texel of a tile, which may be in its gutter.
fn texel(texels: &Texels, i: i64, j: i64) -> (&[u8], u8) {
    let at = (j + GUTTER as i64) as usize * texels.side + (i + GUTTER as i64) as usize;
    let channels = texels.kind.channels();
    (&texels.colour[at * channels..][..channels], texels.alpha.as_ref().map_or(255, |alpha| alpha[at]))
}

/// Holds every leaf tile against the oracle, gutter and all.
fn check_leaves(tiles: &Tiles, picture: &Painting, geo: &Geo, intervals: u64) {
    for (id, (children, texels)) in tiles {
        if *children != 0 {
            continue;
        }
        let size = intervals as f64 / f64::from(TILE << id.level);
        let (left, top) = (i64::from(id.x * TILE), i64::from(id.y * TILE));
        for j in -2..i64::from(TILE) + 2 {
            for i in -2..i64::from(TILE) + 2 {
                let Some((colour, alpha)) = oracle(picture, geo, size, (left + i) as f64, (top + j) as f64)
                else {
                    continue;
                };
                let (got, opacity) = texel(texels, i, j);
                assert!(
                    (f64::from(opacity) - 255.0 * alpha).abs() <= 0.51,
                    "{id} {i} {j}: {opacity} for {alpha}"
                );
                // A colour of next to nothing is not known better than its parts.
                if opacity > 2 {
                    let off = got.iter().zip(&colour).map(|(&got, &want)| (f64::from(got) - want).abs());
                    assert!(off.fold(0.0, f64::max) <= 0.75, "{id} {i} {j}: {got:?} for {colour:?}");
                }
            }
        }
    }
}

/// Parents are means of their children, gutters what the neighbours have, and tiles exist where
/// something shows.
fn check_structure(tiles: &Tiles) {
    let side = i64::from(TILE);
    for (id, (children, texels)) in tiles {
        assert_eq!(texels.side, TILE as usize + 2 * GUTTER);
        let shows = (0..side * side).any(|at| texel(texels, at % side, at / side).1 > 0);
        assert!(shows, "{id} has nothing to show");
        assert!(id.parent().is_none_or(|parent| tiles.contains_key(&parent)));
        for quadrant in 0..4 {
            let child = tiles.get(&id.child(quadrant));
            assert_eq!(child.is_some(), children >> quadrant & 1 == 1, "{id}, child {quadrant}");
            let Some((_, child)) = child else { continue };
            let (left, top) = (i64::from(quadrant & 1) * side / 2, i64::from(quadrant >> 1) * side / 2);
            for (i, j) in (0..side * side / 4).map(|at| (at % (side / 2), at / (side / 2))) {
                check_mean(texel(texels, left + i, top + j), child, 2 * i, 2 * j);
            }
        }
        for (dx, dy) in [(1, 0), (0, 1), (1, 1), (-1, 1)] {
            let (x, y) = (i64::from(id.x) + dx, i64::from(id.y) + dy);
            if x < 0 {
                continue;
            }
            let Some((_, other)) = tiles.get(&TileId::new(id.level, x as u32, y as u32)) else { continue };
            // All texels that both have.
            for j in -2..side + 2 {
                for i in -2..side + 2 {
                    let (k, l) = (i - dx * side, j - dy * side);
                    if (-2..side + 2).contains(&k) && (-2..side + 2).contains(&l) {
                        let (a, b) = (texel(texels, i, j), texel(other, k, l));
                        assert!(
                            a.1 == b.1 && (a.1 == 0 || a.0 == b.0),
                            "{id} and {x} {y} at {i} {j}: {a:?} {b:?}"
                        );
                    }
                }
            }
        }
    }
}

fn check_mean(parent: (&[u8], u8), child: &Texels, i: i64, j: i64) {
    let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| texel(child, i + x, j + y));
    let weight: f64 = four.iter().map(|texel| f64::from(texel.1)).sum();
    if weight == 0.0 {
        assert_eq!(parent.1, 0);
        return;
    }
    let off = f64::from(parent.1) - weight / 4.0;
    assert!(off.abs() <= 0.5 || (weight < 4.0 && parent.1 == 1));
    for (channel, &got) in parent.0.iter().enumerate() {
        let light: f64 = four.iter().map(|texel| f64::from(texel.1) * linear(texel.0[channel])).sum();
        assert!((f64::from(got) - coded(light / weight)).abs() <= 0.75);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn straight_pictures(
        (width, height) in (1_u32..150, 1_u32..150),
        (scale_x, scale_y) in (0.07_f64..1.3, 0.07_f64..1.3),
        (x, y) in (-20.0_f64..50.0, -20.0_f64..50.0),
        (east, south, rgb, sheer) in any::<(bool, bool, bool, bool)>(),
        seed in 0_u64..1000,
    ) {
        let kind = if rgb { Colour::Rgb } else { Colour::Grey };
        let sign = |forward: bool| if forward { 1.0 } else { -1.0 };
        let transform = [x, scale_x * sign(east), 0.0, -y, 0.0, -scale_y * sign(south)];
        let picture = painting((width, height), kind, sheer, transform, seed);
        match build(std::slice::from_ref(&picture), &lattice(), 64) {
            Ok(tiles) => {
                check_leaves(&tiles, &picture, &lattice(), 64);
                check_structure(&tiles);
            }
            Err(error) => prop_assert!(matches!(error, Error::Usage { .. }), "{}", error),
        }
    }

    #[test]
    fn turned_and_sheared_pictures_and_lattices(
        (width, height) in (1_u32..90, 1_u32..90),
        (angle, shear, scale) in (0.0_f64..6.3, -0.4_f64..0.4, 0.15_f64..1.2),
        (x, y) in (0.0_f64..60.0, 0.0_f64..60.0),
        (rgb, sheer, of_lattice) in any::<(bool, bool, bool)>(),
        seed in 0_u64..1000,
    ) {
        let kind = if rgb { Colour::Rgb } else { Colour::Grey };
        let (sin, cos) = angle.sin_cos();
        let turned = |scale: f64| [x, scale * cos, scale * (shear * cos + sin), -y, scale * sin, scale * (shear * sin - cos)];
        let (geo, transform) = if of_lattice {
            (Geo { transform: Some(turned(1.0)), ..Geo::default() }, [x, scale, 0.0, -y, 0.0, -scale])
        } else {
            (lattice(), turned(scale))
        };
        let picture = painting((width, height), kind, sheer, transform, seed);
        match build(std::slice::from_ref(&picture), &geo, 64) {
            Ok(tiles) => {
                check_leaves(&tiles, &picture, &geo, 64);
                check_structure(&tiles);
            }
            Err(error) => prop_assert!(matches!(error, Error::Usage { .. }), "{}", error),
        }
    }

    #[test]
    fn pictures_of_several_resolutions_over_each_other(
        parts in prop::collection::vec(
            ((20_u32..160, 20_u32..160), 0.05_f64..1.2, (-10.0_f64..90.0, -10.0_f64..90.0), any::<(bool, bool, bool)>()),
            2..5,
        ),
    ) {
        let pictures: Vec<Painting> = (0..).zip(&parts).map(|(seed, (size, scale, (x, y), (rgb, sheer, turned)))| {
            let kind = if *rgb { Colour::Rgb } else { Colour::Grey };
            let slant = if *turned { scale / 3.0 } else { 0.0 };
            painting(*size, kind, *sheer, [*x, *scale, slant, -y, slant, -scale], seed)
        }).collect();
        match build(&pictures, &lattice(), 128) {
            Ok(tiles) => check_structure(&tiles),
            Err(error) => prop_assert!(matches!(error, Error::Usage { .. }), "{}", error),
        }
    }
}

#[test]
fn nothing_bleeds_from_transparent_pixels() {
    // Blue, and red where nothing is to be seen.
    let mut picture = painting((120, 120), Colour::Rgb, true, [3.3, 0.41, 0.0, -3.1, 0.0, -0.37], 5);
    let alpha: Vec<u8> = picture.alpha.iter().flatten().map(|&a| if a < 128 { 0 } else { 255 }).collect();
    for (pixel, &alpha) in picture.colour.chunks_exact_mut(3).zip(&alpha) {
        pixel.copy_from_slice(if alpha == 0 { &[255, 0, 0] } else { &[0, 10, 200] });
    }
    picture.alpha = Some(alpha);
    for slant in [0.0, 0.05] {
        picture.info.geo.transform = Some([3.3, 0.41, slant, -3.1, slant, -0.37]);
        let tiles = build(std::slice::from_ref(&picture), &lattice(), 64).expect("tiles");
        assert!(tiles.len() > 4);
        for (_, texels) in tiles.values() {
            // Of texels that are wholly transparent, too.
            assert!(texels.colour.chunks_exact(3).all(|texel| texel == [0, 10, 200]));
            assert!(texels.alpha.is_some());
        }
    }
}

#[test]
fn abutting_pictures_leave_no_seam() {
    // Edges at texel centres, at texel edges, and anywhere.
    for edge in [20.0, 20.5, 20.25, 20.123_456] {
        let west = painting((64, 64), Colour::Rgb, false, [edge - 32.0, 0.5, 0.0, 0.0, 0.0, -0.5], 1);
        let east = painting((64, 64), Colour::Rgb, false, [edge, 0.5, 0.0, 0.0, 0.0, -0.5], 2);
        let tiles = build(&[west, east], &lattice(), 32).expect("tiles");
        for (id, (_, texels)) in tiles.iter().filter(|(id, _)| id.y == 0) {
            for (i, j) in (0..64 * 60).map(|at| (at % 64, at / 64)).filter(|&(_, j)| j > 1) {
                assert_eq!(texel(texels, i, j).1, 255, "{id} {i} {j}");
            }
        }
    }
}

#[test]
fn the_last_picture_lies_on_top() {
    let mut below = painting((64, 64), Colour::Grey, false, [-0.5, 1.0, 0.0, 0.5, 0.0, -1.0], 1);
    let mut above = painting((64, 64), Colour::Grey, false, [15.5, 0.5, 0.0, -15.5, 0.0, -0.5], 2);
    below.colour.fill(50);
    above.colour.fill(200);
    let grey = |pictures: &[Painting], level: u8| {
        let tiles = build(pictures, &lattice(), 64).expect("tiles");
        let mut seen = [0, 0, 0];
        for (id, (children, texels)) in tiles {
            let shown = (0..64 * 64).map(|at| texel(&texels, at % 64, at / 64)).filter(|texel| texel.1 > 0);
            if id.level == level && (children == 0 || level == 0) {
                shown.for_each(|(colour, _)| {
                    seen[usize::from(colour[0] > 100) + usize::from(colour[0] == 200)] += 1;
                });
            }
        }
        seen
    };
    // Half a texel of a lattice of samples lies outside at either end.
    let [dark, mixed, bright] = grey(&[below.clone(), above.clone()], 0);
    assert!(dark > 2900 && bright > 900 && mixed < 140, "{dark} {mixed} {bright}");
    // The finer one is nowhere seen: there is no level for it.
    let [dark, mixed, bright] = grey(&[above, below], 0);
    assert!(dark > 4000 && mixed == 0 && bright == 0, "{dark} {mixed} {bright}");
}

#[test]
fn any_number_of_threads_gives_the_same() {
    let picture = |seed, scale: f64, slant, sheer| {
        painting((900, 700), Colour::Rgb, sheer, [10.0, scale, slant, -10.0, slant, -scale], seed)
    };
    let pictures = [picture(1, 0.21, 0.0, false), picture(2, 0.11, 0.0, true), picture(3, 0.4, 0.05, true)];
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
        pool.install(|| build(&pictures, &lattice(), 256).expect("tiles"))
    };
    let one = with(1);
    assert!(one.len() > 100);
    assert!([2, 5].into_iter().all(|threads| with(threads) == one));
}

#[test]
fn who_wants_to_stop_is_heard() {
    let picture = painting((500, 500), Colour::Grey, false, [0.0, 0.1, 0.0, 0.0, 0.0, -0.1], 1);
    let pictures: Vec<Box<dyn Picture>> = vec![Box::new(picture)];
    let grid = TexelGrid { tile: TILE, intervals: 64, samples: ALL };
    let shelf = Shelf::default();
    let stopped = imagery::build(
        &pictures,
        &lattice(),
        &grid,
        Resolution::Closest,
        &shelf,
        &While::new(|done, _| done < 5),
    );
    assert!(matches!(stopped, Err(Error::Interrupted)));
    assert!(shelf.0.into_inner().expect("alone").len() < 20);
}

#[test]
fn tiles_beside_the_heights_are_not_made() {
    let picture = |seed, scale: f64| {
        painting((600, 500), Colour::Rgb, true, [-20.0, scale, 0.0, 9.0, 0.0, -scale], seed)
    };
    let pictures = [picture(3, 0.19), picture(4, 0.08)];
    let whole = build(&pictures, &lattice(), 64).expect("tiles");
    let (columns, rows) = (41.0, 23.0);
    let part = build_over(&pictures, &lattice(), 64, (41, 23)).expect("tiles");
    // Where a tile begins, and how large a texel is, in intervals.
    let place = |id: &TileId| {
        let side = 64.0 / f64::from(1_u32 << id.level);
        (f64::from(id.x) * side, f64::from(id.y) * side, side / f64::from(TILE))
    };
    let over = |id: &&TileId| place(id).0 < columns && place(id).1 < rows;
    assert!(part.len() < whole.len());
    assert_eq!(part.keys().collect::<Vec<_>>(), whole.keys().filter(over).collect::<Vec<_>>());
    let mut compared = 0;
    for (id, (_, texels)) in &part {
        let (x, y, size) = place(id);
        for at in 0..TILE * TILE {
            let (i, j) = (at % TILE, at / TILE);
            if x + f64::from(i + 1) * size <= columns && y + f64::from(j + 1) * size <= rows {
                let (i, j) = (i64::from(i), i64::from(j));
                let (here, there) = (texel(texels, i, j), texel(&whole[id].1, i, j));
                // What is wholly transparent takes its colour from all of its tile.
                assert!(here == there || (here.1, there.1) == (0, 0), "{id}, {i}, {j}: {here:?}, {there:?}");
                compared += 1;
            }
        }
    }
    assert!(compared > 100_000);
}

#[test]
fn a_picture_elsewhere_is_an_error_that_names_it() {
    let picture = painting((50, 50), Colour::Grey, false, [1000.0, 1.0, 0.0, 0.0, 0.0, -1.0], 7);
    let error = build(std::slice::from_ref(&picture), &lattice(), 64).expect_err("outside").to_string();
    assert!(error.contains("painting 7") && error.contains("beside the heights"), "{error}");
    let mut nowhere = picture.clone();
    nowhere.info.geo.transform = None;
    assert!(build(&[nowhere], &lattice(), 64).is_err());
    let mut hidden = painting((50, 50), Colour::Grey, true, [0.0, 1.0, 0.0, 0.0, 0.0, -1.0], 7);
    hidden.alpha.iter_mut().flatten().for_each(|alpha| *alpha = 0);
    let error = build(&[hidden], &lattice(), 64).expect_err("transparent").to_string();
    assert!(error.contains("transparent"), "{error}");
}

#[test]
fn a_speck_is_seen_from_the_root() {
    let picture = painting((1, 1), Colour::Rgb, false, [700.0, 0.01, 0.0, -300.0, 0.0, -0.01], 3);
    let tiles = build(&[picture], &lattice(), 1024).expect("tiles");
    check_structure(&tiles);
    let levels = tiles.keys().map(|id| id.level).max().expect("some");
    assert!(levels >= 10 && tiles.len() <= 4 * usize::from(levels) + 4);
}

/// Four million pixels wide, and nearly empty.
struct Archipelago {
    info: PictureInfo,
}

impl Archipelago {
    fn is_land(column: u32, row: u32) -> bool {
        column % 900_001 < 700 && row % 5000 < 700
    }
}

impl Picture for Archipelago {
    fn info(&self) -> &PictureInfo {
        &self.info
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> relevo::Result<Pixels> {
        let pixels = rows.flat_map(|row| columns.clone().map(move |column| Self::is_land(column, row)));
        let alpha: Vec<u8> = pixels.map(|land| if land { 255 } else { 0 }).collect();
        Ok(Pixels { colour: vec![90; alpha.len()], alpha: Some(alpha) })
    }

    fn may_show(&self, columns: Range<u32>, rows: Range<u32>) -> bool {
        let any = |range: Range<u32>, period: u32| {
            range.start % period < 700 || range.end / period > range.start / period
        };
        any(columns, 900_001) && any(rows, 5000)
    }

    fn fingerprint(&self) -> relevo::Result<Fingerprint> {
        Ok(Fingerprint { files: Vec::new() })
    }
}

#[test]
fn four_million_texels_of_width_with_little_in_them() {
    let transform = Some([0.0, 1.0, 0.0, 0.0, 0.0, -1.0]);
    let geo = Geo { transform, ..Geo::default() };
    let note = PictureNote::default();
    let info = PictureInfo {
        width: 1 << 22,
        height: 20_000,
        kind: Colour::Grey,
        has_alpha: false,
        geo,
        note,
        warnings: Vec::new(),
    };
    let pictures: Vec<Box<dyn Picture>> = vec![Box::new(Archipelago { info })];
    let shelf = Shelf::default();
    let grid = TexelGrid { tile: TILE, intervals: 1 << 22, samples: ALL };
    let report = imagery::build(&pictures, &lattice(), &grid, Resolution::Closest, &shelf, &Silent);
    let report = report.expect("tiles");
    check_structure(&shelf.0.into_inner().expect("alone"));
    // 5 x 4 islands of 700 x 700, that touch 11 or 12 tiles along each side.
    let finest = report.tiles[16];
    assert!((20 * 11 * 11..=20 * 12 * 12).contains(&finest), "{finest}");
    assert_eq!(report.tiles.len(), 17);
    let texels = report.opaque * finest as f64 * 4096.0;
    assert!((texels / (20.0 * 700.0 * 700.0) - 1.0).abs() < 0.01);
}

fn shared(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(name);
    if path.exists() {
        return Some(path);
    }
    eprintln!("{name} is not there: not tested");
    None
}

fn open(path: &Path, crs: &Crs) -> Vec<Box<dyn Picture>> {
    picture::open_all(&[path.to_owned()], &PictureOptions::default(), crs, &Limits::default())
        .expect("picture")
}

fn real(name: &str, geo: &Geo, intervals: u64) -> Option<(Tiles, imagery::PyramidReport)> {
    let pictures = open(&shared(name)?, &geo.crs);
    let shelf = Shelf::default();
    let grid = TexelGrid { tile: TILE, intervals, samples: ALL };
    let report = imagery::build(&pictures, geo, &grid, Resolution::Closest, &shelf, &Silent).expect("tiles");
    let tiles = shelf.0.into_inner().expect("alone");
    check_structure(&tiles);
    Some((tiles, report))
}

#[test]
fn rocky_mountains() {
    let dem = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem/rmnp_dem_uint16.tif");
    let geo = source::open(&dem, &Limits::default()).expect("dem").info().geo.clone();
    let Some((tiles, report)) = real("rmnp_rgb.tif", &geo, 256) else { return };
    // It reaches beyond the heights, and 11288 of its 180905 pixels are nodata.
    assert!((0.5..0.9).contains(&report.pictures[0].inside));
    assert!(tiles.values().any(|(_, texels)| texels.alpha.is_none()));
    // The root and the finest level show the same light.
    let light = |level: u8| {
        let all = tiles.iter().filter(|(id, _)| id.level == level);
        let shown = all.flat_map(|(_, (_, t))| (0..64 * 64).map(|at| texel(t, at % 64, at / 64)));
        let (sum, weight) = shown.fold((0.0, 0.0), |(sum, weight), (colour, alpha)| {
            (sum + linear(colour[1]) * f64::from(alpha), weight + f64::from(alpha))
        });
        sum / weight
    };
    let finest = report.pictures[0].level;
    assert!((light(0) / light(finest) - 1.0).abs() < 0.01);
}

#[test]
fn the_whole_world() {
    let Some(dem) = shared("etopo20_world_bathymetry_float32.tif") else { return };
    let geo = source::open(&dem, &Limits::default()).expect("dem").info().geo.clone();
    let Some((tiles, report)) = real("bmng_world_5400x2700_geo.tif", &geo, 2048) else { return };
    assert_eq!(report.pictures[0].level, 7);
    // 1079 of 2048 intervals of the square are world, half as many of them from north to south.
    assert!((0.2..0.3).contains(&(report.opaque * report.tiles[7] as f64 / f64::from(1 << 14) * 2.0)));
    // Sahara is brighter and redder than the Pacific.
    let colour_at = |longitude: f64, latitude: f64| {
        let (c, r) = geo.sample_from_world(longitude, latitude).expect("world");
        let at = |sample: f64| (sample * f64::from(TILE << 7) / 2048.0) as u32;
        let (i, j) = (at(c), at(r));
        let (_, texels) = &tiles[&TileId::new(7, i / TILE, j / TILE)];
        texel(texels, i64::from(i % TILE), i64::from(j % TILE)).0.to_vec()
    };
    let (desert, sea) = (colour_at(10.0, 22.0), colour_at(-140.0, 0.0));
    assert!(desert[0] > 150 && desert[0] > desert[2] && sea[2] > sea[0] && sea[0] < 60, "{desert:?} {sea:?}");
}

#[test]
fn san_francisco() {
    let Some(path) = shared("sfbay_landsat7_rgb_nodata.tif") else { return };
    let crs = Crs { epsg: Some(3857), kind: relevo::geo::CrsKind::Projected, ..Crs::default() };
    let own = open(&path, &crs)[0].info().geo.transform.expect("place");
    // Heights of 90 m over the same ground.
    let transform = [own[0], 3.0 * own[1], 0.0, own[3], 0.0, 3.0 * own[5]];
    let geo = Geo { transform: Some(transform), crs, ..Geo::default() };
    let Some((_, report)) = real("sfbay_landsat7_rgb_nodata.tif", &geo, 1024) else { return };
    // What of it is not nodata in all bands is seen, neither more nor less.
    let (across, down) = report.pictures[0].pixels_per_texel;
    let seen = report.opaque * *report.tiles.last().expect("levels") as f64 * 4096.0 * across * down;
    let all = open(&path, &geo.crs)[0].read_window(0..2181, 0..1917).expect("pixels");
    let hidden = all.colour.chunks_exact(3).filter(|pixel| *pixel == [0; 3]).count();
    // Half a sample at the north and the west lies outside the square.
    let there = (2181 * 1917 - hidden) as f64 * report.pictures[0].inside;
    assert!(hidden > 100_000 && all.alpha.is_some());
    assert!((seen / there - 1.0).abs() < 1e-3, "{seen} of {there}");
}
