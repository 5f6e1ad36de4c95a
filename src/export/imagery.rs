//! Exports imagery: a level, cut to the extent of the heights, or a tile.
//!
//! Where the layer ends above the level, its finest tile is magnified. Rows of tiles are read from
//! north to south; memory grows with the width.

use std::path::Path;

use super::picture_file::write_png;
use super::{GeotiffOptions, MAX_PICTURE_SIDE, check_apart, memory};
use crate::container::imagery::ImageryHeader;
use crate::container::reader::{ImageryLayer, Reader};
use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::geotiff_write::{GeotiffSpec, GeotiffWriter};
use crate::sample::SampleType;
use crate::source::Samples;
use crate::source::cropped::Bbox;
use crate::texel::Texels;
use crate::tile::TileId;

/// Side of the GeoTIFF's blocks.
const BLOCK: u32 = 256;

/// Most bytes of the texels of a row of tiles, which is held in memory.
const MAX_ROW_BYTES: u64 = 512 << 20;

/// Bytes for each texel of a tile while it is decoded: chunks, codec (WebP needs most), and texels.
const TEXEL: u64 = 32;

/// A rectangle of texels of a level; `left` and `top` are those of its north-west texel.
#[derive(Clone, Copy)]
struct Area {
    level: u8,
    left: u64,
    top: u64,
    columns: u32,
    rows: u32,
}

/// Writes a level of the imagery as a GeoTIFF of bytes: grey or RGB, and alpha if a texel is
/// transparent. Returns its columns and rows of texels.
pub fn imagery_geotiff(reader: &Reader, output: &Path, options: GeotiffOptions) -> Result<(u32, u32)> {
    check_apart(output, reader)?;
    let layer = layer_of(reader)?;
    let area = level_area(reader, layer.header(), options.level)?;
    write_geotiff(reader, layer, area, output, options)?;
    Ok((area.columns, area.rows))
}

/// Writes a level of the imagery as a PNG; returns its columns and rows of texels.
pub fn imagery_picture(reader: &Reader, output: &Path, level: u8) -> Result<(u32, u32)> {
    check_apart(output, reader)?;
    let layer = layer_of(reader)?;
    let area = level_area(reader, layer.header(), level)?;
    write_picture(reader, layer, area, output)?;
    Ok((area.columns, area.rows))
}

/// Writes a tile of the imagery, without its gutters, as a GeoTIFF if `options` are given, else as
/// a PNG. Returns its columns and rows of texels.
pub fn imagery_tile(
    reader: &Reader,
    output: &Path,
    id: TileId,
    geotiff: Option<GeotiffOptions>,
) -> Result<(u32, u32)> {
    check_apart(output, reader)?;
    let layer = layer_of(reader)?;
    if layer.entry(id)?.is_none() {
        return Err(Error::usage(format!("there is no imagery tile {id} in {}", reader.path().display())));
    }
    let tile = layer.header().tile;
    let [left, top] = [id.x, id.y].map(|place| u64::from(place) * u64::from(tile));
    let area = Area { level: id.level, left, top, columns: tile, rows: tile };
    match geotiff {
        Some(options) => write_geotiff(reader, layer, area, output, options)?,
        None => write_picture(reader, layer, area, output)?,
    }
    Ok((tile, tile))
}

/// Writes the texels of a level that a box touches, as a GeoTIFF if `options` are given, else as a
/// PNG. Returns their columns and rows.
pub fn imagery_part(
    reader: &Reader,
    output: &Path,
    bbox: &Bbox,
    level: u8,
    geotiff: Option<GeotiffOptions>,
) -> Result<(u32, u32)> {
    let layer = layer_of(reader)?;
    let whole = level_area(reader, layer.header(), level)?;
    let geo = area_geo(reader, layer.header(), whole);
    let part = bbox.window(&geo, (whole.columns, whole.rows)).map_err(|error| error.at(reader.path()))?;
    let area = Area {
        level,
        left: part.columns.start.into(),
        top: part.rows.start.into(),
        columns: part.columns.end - part.columns.start,
        rows: part.rows.end - part.rows.start,
    };
    match geotiff {
        Some(options) => write_geotiff(reader, layer, area, output, options)?,
        None => write_picture(reader, layer, area, output)?,
    }
    Ok((area.columns, area.rows))
}

fn layer_of(reader: &Reader) -> Result<&ImageryLayer> {
    reader.imagery().ok_or_else(|| {
        Error::usage(format!("{} has no imagery; add a layer to it first", reader.path().display()))
    })
}

/// The texels of a level that lie over the heights.
fn level_area(reader: &Reader, imagery: &ImageryHeader, level: u8) -> Result<Area> {
    if level > imagery.leaf {
        return Err(Error::usage(format!(
            "`level` {level}: the imagery of this file has levels 0 (root) to {}",
            imagery.leaf
        )));
    }
    let header = reader.header();
    let intervals = u128::from(header.tile()) << header.levels;
    let side = |name: &str, samples: u32| {
        let texels = (u128::from(samples - 1) * u128::from(imagery.texels(level))).div_ceil(intervals).max(1);
        let max = u64::from(u32::MAX / 4);
        let texels = u64::try_from(texels).unwrap_or(u64::MAX);
        if texels > max {
            return Err(Error::limit(format!("{name} (choose a coarser `level`)"), texels, max));
        }
        Ok(texels as u32)
    };
    let (columns, rows) = (side("columns", header.width)?, side("rows", header.height)?);
    Ok(Area { level, left: 0, top: 0, columns, rows })
}

/// Georeference of an area, with texels as pixels.
fn area_geo(reader: &Reader, imagery: &ImageryHeader, area: Area) -> Geo {
    let header = reader.header();
    let intervals = f64::from(header.tile()) * f64::from(header.spacing(0));
    let step = intervals / imagery.texels(area.level) as f64;
    let transform = reader.geo().transform.map(|[x0, a, b, y0, d, e]| {
        // Texel (0, 0) begins at sample (0, 0), which lies half a pixel from the corner.
        let (column, row) = (0.5 + area.left as f64 * step, 0.5 + area.top as f64 * step);
        [x0 + column * a + row * b, a * step, b * step, y0 + column * d + row * e, d * step, e * step]
    });
    Geo { transform, ..reader.geo().clone() }
}

fn write_geotiff(
    reader: &Reader,
    layer: &ImageryLayer,
    area: Area,
    output: &Path,
    options: GeotiffOptions,
) -> Result<()> {
    let geo = area_geo(reader, layer.header(), area);
    let mut spec = GeotiffSpec::new(area.columns, area.rows, SampleType::Uint8, &geo);
    spec.bands = bands(layer.header()) as u16;
    spec.compression = options.compression;
    spec.force = options.force;
    spec.tile = Some(BLOCK);
    let row = u64::from(area.columns) * u64::from(layer.header().tile) * u64::from(spec.bands);
    if row > MAX_ROW_BYTES {
        let what = "bytes of a row of imagery tiles (choose a coarser `level`, or a `tile`)";
        return Err(Error::limit(what, row, MAX_ROW_BYTES));
    }
    let bytes = of_row(layer.header(), area).saturating_add(GeotiffWriter::memory(&spec));
    memory::check(reader, "an export of imagery", bytes)?;
    let mut writer = GeotiffWriter::create(output, &spec)?;
    each_band(layer, area, |pixels| writer.write_rows(&Samples::Uint8(pixels)))?;
    writer.finish().map(drop)
}

fn write_picture(reader: &Reader, layer: &ImageryLayer, area: Area, output: &Path) -> Result<()> {
    for (what, side) in [("picture width", area.columns), ("picture height", area.rows)] {
        if side > MAX_PICTURE_SIDE {
            let what = format!("{what} (choose a coarser `level`, or a GeoTIFF)");
            return Err(Error::limit(what, side.into(), MAX_PICTURE_SIDE.into()));
        }
    }
    let kind = match bands(layer.header()) {
        1 => png::ColorType::Grayscale,
        2 => png::ColorType::GrayscaleAlpha,
        3 => png::ColorType::Rgb,
        _ => png::ColorType::Rgba,
    };
    let pixel = bands(layer.header()) as u64;
    let bytes = of_row(layer.header(), area).saturating_add(memory::of_png(area.columns, area.rows, pixel));
    memory::check(reader, "a picture of imagery", bytes)?;
    let mut pixels = Vec::with_capacity(area.columns as usize * area.rows as usize * pixel as usize);
    each_band(layer, area, |rows| {
        pixels.extend(rows);
        Ok(())
    })?;
    write_png(output, (area.columns, area.rows), (kind, png::BitDepth::Eight), &pixels, &[])
}

/// Bytes of a row of tiles, and of a tile while it is decoded.
fn of_row(header: &ImageryHeader, area: Area) -> u64 {
    let texels = (u64::from(header.tile) + 2 * u64::from(header.gutter)).pow(2);
    u64::from(area.columns) * u64::from(header.tile) * bands(header) as u64 + texels * TEXEL
}

/// Bytes of a pixel.
fn bands(header: &ImageryHeader) -> usize {
    header.colour.channels() + usize::from(header.alpha)
}

/// Calls `take` with the pixels of whole rows of an area, from north to south.
fn each_band(layer: &ImageryLayer, area: Area, mut take: impl FnMut(Vec<u8>) -> Result<()>) -> Result<()> {
    let tile = u64::from(layer.header().tile);
    let bands = bands(layer.header());
    let (right, bottom) = (area.left + u64::from(area.columns), area.top + u64::from(area.rows));
    for y in area.top / tile..bottom.div_ceil(tile) {
        let (top, end) = ((y * tile).max(area.top), ((y + 1) * tile).min(bottom));
        let mut pixels = vec![0; area.columns as usize * (end - top) as usize * bands];
        for x in area.left / tile..right.div_ceil(tile) {
            let (left, stop) = ((x * tile).max(area.left), ((x + 1) * tile).min(right));
            let Some(shown) = finest(layer, TileId::new(area.level, x as u32, y as u32))? else { continue };
            for row in top..end {
                let start = ((row - top) * u64::from(area.columns) + left - area.left) as usize * bands;
                let target = &mut pixels[start..start + (stop - left) as usize * bands];
                for (column, pixel) in (left..stop).zip(target.chunks_exact_mut(bands)) {
                    shown.put((column - x * tile, row - y * tile), pixel);
                }
            }
        }
        take(pixels)?;
    }
    Ok(())
}

/// The texels shown for a tile: its own, or a part of its finest ancestor in the layer.
struct ShownTile {
    texels: Texels,
    gutter: u64,
    /// Number of levels between the ancestor and the tile.
    down: u8,
    /// North-west texel of the tile within the ancestor, in texels of the tile's level.
    origin: (u64, u64),
}

/// The tile, or its finest ancestor in the layer.
fn finest(layer: &ImageryLayer, id: TileId) -> Result<Option<ShownTile>> {
    let tile = u64::from(layer.header().tile);
    for down in 0..=id.level {
        let ancestor = TileId::new(id.level - down, id.x >> down, id.y >> down);
        if layer.entry(ancestor)?.is_some() {
            let within = |place: u32| (u64::from(place) & ((1 << down) - 1)) * tile;
            let origin = (within(id.x), within(id.y));
            let (texels, gutter) = (layer.read_tile(ancestor)?, layer.header().gutter.into());
            return Ok(Some(ShownTile { texels, gutter, down, origin }));
        }
    }
    Ok(None)
}

impl ShownTile {
    /// Writes the texel at a column and row of the tile.
    fn put(&self, (column, row): (u64, u64), pixel: &mut [u8]) {
        let along = |origin: u64, place: u64| (((origin + place) >> self.down) + self.gutter) as usize;
        let at = along(self.origin.1, row) * self.texels.side + along(self.origin.0, column);
        let channels = self.texels.kind.channels();
        pixel[..channels].copy_from_slice(&self.texels.colour[at * channels..][..channels]);
        if let Some(alpha) = pixel.get_mut(channels) {
            *alpha = self.texels.alpha.as_ref().map_or(255, |alphas| alphas[at]);
        }
    }
}
