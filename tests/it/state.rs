//! Builds that go on elsewhere or later, of rasters whose numbers a text would lose: the same bytes
//! as one that runs through.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use relevo::Error;
use relevo::Rect;
use relevo::geo::Geo;
use relevo::geotiff_write::{GeotiffSpec, GeotiffWriter};
use relevo::limits::Limits;
use relevo::pipeline::{self, BuildOptions, Progress, Silent, Stage, column_passes};
use relevo::sample::SampleType;
use relevo::source::{self, Samples, Source};

const SIDE: u32 = 150;

/// Waves with holes of NaN and of the nodata value.
fn dem(path: &Path, nodata: f64, unit: f64) {
    let geo = Geo { transform: Some([-0.0, unit, 0.0, 5e-324, 0.0, -unit]), ..Geo::default() };
    let mut spec = GeotiffSpec::new(SIDE, SIDE, SampleType::Float64, &geo);
    spec.nodata = Some(nodata);
    let mut writer = GeotiffWriter::create(path, &spec).expect("create");
    for y in 0..SIDE {
        let sample = |x: u32| match (x / 9 + y / 7) % 6 {
            0 => nodata,
            1 if x.is_multiple_of(2) => f64::NAN,
            _ => 50.0 * (f64::from(x) / 20.0).sin() + f64::from(x * y % 17) / 3.0,
        };
        writer.write_rows(&Samples::Float64((0..SIDE).map(sample).collect())).expect("rows");
    }
    writer.finish().expect("dem");
}

/// Stops after some bands.
struct StopAfter(AtomicU64);

impl Progress for StopAfter {
    fn report(&self, _: Stage, _: u64, _: u64) {}

    fn is_cancelled(&self) -> bool {
        self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)).is_err()
    }
}

fn options(nodata: Option<f64>) -> BuildOptions {
    BuildOptions {
        tile: 16,
        patch: 4,
        nodata,
        jobs: Some(2),
        checkpoint: Some(Duration::ZERO),
        ..BuildOptions::default()
    }
}

fn resumed(source: &dyn Source, output: &Path, options: &BuildOptions) -> usize {
    let options = BuildOptions { resume: true, ..options.clone() };
    for stops in 0..100 {
        match pipeline::build(source, output, &options, &StopAfter(AtomicU64::new(4 + stops as u64))) {
            Ok(_) => return stops,
            Err(Error::Interrupted) => {}
            Err(error) => panic!("{error}"),
        }
    }
    panic!("it never ends");
}

fn in_windows(source: &dyn Source, folder: &Path, output: &Path, options: &BuildOptions) {
    let tiles = (SIDE - 1).div_ceil(options.tile);
    let pieces: Vec<PathBuf> = [0..4, 4..tiles]
        .into_iter()
        .map(|columns| {
            let piece = folder.join(format!("piece-{}", columns.start));
            let window = Rect { columns, rows: 0..tiles };
            pipeline::build_window(source, &piece, &window, options, &Silent).expect("window");
            piece
        })
        .collect();
    pipeline::merge(&pieces, output, Some(2), false, &Silent).expect("merge");
}

#[test]
fn no_number_is_lost_on_the_way() {
    let odd = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -0.0, 5e-324, f64::MIN, -9999.0];
    for (nodata, stated) in odd.into_iter().flat_map(|nodata| [(nodata, None), (-9999.0, Some(nodata))]) {
        let folder = tempfile::tempdir().expect("folder");
        let path = |name: &str| folder.path().join(name);
        dem(&path("dem.tif"), nodata, 30.0);
        let source = source::open(&path("dem.tif"), &Limits::default()).expect("open");
        let options = options(stated);
        let what = format!("nodata {nodata:?}, stated {stated:?}");
        pipeline::build(&*source, &path("one.rlv"), &options, &Silent).expect("build");
        let expected = fs::read(path("one.rlv")).expect("file");
        let is_same = |name: &str| assert!(fs::read(path(name)).expect("file") == expected, "{what}: {name}");
        resumed(&*source, &path("resumed.rlv"), &options);
        is_same("resumed.rlv");
        in_windows(&*source, folder.path(), &path("merged.rlv"), &options);
        is_same("merged.rlv");
        let limit = {
            let plan = pipeline::plan(source.info(), &options).expect("plan");
            column_passes::memory_estimate(&plan, &options).expect("bytes") - 1
        };
        let narrow = BuildOptions { memory: Some(limit), ..options };
        pipeline::build(&*source, &path("strips.rlv"), &narrow, &Silent).expect("strips");
        is_same("strips.rlv");
    }
}

#[test]
fn a_damaged_row_of_the_list_of_tiles_is_found() {
    let folder = tempfile::tempdir().expect("folder");
    let path = |name: &str| folder.path().join(name);
    dem(&path("dem.tif"), -9999.0, 30.0);
    let source = source::open(&path("dem.tif"), &Limits::default()).expect("open");
    let options = options(None);
    let tiles = (SIDE - 1).div_ceil(options.tile);
    let all = Rect { columns: 0..tiles, rows: 0..tiles };
    let piece = path("piece");
    pipeline::build_window(&*source, &piece, &all, &options, &Silent).expect("window");
    pipeline::merge(std::slice::from_ref(&piece), &path("good.rlv"), Some(2), false, &Silent).expect("merge");
    let records = fs::read(piece.join("records")).expect("records");
    for place in (0..records.len()).step_by(37) {
        let mut damaged = records.clone();
        damaged[place] ^= 1 << (place % 8);
        fs::write(piece.join("records"), damaged).expect("write");
        let merged = pipeline::merge(std::slice::from_ref(&piece), &path("bad.rlv"), Some(2), true, &Silent);
        let message = merged.expect_err("damaged").to_string();
        assert!(message.contains("records") && !path("bad.rlv").exists(), "{place}: {message}");
    }
}
