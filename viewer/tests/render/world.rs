//! Holes, places far from the origin, looks, and what is refused.

use std::sync::Arc;

use relevo::TileId;
use relevo::select::{EdgeRule, Frame, Levels, Selection, View};
use relevo::texel::{Colour, Texels};
use relevo_viewer::gpu::{Drawn, Gpu, Look, Paint, RenderTarget, Renderer, Sizes, target};

use crate::cracks::from_above;
use crate::scene::{LOOK, Scene, Shot, flat, gpu, grid, magenta, mixed, rough, views};

#[test]
fn nothing_is_drawn_where_samples_are_void() {
    let gpu = gpu();
    let mut scene = Scene::new(&grid(3), (32, 3), 3, flat);
    // Void from column 100 on, and in rows up to 90: the surface ends half a sample before.
    for data in &mut scene.data {
        let (left, top) = (data.table.id.x * 32, data.table.id.y * 32);
        for (i, valid) in data.valid.iter_mut().enumerate() {
            let (column, row) = (left + i as u32 % 33, top + i as u32 / 33);
            *valid = u8::from(column < 100 && row > 90);
        }
        for part in 0..16 {
            let (x, y) = (left + part % 4 * 8, top + part / 4 * 8);
            data.table.drawable[part as usize] = x < 100 && y + 8 > 90;
        }
    }
    let mut renderer = scene.renderer(&gpu, target::FORMAT);
    let view = from_above((500, 500));
    let pixels = Shot { tolerance: 1e-3, ..Shot::new(&view) }.seen(&gpu, &mut renderer, &scene);
    let scale = view.eye[2] / view.lambda();
    for (i, pixel) in pixels.chunks_exact(4).enumerate() {
        let x = view.eye[0] + ((i % 500) as f64 - 249.5) * scale;
        let y = -view.eye[1] + ((i / 500) as f64 - 249.5) * scale;
        // In the corner a triangle cuts the outline.
        if (x - 99.5).abs() < 0.01
            || (y - 90.5).abs() < 0.01
            || (x - 99.5).abs() < 1.0 && (y - 90.5).abs() < 1.0
        {
            continue;
        }
        assert_eq!(magenta(pixel) == 0, x < 99.5 && y > 90.5, "at {x}, {y}");
    }
    let drawn = renderer.drawn(&gpu).expect("counts");
    assert!(drawn.patches < 13 * 21 + 1, "{drawn:?}");
}

/// A tile of finest samples with its corner at column and row `at`.
fn lone(at: u32, frame: Frame) -> Scene {
    let mut scene = Scene::new(&[TileId::ROOT], (32, 3), 0, rough);
    scene.frame = frame;
    let id = TileId::new(22, at / 32, at / 32);
    let tile = &mut scene.selection.tiles[0];
    tile.id = id;
    Arc::make_mut(&mut tile.table).id = id;
    scene.data[0].table.id = id;
    scene
}

#[test]
fn far_from_the_origin_all_looks_the_same() {
    let gpu = gpu();
    let frame = Frame { dx: 24.7, dy: 30.9, exaggeration: 20.0 };
    let at = 1_u32 << 22;
    let pictures: Vec<(Vec<u8>, Levels)> = [0, at]
        .into_iter()
        .map(|at| {
            let scene = lone(at, frame);
            let mut renderer = scene.renderer(&gpu, target::FORMAT);
            let (east, south) = (f64::from(at) * frame.dx, f64::from(at) * frame.dy);
            // 100 000 km from the origin; the tile is 800 m wide.
            let eye = [east + 100.3, -south - 900.0, 500.0];
            let view = View::look_at(eye, [east + 400.0, -south - 480.0, 0.0], 0.8, (400, 300), 1.0);
            let look = Look { sun: [0.5, 0.3, 0.8], ..LOOK };
            let pixels = Shot { look, tolerance: 2.0, ..Shot::new(&view) }.seen(&gpu, &mut renderer, &scene);
            (pixels, renderer.levels(&gpu).expect("levels"))
        })
        .collect();
    assert_eq!(pictures[0].1, pictures[1].1);
    let unlike = pictures[0].0.chunks_exact(4).zip(pictures[1].0.chunks_exact(4));
    let unlike = unlike.filter(|(a, b)| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 2)).count();
    assert!(unlike < 12, "{unlike} pixels differ");
    assert!(magenta(&pictures[0].0) < 90_000, "there is something to see");
}

#[test]
fn targets_with_and_without_srgb_look_alike() {
    let gpu = gpu();
    let scene = Scene::new(&mixed(), (32, 3), 3, rough);
    let view = &views()[1];
    let formats = [target::FORMAT, wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureFormat::Bgra8UnormSrgb];
    let look = Look { clear: [0.2, 0.4, 0.6], ..LOOK };
    let pictures = formats.map(|format| {
        let mut renderer = scene.renderer(&gpu, format);
        Shot { look, ..Shot::new(view) }.draw(&gpu, &mut renderer, &scene, format)
    });
    for other in &pictures[1..] {
        let unlike = pictures[0].iter().zip(other).filter(|(a, b)| a.abs_diff(**b) > 1).count();
        assert!(unlike < 20, "{unlike} bytes differ");
    }
}

#[test]
fn every_look_is_another_picture() {
    let gpu = gpu();
    let scene = Scene::new(&mixed(), (32, 3), 3, rough);
    let mut renderer = scene.renderer(&gpu, target::FORMAT);
    let view = &views()[3];
    let look = |paint, wireframe, borders| Look { paint, wireframe, borders, sun: [0.6, 0.0, 0.8], ..LOOK };
    let looks = [
        look(Paint::Tint, false, false),
        look(Paint::TileLevel, false, false),
        look(Paint::Step, false, false),
        look(Paint::Error, false, false),
        look(Paint::Tint, true, false),
        look(Paint::Tint, false, true),
    ];
    let mut seen = Vec::new();
    for look in looks {
        let pixels = Shot { look, ..Shot::new(view) }.seen(&gpu, &mut renderer, &scene);
        assert_eq!(magenta(&pixels), 0);
        assert!(!seen.contains(&pixels), "{look:?}");
        seen.push(pixels);
    }
}

#[test]
fn without_tiles_there_is_the_clear_colour() {
    let gpu = gpu();
    let mut scene = Scene::new(&grid(1), (32, 3), 1, flat);
    let mut renderer = scene.renderer(&gpu, target::FORMAT);
    (scene.selection, scene.slots, scene.draws) = (Selection::default(), Vec::new(), Vec::new());
    let view = from_above((64, 48));
    assert_eq!(magenta(&Shot::new(&view).seen(&gpu, &mut renderer, &scene)), 64 * 48);
    assert_eq!(renderer.drawn(&gpu).expect("counts"), Drawn::default());
    assert_eq!(renderer.levels(&gpu).expect("levels"), Levels::default());
}

/// Draws a scene that was spoilt; the error in words.
fn refused(
    gpu: &Gpu,
    renderer: &mut Renderer,
    scene: &Scene,
    levels: Option<&Levels>,
    images: &[Option<u32>],
) -> String {
    let view = from_above((32, 32));
    let target = RenderTarget::new(gpu, (32, 32), target::FORMAT).expect("a target");
    let none = vec![None; scene.draws.len()];
    let shot = Shot { levels, images, ..Shot::new(&view) };
    let result = renderer.render(gpu, &shot.input(scene, &none), target.view(), (32, 32));
    let error = result.expect_err("it is refused").to_string();
    // And the next picture is drawn.
    assert!(error.starts_with("this picture cannot be drawn"), "{error}");
    error
}

#[test]
fn what_does_not_belong_together_is_refused() {
    let gpu = gpu();
    let fresh = || Scene::new(&grid(1), (32, 3), 1, flat);
    let mut renderer = fresh().renderer(&gpu, target::FORMAT);
    let mut spoilt = |spoil: &dyn Fn(&mut Scene)| {
        let mut scene = fresh();
        spoil(&mut scene);
        refused(&gpu, &mut renderer, &scene, None, &[])
    };
    assert!(spoilt(&|s| s.slots[0] = 99).contains("slot 99"));
    assert!(spoilt(&|s| s.slots[0] = s.sizes.tiles - 1).contains("holds none"));
    assert!(spoilt(&|s| _ = s.slots.pop()).contains("3 slots for 4 tiles"));
    assert!(spoilt(&|s| s.draws[1].tile = 4).contains("tile 4 of 4"));
    assert!(spoilt(&|s| s.draws[1].window = [0, 0, 33, 32]).contains("no window"));
    assert!(spoilt(&|s| s.draws[1].window = [9, 0, 8, 32]).contains("no window"));
    assert!(spoilt(&|s| s.selection.patches = 8).contains("patches"));
    assert!(spoilt(&|s| s.selection.tiles[0].sides[2].first = 1_000_000).contains("edges"));
    assert!(spoilt(&|s| s.selection.tiles[0].sides[2].shift = 77).contains("edges"));
    assert!(spoilt(&|s| s.selection.tiles[0].exponent = 60).contains("exponent 60"));
    assert!(spoilt(&|s| s.frame.dx = f64::NAN).contains("not a number"));
    assert!(spoilt(&|s| s.frame.dx = 0.0).contains("above 0"));
    let scene = fresh();
    assert!(refused(&gpu, &mut renderer, &scene, None, &[None]).contains("1 images for 4 draws"));
    assert!(
        refused(&gpu, &mut renderer, &scene, None, &[Some(5), None, None, None]).contains("image slot 5")
    );
    let short = Levels { inner: vec![0; 5], edges: vec![0; 5] };
    assert!(refused(&gpu, &mut renderer, &scene, Some(&short), &[]).contains("levels"));
    let deep = Levels { inner: vec![9; 64], edges: vec![0; 160] };
    assert!(refused(&gpu, &mut renderer, &scene, Some(&deep), &[]).contains("exponent 9"));
    // All that did no harm.
    let view = from_above((32, 32));
    Shot::new(&view).seen(&gpu, &mut renderer, &scene);
}

#[test]
fn uploads_of_other_sizes_are_refused() {
    let gpu = gpu();
    let scene = Scene::new(&grid(0), (32, 3), 0, flat);
    let mut renderer = scene.renderer(&gpu, target::FORMAT);
    let mut tile = scene.data[0].clone();
    assert!(renderer.upload_tile(&gpu, 400, &tile).is_err());
    tile.table.low.pop();
    assert!(renderer.upload_tile(&gpu, 0, &tile).is_err());
    tile = scene.data[0].clone();
    tile.heights.pop();
    assert!(renderer.upload_tile(&gpu, 0, &tile).is_err());
    let image = Texels { side: 2, kind: Colour::Grey, colour: vec![0; 4], alpha: None };
    assert!(renderer.upload_image(&gpu, 0, &image).is_err());
    assert!(RenderTarget::new(&gpu, (0, 5), target::FORMAT).is_err());
    assert!(RenderTarget::new(&gpu, (1 << 20, 5), target::FORMAT).is_err());
    assert!(Renderer::new(&gpu, Sizes { tile: 33, ..scene.sizes }, target::FORMAT).is_err());
    assert!(Renderer::new(&gpu, Sizes { tiles: 1 << 28, ..scene.sizes }, target::FORMAT).is_err());
}

#[test]
fn a_lost_device_is_an_error() {
    let gpu = gpu();
    let scene = Scene::new(&grid(1), (32, 3), 1, flat);
    let mut renderer = scene.renderer(&gpu, target::FORMAT);
    let view = from_above((32, 32));
    Shot::new(&view).seen(&gpu, &mut renderer, &scene);
    let target = RenderTarget::new(&gpu, (32, 32), target::FORMAT).expect("a target");
    gpu.device.destroy();
    let none = vec![None; 4];
    let input = Shot { rule: EdgeRule::Paper, ..Shot::new(&view) }.input(&scene, &none);
    let drawn = renderer.render(&gpu, &input, target.view(), (32, 32));
    let read = target.read(&gpu).map(|_| ());
    let latest = renderer.latest(&gpu).map(|_| ());
    let again = renderer.render(&gpu, &input, target.view(), (32, 32));
    for result in [drawn, read, latest, again] {
        let error = result.expect_err("the device is lost").to_string();
        assert!(error.contains("graphics device"), "{error}");
    }
}

#[test]
fn a_budget_is_kept() {
    let gpu = gpu();
    let all = Sizes { tile: 256, patch_log2: 6, tiles: 50_000, images: 9000, image_side: 516, gutter: 2 };
    for (budget, patch_log2) in [(64_u64 << 20, 6), (300 << 20, 6), (300 << 20, 3)] {
        let sizes = Sizes { patch_log2, ..all }.within(&gpu, budget, (640, 480)).expect("room");
        let renderer = Renderer::new(&gpu, sizes, target::FORMAT).expect("a renderer");
        let bytes = renderer.bytes() + 640 * 480 * 4;
        assert!(bytes <= budget && bytes * 10 >= budget * 9, "{bytes} of {budget}: {sizes:?}");
    }
    let few = Sizes { tiles: 21, images: 5, ..all }.within(&gpu, 300 << 20, (640, 480)).expect("room");
    assert_eq!((few.tiles, few.images), (21, 5));
    let error = all.within(&gpu, 2 << 20, (640, 480)).expect_err("too little").to_string();
    assert!(error.contains("--gpu-memory"), "{error}");
}
