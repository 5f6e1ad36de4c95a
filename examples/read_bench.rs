//! Speed of reading a container: opening, one cold leaf, all leaves.
//!
//! `cargo run --release --example read_bench -- FILE.rlv [THREADS]...`
//!
//! Prints one line of JSON: milliseconds and resident memory of an opening; milliseconds of a leaf
//! that a fresh reader decodes with all of its ancestors, and of one that it reads alone (median
//! and worst of 64); and for each number of threads the samples of the raster a second when every
//! leaf is read once in storage order. The system's page cache is as it is: read the file before to
//! measure it warm.

#![expect(clippy::print_stdout, reason = "its result")]

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use relevo::container::Reader;
use relevo::sample::Lattice;
use relevo::{Error, Result, TileId};

/// Leaves that a thread takes at a time: they share most of their ancestors.
const TOGETHER: usize = 64;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let usage = || Error::usage("usage: read_bench FILE.rlv [THREADS]...");
    let (path, threads) = arguments.split_first().ok_or_else(usage)?;
    let path = Path::new(path);
    let threads: Vec<usize> =
        threads.iter().map(|n| n.parse().map_err(|_| usage())).collect::<Result<_>>()?;
    let start = Instant::now();
    let reader = Reader::open(path)?;
    let open_ms = milliseconds(start);
    let open_mb = resident_mb();
    let leaves = reader.leaves()?;
    let header = reader.header();
    let samples = f64::from(header.width) * f64::from(header.height);
    let cold = cold_leaves(path, &leaves, |reader, id| reader.read_tile(id).map(drop))?;
    let alone = cold_leaves(path, &leaves, |reader, id| reader.read_tile_alone(id, &mut Lattice::default()))?;
    let mut speeds = Vec::new();
    for count in if threads.is_empty() { vec![1] } else { threads } {
        let (seconds, decoded) = sequential(path, &leaves, count)?;
        speeds.push(format!(
            "{{\"threads\": {count}, \"seconds\": {seconds:.4}, \"tiles_decoded\": {decoded}, \"samples_per_second\": {:.0}}}",
            samples / seconds
        ));
    }
    println!(
        "{{\"tiles\": {}, \"leaves\": {}, \"open_ms\": {open_ms:.3}, \"open_resident_mb\": {open_mb:.1}, \
         \"cold_leaf_ms\": {:.3}, \"cold_leaf_worst_ms\": {:.3}, \"leaf_alone_ms\": {:.3}, \
         \"leaf_alone_worst_ms\": {:.3}, \"sequential\": [{}]}}",
        header.tile_count,
        leaves.len(),
        cold.get(cold.len() / 2).copied().unwrap_or(0.0),
        cold.last().copied().unwrap_or(0.0),
        alone.get(alone.len() / 2).copied().unwrap_or(0.0),
        alone.last().copied().unwrap_or(0.0),
        speeds.join(", ")
    );
    Ok(())
}

/// Milliseconds of leaves spread over the file, each read by a reader that has decoded nothing;
/// sorted.
fn cold_leaves(
    path: &Path,
    leaves: &[TileId],
    read: impl Fn(&Reader, TileId) -> Result<()>,
) -> Result<Vec<f64>> {
    let step = (leaves.len() / 64).max(1);
    let cold = |&id: &TileId| {
        let reader = Reader::open(path)?;
        let start = Instant::now();
        read(&reader, id)?;
        Ok(milliseconds(start))
    };
    let mut times: Vec<f64> = leaves.iter().step_by(step).map(cold).collect::<Result<_>>()?;
    times.sort_by(f64::total_cmp);
    Ok(times)
}

/// Seconds to read all leaves once, and tiles decoded for it.
fn sequential(path: &Path, leaves: &[TileId], threads: usize) -> Result<(f64, u64)> {
    let reader = Reader::open(path)?;
    let next = AtomicUsize::new(0);
    let work = || {
        let mut tile = Lattice::default();
        while let Some(rest) = leaves.get(next.fetch_add(TOGETHER, Ordering::Relaxed)..) {
            for &id in rest.iter().take(TOGETHER) {
                reader.read_tile_into(id, &mut tile)?;
                std::hint::black_box(&tile);
            }
        }
        Ok(())
    };
    let start = Instant::now();
    let results: Vec<Result<()>> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..threads.max(1)).map(|_| scope.spawn(work)).collect();
        let join = |thread: std::thread::ScopedJoinHandle<'_, Result<()>>| {
            thread.join().unwrap_or_else(|_| Err(Error::usage("a thread panicked")))
        };
        threads.into_iter().map(join).collect()
    });
    results.into_iter().collect::<Result<()>>()?;
    Ok((start.elapsed().as_secs_f64(), reader.decoded_tiles()))
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

/// Resident memory of this process; 0 where the system does not tell.
fn resident_mb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kib = line.and_then(|rest| rest.split_whitespace().next()?.parse::<f64>().ok());
    kib.unwrap_or(0.0) * 1024.0 / 1e6
}
