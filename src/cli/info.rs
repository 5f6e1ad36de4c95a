//! `relevo info`: prints what a file is, from its first 64 KiB.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use relevo::TileId;
use relevo::container::imagery::ImageryHeader;
use relevo::container::reader::Reader;
use relevo::container::sections::{IMAGERY, IMAGERY_PAGES, IMAGERY_TILES, SectionEntry};
use relevo::geo::Crs;
use relevo::sample::Coding;
use serde_json::{Value, json};

use crate::cli::add::rule;
use crate::cli::table::{Table, bytes, count, fact, grouped, metres, plural, short, wrapped};
use crate::cli::{Outcome, json, origins, place, shown, voice};

/// Most sources listed without `--verbose`.
const SOURCES: usize = 12;

/// Print what a file is: coordinate system, heights, levels, sections, sizes
#[derive(clap::Args)]
pub struct Args {
    /// The .rlv files
    #[arg(required = true, value_name = "FILE.rlv")]
    files: Vec<PathBuf>,
    /// Print JSON: a list with one object for each file
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
        json::print(&Value::Array(all), out)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn section_name(section: &SectionEntry) -> String {
    let name = section.name();
    if name.starts_with("kind ") { format!("{name} (unknown to this program)") } else { name }
}

/// The imagery layer as JSON.
fn imagery_facts(reader: &Reader) -> Value {
    let Some(layer) = reader.imagery() else { return Value::Null };
    let imagery = layer.header();
    json::joined([json::imagery(imagery, imagery_bytes(reader)), json!({ "texel": texel(reader, imagery) })])
}

/// Bytes of all sections of the imagery.
fn imagery_bytes(reader: &Reader) -> u64 {
    let kinds = [IMAGERY, IMAGERY_PAGES, IMAGERY_TILES];
    reader.sections().iter().filter(|section| kinds.contains(&section.kind)).map(|s| s.length).sum()
}

/// Width and height of a texel of the finest level, in units of the coordinate system, or in
/// samples if there is none.
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
    let quality =
        if imagery.quality > 0 { format!(" of quality {}", imagery.quality) } else { String::new() };
    let colour = if imagery.colour.channels() == 1 { "grey" } else { "RGB" };
    let alpha = if imagery.alpha { " and alpha" } else { "" };
    let codec = imagery.codec;
    writeln!(out, "\nImagery")?;
    fact("texels", &format!("{colour}{alpha}, {codec}{quality}, {}", bytes(imagery_bytes(reader))), out)?;
    let [width, height] = texel(reader, imagery).map(short);
    let unit = if reader.header().transform.is_some() { "units of the CRS" } else { "samples" };
    fact("finest", &format!("{width} x {height} {unit}"), out)?;
    let (tiles, tile, gutter) = (plural(imagery.tiles, "tile", "tiles"), imagery.tile, imagery.gutter);
    let levels = imagery.leaf + 1;
    fact("tiles", &format!("{tiles} of {tile} x {tile} texels and {gutter} around, {levels} levels"), out)?;
    let Some(note) = &reader.metadata().imagery else { return Ok(()) };
    for source in &note.sources {
        let how = rule(&source.bands, &source.stretch);
        fact("picture", &format!("{}: {}{how}", source.name, source.description), out)?;
    }
    match note.pictures.saturating_sub(note.sources.len() as u64) {
        0 => Ok(()),
        more => fact("", &format!("and {} more", grouped(more)), out),
    }
}

/// Lowest and highest height in metres; in a file without statistics, the bounds that the index
/// gives.
fn range_m(reader: &Reader) -> Option<(f64, f64)> {
    let leaves = reader.statistics().ok().flatten().and_then(|mut statistics| statistics.levels.pop());
    let counted = leaves.and_then(|level| level.min_m.zip(level.max_m));
    let bounds =
        || reader.entry(TileId::ROOT).ok().flatten().map(|root| (root.min_m.into(), root.max_m.into()));
    counted.or_else(bounds)
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
    let (min_m, max_m) = range_m(reader).unzip();
    let head = json!({ "file": json::path(file), "bytes": reader.file_len() });
    let rest = json!({
        "min_m": min_m, "max_m": max_m, "unit_metres": header.unit_metres,
        "band_scale": header.band_scale, "band_offset": header.band_offset,
        "code_scale": scale, "code_offset": offset, "max_quantisation_error": header.quantisation_error,
        "nodata": header.nodata.map(json::number), "geotransform": header.transform,
        "place": place::facts(reader), "metadata": metadata,
        "imagery": imagery_facts(reader), "sections": sections,
    });
    json::object("info", json::joined([head, json::lattice(header), rest]))
}

/// The vertical datum, if the file names one.
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
    let metadata = reader.metadata();
    let head = format!("{}: {}, made by {}", shown(file), bytes(reader.file_len()), metadata.tool);
    writeln!(out, "{}", wrapped(&head, 2))?;
    print_place(reader, out)?;
    print_heights(reader, out)?;
    print_sources(reader, out)?;
    print_tiles(reader, out)?;
    print_imagery(reader, out)?;
    print_sections(reader, out)
}

/// Prints where the raster lies.
fn print_place(reader: &Reader, out: &mut dyn Write) -> io::Result<()> {
    let (header, metadata) = (reader.header(), reader.metadata());
    let crs = &metadata.crs;
    writeln!(out, "\nPlace")?;
    fact(
        "lattice",
        &format!("{} x {} {}", header.width, header.height, header.source_type.gdal_name()),
        out,
    )?;
    let epsg = crs.epsg.map_or_else(|| "no EPSG code".to_owned(), |code| format!("EPSG:{code}"));
    let name = if crs.name.is_empty() { "no coordinate system" } else { &crs.name };
    fact("CRS", &format!("{name} ({epsg})"), out)?;
    if let Some([west, south, east, north]) = metadata.bounds {
        fact("bounds", &format!("west {west}, south {south}, east {east}, north {north}"), out)?;
    }
    if let Some(transform) = header.transform.filter(|_| voice::verbose()) {
        let numbers = transform.map(|number| number.to_string()).join(", ");
        fact("transform", &format!("{numbers} (as GDAL has it)"), out)?;
    }
    place::lines(reader).iter().try_for_each(|(name, text)| fact(name, text, out))
}

/// Prints type, unit, range and accuracy of the heights.
fn print_heights(reader: &Reader, out: &mut dyn Write) -> io::Result<()> {
    let (header, metadata) = (reader.header(), reader.metadata());
    writeln!(out, "\nHeights")?;
    if let Some((low, high)) = range_m(reader) {
        let [own_low, own_high] = [low, high].map(|height| metres(height / header.unit_metres));
        let own = format!(" ({own_low} to {own_high} in the unit of the source)");
        let own = if header.unit_metres == 1.0 { "" } else { &own };
        fact("range", &format!("{} to {} m{own}", metres(low), metres(high)), out)?;
    }
    let unit = if metadata.vertical_unit.is_empty() { "metre (assumed)" } else { &metadata.vertical_unit };
    let metres =
        if header.unit_metres == 1.0 { String::new() } else { format!(", {} m", header.unit_metres) };
    fact("unit", &format!("{unit}{metres}{}", datum(&metadata.crs)), out)?;
    if (header.band_scale, header.band_offset) != (1.0, 0.0) {
        fact("values", &format!("{} + {} * sample", header.band_offset, header.band_scale), out)?;
    }
    let kept = match header.coding {
        Coding::Integer { scale, .. } if header.quantisation_error > 0.0 => {
            format!("quantised in steps of {scale}, off by at most {}", short(header.quantisation_error))
        }
        _ => "lossless".to_owned(),
    };
    fact("kept", &kept, out)?;
    let nodata = header.nodata.map_or("none".to_owned(), |value| header.source_type.text(value));
    fact("nodata", &nodata, out)
}

/// Prints the files that the container was made from.
fn print_sources(reader: &Reader, out: &mut dyn Write) -> io::Result<()> {
    let metadata = reader.metadata();
    writeln!(out, "\nMade of")?;
    let named = if voice::verbose() { usize::MAX } else { SOURCES };
    for source in metadata.sources.iter().take(named) {
        fact("source", &format!("{}: {}", source.name, source.description), out)?;
    }
    match metadata.more_sources + metadata.sources.len().saturating_sub(named) as u64 {
        0 => {}
        more => fact("", &format!("and {} more", grouped(more)), out)?,
    }
    if let Some(origins) = origins::line(&metadata.origins) {
        fact("found in", &origins, out)?;
    }
    if let Some(overlap) = metadata.options.get("overlap").and_then(|word| word.as_str()) {
        fact("overlap", &format!("{overlap}, where files overlap"), out)?;
    }
    Ok(())
}

/// Prints the tile sizes, the levels and their errors.
fn print_tiles(reader: &Reader, out: &mut dyn Write) -> io::Result<()> {
    let (header, metadata) = (reader.header(), reader.metadata());
    writeln!(out, "\nTiles")?;
    let (tiles, tile, patch) = (plural(header.tile_count, "tile", "tiles"), header.tile(), header.patch());
    fact("tiles", &format!("{tiles} of {tile} x {tile} intervals, patches of {patch} x {patch}"), out)?;
    fact("metric", header.metric.as_str(), out)?;
    let mut levels =
        Table::new(&["level", "tiles", "size", "vertical", "horizontal"]).groups(&[(2, "largest error (m)")]);
    for (number, level) in metadata.levels.iter().enumerate() {
        levels.row(vec![
            number.to_string(),
            count(level.tiles),
            bytes(level.bytes),
            short(level.max_vertical_m),
            short(level.max_horizontal_m),
        ]);
    }
    levels.print(out)
}

/// Prints the sections of the file, with their offsets if `--verbose` is set.
fn print_sections(reader: &Reader, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "\nFile")?;
    if !voice::verbose() {
        let name = |s: &SectionEntry| format!("{} {}", section_name(s), bytes(s.length));
        let sections: Vec<String> = reader.sections().iter().map(name).collect();
        return fact("sections", &sections.join(", "), out);
    }
    let mut table = Table::new(&["section", "offset (bytes)", "length (bytes)"]).words(0);
    for section in reader.sections() {
        table.row(vec![section_name(section), grouped(section.offset), grouped(section.length)]);
    }
    table.print(out)
}
