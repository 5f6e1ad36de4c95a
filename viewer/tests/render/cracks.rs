//! No gap between patches and tiles, and every pixel once.

use relevo::select::imagery::Draw;
use relevo::select::{EdgeRule, Levels, Side, View};
use relevo_viewer::gpu::{Look, Paint, target};

use crate::scene::{LOOK, Random, Scene, Shot, flat, gpu, grid, magenta, mixed, rough, views};

pub const RULES: [EdgeRule; 2] = [EdgeRule::Shared, EdgeRule::Paper];

/// Levels from base exponents without a pattern.
pub fn random(scene: &Scene, rule: EdgeRule, seed: u64) -> Levels {
    let mut random = Random(seed);
    let m = scene.selection.patches;
    let p = u64::from(scene.selection.patch_log2);
    let of_tile = |exponent: u8| (0..m * m).map(move |_| exponent);
    let bases: Vec<u8> = scene.selection.tiles.iter().flat_map(|tile| of_tile(tile.exponent)).collect();
    let bases: Vec<u8> = bases.iter().map(|&exponent| exponent + random.below(p + 1) as u8).collect();
    Levels::from_base(&scene.selection, bases, rule)
}

#[test]
fn no_pixel_shows_through_at_any_tolerance_or_level() {
    let gpu = gpu();
    let scene = Scene::new(&mixed(), (32, 3), 3, rough);
    let mut renderer = scene.renderer(&gpu, target::FORMAT);
    for view in &views() {
        for rule in RULES {
            for tolerance in [0.3, 1.0, 4.0, 30.0] {
                let shot = Shot { tolerance, rule, ..Shot::new(view) };
                let pixels = shot.seen(&gpu, &mut renderer, &scene);
                assert_eq!(magenta(&pixels), 0, "{rule:?}, {tolerance} pixels, {view:?}");
            }
            for seed in 0..6 {
                let levels = random(&scene, rule, seed);
                let shot = Shot { rule, levels: Some(&levels), ..Shot::new(view) };
                let pixels = shot.seen(&gpu, &mut renderer, &scene);
                assert_eq!(magenta(&pixels), 0, "{rule:?}, seed {seed}, {view:?}");
            }
        }
    }
}

/// The control: tiles that do not share the numbers of their edges are seen to gape.
#[test]
fn edges_that_disagree_are_caught() {
    let gpu = gpu();
    let mut scene = Scene::new(&grid(3), (32, 3), 3, rough);
    let m = scene.selection.patches;
    for (i, tile) in scene.selection.tiles.iter_mut().enumerate() {
        let base = i as u32 * relevo::select::neighbours::edges_of_tile(m);
        let first = [0, m * (m + 1) + m * m, m * m, m * (m + 1)];
        tile.sides = first.map(|first| Side { first: base + first, local: 0, shift: 0, limit: 0 });
    }
    let mut renderer = scene.renderer(&gpu, target::FORMAT);
    let views = views();
    let gaps = |seed: u64| {
        let levels = random(&scene, EdgeRule::Shared, seed);
        let shot = Shot { levels: Some(&levels), ..Shot::new(&views[0]) };
        magenta(&shot.seen(&gpu, &mut renderer, &scene))
    };
    let gaps: Vec<usize> = (0..3).map(gaps).collect();
    assert!(gaps.iter().all(|&gaps| gaps > 50), "{gaps:?}");
}

/// Straight down on a flat square of 256 metres that is larger than the picture.
pub fn from_above(size: (u32, u32)) -> View {
    View::look_at([128.3, -127.6, 100.0], [128.3, -127.6, 0.0], 1.6, size, 0.5)
}

/// Windows of a tile of `n` intervals, cut at random.
fn windows(n: u32, random: &mut Random) -> Vec<[u32; 4]> {
    let mut cut = || {
        let mut at = [0, random.below(u64::from(n) + 1) as u32, random.below(u64::from(n) + 1) as u32, n];
        at.sort_unstable();
        at
    };
    let (x, y) = (cut(), cut());
    (0..9).map(|i| [x[i % 3], y[i / 3], x[i % 3 + 1], y[i / 3 + 1]]).collect()
}

#[test]
fn every_pixel_is_covered_once() {
    let gpu = gpu();
    let format = wgpu::TextureFormat::Rgba8Unorm;
    let mut scene = Scene::new(&mixed(), (32, 3), 3, flat);
    let mut renderer = scene.renderer(&gpu, format);
    let whole = scene.draws.clone();
    let mut numbers = Random(11);
    let cut: Vec<Draw> = (0..whole.len() as u32)
        .flat_map(|tile| {
            windows(32, &mut numbers).into_iter().map(move |window| Draw { tile, window, image: None })
        })
        .collect();
    let look = Look { paint: Paint::Count, clear: [0.0; 3], ..LOOK };
    let view = from_above((801, 797));
    for draws in [whole, cut] {
        scene.draws = draws;
        for rule in RULES {
            for seed in 0..5 {
                let levels = random(&scene, rule, seed);
                let levels = (seed > 0).then_some(&levels);
                let pixels =
                    Shot { rule, levels, look, ..Shot::new(&view) }.draw(&gpu, &mut renderer, &scene, format);
                let wrong = pixels.chunks_exact(4).filter(|pixel| pixel[0] != 16).count();
                assert_eq!(wrong, 0, "{rule:?}, seed {seed}, {} draws", scene.draws.len());
            }
        }
    }
}
