//! The most memory that making the tiles takes, known before a pixel is read.

use std::ops::Range;

use super::place::Placed;
use super::sweep::BATCH;
use super::{GUTTER, Resolution, TexelGrid, placed};
use crate::error::Result;
use crate::geo::Geo;
use crate::source::picture::{KEPT, Memory, Picture};
use crate::texel::Colour;

/// Bytes for each texel of a tile that a thread works on: canvas, layer, texels, and the memory of
/// the codec (WebP takes most).
const THREAD_TEXEL: u64 = 48;
/// Bytes for each pixel that a tile is resampled from.
const PIXEL: u64 = 4;
/// Bytes of the index for each tile of the layer: its row, its entry in a map, and its share of a
/// packed page.
const INDEX: u64 = 128;
/// Bytes of a half besides its texels.
const EACH: u64 = 256;

/// The most memory that [`super::build`] takes on `threads` threads; `reading` is all of it but the
/// cached blocks of pictures.
///
/// - The halves of each level: of four rows of the tiles that pictures touch, and of those that are
///   made together, which are about a hundred, or a row.
/// - For each thread a tile, the pixels that it is resampled from, and a block of the picture that
///   it reads.
/// - The index of the layer.
pub fn memory(
    pictures: &[Box<dyn Picture>],
    geo: &Geo,
    grid: &TexelGrid,
    resolution: Resolution,
    threads: usize,
) -> Result<Memory> {
    let placed = placed(pictures, geo, grid, resolution)?;
    let finest = placed.iter().map(|placed| placed.level).max().unwrap_or(0);
    let is_rgb = pictures.iter().any(|picture| picture.info().kind == Colour::Rgb);
    let channels = if is_rgb { 4 } else { 2 };
    let half = u64::from(grid.tile / 2).pow(2) * channels + EACH;
    let (mut halves, mut tiles) = (0, 0);
    for level in 0..=finest {
        let (columns, rows) = touched(&placed, level);
        let all = columns * rows;
        halves += all.min(5 * columns + BATCH as u64) * half;
        tiles += all;
    }
    let texels = (u64::from(grid.tile) + 2 * GUTTER as u64).pow(2);
    let read = placed.iter().map(|placed| reading(placed, grid)).max().unwrap_or(0);
    let kept = pictures.iter().map(|picture| picture.memory().kept).fold(0, u64::saturating_add);
    let block = pictures.iter().map(|picture| picture.memory().block).max().unwrap_or(0);
    let each = read.saturating_add(texels * THREAD_TEXEL);
    let reading =
        each.saturating_mul(threads as u64).saturating_add(halves + tiles * INDEX).saturating_add(block);
    Ok(Memory { reading, block, kept: kept.min(KEPT) })
}

/// How many columns and rows of tiles of a level there are from the first to the last that pictures
/// touch.
fn touched(placed: &[Placed<'_>], level: u8) -> (u64, u64) {
    let finer = || placed.iter().filter(|placed| placed.level >= level);
    let span = |a: Range<u32>, b: Range<u32>| match (a.is_empty(), b.is_empty()) {
        (true, _) => b,
        (_, true) => a,
        _ => a.start.min(b.start)..a.end.max(b.end),
    };
    let rows = finer().map(|placed| placed.rows(level)).fold(0..0, span);
    let columns = finer().map(|placed| placed.all_columns(level)).fold(0..0, span);
    (columns.len() as u64, rows.len() as u64)
}

/// Bytes that a thread takes to read the pixels of a tile of the picture's own level: no tile needs
/// more.
fn reading(placed: &Placed<'_>, grid: &TexelGrid) -> u64 {
    let info = placed.picture.info();
    let side = grid.tile as usize + 2 * GUTTER;
    let (across, down) = placed.map(placed.level).box_of(side as f64);
    let pixels = |length: f64, most: u32| length.ceil().min(f64::from(most)) as u64;
    let window = (pixels(across, info.width) * pixels(down, info.height)).saturating_mul(PIXEL);
    window.saturating_add(placed.picture.memory().reading)
}
