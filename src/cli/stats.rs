//! `relevo stats`: prints the errors of a file by level and tessellation step.

use std::io::{self, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use relevo::Error;
use relevo::container::layout::Header;
use relevo::container::metadata::{ErrorStatistics, LevelStatistics, Statistics};
use relevo::container::reader::Reader;
use serde_json::json;

use crate::cli::table::{Table, bytes, count, short, wrapped};
use crate::cli::{Outcome, json, shown};

/// Print the errors of a file by level and tessellation step
#[derive(clap::Args)]
pub struct Args {
    /// The .rlv file
    #[arg(value_name = "FILE.rlv")]
    file: PathBuf,
    /// Print JSON: the statistics section, and facts of the header
    #[arg(long, conflicts_with = "csv")]
    json: bool,
    /// Print CSV: one line for each level and step
    #[arg(long)]
    csv: bool,
}

/// Prints the statistics section of the file.
pub fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let reader = Reader::open(&args.file)?;
    let statistics = reader.statistics()?.ok_or_else(|| {
        Error::usage(format!("{}: the file carries no statistics; build it again", shown(&args.file)))
    })?;
    let header = reader.header();
    if args.json {
        let head = json!({ "file": json::path(&args.file), "bytes": reader.file_len() });
        let all = json!({ "statistics": json::statistics(&statistics) });
        json::print(&json::object("stats", json::joined([head, json::lattice(header), all])), out)?;
    } else if args.csv {
        csv(&statistics, out)?;
    } else {
        let (metric, size) = (header.metric.as_str(), format!("{} x {}", header.width, header.height));
        let head = format!("{}: {size} samples, metric {metric}", shown(&args.file));
        writeln!(out, "{}\n", wrapped(&head, 2))?;
        levels_table(&statistics, header, out)?;
        steps_table(&statistics, header, out)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Prints one line for each level: tiles, sizes, voids, and the errors at the finest and the
/// coarsest step.
pub fn levels_table(statistics: &Statistics, header: &Header, out: &mut dyn Write) -> io::Result<()> {
    let last = header.steps().saturating_sub(1) as usize;
    let coarsest = 1_u64 << last;
    let title = format!(
        "Levels, and the largest error in metres where every sample of a level is drawn, and where every {} is:",
        ordinal(coarsest)
    );
    writeln!(out, "{}", wrapped(&title, 0))?;
    let some =
        |pick: Pick| statistics.levels.iter().flat_map(|level| &level.steps).any(|step| pick(step).max > 0.0);
    // Without voids inside or a ragged outline there are no horizontal errors.
    let errors: &[(&str, Pick)] = if some(horizontal) {
        &[("vertical\nerror (m)", vertical), ("horizontal\nerror (m)", horizontal)]
    } else {
        &[("vertical\nerror (m)", vertical)]
    };
    let every = format!("every\n{}", ordinal(coarsest));
    let mut heading = vec!["level", "tiles", "spacing\n(m)", "void\n(%)", "size", "bits per\nsample"];
    heading.extend(errors.iter().flat_map(|_| ["every\nsample", every.as_str()]));
    let groups: Vec<(usize, &str)> = errors.iter().map(|(name, _)| (2, *name)).collect();
    let mut table = Table::new(&heading).groups(&groups);
    for level in &statistics.levels {
        let worst = |pick: Pick, step: usize| {
            level.steps.get(step).map_or(String::new(), |step| match pick(step).max {
                0.0 => "0".to_owned(),
                max => short(max),
            })
        };
        let mut row = vec![
            level.level.to_string(),
            count(level.tiles),
            level.steps.first().map_or(String::new(), |s| short(s.spacing_m[0].max(s.spacing_m[1]))),
            short(100.0 * void_share(level)),
            bytes(level_bytes(level)),
            short(bits_per_sample(level)),
        ];
        row.extend(errors.iter().flat_map(|&(_, pick)| [worst(pick, 0), worst(pick, last)]));
        table.row(row);
    }
    table.print(out)
}

/// An ordinal such as `2nd`, `32nd`, `64th`.
fn ordinal(number: u64) -> String {
    match (number % 10, number % 100) {
        (2, rest) if rest != 12 => format!("{number}nd"),
        (1, rest) if rest != 11 => format!("{number}st"),
        _ => format!("{number}th"),
    }
}

/// Prints one line for each level and step: the distributions of both errors.
fn steps_table(statistics: &Statistics, header: &Header, out: &mut dyn Write) -> io::Result<()> {
    for (title, pick) in [("Vertical", vertical as Pick), ("Horizontal", horizontal as Pick)] {
        if statistics.levels.iter().flat_map(|l| &l.steps).all(|s| pick(s).max == 0.0) {
            writeln!(out, "\n{title} error: none anywhere")?;
            continue;
        }
        let what = if title == "Vertical" { "" } else { " (how far the outline of voids is off)" };
        let title = format!(
            "{title} error{what} of the patches, {0} x {0} intervals each, metric {1}. Step 0 draws every sample of \
             its level, step 1 every 2nd, step 2 every 4th:",
            header.patch(),
            header.metric.as_str(),
        );
        writeln!(out, "\n{}", wrapped(&title, 0))?;
        let heading = [
            "level",
            "step",
            "spacing\n(m)",
            "patches",
            "min\n(m)",
            "mean\n(m)",
            "p50\n(m)",
            "p90\n(m)",
            "p99\n(m)",
            "max\n(m)",
        ];
        let mut table = Table::new(&heading);
        for level in &statistics.levels {
            for (k, step) in level.steps.iter().enumerate() {
                let e = pick(step);
                let figures = [e.min, e.mean, e.p50, e.p90, e.p99, e.max].map(short);
                let spacing = short(step.spacing_m[0].max(step.spacing_m[1]));
                let start = [level.level.to_string(), k.to_string(), spacing, count(e.count)];
                table.row(start.into_iter().chain(figures).collect());
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

/// Share of void samples in a level's lattice, within the raster.
pub fn void_share(level: &LevelStatistics) -> f64 {
    1.0 - level.valid as f64 / (level.columns * level.rows) as f64
}

/// Stored bits per sample of a level's lattice.
pub fn bits_per_sample(level: &LevelStatistics) -> f64 {
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
