//! One picture onto a square of texels.
//!
//! Along an axis on which a texel spans at most one pixel the picture is interpolated linearly between pixel centres, else averaged over
//! the pixels that the texel covers, each by its share. A texel belongs to a picture if its centre lies in it: pictures that abut
//! leave no seam. Pixels outside do not count, nor do transparent ones for the colour. Every texel is computed from its own
//! coordinates alone, in one order, so that two squares that share it agree bit for bit.

use std::ops::Range;

use super::light::TABLES;
use super::oblique;
use super::place::Placed;
use crate::error::Result;
use crate::simd::{self, Kernel};
use crate::source::picture::Pixels;
use crate::texel::Colour;

/// Fraction of a pixel by which a centre may lie outside: rounding must not open a gap between two pictures.
pub(super) const EDGE: f64 = 1e-6;

/// A square of texels of a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Square {
    pub(super) level: u8,
    /// The first column and row; those of a gutter may be negative.
    pub(super) left: i64,
    pub(super) top: i64,
    pub(super) side: usize,
}

/// Resampled texels of a square, row by row. Colours of transparent ones are 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Layer {
    pub(super) kind: Colour,
    pub(super) colour: Vec<u8>,
    /// `None` if all are opaque.
    pub(super) alpha: Option<Vec<u8>>,
}

/// Pixels that texels of one axis are made of.
pub(super) struct Axis {
    /// Pixels of each texel.
    taps: usize,
    /// The first pixel of each texel; `None` if its centre is outside.
    first: Vec<Option<u32>>,
    /// `taps` weights for each texel, of sum 1.
    weights: Vec<f32>,
}

impl Axis {
    /// Texels from `start` on, of which texel `i` spans pixels `scale i + offset` to `scale (i + 1) + offset`.
    pub(super) fn new(scale: f64, offset: f64, start: i64, count: usize, pixels: u32) -> Self {
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
            // A line between two pixel centres weighs them as a window of one pixel does; what it lacks at an edge goes to the edge.
            let share = |pixel: f64| ((pixel + 1.0).min(high) - pixel.max(low)).max(0.0);
            let inside: f64 = (0..taps).map(|tap| share(f64::from(first) + tap as f64)).sum();
            for (tap, weight) in weights.iter_mut().enumerate() {
                *weight = (share(f64::from(first) + tap as f64) / inside) as f32;
            }
            axis.first.push(Some(first));
        }
        axis
    }

    /// The pixels that its texels need; `None` if all are outside.
    fn pixels(&self) -> Option<Range<u32>> {
        let first = self.first.iter().flatten();
        Some(*first.clone().min()?..*first.max()? + self.taps as u32)
    }
}

/// A picture on a square of texels; `None` if it does not touch it.
pub(super) fn resample(placed: &Placed<'_>, square: Square) -> Result<Option<Layer>> {
    let map = placed.map(square.level);
    if !map.is_straight() {
        return oblique::resample(placed, square);
    }
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

/// What is resampled: a window of pixels that begins at `origin`.
struct Straight<'a> {
    pixels: &'a Pixels,
    width: usize,
    origin: (u32, u32),
    columns: &'a Axis,
    rows: &'a Axis,
}

/// Rows of light that were made last.
struct Rows {
    slots: Vec<(Option<u32>, Vec<f32>)>,
}

impl Rows {
    fn new(taps: usize, length: usize) -> Self {
        Self { slots: vec![(None, vec![0.0; length]); taps] }
    }

    /// The weighted sum of `weights.len()` rows from `first` on, each made by `make` if it is not here.
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

/// All pixels opaque, all texels inside.
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

/// A row of texels, `N` pixels each.
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

/// A row of texels, any number of pixels each.
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

/// Some pixels transparent or some texels outside: `C` numbers of colour, multiplied by alpha, and alpha, `K` in all.
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
                *alpha = settle::<C, K>(dot::<K>(row, weights), colour);
            }
        }
        let shows = alpha.iter().any(|&a| a > 0);
        let alpha = alpha.iter().any(|&a| a < 255).then_some(alpha);
        shows.then_some(Layer { kind: if C == 1 { Colour::Grey } else { Colour::Rgb }, colour, alpha })
    }
}

/// Light of pixels multiplied by their alpha, 0 to 1, which follows it.
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

/// Colour and alpha of a texel from its sums. One that is opaque is not divided: it is what it would be among opaque ones.
#[inline(always)]
pub(super) fn settle<const C: usize, const K: usize>(sums: [f32; K], colour: &mut [u8; C]) -> u8 {
    let opacity = sums[C];
    let alpha = (opacity * 255.0 + 0.5) as u8;
    if alpha > 0 {
        let divisor = if alpha == 255 { 1.0 } else { opacity };
        for (colour, sum) in colour.iter_mut().zip(sums) {
            *colour = TABLES.byte((sum / divisor).min(16384.0));
        }
    }
    alpha
}
