//! The metadata of a file: what its raster says of itself, how it was built, and a line for each
//! level.

use serde_json::{Value, json};

use super::options::BuildOptions;
use crate::container::metadata::{LevelNote, LevelStatistics, Metadata, SourceNote, Statistics};
use crate::container::opening::OPENING_BYTES;
use crate::error::{Error, Result};
use crate::source::{Nodata, Overlap, Part, SourceInfo};

/// Bytes of metadata that the list of sources may take.
const SOURCES_BYTES: usize = 20 << 10;

/// Fails if what the raster says of itself takes more than the first bytes of a file, which must
/// hold all of it.
///
/// It is asked before the build. The statistics are not known then, so that this is the least that
/// there will be.
pub fn check(info: &SourceInfo, options: &BuildOptions, nodata: Nodata) -> Result<()> {
    let least = metadata(info, options, nodata, &Statistics::default()).encode()?.len() as u64;
    if least > OPENING_BYTES {
        let what = "bytes of what the raster says of itself (names, coordinate system, unit)";
        return Err(Error::limit(what, least, OPENING_BYTES));
    }
    Ok(())
}

/// The metadata of a file.
pub fn metadata(
    info: &SourceInfo,
    options: &BuildOptions,
    nodata: Nodata,
    statistics: &Statistics,
) -> Metadata {
    let sources = source_notes(&info.parts);
    Metadata {
        tool: concat!("relevo ", env!("CARGO_PKG_VERSION")).to_owned(),
        crs: info.geo.crs.clone(),
        pixel_is_point: info.geo.pixel_is_point,
        bounds: info.geo.transform.map(|_| info.geo.bounds(info.width, info.height)),
        vertical_unit: info.vertical_unit.1.clone(),
        origins: info.origins.texts(),
        more_sources: (info.parts.len() - sources.len()) as u64,
        sources,
        options: options_json(options, nodata, info.overlap),
        levels: statistics.levels.iter().map(level_note).collect(),
        imagery: None,
    }
}

/// The first of the files: they share the first 64 KiB of the container with much else.
fn source_notes(parts: &[Part]) -> Vec<SourceNote> {
    let mut room = SOURCES_BYTES;
    let fits = |note: &SourceNote| {
        room = room.saturating_sub(serde_json::to_vec(note).map_or(0, |json| json.len() + 1));
        room > 0
    };
    let note = |part: &Part| SourceNote { name: part.name.clone(), description: part.description.clone() };
    parts.iter().map(note).take_while(fits).collect()
}

/// Options as recorded in the metadata.
fn options_json(options: &BuildOptions, nodata: Nodata, overlap: Option<Overlap>) -> Value {
    let mut json = json!({
        "tile": options.tile,
        "patch": options.patch,
        "metric": options.metric,
        "precision_m": options.precision_m,
        "nodata": nodata.value().filter(|v| v.is_finite()),
    });
    if let Some(overlap) = overlap {
        json["overlap"] = json!(overlap);
    }
    json
}

fn level_note(level: &LevelStatistics) -> LevelNote {
    let finest = level.steps.first();
    LevelNote {
        tiles: level.tiles,
        bytes: level.heights_bytes + level.masks_bytes + level.errors_bytes,
        max_vertical_m: finest.map_or(0.0, |s| s.vertical.max),
        max_horizontal_m: finest.map_or(0.0, |s| s.horizontal.max),
    }
}
