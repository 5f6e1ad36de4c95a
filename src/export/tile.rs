//! Exports a tile of heights: exact samples as a GeoTIFF, or a 16-bit PNG. Samples outside the
//! raster are left out.

use std::path::Path;

use super::picture_file::write_png;
use super::{GeotiffOptions, Void, check_apart, level_geo, memory, void, write};
use crate::container::reader::Reader;
use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::geotiff_write::{GeotiffSpec, GeotiffWriter};
use crate::sample::{SampleType, VALID};
use crate::tile::TileId;

/// The heights of the greys of a PNG: grey `g` from 1 on is `offset_m + (g - 1) * step_m`; 0 is
/// void.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeightScale {
    /// Height of grey 1 in metres.
    pub offset_m: f64,
    /// Metres from one grey to the next.
    pub step_m: f64,
    /// True if every height equals that of its grey exactly.
    pub exact: bool,
}

/// The values of a tile that lie in the raster, row by row; `None` is void.
struct Cut {
    columns: u32,
    rows: u32,
    values: Vec<Option<f64>>,
}

fn read(reader: &Reader, id: TileId) -> Result<Cut> {
    let header = reader.header();
    if reader.entry(id)?.is_none() {
        return Err(Error::usage(format!("there is no tile {id} in {}", reader.path().display())));
    }
    memory::check(reader, "a tile", memory::of_tile(header.tile(), header.source_type))?;
    let lattice = reader.read_tile(id)?;
    let (width, height) = header.level_size(id.level);
    let tile = header.tile();
    let (columns, rows) = ((tile + 1).min(width - id.x * tile), (tile + 1).min(height - id.y * tile));
    let mut values = Vec::with_capacity(columns as usize * rows as usize);
    for row in 0..rows as usize {
        for column in 0..columns as usize {
            let at = lattice.at(column, row);
            values.push((lattice.state[at] == VALID).then(|| lattice.value(at, header.coding)));
        }
    }
    Ok(Cut { columns, rows, values })
}

/// Writes a tile's samples as a GeoTIFF; returns their columns and rows.
pub fn tile_geotiff(
    reader: &Reader,
    output: &Path,
    id: TileId,
    options: GeotiffOptions,
) -> Result<(u32, u32)> {
    let header = reader.header();
    check_apart(output, reader)?;
    let tile = read(reader, id)?;
    let geo = level_geo(reader.geo(), header, id.level);
    let (column, row) = (f64::from(id.x * header.tile()), f64::from(id.y * header.tile()));
    let transform = geo
        .transform
        .map(|[x0, a, b, y0, d, e]| [x0 + column * a + row * b, a, b, y0 + column * d + row * e, d, e]);
    let geo = Geo { transform, ..geo };
    let mut spec = GeotiffSpec::new(tile.columns, tile.rows, header.source_type, &geo);
    let void = void(reader, id.level)?;
    spec.nodata = void.tag();
    spec.mask = matches!(void, Void::Mask);
    spec.band_scale = header.band_scale;
    spec.band_offset = header.band_offset;
    spec.unit = &reader.metadata().vertical_unit;
    spec.compression = options.compression;
    spec.force = options.force;
    let mut writer = GeotiffWriter::create(output, &spec)?;
    write(&mut writer, &tile.values, header.source_type, void)?;
    writer.finish()?;
    Ok((tile.columns, tile.rows))
}

/// Writes a tile's heights as a PNG of 16-bit greys; returns the heights of the greys, which are
/// also a text in the PNG (keyword `relevo heights`).
pub fn tile_picture(reader: &Reader, output: &Path, id: TileId) -> Result<HeightScale> {
    let header = reader.header();
    check_apart(output, reader)?;
    let tile = read(reader, id)?;
    let valid = || tile.values.iter().flatten().copied();
    let (low, high) = valid().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    let whole = !matches!(header.source_type, SampleType::Float32 | SampleType::Float64)
        && header.quantisation_error == 0.0
        && high - low <= 65_534.0;
    let step = if whole { 1.0 } else { ((high - low) / 65_534.0).max(f64::MIN_POSITIVE) };
    let grey = |v: &Option<f64>| v.map_or(0, |v| 1 + ((v - low) / step).round().min(65_534.0) as u16);
    let pixels: Vec<u8> = tile.values.iter().flat_map(|v| grey(v).to_be_bytes()).collect();
    let empty = low > high;
    let scale = HeightScale {
        offset_m: if empty { 0.0 } else { header.metres(low) },
        step_m: if empty { 0.0 } else { header.metres(low + step) - header.metres(low) },
        exact: whole || empty,
    };
    let text = format!("metres = {} + {} * (grey - 1); grey 0 is void", scale.offset_m, scale.step_m);
    write_png(
        output,
        (tile.columns, tile.rows),
        (png::ColorType::Grayscale, png::BitDepth::Sixteen),
        &pixels,
        &[("relevo heights", &text)],
    )?;
    Ok(scale)
}
