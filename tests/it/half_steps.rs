//! The tables of loaded tiles cover every mesh that is drawn: by brute force, over every triangle
//! of every edge mask.

use crate::support::terrain::{self, Kind, Memory};
use crate::support::truth::{Built, Drawn, Truth, fixture, nearest, open};
use rayon::prelude::*;
use relevo::codec::table::ErrorTable;
use relevo::geo::{Crs, CrsKind, Geo};
use relevo::pipeline::BuildOptions;
use relevo::sample::SampleType;
use relevo::select::pattern::Meshes;
use relevo::select::{EdgeRule, Frame, Node, TileData};
use relevo::source::Samples;
use relevo::{Error, TileId, error_code};

/// Largest deviations of one mesh from the truth: metres up and metres of the frame across.
struct Deviation {
    vertical: f64,
    horizontal: f64,
}

/// Distances of points on quarters to the outline of full resolution.
struct Distances {
    width: u64,
    metres: Vec<f64>,
}

impl Distances {
    fn new(truth: &Truth, frame: &Frame) -> Self {
        let (outline, width) = (truth.outline(), 4 * truth.width);
        let metres = (0..width * 4 * truth.height)
            .into_par_iter()
            .map(|i| nearest(&outline, frame, [(i % width) as f64 / 4.0, (i / width) as f64 / 4.0]).0)
            .collect();
        Self { width, metres }
    }
}

fn measure(drawn: &Drawn, truth: &Truth, distances: Option<&Distances>, worst: &mut Deviation) {
    for (point, weights) in drawn.points(if distances.is_some() { 1 } else { 4 }) {
        let ((true_validity, true_z), (validity, z)) = (truth.at(point), drawn.at(weights));
        if true_validity >= 0.5 && validity >= 0.5 {
            // Sums of another order differ where heights of 1e38 cancel out.
            let rounding = 1e-15 * drawn.z.iter().fold(true_z.abs(), |most, z| most.max(z.abs()));
            worst.vertical = worst.vertical.max((true_z - z).abs() - rounding);
        }
        if let Some(distances) = distances
            && (true_validity >= 0.5 && validity <= 0.5 || true_validity <= 0.5 && validity >= 0.5)
            && point.0 < distances.width
            && let Some(metres) = distances.metres.get((point.1 * distances.width + point.0) as usize)
        {
            worst.horizontal = worst.horizontal.max(*metres);
        }
    }
}

/// Every mesh of every patch of every tile.
fn covers(built: &Built, masks: &[u8]) {
    let (header, frame) = (built.reader.header(), Frame::of(&built.reader));
    let truth = Truth::of(&built.reader);
    let distances = truth.has_voids().then(|| Distances::new(&truth, &frame));
    let p = header.patch_log2;
    let meshes = Meshes::new(p);
    built.tiles().into_par_iter().for_each(|id| {
        let data = built.data(id);
        assert!(data.heights.iter().all(|z| z.is_finite()));
        row_covers(built, &data, &frame);
        let (m, origin, spacing) = (header.patches(), header.origin(id), u64::from(header.spacing(id.level)));
        for (patch, k) in (0..m * m).flat_map(|patch| (0..=p).map(move |k| (patch, k))) {
            let (px, py) = (patch % m, patch / m);
            let odd = (id.x * m + px + id.y * m + py) % 2 == 1;
            let at = (u32::from(k) * m * m + patch) as usize;
            if !data.table.drawable[patch as usize] {
                continue;
            }
            for &mask in if k == 0 { &[0][..] } else { masks } {
                let outer: [u8; 4] = std::array::from_fn(|i| k - (mask >> i & 1));
                let mut worst = Deviation { vertical: 0.0, horizontal: 0.0 };
                for piece in Meshes::pieces(p, k, outer, odd, EdgeRule::Shared) {
                    for triangle in meshes.triangles(piece) {
                        let first = (px << p, py << p);
                        let drawn = Drawn::new(&data, origin, spacing, first, triangle);
                        measure(&drawn, &truth, distances.as_ref(), &mut worst);
                    }
                }
                let promised =
                    [data.table.vertical[at], data.table.horizontal[at]].map(|e| f64::from(e) * (1.0 + 1e-9));
                let place = || format!("tile {id}, patch {px} {py}, step {k}, edges {outer:?}");
                assert!(worst.vertical <= promised[0], "{}: {} m, {promised:?}", place(), worst.vertical);
                assert!(
                    worst.horizontal <= promised[1],
                    "{}: {} m across, {promised:?}",
                    place(),
                    worst.horizontal
                );
            }
        }
        boxes(&data, &truth, origin, spacing);
    });
}

/// A tile that the index lets pass has no patch at full resolution that the table does not.
fn row_covers(built: &Built, data: &TileData, frame: &Frame) {
    let reader = &built.reader;
    let entry = reader.entry(data.table.id).expect("entry").expect("tile");
    let row = Node::new(reader.header(), reader.geo(), frame, &entry);
    let first = 0..data.table.drawable.len();
    for at in first.filter(|&at| data.table.drawable[at]) {
        let (vertical, horizontal) = (data.table.vertical[at], data.table.horizontal[at]);
        let place = || format!("tile {}, patch {at}", entry.id);
        assert!(
            vertical <= row.vertical && horizontal <= row.horizontal,
            "{}: {vertical} {horizontal} {row:?}",
            place()
        );
    }
}

/// The range of each patch holds the truth, as far as it is shown.
fn boxes(data: &TileData, truth: &Truth, (left, top): (u64, u64), spacing: u64) {
    let m = data.table.patches;
    let side = u64::from(data.n / m) * spacing;
    for patch in 0..m * m {
        let (x, y) = (left + u64::from(patch % m) * side, top + u64::from(patch / m) * side);
        let (low, high) = (data.table.low[patch as usize], data.table.high[patch as usize]);
        for (column, row) in (y..=y + side).flat_map(|row| (x..=x + side).map(move |column| (column, row))) {
            let (z, valid) = truth.sample(column, row);
            // What exceeds an f32 is drawn at its end, with an infinite error.
            let z = z.clamp(f32::MIN.into(), f32::MAX.into());
            assert!(!valid || f64::from(low) <= z && z <= f64::from(high), "{z} is not in {low}..{high}");
        }
    }
}

const ALL: [u8; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

#[test]
fn tables_cover_every_mesh_of_difficult_terrain() {
    for (i, kind) in Kind::ALL.into_iter().enumerate() {
        let (tile, patch) = [(16, 4), (16, 16), (32, 8)][i % 3];
        covers(&Built::new(&terrain::int16(50, 37, kind, i as u64), tile, patch), &ALL);
    }
}

#[test]
fn tables_cover_every_mesh_around_holes() {
    for seed in 0..2 {
        for kind in [Kind::Islands, Kind::RandomVoids, Kind::Pinholes, Kind::Rough] {
            covers(&Built::new(&terrain::int16(66, 41, kind, seed), 16, 8), &ALL);
        }
    }
}

#[test]
fn tables_cover_what_heights_lose_on_their_way() {
    // Heights that no f32 holds, from three codings; and quantised ones.
    let mut float64 = terrain::smooth(70, 40, SampleType::Float64, true);
    covers(&Built::new(&float64, 16, 4), &ALL);
    float64.info.band_offset = 1e6;
    float64.info.vertical_unit.0 = 0.3048;
    covers(&Built::new(&float64, 16, 4), &ALL);
    let mut int32 = terrain::smooth(70, 40, SampleType::Int32, true);
    int32.info.band_scale = -0.01;
    covers(&Built::new(&int32, 32, 8), &ALL);
    let precise = BuildOptions { tile: 16, patch: 4, precision_m: Some(0.5), ..BuildOptions::default() };
    covers(&Built::with(&terrain::smooth(70, 40, SampleType::Float32, true), &precise), &ALL);
    for kind in [SampleType::Float64, SampleType::Float32, SampleType::Uint32] {
        covers(&Built::new(&terrain::extreme(40, 30, kind, 3), 16, 4), &[5, 15]);
    }
}

/// A peak that is hidden at every uniform step of a coarse tile and not by a half-step triangle: no
/// error of the file knows of it.
#[test]
fn a_peak_that_only_half_a_step_shows_is_covered() {
    let mut source = terrain::int16(65, 65, Kind::Framed, 0);
    // Ground beside the voids around it, so that their fills are low.
    let ground = [(0, 0), (3, 0), (7, 0), (3, 3), (7, 3)];
    let peak = |x: u32, y: u32| {
        let void = (x < 8 && y < 4 && !ground.contains(&(x, y))) || [(8, 0), (8, 8)].contains(&(x, y));
        if (x, y) == (5, 1) {
            1000
        } else if void {
            terrain::NODATA
        } else {
            0
        }
    };
    source.samples = Samples::Int16((0..65 * 65).map(|i| peak(i % 65, i / 65)).collect());
    let built = Built::new(&source, 16, 8);
    let errors = built.reader.read_errors(TileId::ROOT).expect("errors");
    assert!(error_code::metres_from_code(errors.vertical[errors.at(1, 0, 0)]) < 100.0);
    assert!(built.data(TileId::ROOT).table.vertical[errors.at(1, 0, 0)] > 900.0);
    covers(&built, &ALL);
}

/// Degrees, far north and over the equator: spacings are not those of the frame.
fn geographic(mut source: Memory, top: f64, degrees: f64) -> Memory {
    let crs = Crs { kind: CrsKind::Geographic, unit: 1.0_f64.to_radians(), ..Crs::default() };
    source.info.geo = Geo { transform: Some([7.0, degrees, 0.0, top, 0.0, -degrees]), crs, ..Geo::default() };
    source
}

#[test]
fn tables_are_in_metres_of_the_frame() {
    for (top, degrees) in [(80.0, 0.2), (4.0, 0.2), (60.0, 0.001)] {
        for kind in [Kind::Islands, Kind::RandomVoids] {
            covers(
                &Built::new(&geographic(terrain::int16(50, 37, kind, 8), top, degrees), 16, 4),
                &[0, 6, 15],
            );
        }
    }
}

#[test]
fn tables_cover_every_mesh_of_real_terrain() {
    let rmnp = open(&fixture("rmnp_dem_uint16.tif"));
    for (tile, patch) in [(16, 4), (64, 16), (64, 64)] {
        covers(&Built::new(&*rmnp, tile, patch), &ALL);
    }
    let colorado = open(&fixture("co_elevation_float32_lzw.tif"));
    covers(&Built::new(&*colorado, 128, 32), &[1, 6, 15]);
}

#[test]
fn planes_of_another_size_are_refused() {
    let built = Built::new(&terrain::int16(50, 37, Kind::Islands, 1), 16, 4);
    let (reader, frame, id) = (&built.reader, Frame::of(&built.reader), TileId::ROOT);
    let entry = reader.entry(id).expect("entry").expect("root");
    let (lattice, table) = (reader.read_tile(id).expect("tile"), reader.read_errors(id).expect("errors"));
    let new =
        |lattice: &_, table: &_| TileData::new(reader.header(), reader.geo(), &frame, &entry, lattice, table);
    assert!(new(&lattice, &table).is_ok());
    let refused = |lattice: &_, table: &_| assert!(matches!(new(lattice, table), Err(Error::Format { .. })));
    let mut short = (*lattice).clone();
    short.code.pop();
    refused(&short, &table);
    let mut stateless = (*lattice).clone();
    stateless.state.clear();
    refused(&stateless, &table);
    let mut large = (*lattice).clone();
    large.n = 32;
    refused(&large, &table);
    let changes: [fn(&mut ErrorTable); 5] = [
        |table| table.steps += 1,
        |table| table.patches = 2,
        |table| table.vertical.push(0),
        |table| table.horizontal.clear(),
        |table| table.drawable.truncate(3),
    ];
    for change in changes {
        let mut other = table.clone();
        change(&mut other);
        refused(&lattice, &other);
    }
}
