//! `relevo build --each`: builds one file from every input, on all cores; an input that fails is
//! reported, and the others go on.
//!
//! Small inputs are built at the same time, one thread each, the largest first. An input so large
//! that the others would finish long before it is built first, on all threads. A record beside the
//! outputs says which input and options each was made from, for `--resume`.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use relevo::container::reader::Reader;
use relevo::output::Inputs;
use relevo::pipeline::{self, BuildOptions, Report};
use relevo::progress::{Progress, Stage};
use relevo::verify::{VerifyOptions, verify};
use relevo::{Build, Error};
use serde_json::json;

use crate::cli::build::{self, failure};
use crate::cli::dem::SourceArgs;
use crate::cli::progress::{Show, UntilStopped};
use crate::cli::table::{Table, bytes, count, seconds};
use crate::cli::warnings::{self, with_options};
use crate::cli::{Outcome, inputs, json, shown, stopped, voice};

mod names;
mod record;

use record::Record;

/// An input and the file to make from it.
struct Job {
    input: PathBuf,
    output: PathBuf,
    /// Bytes of the input, a measure of the time it takes.
    weight: u64,
}

/// The result of a job.
enum JobResult {
    Built(Box<Report>),
    /// The file was made before, from the same input with the same options.
    Unchanged,
    Failed(String),
    /// The batch was stopped before the job began.
    NotBegun,
}

/// What all jobs of a batch share.
struct Batch<'a> {
    options: &'a BuildOptions,
    reading: &'a SourceArgs,
    verify: bool,
    /// `options` and `reading` as text, to compare with the record.
    options_text: String,
    record: Record,
    show: &'a Show,
    /// Weight done so far, for each job.
    done: Vec<AtomicU64>,
    finished: AtomicUsize,
    total: u64,
}

/// Builds all of `inputs` into `folder`.
pub fn run(
    args: &build::Args,
    inputs: &[PathBuf],
    folder: &Path,
    options: &BuildOptions,
    out: &mut dyn Write,
) -> Outcome {
    let start = Instant::now();
    let inputs = inputs::of_folders(inputs)?;
    let mut jobs = jobs(&inputs, &Inputs::new(&build::named_inputs(args, &inputs)), folder)?;
    // The largest first, so that no long job is left for the end.
    jobs.sort_by(|a, b| b.weight.cmp(&a.weight).then_with(|| a.input.cmp(&b.input)));
    fs::create_dir_all(folder).map_err(|source| Error::io(folder, "make the folder", source))?;
    let show = Show::new(args.progress);
    let batch = Batch {
        options,
        reading: &args.source,
        verify: args.verify,
        options_text: options_text(options, &args.source)?,
        record: Record::open(folder)?,
        show: &show,
        done: jobs.iter().map(|_| AtomicU64::new(0)).collect(),
        finished: AtomicUsize::new(0),
        total: jobs.iter().map(|job| job.weight).sum(),
    };
    let results = batch.run(&jobs);
    show.finish();
    let seconds = start.elapsed().as_secs_f64();
    if args.json {
        print_json(&jobs, &results, seconds, out)?;
    } else if !voice::quiet() {
        print(&jobs, &results, seconds, out)?;
    }
    let good = results.iter().all(|result| matches!(result, JobResult::Built(_) | JobResult::Unchanged));
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::from(2) })
}

/// The jobs of a batch; fails if an output is also an input.
fn jobs(inputs: &[PathBuf], read: &Inputs, folder: &Path) -> Result<Vec<Job>, Error> {
    let outputs = names::outputs(inputs, folder)?;
    let job = |(input, output): (&PathBuf, PathBuf)| {
        let weight = fs::metadata(input).map_or(1, |metadata| metadata.len().max(1));
        read.check(&output)?;
        Ok(Job { input: input.clone(), output, weight })
    };
    inputs.iter().zip(outputs).map(job).collect()
}

/// All options that change the output, as text.
fn options_text(options: &BuildOptions, reading: &SourceArgs) -> Result<String, Error> {
    let options = serde_json::to_string(options)
        .map_err(|error| Error::usage(format!("the options cannot be recorded: {error}")))?;
    Ok(format!("relevo {} {options} {:?}", env!("CARGO_PKG_VERSION"), reading.options()))
}

impl Batch<'_> {
    /// Does all jobs, which are sorted by falling weight.
    fn run(&self, jobs: &[Job]) -> Vec<JobResult> {
        let threads = pipeline::workers(self.options.jobs);
        // On one thread, a job above this share would still run after all others are done.
        let share = self.total / (2 * threads as u64) + 1;
        let alone = jobs.partition_point(|job| job.weight > share);
        let results: Vec<Mutex<JobResult>> = jobs.iter().map(|_| Mutex::new(JobResult::NotBegun)).collect();
        let keep = |i: usize, result| *results[i].lock().unwrap_or_else(PoisonError::into_inner) = result;
        for (i, job) in jobs[..alone].iter().enumerate() {
            keep(i, self.job(i, job, threads, self.options.memory));
        }
        let workers = threads.min(jobs.len() - alone);
        let memory = self.options.memory.map(|memory| memory / workers.max(1) as u64);
        let next = AtomicUsize::new(alone);
        std::thread::scope(|scope| {
            for _ in 0..workers {
                scope.spawn(|| {
                    loop {
                        let i = next.fetch_add(1, Ordering::Relaxed);
                        let Some(job) = jobs.get(i) else { break };
                        keep(i, self.job(i, job, 1, memory));
                    }
                });
            }
        });
        results
            .into_iter()
            .map(|result| result.into_inner().unwrap_or_else(PoisonError::into_inner))
            .collect()
    }

    fn job(&self, index: usize, job: &Job, threads: usize, memory: Option<u64>) -> JobResult {
        if stopped() {
            return JobResult::NotBegun;
        }
        let options = BuildOptions { jobs: Some(threads), memory, ..self.options.clone() };
        let result = self.make(index, job, &options).unwrap_or_else(|message| self.failed(job, message));
        self.done[index].store(job.weight, Ordering::Relaxed);
        let finished = self.finished.fetch_add(1, Ordering::Relaxed) + 1;
        self.show.note(&format!("{finished} of {} files", self.done.len()));
        self.show_progress();
        result
    }

    /// Prints a failure and adds it to the record.
    fn failed(&self, job: &Job, message: String) -> JobResult {
        // Most messages begin with the name of the file.
        let name = shown(&job.input);
        let message = if message.contains(&name) { message } else { format!("{name}: {message}") };
        self.show.aside(|| {
            voice::error(&message);
            if let Err(error) = self.record.add_failed(&job.input, &message) {
                voice::warning(&error.to_string());
            }
        });
        JobResult::Failed(message)
    }

    fn make(&self, index: usize, job: &Job, options: &BuildOptions) -> Result<JobResult, String> {
        let input = std::slice::from_ref(&job.input);
        let named = |error: Error| failure(error, &job.input, &job.output).message();
        let source = self.reading.open(input).map_err(named)?;
        let fingerprint = source.fingerprint().map_err(named)?;
        let warnings = with_options(&source.info().warnings);
        if options.resume && self.record.has(&job.output, &fingerprint, &self.options_text) {
            return Ok(JobResult::Unchanged);
        }
        self.warn(&warnings);
        warnings::refuse(&warnings, options.strict)
            .map_err(|error| format!("{}: {error}", job.input.display()))?;
        // With `resume`, a file that is there but not in the record is from another input or other
        // options.
        let force = options.force || (options.resume && job.output.exists());
        let options = BuildOptions { force, ..options.clone() };
        let share = JobProgress { batch: self, index, weight: job.weight };
        let report = Build::new(&*source).options(options).progress(&share).run(&job.output);
        let mut report = report.map_err(named)?;
        self.warn(&with_options(&report.warnings[source.info().warnings.len()..]));
        report.warnings = with_options(&report.warnings);
        if self.verify {
            let checked = Reader::open(&job.output)
                .and_then(|reader| verify(&reader, Some(&*source), &VerifyOptions::default(), &UntilStopped));
            let problems = checked.map_err(named)?.problems();
            if problems > 0 {
                return Err(format!("{}: {problems} problems found by the check", shown(&job.output)));
            }
        }
        self.record.add(&job.output, fingerprint, &self.options_text, &report.warnings).map_err(named)?;
        Ok(JobResult::Built(Box::new(report)))
    }

    fn warn(&self, warnings: &[String]) {
        self.show.aside(|| warnings::print_warnings(warnings));
    }

    fn show_progress(&self) {
        let done = self.done.iter().map(|done| done.load(Ordering::Relaxed)).sum();
        self.show.report(Stage::Build, done, self.total);
    }
}

/// The progress of one job, weighted by its share of the batch.
struct JobProgress<'a> {
    batch: &'a Batch<'a>,
    index: usize,
    weight: u64,
}

impl Progress for JobProgress<'_> {
    fn report(&self, stage: Stage, done: u64, total: u64) {
        // Assembling the file takes about a tenth of the time.
        let (from, to) = match stage {
            Stage::Scan => (0.0, 0.0),
            Stage::Build => (0.0, 0.9),
            _ => (0.9, 1.0),
        };
        let share = from + (to - from) * done as f64 / total.max(1) as f64;
        self.batch.done[self.index].store((share * self.weight as f64) as u64, Ordering::Relaxed);
        self.batch.show_progress();
    }

    fn is_cancelled(&self) -> bool {
        stopped()
    }
}

fn print(jobs: &[Job], results: &[JobResult], time: f64, out: &mut dyn Write) -> io::Result<()> {
    let mut table = Table::new(&["input", "samples", "tiles", "size", "time", "outcome"]).words(0);
    let mut counts = [0; 4];
    for (job, result) in jobs.iter().zip(results) {
        let name = shown(&job.input);
        let (index, cells) = match result {
            JobResult::Built(report) => {
                let header = &report.header;
                let rate = u64::from(header.width) * u64::from(header.height);
                (
                    0,
                    [
                        count(rate),
                        count(header.tile_count),
                        bytes(report.file.file_bytes),
                        seconds(report.elapsed.as_secs_f64()),
                        "built".to_owned(),
                    ],
                )
            }
            JobResult::Unchanged => (1, ["", "", "", "", "unchanged"].map(str::to_owned)),
            JobResult::Failed(_) => (2, ["", "", "", "", "failed"].map(str::to_owned)),
            JobResult::NotBegun => (3, ["", "", "", "", "not begun"].map(str::to_owned)),
        };
        counts[index] += 1;
        table.row(std::iter::once(name).chain(cells).collect());
    }
    table.print(out)?;
    let [built, unchanged, failed, not_begun] = counts;
    let parts = [(unchanged, "unchanged"), (failed, "failed"), (not_begun, "not begun")];
    let others = parts.iter().filter(|(count, _)| *count > 0).map(|(count, word)| format!("{count} {word}"));
    let all: Vec<String> = std::iter::once(format!("{built} built")).chain(others).collect();
    writeln!(out, "{} in {}", all.join(", "), seconds(time))?;
    Ok(())
}

fn print_json(jobs: &[Job], results: &[JobResult], seconds: f64, out: &mut dyn Write) -> io::Result<()> {
    let of_job = |(job, result): (&Job, &JobResult)| {
        let head = json!({ "sources": [json::path(&job.input)] });
        let rest = match result {
            JobResult::Built(report) => build::json(report, &job.output),
            JobResult::Unchanged => json!({ "file": json::path(&job.output), "status": "unchanged" }),
            JobResult::Failed(error) => {
                json!({ "file": json::path(&job.output), "status": "failed", "error": error })
            }
            JobResult::NotBegun => json!({ "file": json::path(&job.output), "status": "not begun" }),
        };
        json::joined([head, rest])
    };
    let files: Vec<_> = jobs.iter().zip(results).map(of_job).collect();
    json::print(&json::object("build --each", json!({ "files": files, "seconds": seconds })), out)
}
