//! Exports the part of a level that a box touches, as a GeoTIFF or as a shaded PNG. Only tiles that
//! it touches are read.

use std::path::Path;

use super::memory::{Extract, WriteMode};
use super::{
    GeotiffOptions, MAX_PICTURE_SIDE, Void, check_apart, check_level, level_geo, memory, void, write,
};
use crate::container::reader::Reader;
use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::geotiff_write::{GeotiffSpec, GeotiffWriter};
use crate::hillshade;
use crate::sample::VALID;
use crate::source::Rect;
use crate::source::cropped::{Bbox, part_geo};
use crate::tile::TileId;

/// The samples of a level that a box touches, and their georeference.
fn part_of(reader: &Reader, bbox: &Bbox, level: u8) -> Result<(Rect, Geo)> {
    let header = reader.header();
    check_level(header, level)?;
    let geo = level_geo(reader.geo(), header, level);
    let part = bbox.window(&geo, header.level_size(level)).map_err(|error| error.at(reader.path()))?;
    let geo = part_geo(&geo, &part);
    Ok((part, geo))
}

/// Writes the samples that a box touches as a GeoTIFF; returns their columns and rows.
pub fn part_geotiff(
    reader: &Reader,
    output: &Path,
    bbox: &Bbox,
    options: GeotiffOptions,
) -> Result<(u32, u32)> {
    let header = reader.header();
    check_apart(output, reader)?;
    let (part, geo) = part_of(reader, bbox, options.level)?;
    let size = (part.columns.end - part.columns.start, part.rows.end - part.rows.start);
    let mut spec = GeotiffSpec::new(size.0, size.1, header.source_type, &geo);
    let void = void(reader, options.level)?;
    spec.nodata = void.tag();
    spec.mask = matches!(void, Void::Mask);
    spec.band_scale = header.band_scale;
    spec.band_offset = header.band_offset;
    spec.unit = &reader.metadata().vertical_unit;
    spec.compression = options.compression;
    spec.force = options.force;
    let extract = Extract { level: options.level, columns: size.0, rows: size.1 };
    let most = match memory::way(reader, extract, void, &spec, true)? {
        WriteMode::Bands(most) => most,
        WriteMode::Blocks(..) => header.tile(),
    };
    let mut writer = GeotiffWriter::create(output, &spec)?;
    each_band(reader, (options.level, most), &part, &mut |values| {
        write(&mut writer, values, header.source_type, void)
    })?;
    writer.finish()?;
    Ok(size)
}

/// Writes the samples that a box touches as a shaded PNG; returns their columns and rows.
pub fn part_picture(
    reader: &Reader,
    output: &Path,
    bbox: &Bbox,
    level: u8,
    style: hillshade::Style,
) -> Result<(u32, u32)> {
    let header = reader.header();
    check_apart(output, reader)?;
    let (part, geo) = part_of(reader, bbox, level)?;
    let size = (part.columns.end - part.columns.start, part.rows.end - part.rows.start);
    for (what, side) in [("picture width", size.0), ("picture height", size.1)] {
        if side > MAX_PICTURE_SIDE {
            let what = format!("{what} (choose a coarser level)");
            return Err(Error::limit(what, side.into(), MAX_PICTURE_SIDE.into()));
        }
    }
    let extract = Extract { level, columns: size.0, rows: size.1 };
    memory::check(reader, "a picture", memory::of_relief(extract, header.tile()))?;
    let mut heights = Vec::with_capacity(size.0 as usize * size.1 as usize);
    each_band(reader, (level, header.tile()), &part, &mut |values| {
        heights.extend(values.iter().map(|v| v.map_or(f32::NAN, |v| header.metres(v) as f32)));
        Ok(())
    })?;
    let spacing = geo.spacing((0, size.0 - 1), (size.1 / 2, size.1 / 2));
    let mut options = hillshade::Options::new(spacing.dx, spacing.dy);
    options.style = style;
    let rgba = hillshade::hillshade(&heights, size.0 as usize, size.1 as usize, &options)?;
    hillshade::write_png(output, &rgba, size.0, size.1)?;
    Ok(size)
}

/// Calls `take` with the values of whole rows of a part of a level, from north to south: at most
/// `most` rows of one row of tiles at a time, plus the border of the last one. `None` is void.
pub(super) fn each_band(
    reader: &Reader,
    (level, most): (u8, u32),
    part: &Rect,
    take: &mut dyn FnMut(&[Option<f64>]) -> Result<()>,
) -> Result<()> {
    let header = reader.header();
    let (tile, last) = (header.tile(), ((1_u64 << level) - 1) as u32);
    let (columns, rows) = header.level_size(level);
    // Each tile owns its first rows and columns; the last one also owns its border.
    let tiles = |from: u32, to: u32| (from / tile).min(last)..=((to - 1) / tile).min(last);
    let owned = |place: u32, side: u32| place * tile..if place == last { side } else { (place + 1) * tile };
    let width = (part.columns.end - part.columns.start) as usize;
    let mut values: Vec<Option<f64>> = Vec::new();
    for y in tiles(part.rows.start, part.rows.end) {
        let own = owned(y, rows);
        let (mut from, end) = (own.start.max(part.rows.start), own.end.min(part.rows.end));
        while from < end {
            // A single remaining row is joined to those before it.
            let to = if end - from <= most + 1 { end } else { from + most };
            let band = from..to;
            values.clear();
            values.resize(width * band.len(), None);
            for x in tiles(part.columns.start, part.columns.end) {
                let id = TileId::new(level, x, y);
                if reader.entry(id)?.is_none() {
                    continue;
                }
                let lattice = reader.read_tile(id)?;
                let own = owned(x, columns);
                let own = own.start.max(part.columns.start)..own.end.min(part.columns.end);
                for row in band.clone() {
                    let place = (row - from) as usize * width + (own.start - part.columns.start) as usize;
                    for (value, column) in values[place..].iter_mut().zip(own.clone()) {
                        let at = lattice.at((column - x * tile) as usize, (row - y * tile) as usize);
                        if lattice.state[at] == VALID {
                            *value = Some(lattice.value(at, header.coding));
                        }
                    }
                }
            }
            take(&values)?;
            from = to;
        }
    }
    Ok(())
}
