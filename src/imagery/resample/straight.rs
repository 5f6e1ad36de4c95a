//! Pictures whose columns are columns of texels: both axes are resampled one after the other.

use std::ops::Range;

use super::super::light::TABLES;
use super::super::place::{Map, Placed};
use super::super::square::{EDGE, Layer, Square, texel};
use crate::error::Result;
use crate::simd::{self, Kernel};
use crate::source::picture::Pixels;
use crate::texel::Colour;

/// The texels of a picture in a square; `None` if it does not touch the square.
pub(super) fn resample(placed: &Placed<'_>, map: &Map, square: Square) -> Result<Option<Layer>> {
    let info = placed.picture.info();
    let columns = Axis::new(map.a, map.x, square.left, square.side, info.width);
    let rows = Axis::new(map.e, map.y, square.top, square.side, info.height);
    let (Some(across), Some(down)) = (columns.pixels(), rows.pixels()) else { return Ok(None) };
    let origin = (across.start, down.start);
    let width = across.len();
    let pixels = placed.picture.read_window(across, down)?;
    let work = Straight { pixels: &pixels, width, origin, columns: &columns, rows: &rows };
    let grey = info.kind == Colour::Grey;
    let complete = columns.first.iter().chain(&rows.first).all(Option::is_some);
    Ok(match (pixels.alpha.is_some() || !complete, grey) {
        (false, true) => simd::run(Opaque::<1>(&work)),
        (false, false) => simd::run(Opaque::<3>(&work)),
        (true, true) => simd::run(Sheer::<1, 2>(&work)),
        (true, false) => simd::run(Sheer::<3, 4>(&work)),
    })
}

/// The pixels, and their weights, that the texels along one axis are made of.
struct Axis {
    /// How many pixels each texel is made of.
    taps: usize,
    /// The first pixel of each texel; `None` if its centre is outside.
    first: Vec<Option<u32>>,
    /// `taps` weights for each texel, of sum 1.
    weights: Vec<f32>,
}

impl Axis {
    /// The axis of `count` texels from `start` on: texel `i` spans pixels `scale i + offset` to
    /// `scale (i + 1) + offset`.
    fn new(scale: f64, offset: f64, start: i64, count: usize, pixels: u32) -> Self {
        let shrinks = scale.abs() > 1.0;
        let taps = if shrinks { scale.abs().ceil() as usize + 1 } else { 2 }.min(pixels as usize);
        let mut axis = Self { taps, first: Vec::with_capacity(count), weights: vec![0.0; count * taps] };
        let end = f64::from(pixels);
        for (texel, weights) in (start..).zip(axis.weights.chunks_exact_mut(taps)).take(count) {
            let centre = scale * (texel as f64 + 0.5) + offset;
            if !(-EDGE..=end + EDGE).contains(&centre) {
                axis.first.push(None);
                continue;
            }
            let half = if shrinks { scale.abs() / 2.0 } else { 0.5 };
            let (low, high) = (centre - half, centre + half);
            let first = low.max(0.0).floor().min(end - taps as f64) as u32;
            // Linear interpolation between two pixel centres has the weights of a window of one
            // pixel. At an edge the pixel there gets the rest of the weight.
            let share = |pixel: f64| ((pixel + 1.0).min(high) - pixel.max(low)).max(0.0);
            let inside: f64 = (0..taps).map(|tap| share(f64::from(first) + tap as f64)).sum();
            for (tap, weight) in weights.iter_mut().enumerate() {
                *weight = (share(f64::from(first) + tap as f64) / inside) as f32;
            }
            axis.first.push(Some(first));
        }
        axis
    }

    /// The range of pixels that its texels need; `None` if all are outside.
    fn pixels(&self) -> Option<Range<u32>> {
        let first = self.first.iter().flatten();
        Some(*first.clone().min()?..*first.max()? + self.taps as u32)
    }
}

/// A window of pixels that begins at `origin`, and the axes it is resampled along.
struct Straight<'a> {
    pixels: &'a Pixels,
    width: usize,
    origin: (u32, u32),
    columns: &'a Axis,
    rows: &'a Axis,
}

/// A ring of the rows of light that were made last.
struct Rows {
    slots: Vec<(Option<u32>, Vec<f32>)>,
}

impl Rows {
    /// A ring of `taps` rows.
    fn new(taps: usize, length: usize) -> Self {
        Self { slots: vec![(None, vec![0.0; length]); taps] }
    }

    /// Sets `out` to the weighted sum of `weights.len()` rows from `first` on, each made by `make`
    /// if it is not in the ring.
    #[inline(always)]
    fn sum(&mut self, first: u32, weights: &[f32], out: &mut [f32], make: impl Fn(u32, &mut [f32])) {
        let taps = self.slots.len();
        for (row, &weight) in (first..).zip(weights) {
            let (made, light) = &mut self.slots[row as usize % taps];
            if *made != Some(row) && weight != 0.0 {
                make(row, light);
                *made = Some(row);
            }
            if row == first {
                out.iter_mut().zip(&*light).for_each(|(sum, light)| *sum = light * weight);
            } else if weight != 0.0 {
                out.iter_mut().zip(&*light).for_each(|(sum, light)| *sum += light * weight);
            }
        }
    }
}

/// The weighted sum of pixels, `C` numbers each.
#[inline(always)]
fn dot<const C: usize>(row: &[f32], weights: &[f32]) -> [f32; C] {
    let mut sum = [0.0; C];
    for (pixel, &weight) in row.as_chunks::<C>().0.iter().zip(weights) {
        for (sum, value) in sum.iter_mut().zip(pixel) {
            *sum += value * weight;
        }
    }
    sum
}

/// Kernel: resamples where all pixels are opaque and all texels inside.
struct Opaque<'a, const C: usize>(&'a Straight<'a>);

impl<const C: usize> Kernel for Opaque<'_, C> {
    type Output = Option<Layer>;

    #[inline(always)]
    fn run(self) -> Option<Layer> {
        let &Straight { pixels, width, origin, columns, rows } = self.0;
        let side = columns.first.len();
        let tables = &*TABLES;
        let mut colour = vec![0; side * rows.first.len() * C];
        let mut ring = Rows::new(rows.taps, width * C);
        let mut light = vec![0.0; width * C];
        let make = |row: u32, out: &mut [f32]| {
            let bytes = &pixels.colour[(row - origin.1) as usize * width * C..][..width * C];
            out.iter_mut().zip(bytes).for_each(|(light, &byte)| *light = tables.light[usize::from(byte)]);
        };
        let down = rows.first.iter().flatten().zip(rows.weights.chunks_exact(rows.taps));
        for ((&first, weights), out) in down.zip(colour.chunks_exact_mut(side * C)) {
            ring.sum(first, weights, &mut light, make);
            let out = out.as_chunks_mut::<C>().0;
            match columns.taps {
                2 => across::<C, 2>(columns, origin.0, &light, out),
                3 => across::<C, 3>(columns, origin.0, &light, out),
                _ => across_any::<C>(columns, origin.0, &light, out),
            }
        }
        Some(Layer { kind: if C == 1 { Colour::Grey } else { Colour::Rgb }, colour, alpha: None })
    }
}

/// Sets `out` to a row of texels, each made of `N` pixels.
#[inline(always)]
fn across<const C: usize, const N: usize>(axis: &Axis, origin: u32, light: &[f32], out: &mut [[u8; C]]) {
    let tables = &*TABLES;
    let weights = axis.weights.as_chunks::<N>().0;
    for ((&first, weights), out) in axis.first.iter().flatten().zip(weights).zip(out) {
        let row = &light[(first - origin) as usize * C..][..C * N];
        let sum = dot::<C>(row, weights);
        for (out, sum) in out.iter_mut().zip(sum) {
            *out = tables.byte(sum);
        }
    }
}

/// Sets `out` to a row of texels, each made of any number of pixels.
#[inline(always)]
fn across_any<const C: usize>(axis: &Axis, origin: u32, light: &[f32], out: &mut [[u8; C]]) {
    let tables = &*TABLES;
    let weights = axis.weights.chunks_exact(axis.taps);
    for ((&first, weights), out) in axis.first.iter().flatten().zip(weights).zip(out) {
        let row = &light[(first - origin) as usize * C..][..C * axis.taps];
        let sum = dot::<C>(row, weights);
        for (out, sum) in out.iter_mut().zip(sum) {
            *out = tables.byte(sum);
        }
    }
}

/// Kernel: resamples where some pixels are transparent or some texels outside. A pixel is `C`
/// numbers of colour, multiplied by alpha, and alpha, `K` in all.
struct Sheer<'a, const C: usize, const K: usize>(&'a Straight<'a>);

impl<const C: usize, const K: usize> Kernel for Sheer<'_, C, K> {
    type Output = Option<Layer>;

    #[inline(always)]
    fn run(self) -> Option<Layer> {
        let &Straight { pixels, width, origin, columns, rows } = self.0;
        let side = columns.first.len();
        let mut colour = vec![0; side * rows.first.len() * C];
        let mut alpha = vec![0; side * rows.first.len()];
        let mut ring = Rows::new(rows.taps, width * K);
        let mut light = vec![0.0; width * K];
        let make = |row: u32, out: &mut [f32]| {
            let start = (row - origin.1) as usize * width;
            let bytes = &pixels.colour[start * C..][..width * C];
            let alpha = pixels.alpha.as_ref().map(|alpha| &alpha[start..][..width]);
            sheer_row::<C, K>(bytes, alpha, out);
        };
        let down = rows.first.iter().zip(rows.weights.chunks_exact(rows.taps));
        let out = colour.chunks_exact_mut(side * C).zip(alpha.chunks_exact_mut(side));
        for ((first, weights), (colour, alpha)) in down.zip(out) {
            let &Some(first) = first else { continue };
            ring.sum(first, weights, &mut light, make);
            let out = colour.as_chunks_mut::<C>().0.iter_mut().zip(alpha);
            let across = columns.first.iter().zip(columns.weights.chunks_exact(columns.taps));
            for ((first, weights), (colour, alpha)) in across.zip(out) {
                let Some(first) = first else { continue };
                let row = &light[(first - origin.0) as usize * K..][..K * columns.taps];
                *alpha = texel::<C, K>(dot::<K>(row, weights), colour);
            }
        }
        let shows = alpha.iter().any(|&a| a > 0);
        let alpha = alpha.iter().any(|&a| a < 255).then_some(alpha);
        shows.then_some(Layer { kind: if C == 1 { Colour::Grey } else { Colour::Rgb }, colour, alpha })
    }
}

/// Sets `out` to the light of pixels, multiplied by their alpha (0 to 1), each followed by its
/// alpha.
#[inline(always)]
fn sheer_row<const C: usize, const K: usize>(bytes: &[u8], alpha: Option<&[u8]>, out: &mut [f32]) {
    let tables = &*TABLES;
    for (index, (out, bytes)) in
        out.as_chunks_mut::<K>().0.iter_mut().zip(bytes.as_chunks::<C>().0).enumerate()
    {
        let opacity = f32::from(alpha.map_or(255, |alpha| alpha[index])) / 255.0;
        for channel in 0..C {
            out[channel] = tables.light[usize::from(bytes[channel])] * opacity;
        }
        out[C] = opacity;
    }
}
