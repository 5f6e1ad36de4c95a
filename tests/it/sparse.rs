//! Sources that say where they have samples: the same bytes as without, and nothing done for the
//! rest of a huge raster.

use std::fs;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use proptest::prelude::*;
use relevo::Rect;
use relevo::Result;
use relevo::container::reader::Reader;
use relevo::geo::Geo;
use relevo::pipeline::{self, BuildOptions, Silent, column_passes, memory};
use relevo::sample::SampleType;
use relevo::source::{Fingerprint, Part, Samples, Source, SourceInfo, Window};
use relevo::verify::{VerifyOptions, verify};

use crate::support::terrain::info;

const VOID: i16 = -32768;

/// Hills in some rectangles, void elsewhere.
struct Patches {
    info: SourceInfo,
    rects: Vec<Rect>,
    read: AtomicU64,
}

impl Patches {
    fn new(side: (u32, u32), rects: Vec<Rect>) -> Self {
        let transform = Some([500_000.0, 1.0, 0.0, 5_000_000.0, 0.0, -1.0]);
        let info = SourceInfo {
            nodata: Some(VOID.into()),
            geo: Geo { transform, ..Geo::default() },
            footprint: Some(rects.clone()),
            block_rows: 1,
            ..info(side.0, side.1, SampleType::Int16)
        };
        Self { info, rects, read: AtomicU64::new(0) }
    }

    /// The same samples from a source that does not say where they are.
    fn dense(&self) -> Self {
        let info = SourceInfo { footprint: None, ..self.info.clone() };
        Self { info, rects: self.rects.clone(), read: AtomicU64::new(0) }
    }

    fn sample(&self, column: u32, row: u32) -> i16 {
        let inside = |rect: &Rect| rect.columns.contains(&column) && rect.rows.contains(&row);
        let (x, y) = (f64::from(column), f64::from(row));
        let height = 200.0 * ((x / 31.0).sin() + (y / 47.0).cos()) + (x * 0.7 + y * 1.3).sin() * 9.0;
        // A few voids inside, too.
        let hole = (x / 11.0).sin() * (y / 13.0).cos() > 0.93;
        if self.rects.iter().any(inside) && !hole { height as i16 } else { VOID }
    }
}

impl Source for Patches {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Window> {
        self.read.fetch_add(columns.len() as u64 * rows.len() as u64, Ordering::Relaxed);
        let samples = rows.flat_map(|row| columns.clone().map(move |column| self.sample(column, row)));
        Ok(Window { samples: Samples::Int16(samples.collect()), mask: None })
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        Ok(Fingerprint { files: Vec::new() })
    }
}

fn rect(side: u32) -> impl Strategy<Value = Rect> {
    (0..side, 0..side, 1_u32..120, 1_u32..120)
        .prop_map(move |(x, y, w, h)| Rect { columns: x..(x + w).min(side), rows: y..(y + h).min(side) })
}

fn built(source: &Patches, output: &Path, options: &BuildOptions) -> Vec<u8> {
    pipeline::build(source, output, options, &Silent).expect("build");
    fs::read(output).expect("file")
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn a_footprint_changes_no_byte(rects in prop::collection::vec(rect(500), 1..7), at in 1_u32..31, precise in any::<bool>()) {
        let folder = tempfile::tempdir().expect("folder");
        let sparse = Patches::new((500, 500), rects);
        let precision_m = precise.then_some(0.5);
        let options = BuildOptions { tile: 16, patch: 8, precision_m, force: true, ..BuildOptions::default() };
        let any = (0..500).any(|row| (0..500).any(|column| sparse.sample(column, row) != VOID));
        prop_assume!(any);
        let dense = built(&sparse.dense(), &folder.path().join("dense.rlv"), &options);
        prop_assert!(built(&sparse, &folder.path().join("sparse.rlv"), &options) == dense);
        // In two windows, and in strips.
        let extent = |columns: Range<u32>| Rect { columns, rows: 0..32 };
        let pieces = [extent(0..at), extent(at..32)].map(|window| {
            let piece = folder.path().join(format!("piece-{}", window.columns.start));
            pipeline::build_window(&sparse, &piece, &window, &options, &Silent).expect("piece");
            piece
        });
        let merged = folder.path().join("merged.rlv");
        pipeline::merge(&pieces, &merged, None, true, &Silent).expect("merge");
        prop_assert!(fs::read(&merged).expect("merged") == dense);
        let plan = pipeline::plan(&sparse.info, &options).expect("plan");
        // As little as strips, and joining them, can do with.
        let tight = |columns: u32| (0..32).map(|x| memory::estimate(&plan, &(u32::saturating_sub(x, 2)..x + columns))).max();
        let memory = [3, 7, 15].map(tight).into_iter().find(|&memory| column_passes::windows(&plan, memory).is_ok()).flatten();
        let options = BuildOptions { memory, ..options };
        prop_assert!(built(&sparse, &folder.path().join("strips.rlv"), &options) == dense);
    }
}

/// Squares along a winding diagonal of a raster as large as a continent at 1 m.
fn strip(count: u32, square: u32) -> Vec<Rect> {
    let rect = |i: u32| {
        let along = f64::from(i) * f64::from(square) * 0.6;
        let across = (f64::from(i) / 7.0).sin() * f64::from(square) * 2.0;
        let (x, y) = (1_900_000.0 + along + across, 1_800_000.0 + along - across);
        Rect { columns: x as u32..x as u32 + square, rows: y as u32..y as u32 + square }
    };
    (0..count).map(rect).collect()
}

#[test]
fn metadata_have_room_for_any_number_of_sources() {
    let folder = tempfile::tempdir().expect("folder");
    let mut source = Patches::new((60, 60), vec![Rect { columns: 0..60, rows: 0..60 }]);
    let part = |i: usize| Part {
        name: format!("a_file_with_quite_a_long_name_{i}.tif"),
        description: "GeoTIFF through GDAL; gdalwarp with many words".repeat(9),
    };
    source.info.parts = (0..5000).map(part).collect();
    let output = folder.path().join("many.rlv");
    pipeline::build(&source, &output, &BuildOptions::default(), &Silent).expect("build");
    let reader = Reader::open(&output).expect("open");
    let metadata = reader.metadata();
    assert!(metadata.sources.len() > 20 && metadata.sources[20].name == source.info.parts[20].name);
    assert_eq!(metadata.sources.len() as u64 + metadata.more_sources, 5000);
}

#[test]
fn a_strip_in_a_raster_of_2_to_the_22_costs_what_it_holds() {
    let folder = tempfile::tempdir().expect("folder");
    let rects = strip(40, 100);
    let source = Patches::new((1 << 22, 1 << 22), rects.clone());
    let options = BuildOptions { tile: 32, patch: 16, ..BuildOptions::default() };
    let plan = pipeline::plan(source.info(), &options).expect("plan");
    assert_eq!(plan.pyramid.levels, 17);
    let output = folder.path().join("strip.rlv");
    let report = pipeline::build(&source, &output, &options, &Silent).expect("build");
    // Tiles that a square touches, counted one by one.
    let mut tiles = std::collections::BTreeSet::new();
    for rect in &rects {
        for row in rect.rows.clone() {
            for column in rect.columns.clone().filter(|&column| source.sample(column, row) != VOID) {
                let along = |v: u32| std::iter::once(v / 32).chain(v.is_multiple_of(32).then(|| v / 32 - 1));
                along(row).for_each(|y| tiles.extend(along(column).map(|x| (x, y))));
            }
        }
    }
    let leaves = report.statistics.levels.last().expect("leaves").tiles;
    assert_eq!(leaves, tiles.len() as u64);
    // The root path is as long as the raster is large, all else follows the leaves.
    assert!(report.header.tile_count < 2 * leaves + 17 * 4, "{} tiles", report.header.tile_count);
    // Tiles are read with the whole of their borders, and the rows of the squares one after the
    // other.
    let read = source.read.load(Ordering::Relaxed);
    assert!(read <= 2 * leaves * 33 * 33, "{read} samples were read for {leaves} tiles");
    assert!(
        memory::estimate(&plan, &(0..u32::MAX)) < 64 << 20,
        "{}",
        memory::estimate(&plan, &(0..u32::MAX))
    );
    let reader = Reader::open(&output).expect("open");
    for y in [tiles.first().expect("a tile").1, 5, 60_000] {
        let row = reader.row(17, y).expect("row");
        assert!(row.into_iter().eq(tiles.iter().filter(|tile| tile.1 == y).map(|tile| tile.0)), "row {y}");
    }
    let report = verify(&reader, Some(&source), &VerifyOptions::default(), &Silent).expect("verify");
    assert!(report.is_good(), "{:?}", report.checks);
}
