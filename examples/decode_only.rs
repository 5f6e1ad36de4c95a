//! Reads all samples of a raster and does nothing with them: what no build from it can be faster
//! than.
//!
//! `cargo run --release --example decode_only -- DEM.tif [THREADS] [ROWS]`
//!
//! Goes from north to south in bands of ROWS rows (257), one row shared with the band before, as
//! the builder does with tiles of
//! 256. Prints one line of JSON: seconds, samples a second.

#![expect(clippy::print_stdout, reason = "its result")]

use std::path::Path;
use std::time::Instant;

use relevo::limits::Limits;
use relevo::{Error, Result, source};

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |at: usize, or: usize| arguments.get(at).map_or(Ok(or), |text| text.parse());
    let usage = || Error::usage("usage: decode_only DEM.tif [THREADS] [ROWS]");
    let path = Path::new(arguments.first().ok_or_else(usage)?);
    let threads = number(1, 0).map_err(|_| usage())?;
    let rows = number(2, 257).map_err(|_| usage())?.max(2) as u32;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| Error::usage(error.to_string()))?;
    let start = Instant::now();
    let samples = pool.install(|| read(path, rows))?;
    let seconds = start.elapsed().as_secs_f64();
    let threads = pool.current_num_threads();
    println!(
        "{{\"threads\": {threads}, \"samples\": {samples}, \"seconds\": {seconds:.4}, \"samples_per_second\": {:.0}}}",
        samples as f64 / seconds
    );
    Ok(())
}

/// Reads band after band; how many samples the raster has.
fn read(path: &Path, rows: u32) -> Result<u64> {
    let source = source::open(path, &Limits::default())?;
    let (width, height) = (source.info().width, source.info().height);
    let mut start = 0;
    loop {
        let end = height.min(start + rows);
        std::hint::black_box(source.read_rows(start..end)?);
        if end == height {
            return Ok(u64::from(width) * u64::from(height));
        }
        start = end - 1;
    }
}
