//! Levels found on the device are those of the CPU.

use relevo::select::{EdgeRule, Frame, Levels, View};
use relevo_viewer::gpu::target;

use crate::scene::{Random, Scene, Shot, gpu, mixed, rough, views};

const RULES: [EdgeRule; 2] = [EdgeRule::Shared, EdgeRule::Paper];

/// Cameras over, beside and below the square.
fn anywhere(count: u64) -> Vec<View> {
    let mut random = Random(5);
    let mut at = |low: f64, high: f64| low + (high - low) * random.unit();
    (0..count)
        .map(|_| {
            let eye = [at(-50.0, 300.0), at(-300.0, 50.0), at(-5.0, 150.0)];
            let target = [at(0.0, 256.0), at(-256.0, 0.0), at(-10.0, 10.0)];
            View::look_at(eye, target, at(0.3, 1.8), (320, 200), at(0.01, 5.0))
        })
        .collect()
}

/// Levels are monotone in the tolerance, so those of the device lie between those of tolerances a
/// little apart; single precision can change a level only where an error is as good as equal to the
/// tolerance.
#[test]
fn the_device_finds_the_levels_of_the_cpu() {
    let gpu = gpu();
    let mut scene = Scene::new(&mixed(), (32, 3), 3, rough);
    let mut renderer = scene.renderer(&gpu, target::FORMAT);
    let (mut all, mut unlike) = (0, 0);
    for (i, view) in views().iter().chain(&anywhere(40)).enumerate() {
        scene.frame = Frame { dx: 1.0, dy: 0.9, exaggeration: [1.0, 3.0][i % 2] };
        let tolerance = [0.5, 1.0, 3.0, 10.0][i % 4];
        for rule in RULES {
            let shot = Shot { tolerance, rule, ..Shot::new(view) };
            shot.seen(&gpu, &mut renderer, &scene);
            let found = renderer.levels(&gpu).expect("levels");
            let of = |tolerance| Levels::of(&scene.selection, &scene.frame, view, tolerance, rule);
            let (low, exact, high) = (of(tolerance * 0.999), of(tolerance), of(tolerance * 1.001));
            let between = |found: &[u8], low: &[u8], high: &[u8]| {
                found.len() == low.len() && (0..found.len()).all(|i| (low[i]..=high[i]).contains(&found[i]))
            };
            assert!(between(&found.inner, &low.inner, &high.inner), "{rule:?}, patches, {view:?}");
            assert!(between(&found.edges, &low.edges, &high.edges), "{rule:?}, edges, {view:?}");
            all += found.inner.len();
            unlike += found.inner.iter().zip(&exact.inner).filter(|(a, b)| a != b).count();
        }
    }
    assert!(unlike * 1000 <= all, "{unlike} of {all} levels are not the exact ones");
}

/// Levels that are given are drawn, and are returned.
#[test]
fn given_levels_are_used() {
    let gpu = gpu();
    let scene = Scene::new(&mixed(), (32, 3), 3, rough);
    let mut renderer = scene.renderer(&gpu, target::FORMAT);
    let view = &views()[0];
    let mut counts = Vec::new();
    for step in 0..=3 {
        let of_tile = |exponent: u8| vec![exponent + step; 16];
        let base: Vec<u8> = scene.selection.tiles.iter().flat_map(|tile| of_tile(tile.exponent)).collect();
        let levels = Levels::from_base(&scene.selection, base, EdgeRule::Shared);
        Shot { levels: Some(&levels), ..Shot::new(view) }.seen(&gpu, &mut renderer, &scene);
        assert_eq!(renderer.levels(&gpu).expect("levels"), levels);
        counts.push(renderer.drawn(&gpu).expect("counts"));
    }
    assert!(
        counts
            .windows(2)
            .all(|pair| pair[0].patches == pair[1].patches && pair[0].triangles > pair[1].triangles)
    );
}

/// Patches outside of the picture are not drawn, and each has as many triangles as its step says.
#[test]
fn counts_are_those_of_the_patches_in_the_picture() {
    let gpu = gpu();
    let scene = Scene::new(&crate::scene::grid(2), (32, 3), 2, crate::scene::flat);
    let mut renderer = scene.renderer(&gpu, target::FORMAT);
    // 20 metres square in the middle of a patch of 8: with its neighbours, 3 x 3 patches.
    let view = View::look_at([68.0, -68.0, 20.0], [68.0, -68.0, 0.0], 1.0, (100, 100), 0.5);
    let shot = Shot { tolerance: 1e-3, ..Shot::new(&view) };
    shot.seen(&gpu, &mut renderer, &scene);
    let drawn = renderer.drawn(&gpu).expect("counts");
    assert_eq!((drawn.patches, drawn.triangles), (9, 9 * 128));
    let mut latest = renderer.latest(&gpu).expect("counts");
    for _ in 0..100 {
        if latest == drawn {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
        latest = renderer.latest(&gpu).expect("counts");
    }
    assert_eq!(latest, drawn);
}
