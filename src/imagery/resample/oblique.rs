//! Pictures that are turned or sheared against the texel grid: linear interpolation at points
//! spread evenly over each texel, as many along each of its sides as it spans pixels.

use std::ops::Range;

use super::super::light::TABLES;
use super::super::place::{Map, Placed};
use super::super::square::{EDGE, Layer, Square, texel};
use crate::error::Result;
use crate::source::picture::Pixels;
use crate::texel::Colour;

/// A window of pixels of a picture.
struct Window {
    pixels: Pixels,
    columns: Range<u32>,
    rows: Range<u32>,
}

/// The texels of a picture in a square; `None` if it does not touch the square.
pub(super) fn resample(placed: &Placed<'_>, map: &Map, square: Square) -> Result<Option<Layer>> {
    let info = placed.picture.info();
    let (columns, rows) = placed.window(square);
    if columns.is_empty() || rows.is_empty() {
        return Ok(None);
    }
    let pixels = placed.picture.read_window(columns.clone(), rows.clone())?;
    let window = Window { pixels, columns, rows };
    let size = (f64::from(info.width), f64::from(info.height));
    Ok(match info.kind {
        Colour::Grey => texels::<1, 2>(&window, map, square, size, Colour::Grey),
        Colour::Rgb => texels::<3, 4>(&window, map, square, size, Colour::Rgb),
    })
}

/// Texels of `C` numbers of colour, `K` with alpha.
fn texels<const C: usize, const K: usize>(
    window: &Window,
    map: &Map,
    square: Square,
    size: (f64, f64),
    kind: Colour,
) -> Option<Layer> {
    let count = square.side * square.side;
    let (mut colour, mut alpha) = (vec![0; count * C], vec![0; count]);
    let steps = map.steps();
    let points = |step: f64| (step.ceil() as u32).max(1);
    let (across, down) = (points(steps.0), points(steps.1));
    let part = 1.0 / f64::from(across * down);
    let inside = |value: f64, end: f64| (-EDGE..=end + EDGE).contains(&value);
    let texels = colour.as_chunks_mut::<C>().0.iter_mut().zip(&mut alpha).enumerate();
    for (index, (colour, alpha)) in texels {
        let c = (square.left + (index % square.side) as i64) as f64;
        let r = (square.top + (index / square.side) as i64) as f64;
        let (u, v) = map.apply(c + 0.5, r + 0.5);
        if !inside(u, size.0) || !inside(v, size.1) {
            continue;
        }
        let mut sums = [0.0_f32; K];
        for point in 0..across * down {
            let (x, y) = (f64::from(point % across) + 0.5, f64::from(point / across) + 0.5);
            let (u, v) = map.apply(c + x / f64::from(across), r + y / f64::from(down));
            interpolate::<C, K>(window, size, (u - 0.5, v - 0.5), part, &mut sums);
        }
        *alpha = texel::<C, K>(sums, colour);
    }
    let shows = alpha.iter().any(|&a| a > 0);
    let alpha = alpha.iter().any(|&a| a < 255).then_some(alpha);
    shows.then_some(Layer { kind, colour, alpha })
}

/// Adds `part` of the light at a point between four pixel centres. Outside the picture the nearest
/// pixel counts.
fn interpolate<const C: usize, const K: usize>(
    window: &Window,
    size: (f64, f64),
    (u, v): (f64, f64),
    part: f64,
    sums: &mut [f32; K],
) {
    let width = window.columns.len();
    let (x, y) = (u.floor(), v.floor());
    let clamp = |value: f64, size: f64, window: &Range<u32>| {
        let pixel = value.clamp(0.0, size - 1.0) as u32;
        (pixel.clamp(window.start, window.end - 1) - window.start) as usize
    };
    for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
        let weight = (1.0 - (u - x - dx).abs()) * (1.0 - (v - y - dy).abs()) * part;
        let (column, row) = (clamp(x + dx, size.0, &window.columns), clamp(y + dy, size.1, &window.rows));
        let index = row * width + column;
        let opacity = window.pixels.alpha.as_ref().map_or(255, |alpha| alpha[index]);
        let weight = weight as f32 * (f32::from(opacity) / 255.0);
        let pixel = &window.pixels.colour[index * C..][..C];
        for (sum, &byte) in sums.iter_mut().zip(pixel) {
            *sum += TABLES.light[usize::from(byte)] * weight;
        }
        sums[C] += weight;
    }
}
