//! Reading a whole file: every leaf, in storage order, with its ancestors through the cache.

#![expect(clippy::expect_used, reason = "a benchmark that cannot go on says why")]

use std::path::Path;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use relevo::container::Reader;
use relevo::limits::Limits;
use relevo::pipeline::{self, BuildOptions, Silent};
use relevo::source;

fn every_leaf(criterion: &mut Criterion) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().expect("folder");
    let mut group = criterion.benchmark_group("every_leaf");
    for (name, dem) in [
        ("float32", "fixtures/dem/co_elevation_float32_lzw.tif"),
        ("int16", "../shared/data/bigtujunga_utm11_int16.tif"),
        ("int16_voids", "../shared/data/mt_rainier_srtm3_int16_voids.tif"),
    ] {
        let dem = root.join(dem);
        if !dem.exists() {
            eprintln!("{} is not there: not measured", dem.display());
            continue;
        }
        let output = folder.path().join(name);
        let source = source::open(&dem, &Limits::default()).expect("source");
        pipeline::build(&*source, &output, &BuildOptions::default(), &Silent).expect("build");
        let leaves = Reader::open(&output).expect("open").leaves().expect("leaves");
        // Samples that are stored: three quarters of each tile and all of the root.
        let tiles = Reader::open(&output).expect("open").header().tile_count;
        group.throughput(Throughput::Elements(tiles * 257 * 257 * 3 / 4));
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                let reader = Reader::open(&output).expect("open");
                leaves.iter().map(|&id| reader.read_tile(id).expect("tile").code[0]).max()
            });
        });
    }
    group.finish();
}

criterion_group!(benches, every_leaf);
criterion_main!(benches);
