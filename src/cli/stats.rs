//! `relevo stats`: how wrong a file is, by level and tessellation step.

use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use relevo::Error;
use relevo::container::layout::Header;
use relevo::container::metadata::{ErrorStatistics, LevelStatistics, Statistics};
use relevo::container::reader::Reader;
use serde_json::{Value, json};

use crate::cli::Outcome;
use crate::cli::table::{Table, bytes, grouped, short};

/// How wrong a file is, by level and tessellation step
#[derive(clap::Args)]
pub struct Args {
    /// The .rlv file
    file: PathBuf,
    /// As JSON: the statistics section with the header's facts
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// As CSV: one line for each level and step
    #[arg(long)]
    csv: bool,
}

/// Prints the statistics that the file carries.
pub fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let reader = Reader::open(&args.file)?;
    let statistics = reader.statistics()?.ok_or_else(|| {
        Error::usage(format!("{}: the file carries no statistics; build it again", args.file.display()))
    })?;
    let header = reader.header();
    if args.json {
        let all = json!({
            "file": args.file, "bytes": reader.file_len(), "columns": header.width, "rows": header.height,
            "metric": header.metric.as_str(), "tile": header.tile(), "patch": header.patch(),
            "statistics": with_shares(&statistics),
        });
        serde_json::to_writer_pretty(&mut *out, &all).map_err(io::Error::from)?;
        writeln!(out)?;
    } else if args.csv {
        csv(&statistics, out)?;
    } else {
        let metric = header.metric.as_str();
        writeln!(
            out,
            "{}: {} x {} samples, metric {metric}",
            args.file.display(),
            header.width,
            header.height
        )?;
        levels_table(&statistics, header, out)?;
        steps_table(&statistics, header, out)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// One line a level: tiles, sizes, voids, and the errors of the finest and the coarsest step.
pub fn levels_table(statistics: &Statistics, header: &Header, out: &mut dyn Write) -> io::Result<()> {
    let mut table = Table::new(&[
        "level",
        "tiles",
        "patches",
        "spacing m",
        "void %",
        "bytes",
        "bits/sample",
        "error m: step 0",
        &format!("step {}", header.steps() - 1),
    ]);
    for level in &statistics.levels {
        let worst = |step: usize| {
            level.steps.get(step).map_or(String::new(), |s| {
                let h = if s.horizontal.max > 0.0 {
                    format!(" / {}", short(s.horizontal.max))
                } else {
                    String::new()
                };
                format!("{}{h}", short(s.vertical.max))
            })
        };
        table.row(vec![
            level.level.to_string(),
            grouped(level.tiles),
            grouped(level.patches),
            level.steps.first().map_or(String::new(), |s| short(s.spacing_m[0].max(s.spacing_m[1]))),
            short(100.0 * void_share(level)),
            bytes(level_bytes(level)),
            short(bits_per_sample(level)),
            worst(0),
            worst(level.steps.len().saturating_sub(1)),
        ]);
    }
    table.print(out)?;
    writeln!(
        out,
        "  error: largest vertical / horizontal (outline of voids) deviation in metres; step k draws every 2^k-th sample"
    )
}

/// One line for each level and step: distribution of both errors.
fn steps_table(statistics: &Statistics, header: &Header, out: &mut dyn Write) -> io::Result<()> {
    for (title, pick) in [("Vertical", vertical as Pick), ("Horizontal", horizontal as Pick)] {
        if statistics.levels.iter().flat_map(|l| &l.steps).all(|s| pick(s).max == 0.0) {
            writeln!(out, "\n{title} error: none anywhere")?;
            continue;
        }
        writeln!(
            out,
            "\n{title} error in metres, by level and step ({} patches of {} x {})",
            header.metric.as_str(),
            header.patch(),
            header.patch()
        )?;
        let mut table =
            Table::new(&["level", "step", "spacing m", "patches", "min", "mean", "p50", "p90", "p99", "max"]);
        for level in &statistics.levels {
            for (k, step) in level.steps.iter().enumerate() {
                let e = pick(step);
                table.row(vec![
                    level.level.to_string(),
                    k.to_string(),
                    short(step.spacing_m[0].max(step.spacing_m[1])),
                    grouped(e.count),
                    short(e.min),
                    short(e.mean),
                    short(e.p50),
                    short(e.p90),
                    short(e.p99),
                    short(e.max),
                ]);
            }
        }
        table.print(out)?;
    }
    Ok(())
}

type Step = relevo::container::metadata::StepStatistics;
type Pick = fn(&Step) -> &ErrorStatistics;

fn vertical(step: &Step) -> &ErrorStatistics {
    &step.vertical
}

fn horizontal(step: &Step) -> &ErrorStatistics {
    &step.horizontal
}

/// The statistics section, each level with its share of voids and its bits a sample.
fn with_shares(statistics: &Statistics) -> Value {
    let mut all = json!(statistics);
    let levels = all["levels"].as_array_mut().map(|levels| levels.iter_mut().zip(&statistics.levels));
    for (json, level) in levels.into_iter().flatten() {
        json["void_share"] = json!(void_share(level));
        json["bits_per_sample"] = json!(bits_per_sample(level));
    }
    all
}

/// Share of a level's lattice within the raster that is void.
fn void_share(level: &LevelStatistics) -> f64 {
    1.0 - level.valid as f64 / (level.columns * level.rows) as f64
}

/// Stored bits for each sample of a level's lattice.
fn bits_per_sample(level: &LevelStatistics) -> f64 {
    level_bytes(level) as f64 * 8.0 / (level.columns * level.rows) as f64
}

/// Bytes of all chunks of a level.
pub fn level_bytes(level: &LevelStatistics) -> u64 {
    level.heights_bytes + level.masks_bytes + level.errors_bytes
}

fn csv(statistics: &Statistics, out: &mut dyn Write) -> io::Result<()> {
    write!(
        out,
        "level,step,tiles,patches,columns,rows,valid,void_share,bytes,bits_per_sample,spacing_x_m,spacing_y_m"
    )?;
    for kind in ["vertical", "horizontal"] {
        for figure in ["min", "mean", "p50", "p90", "p99", "max"] {
            write!(out, ",{kind}_{figure}_m")?;
        }
    }
    writeln!(out)?;
    for level in &statistics.levels {
        for (k, step) in level.steps.iter().enumerate() {
            let [dx, dy] = step.spacing_m;
            write!(out, "{},{k},{},{}", level.level, level.tiles, step.vertical.count)?;
            let (void, bits) = (void_share(level), bits_per_sample(level));
            write!(out, ",{},{},{},{void}", level.columns, level.rows, level.valid)?;
            write!(out, ",{},{bits},{dx},{dy}", level_bytes(level))?;
            for e in [&step.vertical, &step.horizontal] {
                write!(out, ",{},{},{},{},{},{}", e.min, e.mean, e.p50, e.p90, e.p99, e.max)?;
            }
            writeln!(out)?;
        }
    }
    Ok(())
}
