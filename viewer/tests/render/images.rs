//! Images on tiles: one on one, one on many, many on one, against a picture made on the CPU.

use relevo::TileId;
use relevo::select::imagery::Draw;
use relevo::select::{Frame, View};
use relevo::texel::{Colour, Texels};
use relevo_viewer::gpu::{Look, Paint, Renderer, target};

use crate::scene::{LOOK, Random, Scene, Shot, flat, gpu, grid};

const SIDE: usize = 20;
const GUTTER: usize = 2;
const INNER: usize = SIDE - 2 * GUTTER;
/// Metres of the root square.
const ROOT: f64 = 128.0;

/// Red, green, blue, alpha of a texel of a level, 16 x 2^level texels across the root; beyond it,
/// the nearest.
fn texel(level: u8, x: i64, y: i64) -> [u8; 4] {
    let last = ((INNER as i64) << level) - 1;
    let (x, y) = (x.clamp(0, last), y.clamp(0, last));
    let mut random = Random(u64::from(level) << 60 ^ (x as u64) << 20 ^ y as u64);
    let bits = random.next().to_le_bytes();
    [bits[0], bits[1], bits[2], [255, 255, 128, 0][usize::from(bits[3] & 3)]]
}

fn image(id: TileId) -> Texels {
    let at = |i: usize, tile: u32| i as i64 - GUTTER as i64 + i64::from(tile) * INNER as i64;
    let all: Vec<[u8; 4]> =
        (0..SIDE * SIDE).map(|i| texel(id.level, at(i % SIDE, id.x), at(i / SIDE, id.y))).collect();
    Texels {
        side: SIDE,
        kind: Colour::Rgb,
        colour: all.iter().flat_map(|t| [t[0], t[1], t[2]]).collect(),
        alpha: Some(all.iter().map(|t| t[3]).collect()),
    }
}

fn linear(code: f64) -> f64 {
    let c = code / 255.0;
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

fn coded(c: f64) -> f64 {
    255.0 * if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
}

/// What a pixel of ground at (x, -y) metres shows of a level, over a colour.
fn expected(level: u8, x: f64, y: f64, under: [f64; 3]) -> [f64; 3] {
    let scale = f64::from((INNER as u32) << level) / ROOT;
    let (x, y) = (x * scale - 0.5, y * scale - 0.5);
    let mut sum = [0.0; 4];
    for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let (column, row) = (x.floor() as i64 + i, y.floor() as i64 + j);
        let weight = (1.0 - (x - column as f64).abs()) * (1.0 - (y - row as f64).abs());
        let t = texel(level, column, row);
        for c in 0..3 {
            sum[c] += weight * linear(t[c].into());
        }
        sum[3] += weight * f64::from(t[3]) / 255.0;
    }
    std::array::from_fn(|c| coded(under[c] + (sum[c] - under[c]) * sum[3]))
}

const VIEW_SIDE: u32 = 200;

fn view() -> View {
    View::look_at([64.3, -63.8, 60.0], [64.3, -63.8, 0.0], 0.9, (VIEW_SIDE, VIEW_SIDE), 0.5)
}

/// Draws tiles of level 2 with images of a level and compares with the reference.
fn compare(level: u8, draws: &[(u32, [u32; 4], TileId)], dx: f64) {
    let gpu = gpu();
    let mut scene = Scene::new(&grid(2), (32, 3), 2, flat);
    scene.frame = Frame { dx, dy: dx, exaggeration: 1.0 };
    let count = 1_u32 << (2 * level);
    scene.sizes.images = count;
    scene.sizes.image_side = SIDE as u32;
    scene.sizes.gutter = GUTTER as u32;
    let mut renderer: Renderer = scene.renderer(&gpu, target::FORMAT);
    let slot = |id: TileId| count - 1 - ((id.y << level) + id.x);
    for id in grid(level) {
        renderer.upload_image(&gpu, slot(id), &image(id)).expect("room for an image");
    }
    scene.draws = draws.iter().map(|&(tile, window, id)| Draw { tile, window, image: Some(id) }).collect();
    let images: Vec<_> = draws.iter().map(|&(_, _, id)| Some(slot(id))).collect();
    let mut view = view();
    view.eye = view.eye.map(|c| c * dx);
    let look = Look { paint: Paint::Terrain, range: [0.0, 1.0], ..LOOK };
    let shot = Shot { images: &images, look, ..Shot::new(&view) };
    let pixels = shot.seen(&gpu, &mut renderer, &scene);
    // The tint of the lowest height.
    let under = [0.073, 0.194, 0.091];
    let scale = view.eye[2] / view.lambda() / dx;
    let mut worst = 0.0_f64;
    for (i, pixel) in pixels.chunks_exact(4).enumerate() {
        let middle = |i: usize| i as f64 + 0.5 - f64::from(VIEW_SIDE) / 2.0;
        let x = view.eye[0] / dx + middle(i % VIEW_SIDE as usize) * scale;
        let y = -view.eye[1] / dx + middle(i / VIEW_SIDE as usize) * scale;
        let wanted = expected(level, x, y, under);
        (0..3).for_each(|c| worst = worst.max((wanted[c] - f64::from(pixel[c])).abs()));
    }
    // A texture unit has 8 bits of weight.
    assert!(worst < 6.0, "{worst} of 255 off");
}

const WHOLE: [u32; 4] = [0, 0, 32, 32];

#[test]
fn one_image_on_one_tile() {
    let draws: Vec<_> = grid(2).into_iter().zip(0..).map(|(id, tile)| (tile, WHOLE, id)).collect();
    compare(2, &draws, 1.0);
}

#[test]
fn one_image_on_many_tiles() {
    for level in [0, 1] {
        let above = |id: TileId| TileId::new(level, id.x >> (2 - level), id.y >> (2 - level));
        let draws: Vec<_> = grid(2).into_iter().zip(0..).map(|(id, tile)| (tile, WHOLE, above(id))).collect();
        compare(level, &draws, 30.0);
    }
}

#[test]
fn many_images_on_one_tile() {
    // Windows of 16 meet patches of 8 at their borders, windows of 4 cut them.
    for deeper in [1_u8, 3] {
        let n = 1_u32 << deeper;
        let w = 32 / n;
        let draws: Vec<_> = grid(2)
            .into_iter()
            .zip(0..)
            .flat_map(|(id, tile)| {
                (0..n * n).map(move |i| {
                    let (x, y) = (i % n, i / n);
                    let window = [x * w, y * w, (x + 1) * w, (y + 1) * w];
                    (tile, window, TileId::new(2 + deeper, id.x * n + x, id.y * n + y))
                })
            })
            .collect();
        compare(2 + deeper, &draws, 1.0);
    }
}
