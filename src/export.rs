//! A level or a tile of a container back to a raster: GeoTIFF, or a picture.
//!
//! Tiles are read in rows from north to south; memory grows with the width of the level. At the leaf level the samples are
//! the source's own, bit for bit unless the file is quantised.

mod imagery;
mod picture_file;
mod tile;

use std::path::Path;

pub use imagery::{imagery_geotiff, imagery_picture, imagery_tile};
pub use tile::{HeightScale, tile_geotiff, tile_picture};

use crate::container::layout::Header;
use crate::container::reader::Reader;
use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::geotiff_write::{Compression, GeotiffSpec, GeotiffWriter};
use crate::hillshade;
use crate::sample::{SampleType, VALID};
use crate::source::Samples;
use crate::tile::TileId;

/// Largest picture, in samples on a side: a PNG is made in memory.
const MAX_PICTURE_SIDE: u32 = 16_384;

/// How a GeoTIFF is to be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GeotiffOptions {
    /// The level.
    pub level: u8,
    /// Compression of the strips.
    pub compression: Compression,
    /// Replace an existing file.
    pub force: bool,
}

/// Georeference of a level: pixels as many times larger, its first sample on the raster's first.
pub fn level_geo(geo: &Geo, header: &Header, level: u8) -> Geo {
    let step = f64::from(header.spacing(level));
    let transform = geo.transform.map(|[x0, a, b, y0, d, e]| {
        // Pixel (0, 0) of the level is centred on sample (0, 0), which stands half a source pixel in.
        let shift = 0.5 - 0.5 * step;
        [x0 + shift * (a + b), a * step, b * step, y0 + shift * (d + e), d * step, e * step]
    });
    Geo { transform, ..geo.clone() }
}

/// Writes a level as a GeoTIFF; returns its size in samples.
pub fn geotiff(reader: &Reader, output: &Path, options: GeotiffOptions) -> Result<(u32, u32)> {
    let header = reader.header();
    check_level(header, options.level)?;
    let (columns, rows) = header.level_size(options.level);
    let geo = level_geo(reader.geo(), header, options.level);
    let mut spec = GeotiffSpec::new(columns, rows, header.source_type, &geo);
    spec.nodata = void_value(reader, options.level)?;
    spec.band_scale = header.band_scale;
    spec.band_offset = header.band_offset;
    spec.unit = &reader.metadata().vertical_unit;
    spec.compression = options.compression;
    spec.force = options.force;
    let mut writer = GeotiffWriter::create(output, &spec)?;
    each_band(reader, options.level, |values| {
        writer.write_rows(&samples(values, header.source_type, spec.nodata))
    })?;
    writer.finish()?;
    Ok((columns, rows))
}

/// Writes a level as a shaded PNG; returns its size.
pub fn picture(reader: &Reader, output: &Path, level: u8, style: hillshade::Style) -> Result<(u32, u32)> {
    let header = reader.header();
    check_level(header, level)?;
    let (columns, rows) = header.level_size(level);
    for (what, side) in [("picture width", columns), ("picture height", rows)] {
        if side > MAX_PICTURE_SIDE {
            return Err(Error::limit(
                format!("{what} (choose a coarser --level)"),
                side.into(),
                MAX_PICTURE_SIDE.into(),
            ));
        }
    }
    let mut heights = Vec::with_capacity(columns as usize * rows as usize);
    each_band(reader, level, |values| {
        heights.extend(values.iter().map(|v| v.map_or(f32::NAN, |v| header.metres(v) as f32)));
        Ok(())
    })?;
    let spacing = reader.geo().spacing((0, header.width - 1), (header.height / 2, header.height / 2));
    let step = f64::from(header.spacing(level));
    let mut options = hillshade::Options::new(spacing.dx * step, spacing.dy * step);
    options.style = style;
    let rgba = hillshade::hillshade(&heights, columns as usize, rows as usize, &options)?;
    hillshade::write_png(output, &rgba, columns, rows)?;
    Ok((columns, rows))
}

fn check_level(header: &Header, level: u8) -> Result<()> {
    if level > header.levels {
        return Err(Error::usage(format!(
            "--level {level}: this file has levels 0 (root) to {}",
            header.levels
        )));
    }
    Ok(())
}

/// Calls `take` with the values of whole rows of a level, north to south; `None` is void.
fn each_band(reader: &Reader, level: u8, mut take: impl FnMut(&[Option<f64>]) -> Result<()>) -> Result<()> {
    let header = reader.header();
    let (columns, rows) = (header.level_size(level).0 as usize, header.level_size(level).1 as usize);
    let n = header.tile() as usize;
    let last = (1_usize << level) - 1;
    let mut values: Vec<Option<f64>> = Vec::new();
    for y in 0..=((rows - 1) / n).min(last) {
        let first = y * n;
        // Each tile owns its first n rows and columns; the last one its border too.
        let height = if y == last { rows - first } else { (rows - first).min(n) };
        values.clear();
        values.resize(columns * height, None);
        for x in 0..=((columns - 1) / n).min(last) {
            let id = TileId::new(level, x as u32, y as u32);
            if reader.entry(id)?.is_none() {
                continue;
            }
            let lattice = reader.read_tile(id)?;
            let left = x * n;
            let width = if x == last { columns - left } else { (columns - left).min(n) };
            for row in 0..height {
                for column in 0..width {
                    let at = lattice.at(column, row);
                    if lattice.state[at] == VALID {
                        values[row * columns + left + column] = Some(lattice.value(at, header.coding));
                    }
                }
            }
        }
        take(&values)?;
    }
    Ok(())
}

/// The value to write for voids: the source's, or where it has none and the level has voids (a mask), NaN or the end of the
/// type's range that the data does not reach.
fn void_value(reader: &Reader, level: u8) -> Result<Option<f64>> {
    let header = reader.header();
    let range = integer_range(header.source_type);
    let usable = |v: &f64| range.is_none_or(|(low, high)| (low..=high).contains(v) && v.fract() == 0.0);
    if let Some(nodata) = header.nodata.filter(usable) {
        return Ok(Some(nodata));
    }
    let statistics = reader.statistics()?.and_then(|s| s.levels.into_iter().find(|l| l.level == level));
    if statistics.is_some_and(|l| l.valid == l.columns * l.rows) {
        return Ok(None);
    }
    let Some((low, high)) = range else { return Ok(Some(f64::NAN)) };
    let Some(root) = reader.entry(TileId::ROOT)? else { return Ok(Some(low)) };
    let value =
        |metres: f32| (f64::from(metres) / header.unit_metres - header.band_offset) / header.band_scale;
    let (a, b) = (value(root.min_m), value(root.max_m));
    if a.min(b) > low + 1.0 {
        Ok(Some(low))
    } else if a.max(b) < high - 1.0 {
        Ok(Some(high))
    } else {
        Err(Error::usage(format!(
            "{}: voids came from a mask and the samples use the whole range of {}, so none is free to stand for void",
            reader.path().display(),
            header.source_type.gdal_name()
        )))
    }
}

/// Least and greatest value of an integer type; `None` for floats.
fn integer_range(kind: SampleType) -> Option<(f64, f64)> {
    match kind {
        SampleType::Int8 => Some((f64::from(i8::MIN), f64::from(i8::MAX))),
        SampleType::Uint8 => Some((0.0, f64::from(u8::MAX))),
        SampleType::Int16 => Some((f64::from(i16::MIN), f64::from(i16::MAX))),
        SampleType::Uint16 => Some((0.0, f64::from(u16::MAX))),
        SampleType::Int32 => Some((f64::from(i32::MIN), f64::from(i32::MAX))),
        SampleType::Uint32 => Some((0.0, f64::from(u32::MAX))),
        SampleType::Float32 | SampleType::Float64 => None,
    }
}

/// Values as samples of the source's type; quantised values are rounded into it.
///
/// A quantised height that falls on the void value is moved to the next number, so that it does not become a void.
fn samples(values: &[Option<f64>], kind: SampleType, void: Option<f64>) -> Samples {
    macro_rules! convert {
        ($variant:ident, $type:ty, $round:expr, $next:expr) => {{
            let void = void.map(|v| v as $type);
            let sample = |value: &Option<f64>| match value.map(|v| $round(v) as $type) {
                Some(valid) if Some(valid) == void => $next(valid),
                Some(valid) => valid,
                None => void.unwrap_or_default(),
            };
            Samples::$variant(values.iter().map(sample).collect())
        }};
    }
    macro_rules! integers {
        ($variant:ident, $type:ty) => {
            convert!($variant, $type, f64::round, |v: $type| v.checked_add(1).unwrap_or_else(|| v - 1))
        };
    }
    match kind {
        SampleType::Int8 => integers!(Int8, i8),
        SampleType::Uint8 => integers!(Uint8, u8),
        SampleType::Int16 => integers!(Int16, i16),
        SampleType::Uint16 => integers!(Uint16, u16),
        SampleType::Int32 => integers!(Int32, i32),
        SampleType::Uint32 => integers!(Uint32, u32),
        SampleType::Float32 => convert!(Float32, f32, f64::from, f32::next_up),
        SampleType::Float64 => convert!(Float64, f64, f64::from, f64::next_up),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantised_height_never_becomes_a_void() {
        let values = [Some(0.0), None, Some(3.0), Some(255.0)];
        assert_eq!(samples(&values, SampleType::Uint8, Some(0.0)), Samples::Uint8(vec![1, 0, 3, 255]));
        assert_eq!(samples(&values, SampleType::Uint8, Some(255.0)), Samples::Uint8(vec![0, 255, 3, 254]));
        assert_eq!(samples(&values, SampleType::Uint8, None), Samples::Uint8(vec![0, 0, 3, 255]));
        let tiny = f32::from_bits(1);
        assert_eq!(samples(&values[..2], SampleType::Float32, Some(0.0)), Samples::Float32(vec![tiny, 0.0]));
    }
}
