//! The device draws the pieces that `relevo::select::pattern` says, for every size of patches.

use relevo::select::imagery::Draw;
use relevo::select::neighbours::edges_of_patch;
use relevo::select::pattern::Meshes;
use relevo::select::{EdgeRule, Levels};
use relevo_viewer::gpu::{Drawn, Look, Paint};

use crate::cracks::{RULES, from_above, random};
use crate::scene::{LOOK, Scene, Shot, flat, gpu, grid, mixed};

/// What is to be drawn of the patches of all draws, each in the picture.
fn expected(scene: &Scene, levels: &Levels, rule: EdgeRule) -> Drawn {
    let (m, p) = (scene.selection.patches, scene.selection.patch_log2);
    let meshes = Meshes::new(p);
    let mut drawn = Drawn::default();
    for draw in &scene.draws {
        let tile = &scene.selection.tiles[draw.tile as usize];
        let [west, north, east, south] = draw.window.map(|at| at >> p);
        for (y, x) in (north..south).flat_map(|y| (west..east).map(move |x| (y, x))) {
            let part = (draw.tile * m * m + y * m + x) as usize;
            let outer = edges_of_patch(draw.tile, &tile.sides, m, x, y)
                .map(|e| levels.edges[e as usize] - tile.exponent);
            let odd = (tile.id.x * m + x + tile.id.y * m + y) % 2 == 1;
            let pieces = Meshes::pieces(p, levels.inner[part] - tile.exponent, outer, odd, rule);
            drawn.triangles +=
                pieces.map(|piece| u64::from(meshes.buckets[piece.bucket as usize].count) / 3).sum::<u64>();
            drawn.patches += 1;
        }
    }
    drawn
}

#[test]
fn every_patch_size_is_drawn_in_its_pieces() {
    let gpu = gpu();
    let format = wgpu::TextureFormat::Rgba8Unorm;
    let look = Look { paint: Paint::Count, clear: [0.0; 3], ..LOOK };
    // All of the square, and what is in its middle only.
    let (mut whole, view) = (from_above((64, 64)), from_above((301, 299)));
    whole.eye[2] = 500.0;
    for (n, p, level) in [(32, 2, 3), (32, 3, 3), (32, 4, 3), (32, 5, 3), (64, 6, 2), (64, 2, 2)] {
        let ids = if level == 3 { mixed() } else { grid(2) };
        let mut scene = Scene::new(&ids, (n, p), level, flat);
        let mut renderer = scene.renderer(&gpu, format);
        for rule in RULES {
            for seed in 0..4 {
                let levels = random(&scene, rule, seed);
                let shot = |view| Shot { rule, look, levels: Some(&levels), ..Shot::new(view) };
                shot(&whole).draw(&gpu, &mut renderer, &scene, format);
                assert_eq!(
                    renderer.drawn(&gpu).expect("counts"),
                    expected(&scene, &levels, rule),
                    "p {p}, {rule:?}"
                );
                let pixels = shot(&view).draw(&gpu, &mut renderer, &scene, format);
                assert!(pixels.chunks_exact(4).all(|pixel| pixel[0] == 16), "p {p}, {rule:?}, seed {seed}");
            }
        }
        // Windows of whole patches, more draws than there is room for tiles.
        let patch = 1 << p;
        let all = 0..scene.draws.len() as u32 * (n >> p);
        let column = |i: u32| [i % (n >> p) * patch, 0, (i % (n >> p) + 1) * patch, n];
        scene.draws = all.map(|i| Draw { tile: i / (n >> p), window: column(i), image: None }).collect();
        let levels = random(&scene, EdgeRule::Shared, 9);
        let shot = Shot { look, levels: Some(&levels), ..Shot::new(&whole) };
        shot.draw(&gpu, &mut renderer, &scene, format);
        assert_eq!(
            renderer.drawn(&gpu).expect("counts"),
            expected(&scene, &levels, EdgeRule::Shared),
            "p {p}"
        );
    }
}
