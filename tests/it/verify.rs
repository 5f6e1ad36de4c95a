//! Files of adversarial terrain verify without a finding; files with one thing wrong do not.

pub mod lies;
pub mod patch;
pub mod statements;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use crate::support::progress::While;
use crate::support::terrain::{self, Kind, Memory};
use proptest::prelude::*;
use relevo::TileId;
use relevo::codec::table::{self, ErrorTable};
use relevo::codec::{Scratch, height};
use relevo::container::directory::{ChunkKind, TileEntry};
use relevo::container::layout::Metric;
use relevo::container::metadata::Statistics;
use relevo::container::reader::Reader;
use relevo::geo::{Crs, CrsKind, Geo};
use relevo::pipeline::{BuildOptions, Silent, build};
use relevo::sample::{FILLED, Lattice, SampleType, VALID};
use relevo::source::{Samples, Source};
use relevo::verify::{VerifyOptions, VerifyReport, refused, verify};
use relevo::writer::{ContainerWriter, TileChunks, TileRecord};
use tempfile::TempDir;

/// A folder with one built file.
struct Built {
    folder: TempDir,
    path: PathBuf,
}

fn built(source: &Memory, options: &BuildOptions) -> Built {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rlv");
    let options = BuildOptions { jobs: Some(2), ..options.clone() };
    build(source, &path, &options, &Silent).unwrap();
    Built { folder, path }
}

fn report(path: &Path, source: Option<&Memory>, deep: bool) -> VerifyReport {
    let reader = match Reader::open(path) {
        Ok(reader) => reader,
        Err(error) => return refused(error).unwrap(),
    };
    let options = VerifyOptions { deep, ..VerifyOptions::default() };
    verify(&reader, source.map(|s| s as &dyn Source), &options, &Silent).unwrap()
}

fn words(report: &VerifyReport) -> String {
    let lines = report.checks.iter().filter(|check| check.problems > 0).map(|check| {
        let first: Vec<_> = check.first.iter().map(ToString::to_string).collect();
        format!("{} ({}): {}", check.name, check.problems, first.join("; "))
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// Builds, and finds nothing.
fn good(source: &Memory, options: &BuildOptions) {
    let built = built(source, options);
    let report = report(&built.path, Some(source), true);
    let info = &source.info;
    assert!(report.is_good(), "{}x{} {options:?}\n{}", info.width, info.height, words(&report));
    assert!(report.checks.iter().all(|check| check.note.is_empty()));
    let deep = report.checks.last().unwrap();
    assert!(deep.name.contains("horizontal") && deep.looked_at > 0);
}

fn sizes(tile: u32, patch: u32, metric: Metric) -> BuildOptions {
    BuildOptions { tile, patch, metric, ..BuildOptions::default() }
}

const SIZES: [(u32, u32); 4] = [(16, 4), (16, 16), (64, 16), (32, 4)];
const METRICS: [Metric; 2] = [Metric::Bound, Metric::Paper];

#[test]
fn adversarial_terrain_of_every_kind() {
    for (i, kind) in Kind::ALL.into_iter().enumerate() {
        let (tile, patch) = SIZES[i % SIZES.len()];
        for metric in METRICS {
            good(&terrain::int16(130, 67, kind, i as u64), &sizes(tile, patch, metric));
        }
    }
}

#[test]
fn every_tile_and_patch_size() {
    for (tile, patch) in SIZES {
        for metric in METRICS {
            for kind in [Kind::RandomVoids, Kind::Islands] {
                good(&terrain::int16(130, 67, kind, 5), &sizes(tile, patch, metric));
            }
        }
    }
}

#[test]
fn rasters_that_are_hardly_any() {
    for (width, height) in [(1, 1), (1, 40), (40, 1), (2, 2), (17, 17), (16, 33), (18, 1)] {
        for (i, kind) in [Kind::Rough, Kind::OneValid, Kind::RandomVoids].into_iter().enumerate() {
            good(&terrain::int16(width, height, kind, i as u64), &sizes(16, 4, METRICS[i % 2]));
        }
    }
}

#[test]
fn long_strips() {
    for (kind, metric) in
        [(Kind::Rough, Metric::Bound), (Kind::RandomVoids, Metric::Paper), (Kind::Stripes, Metric::Bound)]
    {
        good(&terrain::int16(4097, 17, kind, 3), &sizes(16, 16, metric));
    }
    good(&terrain::int16(17, 4097, Kind::Islands, 3), &sizes(64, 16, Metric::Bound));
}

#[test]
fn every_sample_type_up_to_its_ends() {
    for kind in SampleType::ALL {
        for metric in METRICS {
            good(&terrain::extreme(70, 40, kind, 11), &sizes(16, 4, metric));
        }
    }
}

#[test]
fn heights_near_the_end_of_float64() {
    for size in [1e300, 1e150] {
        let mut source = terrain::smooth(70, 40, SampleType::Float64, true);
        let Samples::Float64(samples) = &mut source.samples else { unreachable!() };
        for sample in samples {
            *sample = 1.5e8 * size + *sample * size;
        }
        good(&source, &sizes(16, 4, Metric::Bound));
        source.info.band_scale = 1e-300;
        good(&source, &sizes(16, 4, Metric::Bound));
    }
}

#[test]
fn smooth_floats() {
    for kind in [SampleType::Float32, SampleType::Float64] {
        good(&terrain::smooth(130, 67, kind, true), &sizes(16, 4, Metric::Bound));
        good(&terrain::smooth(130, 67, kind, false), &sizes(32, 16, Metric::Paper));
    }
}

#[test]
fn quantised_heights() {
    for kind in [SampleType::Float32, SampleType::Float64, SampleType::Int32] {
        let precision_m = Some(if kind.is_float() { 0.01 } else { 5.0 });
        for metric in METRICS {
            let options = BuildOptions { precision_m, ..sizes(32, 4, metric) };
            good(&terrain::smooth(130, 67, kind, true), &options);
        }
    }
}

#[test]
fn bands_with_scale_offset_and_unit() {
    let mut source = terrain::int16(100, 70, Kind::RandomVoids, 2);
    (source.info.band_scale, source.info.band_offset) = (-0.1, 37.5);
    source.info.vertical_unit = (0.3048, "ft".into());
    for metric in METRICS {
        good(&source, &sizes(16, 4, metric));
    }
    good(&source, &BuildOptions { precision_m: Some(0.2), ..sizes(16, 4, Metric::Bound) });
}

#[test]
fn another_nodata_value_and_a_mask() {
    let mut source = terrain::int16(60, 60, Kind::Rough, 2);
    let Samples::Int16(samples) = &source.samples else { unreachable!() };
    let nodata = Some(f64::from(samples[777]));
    good(&source, &BuildOptions { nodata, ..sizes(16, 4, Metric::Bound) });
    source.mask = Some((0..3600).map(|i| u8::from(i % 7 != 0 && (i / 60) % 13 != 5)).collect());
    good(&source, &sizes(16, 4, Metric::Bound));
}

#[test]
fn transforms_of_every_kind() {
    let geographic = Crs { kind: CrsKind::Geographic, unit: 1.0_f64.to_radians(), ..Crs::default() };
    let transforms = [
        ([10.0, 0.25, 0.0, 71.0, 0.0, -0.25], geographic.clone()),
        ([-170.0, 1.0, 0.0, 60.0, 0.0, -1.0], geographic.clone()),
        ([3.0, 0.2, 0.15, 60.0, 0.1, -0.3], geographic),
        ([5e5, 3.0, 0.0, 4e6, 0.0, -90.0], Crs { kind: CrsKind::Projected, ..Crs::default() }),
        (
            [5e5, 20.0, 12.0, 4e6, 12.0, -20.0],
            Crs { kind: CrsKind::Projected, unit: 0.3048, ..Crs::default() },
        ),
        ([0.0, 30.0, 25.0, 0.0, 0.0, 10.0], Crs::default()),
    ];
    for (i, (transform, crs)) in transforms.into_iter().enumerate() {
        for kind in [Kind::RandomVoids, Kind::Islands] {
            let mut source = terrain::int16(130, 67, kind, i as u64);
            source.info.geo = Geo { transform: Some(transform), crs: crs.clone(), ..Geo::default() };
            good(&source, &sizes(16, 4, METRICS[i % 2]));
            good(&source, &sizes(32, 16, Metric::Bound));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn random_terrain(
        (width, height) in (1_u32..90, 1_u32..90),
        kind in prop::sample::select(Kind::ALL.to_vec()),
        (tile, patch) in prop::sample::select(SIZES.to_vec()),
        metric in prop::sample::select(METRICS.to_vec()),
        dy in 0.1..10.0_f64,
        seed: u64,
    ) {
        let mut source = terrain::int16(width, height, kind, seed);
        source.info.geo.transform = Some([0.0, 1.0, 0.0, 0.0, 0.0, -dy]);
        // A raster of a few samples may have no valid one: that is refused.
        if is_void(&source) {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.rlv");
            let refusal = build(&source, &path, &sizes(tile, patch, metric), &Silent).unwrap_err();
            prop_assert!(refusal.to_string().contains("at least one valid sample"), "{refusal}");
            prop_assert!(!path.exists());
        } else {
            good(&source, &sizes(tile, patch, metric));
        }
    }
}

/// True if no sample of an int16 terrain is valid.
fn is_void(source: &Memory) -> bool {
    let nodata = source.info.nodata;
    matches!(&source.samples, Samples::Int16(all) if all.iter().all(|&sample| Some(f64::from(sample)) == nodata))
}

/// Tiles as they are stored.
type Stored = (TileEntry, TileChunks);

/// Writes a file again, with all checksums right, after `edit` has been at its tiles; those it
/// turns to `None` are left out.
fn rewritten(built: &Built, mut edit: impl FnMut(&Reader, &mut Stored) -> bool) -> PathBuf {
    let reader = Reader::open(&built.path).unwrap();
    let to = built.folder.path().join("b.rlv");
    let mut writer = ContainerWriter::create(&to, true).unwrap();
    let mut entries = Vec::new();
    reader
        .walk(&mut |entry| {
            entries.push(*entry);
            Ok(())
        })
        .unwrap();
    for entry in entries {
        let chunk = |kind| reader.raw_chunk(entry.id, kind).unwrap();
        let chunks = TileChunks {
            heights: chunk(ChunkKind::Heights),
            mask: chunk(ChunkKind::Mask),
            errors: chunk(ChunkKind::Errors),
        };
        let mut stored = (entry, chunks);
        if edit(&reader, &mut stored) {
            let (e, chunks) = stored;
            let record = TileRecord {
                id: e.id,
                children: e.children,
                has_valid: e.has_valid,
                has_void: e.has_void,
                vertical: e.vertical,
                horizontal: e.horizontal,
                min_m: e.min_m,
                max_m: e.max_m,
            };
            writer.append(&record, &chunks).unwrap();
        }
    }
    let statistics = reader.statistics().unwrap().unwrap();
    writer.finish(reader.header(), reader.metadata(), &statistics).unwrap();
    to
}

/// A file of several levels with voids.
fn usual() -> (Memory, Built) {
    let source = terrain::int16(100, 80, Kind::Islands, 9);
    let file = built(&source, &sizes(16, 4, Metric::Bound));
    (source, file)
}

/// Applies `edit` to the error table of one tile.
fn with_table(built: &Built, id: TileId, edit: impl Fn(&mut ErrorTable)) -> PathBuf {
    rewritten(built, |reader, (entry, chunks)| {
        if entry.id == id {
            let mut errors = reader.read_errors(id).unwrap();
            edit(&mut errors);
            chunks.errors.clear();
            table::encode(&errors, &mut chunks.errors).unwrap();
        }
        true
    })
}

const VERTICAL: &str = "vertical errors";
const HORIZONTAL: &str = "horizontal errors";

/// The codes that a check is about.
fn plane_of<'a>(errors: &'a mut ErrorTable, check: &str) -> &'a mut [u16] {
    if check == VERTICAL { &mut errors.vertical } else { &mut errors.horizontal }
}

fn problems(report: &VerifyReport, check: &str) -> u64 {
    report.check(check).unwrap().problems
}

#[test]
fn a_file_written_again_unchanged_is_good() {
    let (source, file) = usual();
    let path = rewritten(&file, |_, _| true);
    let report = report(&path, Some(&source), true);
    assert!(report.is_good(), "{}", words(&report));
}

#[test]
fn an_error_stored_too_low_is_found_where_it_is() {
    let (_, file) = usual();
    let reader = Reader::open(&file.path).unwrap();
    let last = reader.header().levels;
    for (level, name) in [(0, VERTICAL), (2, VERTICAL), (last, VERTICAL), (1, HORIZONTAL), (last, HORIZONTAL)]
    {
        // The patch whose coarsest step is most its own, not one that a finer step or a child has
        // already.
        let jump = |plane: &[u16], i: usize| (plane[32 + i] - plane[16 + i], i);
        let tiles = reader.tiles(level).unwrap().into_iter();
        let largest = |id| {
            (0..16).map(|i| jump(plane_of(&mut reader.read_errors(id).unwrap(), name), i)).max().unwrap()
        };
        let ((jump, patch), id) = tiles.map(|id| (largest(id), id)).max().unwrap();
        assert!(jump > 60, "{name} at level {level}: {jump}");
        let path = with_table(&file, id, |errors| plane_of(errors, name)[32 + patch] -= jump - 1);
        let report = report(&path, None, true);
        let problem = &report.check(name).unwrap().first[0];
        assert_eq!(problems(&report, name), 1, "{}", words(&report));
        let place = &problem.place;
        assert_eq!((place.tile, place.step), (Some(id), Some(2)));
        assert_eq!(place.patch, Some([patch as u32 % 4, patch as u32 / 4]));
        // Without brute force only the statistics can tell.
        assert!(problems(&report, "statistics") > 0);
    }
}

#[test]
fn errors_below_those_of_a_child_are_found() {
    let (_, file) = usual();
    let path = with_table(&file, TileId::ROOT, |errors| {
        let patches = errors.patches * errors.patches;
        errors.vertical.iter_mut().take(patches).for_each(|code| *code = 0);
    });
    let report = report(&path, None, false);
    assert!(problems(&report, "monotone errors") > 0);
    assert_eq!(report.check("monotone errors").unwrap().first[0].place.tile, Some(TileId::ROOT));
    assert!(problems(&report, "tiles") > 0, "the index row is the largest of step 0");
}

#[test]
fn a_leaf_with_an_error_at_step_0_is_found() {
    let (_, file) = usual();
    let reader = Reader::open(&file.path).unwrap();
    let leaf = reader.leaves().unwrap()[0];
    let path = rewritten(&file, |reader, (entry, chunks)| {
        if entry.id == leaf {
            let mut errors = reader.read_errors(leaf).unwrap();
            let patches = errors.patches * errors.patches;
            errors.horizontal.iter_mut().step_by(patches).for_each(|code| *code += 5);
            entry.horizontal = 5;
            chunks.errors.clear();
            table::encode(&errors, &mut chunks.errors).unwrap();
        }
        true
    });
    assert!(problems(&report(&path, None, false), "monotone errors") > 0);
}

#[test]
fn a_metric_paper_that_is_not_the_papers_is_found() {
    let source = terrain::int16(100, 80, Kind::Islands, 9);
    let file = built(&source, &sizes(16, 4, Metric::Paper));
    let reader = Reader::open(&file.path).unwrap();
    let worst = |id: &TileId| reader.read_errors(*id).unwrap().vertical.into_iter().max();
    let leaf = reader.leaves().unwrap().into_iter().max_by_key(worst).unwrap();
    for higher in [true, false] {
        let path = with_table(&file, leaf, |errors| {
            for i in 32..48 {
                let finer = errors.vertical[i - 16];
                let code = &mut errors.vertical[i];
                if higher {
                    *code += 2;
                } else if *code > finer + 1 {
                    *code -= 2;
                }
            }
        });
        let report = report(&path, None, true);
        assert!(problems(&report, "vertical one-step errors") > 0, "higher: {higher}");
        assert_eq!(problems(&report, "horizontal one-step errors"), 0);
    }
}

/// Changes samples of one tile and encodes it again.
fn with_lattice(built: &Built, id: TileId, edit: impl Fn(&mut Lattice)) -> PathBuf {
    rewritten(built, |reader, (entry, chunks)| {
        if entry.id == id {
            let mut lattice = Lattice::clone(&*reader.read_tile(id).unwrap());
            // A reader cannot tell a fill from nothing: all are kept.
            lattice.state.iter_mut().filter(|state| **state != VALID).for_each(|state| *state = FILLED);
            edit(&mut lattice);
            chunks.heights.clear();
            let coding = reader.header().coding;
            height::encode(
                (&lattice, height::Fills::Any),
                coding,
                id == TileId::ROOT,
                &mut Scratch::default(),
                &mut chunks.heights,
            )
            .unwrap();
        }
        true
    })
}

#[test]
fn a_border_sample_that_differs_is_found() {
    let source = terrain::int16(100, 80, Kind::Rough, 9);
    let file = built(&source, &sizes(16, 4, Metric::Bound));
    let id = TileId::new(3, 2, 1);
    let path = with_lattice(&file, id, |lattice| {
        let at = lattice.at(16, 3);
        lattice.code[at] += 1;
    });
    let quick = report(&path, None, false);
    assert_eq!(problems(&quick, "borders"), 1, "{}", words(&quick));
    assert_eq!(quick.check("borders").unwrap().first[0].place.sample, Some([3 * 16, 16 + 3]));
    let full = report(&path, Some(&source), true);
    assert_eq!(
        problems(&full, "source samples") + problems(&full, "samples across levels"),
        1,
        "{}",
        words(&full)
    );
}

#[test]
fn a_fill_that_differs_is_found() {
    let (_, file) = usual();
    let reader = Reader::open(&file.path).unwrap();
    let (id, at) = reader
        .leaves()
        .unwrap()
        .into_iter()
        .find_map(|id| {
            let lattice = reader.read_tile(id).unwrap();
            let odd = |at: &usize| (at % 17) % 2 == 1 && (at / 17) % 2 == 1;
            let mut inner = (0..17 * 17).filter(odd);
            let at = inner.find(|&at| {
                lattice.state[at] != VALID && [1, 16, 17, 18].iter().any(|d| lattice.state[at - d] == VALID)
            })?;
            Some((id, at))
        })
        .unwrap();
    let path = with_lattice(&file, id, |lattice| lattice.code[at] += 1);
    let report = report(&path, None, true);
    assert_eq!(problems(&report, "samples across levels"), 1, "{}", words(&report));
    assert_eq!(report.check("samples across levels").unwrap().first[0].place.tile, Some(id));
}

#[test]
fn a_tile_that_is_left_out_is_found() {
    let source = terrain::int16(100, 80, Kind::Pinholes, 9);
    let file = built(&source, &sizes(16, 4, Metric::Bound));
    let levels = Reader::open(&file.path).unwrap().header().levels;
    let reader = Reader::open(&file.path).unwrap();
    let gone = reader.tiles(levels).unwrap()[7];
    let path = rewritten(&file, |_, (entry, _)| {
        if Some(entry.id) == gone.parent() {
            entry.children &= !(1 << gone.quadrant());
        }
        entry.id != gone
    });
    let report = report(&path, Some(&source), false);
    for check in ["existence", "tiles", "statistics", "source samples"] {
        assert!(problems(&report, check) > 0, "{check}: {}", words(&report));
    }
    assert_eq!(report.check("existence").unwrap().first[0].place.tile, Some(gone));
}

#[test]
fn a_height_range_that_is_too_narrow_is_found() {
    let (_, file) = usual();
    for id in [TileId::ROOT, TileId::new(1, 0, 0), TileId::new(3, 1, 1)] {
        let path = rewritten(&file, |_, (entry, _)| {
            if entry.id == id {
                entry.max_m = entry.max_m.next_down();
            }
            true
        });
        let report = report(&path, None, true);
        assert!(problems(&report, "tiles") + problems(&report, "samples across levels") > 0, "{id}");
    }
}

#[test]
fn statistics_that_are_wrong_are_found() {
    let (_, file) = usual();
    let reader = Reader::open(&file.path).unwrap();
    let edits: [fn(&mut Statistics); 5] = [
        |s| s.levels[1].tiles += 1,
        |s| s.levels[2].valid -= 1,
        |s| s.levels[0].steps[1].vertical.p50 *= 1.1,
        |s| s.levels[0].min_m = Some(-12345.0),
        |s| s.levels[3].steps[2].horizontal.histogram[0].1 += 1,
    ];
    for edit in edits {
        let mut statistics = reader.statistics().unwrap().unwrap();
        edit(&mut statistics);
        let to = file.folder.path().join("c.rlv");
        let mut writer = ContainerWriter::create(&to, true).unwrap();
        let mut stored = HashMap::new();
        rewritten(&file, |_, (entry, chunks)| {
            stored.insert(entry.id, (*entry, chunks.clone()));
            true
        });
        for (e, chunks) in stored.values() {
            let (has_valid, has_void, min_m, max_m) = (e.has_valid, e.has_void, e.min_m, e.max_m);
            let (vertical, horizontal, children) = (e.vertical, e.horizontal, e.children);
            let record =
                TileRecord { id: e.id, children, has_valid, has_void, vertical, horizontal, min_m, max_m };
            writer.append(&record, chunks).unwrap();
        }
        writer.finish(reader.header(), reader.metadata(), &statistics).unwrap();
        let report = report(&to, None, false);
        assert_eq!(report.problems(), problems(&report, "statistics"));
        assert!(report.problems() > 0);
    }
}

#[test]
fn every_flipped_bit_is_found() {
    let source = terrain::int16(40, 30, Kind::RandomVoids, 1);
    let file = built(&source, &sizes(16, 4, Metric::Bound));
    let whole = std::fs::read(&file.path).unwrap();
    let path = file.folder.path().join("flipped.rlv");
    for at in 0..whole.len() {
        let mut bytes = whole.clone();
        bytes[at] ^= 1 << (at % 8);
        std::fs::write(&path, bytes).unwrap();
        let reader = match Reader::open(&path) {
            Ok(reader) => reader,
            Err(error) => {
                // Another version or feature is no damage: the rest goes into a report.
                let unknown = matches!(error, relevo::Error::Unsupported { .. });
                assert!(unknown || !refused(error).unwrap().is_good());
                continue;
            }
        };
        let report = verify(&reader, None, &VerifyOptions::default(), &Silent).unwrap();
        assert!(!report.is_good(), "bit {} of byte {at} of {}", at % 8, whole.len());
    }
}

#[test]
fn another_source_is_found() {
    let (mut source, file) = usual();
    let Samples::Int16(samples) = &mut source.samples else { unreachable!() };
    let at = samples.iter().rposition(|&sample| sample != terrain::NODATA).unwrap();
    samples[at] += 1;
    let one = report(&file.path, Some(&source), false);
    assert_eq!((problems(&one, "source samples"), one.problems()), (1, 1), "{}", words(&one));
    let place = [(at % 100) as u64, (at / 100) as u64];
    assert_eq!(one.check("source samples").unwrap().first[0].place.sample, Some(place));
    let Samples::Int16(samples) = &mut source.samples else { unreachable!() };
    samples[at] = terrain::NODATA;
    assert_eq!(problems(&report(&file.path, Some(&source), false), "source samples"), 1);

    source.info.geo.transform = Some([0.0, 2.0, 0.0, 0.0, 0.0, 1.0]);
    assert_eq!(problems(&report(&file.path, Some(&source), false), "source header"), 1);
    let smaller = terrain::int16(99, 80, Kind::Islands, 9);
    let report = report(&file.path, Some(&smaller), false);
    assert!(
        problems(&report, "source header") > 0 && !report.check("source samples").unwrap().note.is_empty()
    );
}

#[test]
fn too_large_for_a_deep_look_is_an_error_and_a_stop_is_heard() {
    let (_, file) = usual();
    let reader = Reader::open(&file.path).unwrap();
    let options = VerifyOptions { deep: true, max_deep_samples: 7999, ..VerifyOptions::default() };
    let error = verify(&reader, None, &options, &Silent).unwrap_err();
    assert!(matches!(error, relevo::Error::Limit { got: 8000, max: 7999, .. }), "{error}");
    let stopped = verify(&reader, None, &options, &While::new(|_, _| false)).unwrap_err();
    assert!(matches!(stopped, relevo::Error::Interrupted));
}

#[test]
fn a_quantised_file_that_strays_is_found() {
    let source = terrain::smooth(60, 60, SampleType::Float32, true);
    let file = built(&source, &BuildOptions { precision_m: Some(0.01), ..sizes(16, 4, Metric::Bound) });
    let mut other = terrain::smooth(60, 60, SampleType::Float32, true);
    let Samples::Float32(samples) = &mut other.samples else { unreachable!() };
    samples[1234] += 0.02;
    let report = report(&file.path, Some(&other), false);
    assert_eq!(problems(&report, "source samples"), 1);
}

#[test]
fn the_command_line_says_what_is_wrong() {
    let (_, file) = usual();
    let run = |arguments: &[&std::ffi::OsStr]| {
        assert_cmd::Command::cargo_bin("relevo").unwrap().arg("verify").args(arguments).output().unwrap()
    };
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    let good = run(&[file.path.as_ref(), "--deep".as_ref()]);
    assert_eq!(good.status.code(), Some(0), "{}", text(&good.stderr));
    assert!(
        text(&good.stdout).contains("a.rlv: good")
            && text(&good.stdout).contains("Stored error / true error")
    );

    let mut bytes = std::fs::read(&file.path).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    let damaged = file.folder.path().join("damaged.rlv");
    std::fs::write(&damaged, &bytes).unwrap();
    let bad = run(&[damaged.as_ref(), "--json".as_ref()]);
    assert_eq!(bad.status.code(), Some(1));
    let json: serde_json::Value = serde_json::from_slice(&bad.stdout).unwrap();
    assert_eq!(json["good"], false);
    let chunks = json["checks"].as_array().unwrap().iter().find(|check| check["name"] == "chunks").unwrap();
    assert!(chunks["first"][0]["place"]["tile_id"].as_str().unwrap().starts_with("3/"));

    bytes.truncate(300);
    std::fs::write(&damaged, &bytes).unwrap();
    let bad = run(&[damaged.as_ref()]);
    assert_eq!(bad.status.code(), Some(1));
    assert!(text(&bad.stdout).contains("truncated"), "{}", text(&bad.stdout));
    let absent = run(&["no-such-file.rlv".as_ref()]);
    assert_eq!((absent.status.code(), absent.stdout.len()), (Some(2), 0));
    assert_eq!(
        run(&[file.path.as_ref(), "--source".as_ref(), "no-such.tif".as_ref()]).status.code(),
        Some(2)
    );
}
