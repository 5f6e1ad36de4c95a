//! `relevo info`: what a file is, from its first 64 KiB.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use relevo::container::imagery::ImageryHeader;
use relevo::container::reader::Reader;
use relevo::container::sections::{IMAGERY, IMAGERY_PAGES, IMAGERY_TILES, SectionEntry};
use relevo::geo::Crs;
use relevo::sample::Coding;
use serde_json::{Value, json};

use crate::cli::Outcome;
use crate::cli::add::rule;
use crate::cli::table::{Table, bytes, grouped, short};

/// Sources that are named.
const SOURCES: usize = 12;

/// What a file is: coordinate system, levels, sections, sizes
#[derive(clap::Args)]
pub struct Args {
    /// The .rlv files
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// As JSON: one object a file, in a list
    #[arg(long)]
    json: bool,
}

/// Prints the facts of every file.
pub fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let mut all = Vec::new();
    for (i, file) in args.files.iter().enumerate() {
        let reader = Reader::open(file)?;
        if args.json {
            all.push(facts(&reader, file));
        } else {
            if i > 0 {
                writeln!(out)?;
            }
            print(&reader, file, out)?;
        }
    }
    if args.json {
        serde_json::to_writer_pretty(&mut *out, &all).map_err(io::Error::from)?;
        writeln!(out)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn section_name(section: &SectionEntry) -> String {
    let name = section.name();
    if name.starts_with("kind ") { format!("{name} (unknown to this program)") } else { name }
}

/// The imagery layer for machines.
fn imagery_facts(reader: &Reader) -> Value {
    let Some(layer) = reader.imagery() else { return Value::Null };
    let imagery = layer.header();
    json!({
        "codec": imagery.codec.as_str(), "quality": imagery.quality, "tile": imagery.tile, "gutter": imagery.gutter,
        "channels": imagery.colour.channels(), "alpha": imagery.alpha, "levels": imagery.leaf + 1, "tiles": imagery.tiles,
        "bytes": imagery_bytes(reader), "texel": texel(reader, imagery),
    })
}

/// Bytes of the sections of the imagery.
fn imagery_bytes(reader: &Reader) -> u64 {
    let kinds = [IMAGERY, IMAGERY_PAGES, IMAGERY_TILES];
    reader.sections().iter().filter(|section| kinds.contains(&section.kind)).map(|s| s.length).sum()
}

/// How many units of the coordinate system a texel of the finest level is wide and high; samples if there is no coordinate system.
fn texel(reader: &Reader, imagery: &ImageryHeader) -> [f64; 2] {
    let header = reader.header();
    let samples =
        f64::from(header.tile()) * f64::from(header.spacing(0)) / imagery.texels(imagery.leaf) as f64;
    let [_, a, b, _, d, e] = header.transform.unwrap_or([0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    [samples * a.hypot(d), samples * b.hypot(e)]
}

fn print_imagery(reader: &Reader, out: &mut dyn Write) -> io::Result<()> {
    let Some(layer) = reader.imagery() else { return Ok(()) };
    let imagery = layer.header();
    let mut line = |name: &str, text: String| writeln!(out, "  {name:<10} {text}");
    let quality =
        if imagery.quality > 0 { format!(" of quality {}", imagery.quality) } else { String::new() };
    let colour = if imagery.colour.channels() == 1 { "grey" } else { "RGB" };
    let alpha = if imagery.alpha { " and alpha" } else { "" };
    let codec = imagery.codec;
    let size = bytes(imagery_bytes(reader));
    line("imagery", format!("{colour}{alpha}, {codec}{quality}, {size}"))?;
    let [width, height] = texel(reader, imagery).map(short);
    let (tiles, tile, gutter) = (grouped(imagery.tiles), imagery.tile, imagery.gutter);
    line(
        "",
        format!(
            "{tiles} tiles of {tile} x {tile} texels and {gutter} around, {} levels, finest texel {width} x {height}",
            imagery.leaf + 1
        ),
    )?;
    let Some(note) = &reader.metadata().imagery else { return Ok(()) };
    for source in &note.sources {
        let how = rule(&source.bands, &source.stretch);
        line("picture", format!("{}: {}{how}", source.name, source.description))?;
    }
    match note.pictures.saturating_sub(note.sources.len() as u64) {
        0 => Ok(()),
        more => line("", format!("and {} more", grouped(more))),
    }
}

fn facts(reader: &Reader, file: &Path) -> Value {
    let (header, metadata) = (reader.header(), reader.metadata());
    let sections: Vec<Value> = reader
        .sections()
        .iter()
        .map(|s| json!({ "kind": s.kind, "name": section_name(s), "offset": s.offset, "bytes": s.length }))
        .collect();
    let (scale, offset) = match header.coding {
        Coding::Integer { scale, offset } => (scale, offset),
        _ => (1.0, 0.0),
    };
    json!({
        "file": file, "bytes": reader.file_len(), "columns": header.width, "rows": header.height,
        "sample_type": header.source_type.gdal_name(), "tile": header.tile(), "patch": header.patch(),
        "levels": header.levels + 1, "tiles": header.tile_count, "metric": header.metric.as_str(),
        "code_scale": scale, "code_offset": offset, "band_scale": header.band_scale, "band_offset": header.band_offset,
        "unit_metres": header.unit_metres, "max_quantisation_error": header.quantisation_error,
        "nodata": header.nodata.map(|v| if v.is_finite() { json!(v) } else { json!(v.to_string()) }),
        "geotransform": header.transform, "metadata": metadata, "imagery": imagery_facts(reader), "sections": sections,
    })
}

/// What the heights are measured from, where the file says so.
fn datum(crs: &Crs) -> String {
    let code = crs.vertical_epsg.map(|code| format!("EPSG:{code}"));
    let name = Some(crs.vertical_name.clone()).filter(|name| !name.is_empty());
    let named = match (name, code) {
        (Some(name), Some(code)) => format!("; {name} ({code})"),
        (Some(one), None) | (None, Some(one)) => format!("; {one}"),
        (None, None) => return String::new(),
    };
    if crs.vertical_down { named + ", depths: positive down" } else { named }
}

fn print(reader: &Reader, file: &Path, out: &mut dyn Write) -> io::Result<()> {
    let (header, metadata) = (reader.header(), reader.metadata());
    let crs = &metadata.crs;
    writeln!(out, "{}: {}, made by {}", file.display(), bytes(reader.file_len()), metadata.tool)?;
    let mut line = |name: &str, text: String| writeln!(out, "  {name:<10} {text}");
    for source in metadata.sources.iter().take(SOURCES) {
        line("source", format!("{}: {}", source.name, source.description))?;
    }
    match metadata.more_sources + metadata.sources.len().saturating_sub(SOURCES) as u64 {
        0 => {}
        more => line("", format!("and {} more", grouped(more)))?,
    }
    if let Some(overlap) = metadata.options.get("overlap").and_then(|word| word.as_str()) {
        line("overlap", format!("{overlap}, where files overlap"))?;
    }
    line("lattice", format!("{} x {} {}", header.width, header.height, header.source_type.gdal_name()))?;
    let heights = match header.coding {
        Coding::Integer { scale, .. } if header.quantisation_error > 0.0 => {
            format!("quantised in steps of {scale}, off by at most {}", short(header.quantisation_error))
        }
        _ => "lossless".to_owned(),
    };
    let unit = if metadata.vertical_unit.is_empty() { "metre (assumed)" } else { &metadata.vertical_unit };
    line("heights", format!("{heights}; unit {unit}{}", datum(crs)))?;
    if let Some(nodata) = header.nodata {
        line("nodata", nodata.to_string())?;
    }
    let epsg = crs.epsg.map_or_else(|| "no EPSG code".to_owned(), |code| format!("EPSG:{code}"));
    let name = if crs.name.is_empty() { "no coordinate system" } else { &crs.name };
    line("CRS", format!("{name} ({epsg})"))?;
    if let Some([west, south, east, north]) = metadata.bounds {
        line("bounds", format!("west {west}, south {south}, east {east}, north {north}"))?;
    }
    line("metric", header.metric.as_str().to_owned())?;
    let tiles = grouped(header.tile_count);
    line(
        "tiles",
        format!("{tiles} of {0} x {0} intervals, patches of {1} x {1}", header.tile(), header.patch()),
    )?;
    let mut levels = Table::new(&["level", "tiles", "bytes", "vertical m", "horizontal m"]);
    for (number, level) in metadata.levels.iter().enumerate() {
        levels.row(vec![
            number.to_string(),
            grouped(level.tiles),
            bytes(level.bytes),
            short(level.max_vertical_m),
            short(level.max_horizontal_m),
        ]);
    }
    levels.print(out)?;
    print_imagery(reader, out)?;
    let sections: Vec<String> =
        reader.sections().iter().map(|s| format!("{} {}", section_name(s), bytes(s.length))).collect();
    writeln!(out, "  sections   {}", sections.join(", "))
}
