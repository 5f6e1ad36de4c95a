//! `relevo build --dry-run`: prints what would be made and what it would take.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use relevo::Error;
use relevo::pipeline::estimate::{Estimate, estimate};
use relevo::pipeline::imagery::Imagery as Layer;
use relevo::pipeline::{BuildOptions, Plan, column_passes};
use relevo::source::Source;
use serde_json::{Value, json};

use super::{Args, source_line};
use crate::cli::dem::Dem;
use crate::cli::table::{bytes, count, fact, grouped, plural, seconds, wrapped};
use crate::cli::{Outcome, json, shown};

/// Prints the plan of a build; some tiles of the DEM are read to estimate it.
pub fn run(
    (args, dem): (&Args, &Dem),
    (source, layer): (&dyn Source, Option<&Layer<'_>>),
    (plan, options): (&Plan, &BuildOptions),
    output: &Path,
    out: &mut dyn Write,
) -> Outcome {
    let info = source.info();
    let memory = memory((plan, layer), options)?;
    let estimate = estimate(source, options, plan).map_err(|error| error.at(dem.first()))?;
    if args.json {
        let head = json!({
            "sources": json::paths(&dem.dems), "file": json::path(output), "status": "planned",
            "description": info.description, "sample_type": info.sample_type.gdal_name(),
        });
        json::print(
            &json::object("build --dry-run", json::joined([head, facts(plan, &estimate, memory)])),
            out,
        )?;
        return Ok(ExitCode::SUCCESS);
    }
    writeln!(out, "{}", source_line(dem, info))?;
    writeln!(out, "{}", wrapped(&format!("{}: nothing is written (--dry-run)", shown(output)), 2))?;
    let tiles = plan.most_tiles();
    let each: Vec<String> = tiles.iter().map(|&tiles| count(tiles)).collect();
    let levels =
        format!("{} (0 to {}), of at most {} tiles", tiles.len(), plan.pyramid.levels, each.join(", "));
    fact("levels", &levels, out)?;
    let side = plan.pyramid.tile;
    fact("tiles", &format!("at most {} of {side} x {side}", grouped(tiles.iter().sum())), out)?;
    let threads = plural(plan.jobs as u64, "thread", "threads");
    let took = format!("about {} on {threads}, if nobody else works here", seconds(estimate.seconds));
    fact("time", &took, out)?;
    let beside = "and what the system keeps of the input";
    fact("memory", &format!("at most {} on {threads}, {beside}", bytes(memory)), out)?;
    let (file, work) = (bytes(estimate.bytes), bytes(2 * estimate.bytes));
    fact("disk", &format!("about {file}, {work} while it is being made"), out)?;
    let imagery = if layer.is_some() { "; imagery comes on top of both" } else { "" };
    let tiles = plural(estimate.tiles, "tile", "tiles");
    fact("", &format!("(time and disk as of {tiles} that were tried{imagery})"), out)?;
    Ok(ExitCode::SUCCESS)
}

fn facts(plan: &Plan, estimate: &Estimate, memory: u64) -> Value {
    let tiles = plan.most_tiles();
    let of_level = |(level, tiles): (usize, &u64)| json!({ "level": level, "most_tiles": tiles });
    let levels: Vec<Value> = tiles.iter().enumerate().map(of_level).collect();
    json!({
        "columns": plan.pyramid.width, "rows": plan.pyramid.height, "tile": plan.pyramid.tile, "patch": plan.patch, "metric": plan.metric.as_str(), "level_count": tiles.len(),
        "most_tiles": tiles.iter().sum::<u64>(), "levels": levels, "memory_bytes": memory,
        "disk_bytes": estimate.bytes, "work_folder_bytes": 2 * estimate.bytes,
        "estimated_seconds": estimate.seconds, "tiles_tried": estimate.tiles,
    })
}

/// Most bytes of memory that the build takes; the imagery is made after the heights are done.
fn memory((plan, layer): (&Plan, Option<&Layer<'_>>), options: &BuildOptions) -> Result<u64, Error> {
    let heights = column_passes::memory_estimate(plan, options)?;
    let Some(layer) = layer else { return Ok(heights) };
    layer.check(&plan.ground())?;
    layer.keep_within(&plan.ground(), plan.jobs, options.memory)?;
    let most = *layer.memory(&plan.ground(), plan.jobs)?.end();
    Ok(heights.max(options.memory.map_or(most, |limit| most.min(limit))))
}
