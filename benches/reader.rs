//! Reading a file: opening it, a leaf out of nothing, every leaf in storage order by one thread and
//! by several; by position and through a map.

#![expect(clippy::expect_used, reason = "a benchmark that cannot go on says why")]

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use criterion::{
    BatchSize, BenchmarkGroup, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main,
};
use relevo::container::{Reader, ReaderOptions};
use relevo::geo::Geo;
use relevo::limits::Limits;
use relevo::pipeline::{self, BuildOptions, Silent};
use relevo::sample::{Lattice, SampleType};
use relevo::source::{self, Fingerprint, Samples, Source, SourceInfo, Window};
use relevo::{Result, TileId};
use relevo_core::Map;

/// Side of the rasters that are made here: 8 x 8 leaves.
const SIDE: u32 = 2049;

/// Rough hills of about 3 bits a sample, with lakes if asked for.
struct Hills {
    info: SourceInfo,
    lakes: bool,
}

impl Hills {
    fn new(lakes: bool) -> Self {
        let info = SourceInfo {
            width: SIDE,
            height: SIDE,
            sample_type: SampleType::Int16,
            nodata: Some(-32768.0),
            band_scale: 1.0,
            band_offset: 0.0,
            vertical_unit: (1.0, String::new()),
            geo: Geo::default(),
            description: "hills".into(),
            parts: Vec::new(),
            footprint: None,
            overlap: None,
            block_rows: 1,
            reading: relevo::source::ReadMemory::default(),
            warnings: Vec::new(),
            origins: relevo::source::Origins::default(),
        };
        Self { info, lakes }
    }

    fn height(&self, x: u32, y: u32) -> i16 {
        let (u, v) = (f64::from(x), f64::from(y));
        let (wide, narrow) = ((u / 70.0).sin() * (v / 50.0).cos(), ((u + v) / 8.0).sin());
        let mixed =
            (x.wrapping_mul(2_654_435_761) ^ y.wrapping_mul(2_246_822_519)).wrapping_mul(3_266_489_917);
        let noise = f64::from(mixed >> 24) / 256.0 + f64::from(mixed >> 16 & 255) / 256.0;
        if self.lakes && wide < -0.8 {
            -32768
        } else {
            (1500.0 + 400.0 * wide + 40.0 * narrow + 3.0 * noise) as i16
        }
    }
}

impl Source for Hills {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Window> {
        let heights = rows.flat_map(|y| columns.clone().map(move |x| self.height(x, y)));
        Ok(Window { samples: Samples::Int16(heights.collect()), mask: None })
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        Ok(Fingerprint { files: Vec::new() })
    }
}

fn build(folder: &Path, name: &str, source: &dyn Source) -> PathBuf {
    let output = folder.join(name);
    pipeline::build(source, &output, &BuildOptions::default(), &Silent).expect("build");
    output
}

/// Opens a file to be read by position, or through a map.
fn open(path: &Path, is_mapped: bool) -> Reader {
    if is_mapped {
        let map = Map::open(path).expect("map");
        return Reader::new(map, path, ReaderOptions::default()).expect("open");
    }
    Reader::open(path).expect("open")
}

/// Reads every leaf once, some at a time to a thread.
fn every_leaf((path, is_mapped): (&Path, bool), leaves: &[TileId], threads: usize) {
    let reader = open(path, is_mapped);
    let next = AtomicUsize::new(0);
    let work = || {
        let mut tile = Lattice::default();
        while let Some(rest) = leaves.get(next.fetch_add(16, Ordering::Relaxed)..) {
            rest.iter().take(16).for_each(|&id| reader.read_tile_into(id, &mut tile).expect("tile"));
        }
    };
    std::thread::scope(|scope| (0..threads).for_each(|_| drop(scope.spawn(work))));
}

fn reading(group: &mut BenchmarkGroup<'_, criterion::measurement::WallTime>, path: &Path, is_mapped: bool) {
    let reader = open(path, is_mapped);
    let leaves = reader.leaves().expect("leaves");
    group.bench_function("open", |bencher| bencher.iter(|| open(path, is_mapped)));
    let mut turn = 0;
    group.bench_function("cold leaf", |bencher| {
        let fresh = || {
            turn = (turn + 29) % leaves.len();
            (open(path, is_mapped), leaves[turn])
        };
        bencher.iter_batched(
            fresh,
            |(reader, id)| reader.read_tile(id).expect("tile"),
            BatchSize::PerIteration,
        );
    });
    group.bench_function("cold leaf, alone", |bencher| {
        let fresh = || {
            turn = (turn + 29) % leaves.len();
            (open(path, is_mapped), leaves[turn])
        };
        let read = |(reader, id): (Reader, TileId)| {
            let mut tile = Lattice::default();
            reader.read_tile_alone(id, &mut tile).expect("tile");
            tile
        };
        bencher.iter_batched(fresh, read, BatchSize::PerIteration);
    });
    let header = reader.header();
    group.throughput(Throughput::Elements(u64::from(header.width) * u64::from(header.height)));
    let all = std::thread::available_parallelism().map_or(1, usize::from);
    for threads in if all > 1 { vec![1, all] } else { vec![1] } {
        group.bench_function(BenchmarkId::new("every leaf, threads", threads), |bencher| {
            bencher.iter(|| every_leaf((path, is_mapped), &leaves, threads));
        });
    }
}

fn reader(criterion: &mut Criterion) {
    let folder = tempfile::tempdir().expect("folder");
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem/co_elevation_float32_lzw.tif");
    let fixture = source::open(&fixture, &Limits::default()).expect("fixture");
    let sources: [(&str, &dyn Source); 3] = [
        ("int16", &Hills::new(false)),
        ("int16 with lakes", &Hills::new(true)),
        ("float32 fixture", &*fixture),
    ];
    for (name, source) in sources {
        let path = build(folder.path(), name, source);
        reading(&mut criterion.benchmark_group(name), &path, false);
        reading(&mut criterion.benchmark_group(format!("{name}, mapped")), &path, true);
    }
}

criterion_group!(benches, reader);
criterion_main!(benches);
