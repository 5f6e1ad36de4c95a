//! JSON output of all commands in one schema: a field has the same meaning, type and unit
//! everywhere (docs/json.md).

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use relevo::container::imagery::ImageryHeader;
use relevo::container::layout::Header;
use relevo::container::metadata::Statistics;
use relevo::pipeline::imagery::LayerReport;
use serde_json::{Map, Value, json};

use crate::cli::named;
use crate::cli::stats::{bits_per_sample, void_share};

/// Version of the schema: grows when the meaning of a field changes, not when a field is added.
const SCHEMA: u32 = 1;

/// The JSON object of a command, which begins with the schema version and the command's name.
pub fn object(command: &str, fields: Value) -> Value {
    let head = json!({ "schema": SCHEMA, "command": command });
    joined([head, fields])
}

/// One object with the fields of several, in order.
pub fn joined<const N: usize>(objects: [Value; N]) -> Value {
    let mut all = Map::new();
    for object in objects {
        if let Value::Object(fields) = object {
            all.extend(fields);
        }
    }
    Value::Object(all)
}

/// Prints a value and a line break.
pub fn print(value: &Value, out: &mut dyn Write) -> io::Result<()> {
    serde_json::to_writer_pretty(&mut *out, value)?;
    writeln!(out)
}

/// A path as text.
pub fn path(path: &Path) -> Value {
    json!(named(path))
}

/// Paths as texts.
pub fn paths(list: &[PathBuf]) -> Value {
    list.iter().map(|one| path(one)).collect()
}

/// A number, or its name where JSON has none: `NaN`, `inf`, `-inf`.
pub fn number(value: f64) -> Value {
    if value.is_finite() { json!(value) } else { json!(value.to_string()) }
}

/// The lattice that a header describes.
pub fn lattice(header: &Header) -> Value {
    json!({
        "columns": header.width, "rows": header.height, "sample_type": header.source_type.gdal_name(),
        "tile": header.tile(), "patch": header.patch(), "metric": header.metric.as_str(),
        "level_count": header.levels + 1, "tiles": header.tile_count,
    })
}

/// An imagery layer that takes `bytes` in the file.
pub fn imagery(header: &ImageryHeader, bytes: u64) -> Value {
    json!({
        "codec": header.codec.as_str(), "quality": header.quality, "tile": header.tile, "gutter": header.gutter,
        "channels": header.colour.channels(), "alpha": header.alpha, "level_count": header.leaf + 1,
        "tiles": header.tiles, "bytes": bytes,
    })
}

/// The report of a layer that has just been made.
pub fn layer(layer: &LayerReport) -> Value {
    let of_level = |(level, (tiles, bytes)): (usize, &(u64, u64))| json!({ "level": level, "tiles": tiles, "bytes": bytes });
    let levels: Vec<Value> = layer.levels.iter().enumerate().map(of_level).collect();
    let more = json!({ "levels": levels, "picture_count": layer.pyramid.pictures.len() });
    joined([imagery(&layer.header, layer.bytes), more])
}

/// The statistics section, with the void share and the bits per sample of each level.
pub fn statistics(statistics: &Statistics) -> Value {
    let mut all = json!(statistics);
    let levels = all["levels"].as_array_mut().map(|levels| levels.iter_mut().zip(&statistics.levels));
    for (json, level) in levels.into_iter().flatten() {
        json["void_share"] = json!(void_share(level));
        json["bits_per_sample"] = json!(bits_per_sample(level));
    }
    all
}
