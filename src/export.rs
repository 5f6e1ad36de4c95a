//! Exports a level or a tile of a container as a GeoTIFF or a PNG.
//!
//! Tiles are read in rows from north to south. A GeoTIFF of a level that is too wide for that, or
//! mostly void, is made of large blocks, of which those without samples are left out: it takes some
//! 300 MiB, and 80 bytes for each of at most 4 million blocks. A PNG is made in memory, of at most
//! 16 384 x 16 384 samples. Within a memory limit (`ReaderOptions::memory`) bands have fewer rows
//! and blocks are made a few at a time; an export that still exceeds it is refused before the file
//! is begun. At the leaf level the samples are the source's own, bit for bit unless the file is
//! quantised.

mod imagery;
mod memory;
mod part;
mod picture_file;
mod sparse;
mod tile;

use std::path::Path;

pub use imagery::{imagery_geotiff, imagery_part, imagery_picture, imagery_tile};
pub use part::{part_geotiff, part_picture};
pub use tile::{HeightScale, tile_geotiff, tile_picture};

use crate::container::layout::Header;
use crate::container::reader::Reader;
use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::geotiff_write::{Compression, GeotiffSpec, GeotiffWriter};
use crate::hillshade;
use crate::output;
use crate::sample::SampleType;
use crate::source::{Nodata, Rect, Samples};
use crate::tile::TileId;
use memory::{Extract, WriteMode};
use part::each_band;

/// Largest side of a PNG in samples, since it is made in memory.
const MAX_PICTURE_SIDE: u32 = 16_384;

/// Most bytes of the values of a row of tiles.
const BAND_BYTES: u64 = 256 << 20;
/// Bytes of a value before it becomes a sample.
const VALUE_BYTES: u64 = size_of::<Option<f64>>() as u64;

/// Options of a GeoTIFF export.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GeotiffOptions {
    /// The level.
    pub level: u8,
    /// Compression of the blocks.
    pub compression: Compression,
    /// Replace an existing file.
    pub force: bool,
}

/// Georeference of a level: larger pixels, with its first sample on the raster's first sample.
pub fn level_geo(geo: &Geo, header: &Header, level: u8) -> Geo {
    let step = f64::from(header.spacing(level));
    let transform = geo.transform.map(|[x0, a, b, y0, d, e]| {
        // Pixel (0, 0) of the level is centred on sample (0, 0), which lies half a source pixel
        // from the corner.
        let shift = 0.5 - 0.5 * step;
        [x0 + shift * (a + b), a * step, b * step, y0 + shift * (d + e), d * step, e * step]
    });
    Geo { transform, ..geo.clone() }
}

/// Writes a level as a GeoTIFF; returns its columns and rows.
pub fn geotiff(reader: &Reader, output: &Path, options: GeotiffOptions) -> Result<(u32, u32)> {
    let header = reader.header();
    check_apart(output, reader)?;
    check_level(header, options.level)?;
    let (columns, rows) = header.level_size(options.level);
    let geo = level_geo(reader.geo(), header, options.level);
    let mut spec = GeotiffSpec::new(columns, rows, header.source_type, &geo);
    let void = void(reader, options.level)?;
    spec.nodata = void.tag();
    spec.mask = matches!(void, Void::Mask);
    spec.band_scale = header.band_scale;
    spec.band_offset = header.band_offset;
    spec.unit = &reader.metadata().vertical_unit;
    spec.compression = options.compression;
    spec.force = options.force;
    let (rect, extract) = all_of(header, options.level);
    match memory::way(reader, extract, void, &spec, false)? {
        WriteMode::Bands(most) => {
            let mut writer = GeotiffWriter::create(output, &spec)?;
            let mut put = |values: &[Option<f64>]| write(&mut writer, values, header.source_type, void);
            each_band(reader, (options.level, most), &rect, &mut put)?;
            writer.finish()?;
        }
        WriteMode::Blocks(blocks, at_once) => {
            spec.tile = Some(blocks.side());
            let mut writer = GeotiffWriter::create_sparse(output, &spec)?;
            blocks.write(reader, &mut writer, void, at_once)?;
            writer.finish()?;
        }
    }
    Ok((columns, rows))
}

/// Writes a level as a shaded PNG; returns its columns and rows.
pub fn picture(reader: &Reader, output: &Path, level: u8, style: hillshade::Style) -> Result<(u32, u32)> {
    let header = reader.header();
    check_apart(output, reader)?;
    check_level(header, level)?;
    let (columns, rows) = header.level_size(level);
    for (what, side) in [("picture width", columns), ("picture height", rows)] {
        if side > MAX_PICTURE_SIDE {
            return Err(Error::limit(
                format!("{what} (choose a coarser `level`)"),
                side.into(),
                MAX_PICTURE_SIDE.into(),
            ));
        }
    }
    let (rect, extract) = all_of(header, level);
    memory::check(reader, "a picture", memory::of_relief(extract, header.tile()))?;
    let mut heights = Vec::with_capacity(columns as usize * rows as usize);
    each_band(reader, (level, header.tile()), &rect, &mut |values| {
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

/// Fails if the output is the container itself.
fn check_apart(output: &Path, reader: &Reader) -> Result<()> {
    output::check_apart(output, &[reader.path().to_owned()])
}

fn check_level(header: &Header, level: u8) -> Result<()> {
    if level > header.levels {
        return Err(Error::usage(format!(
            "`level` {level}: this file has levels 0 (root) to {}",
            header.levels
        )));
    }
    Ok(())
}

/// All samples of a level.
fn all_of(header: &Header, level: u8) -> (Rect, Extract) {
    let (columns, rows) = header.level_size(level);
    (Rect { columns: 0..columns, rows: 0..rows }, Extract { level, columns, rows })
}

/// How an exported raster marks voids.
#[derive(Clone, Copy, Debug)]
enum Void {
    /// There are no voids.
    Nothing,
    /// By a nodata value.
    Value(Nodata),
    /// By a mask, as the samples use all numbers of their type.
    Mask,
}

impl Void {
    /// The nodata value for the tag.
    fn tag(self) -> Option<f64> {
        if let Self::Value(nodata) = self { nodata.value() } else { None }
    }
}

/// How to mark the voids of a level: by the source's nodata value. If there is none and the level
/// has voids (a mask), by NaN or by an end of the type's range that the data does not reach, else
/// by a mask.
fn void(reader: &Reader, level: u8) -> Result<Void> {
    let header = reader.header();
    let value = |value: f64| Void::Value(Nodata::new(Some(value), header.source_type));
    let own = Nodata::new(header.nodata, header.source_type);
    let is_nan = header.source_type.is_float() && header.nodata.is_some_and(f64::is_nan);
    if own.near().is_some() || is_nan {
        return Ok(Void::Value(own));
    }
    let statistics = reader.statistics()?.and_then(|s| s.levels.into_iter().find(|l| l.level == level));
    if statistics.is_some_and(|l| l.valid == l.columns * l.rows) {
        return Ok(Void::Nothing);
    }
    let Some((low, high)) = integer_range(header.source_type) else { return Ok(value(f64::NAN)) };
    let Some(root) = reader.entry(TileId::ROOT)? else { return Ok(value(low)) };
    let sample =
        |metres: f32| (f64::from(metres) / header.unit_metres - header.band_offset) / header.band_scale;
    let (a, b) = (sample(root.min_m), sample(root.max_m));
    Ok(if a.min(b) > low + 1.0 {
        value(low)
    } else if a.max(b) < high - 1.0 {
        value(high)
    } else {
        Void::Mask
    })
}

/// Writes rows of values, with their mask if voids need one.
fn write(writer: &mut GeotiffWriter, values: &[Option<f64>], kind: SampleType, void: Void) -> Result<()> {
    let samples = samples(values, kind, void);
    match void {
        Void::Mask => {
            let valid: Vec<bool> = values.iter().map(Option::is_some).collect();
            writer.write_masked_rows(&samples, &valid)
        }
        _ => writer.write_rows(&samples),
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

/// Values as samples of the source's type; quantised values are rounded to it.
///
/// A quantised height that equals a void sample is moved to the next number, so that it stays
/// valid.
fn samples(values: &[Option<f64>], kind: SampleType, void: Void) -> Samples {
    let nodata = if let Void::Value(nodata) = void { nodata } else { Nodata::NONE };
    let hole = if let Void::Value(nodata) = void { nodata.sample(kind).unwrap_or(f64::NAN) } else { 0.0 };
    macro_rules! convert {
        ($variant:ident, $type:ty, $round:expr) => {{
            let sample = |value: &Option<f64>| match value.map(|v| $round(v) as $type) {
                Some(valid) if nodata.is(valid.into()) => nodata.beside(valid.into(), kind) as $type,
                Some(valid) => valid,
                None => hole as $type,
            };
            Samples::$variant(values.iter().map(sample).collect())
        }};
    }
    match kind {
        SampleType::Int8 => convert!(Int8, i8, f64::round),
        SampleType::Uint8 => convert!(Uint8, u8, f64::round),
        SampleType::Int16 => convert!(Int16, i16, f64::round),
        SampleType::Uint16 => convert!(Uint16, u16, f64::round),
        SampleType::Int32 => convert!(Int32, i32, f64::round),
        SampleType::Uint32 => convert!(Uint32, u32, f64::round),
        SampleType::Float32 => convert!(Float32, f32, std::convert::identity),
        SampleType::Float64 => convert!(Float64, f64, std::convert::identity),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quantised_height_never_becomes_a_void() {
        let values = [Some(0.0), None, Some(3.0), Some(255.0)];
        let samples = |kind, nodata: Option<f64>| {
            let void = nodata.map_or(Void::Nothing, |value| Void::Value(Nodata::new(Some(value), kind)));
            super::samples(&values, kind, void)
        };
        assert_eq!(samples(SampleType::Uint8, Some(0.0)), Samples::Uint8(vec![1, 0, 3, 255]));
        assert_eq!(samples(SampleType::Uint8, Some(255.0)), Samples::Uint8(vec![0, 255, 3, 254]));
        assert_eq!(samples(SampleType::Uint8, None), Samples::Uint8(vec![0, 0, 3, 255]));
        let tiny = f32::from_bits(1);
        assert_eq!(samples(SampleType::Float32, Some(0.0)), Samples::Float32(vec![tiny, 0.0, 3.0, 255.0]));
        // Also a value that is only close to the nodata value.
        let Samples::Float32(got) = samples(SampleType::Float32, Some(255.000_02)) else { panic!() };
        assert!(got[3] > 255.000_02 && got[3] < 255.0003, "{got:?}");
    }
}
