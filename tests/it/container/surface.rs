//! Heights against a plain evaluation of section 2.

use relevo::TileId;
use relevo::container::Reader;
use relevo::sample::{Coding, VALID, VOID};
use relevo::surface::{height_at, height_at_sample, height_in_tile};

use super::raster::{INTEGER, Random, Raster};

/// The surface at a point, from the samples alone: validity, height, and whether all its triangle
/// has heights.
fn brute(raster: &Raster, column: f64, row: f64) -> (f64, f64, bool) {
    let last = f64::from(raster.header.tile() << raster.header.levels);
    let (i, j) = (column.floor().min(last - 1.0), row.floor().min(last - 1.0));
    let falling = (i + j) % 2.0 == 0.0;
    let (nw, ne, sw, se) = ((i, j), (i + 1.0, j), (i, j + 1.0), (i + 1.0, j + 1.0));
    let (x, y) = (column - i, row - j);
    let triangle = match (falling, x >= y, x + y <= 1.0) {
        (true, true, _) => [nw, ne, se],
        (true, false, _) => [nw, sw, se],
        (false, _, true) => [nw, ne, sw],
        (false, _, false) => [ne, sw, se],
    };
    // Plane through three points by Cramer's rule.
    let [a, b, c] = triangle;
    let area = (b.0 - a.0) * (c.1 - a.1) - (c.0 - a.0) * (b.1 - a.1);
    let wb = ((column - a.0) * (c.1 - a.1) - (c.0 - a.0) * (row - a.1)) / area;
    let wc = ((b.0 - a.0) * (row - a.1) - (column - a.0) * (b.1 - a.1)) / area;
    let (mut validity, mut height, mut whole) = (0.0, 0.0, true);
    for (weight, (x, y)) in [(1.0 - wb - wc, a), (wb, b), (wc, c)] {
        let (code, low, state) = raster.sample(x as u64, y as u64);
        whole &= state != VOID;
        validity += if state == VALID { weight } else { 0.0 };
        height += weight * raster.header.metres_of(code, low);
    }
    (validity, height, whole)
}

#[test]
fn heights_are_those_of_the_two_triangles() {
    let folder = tempfile::tempdir().unwrap();
    for (number, coding) in [INTEGER, Coding::Float32, Coding::Float64].into_iter().enumerate() {
        let raster = Raster::bumpy(50, 43, coding, 20 + number as u64);
        let path = folder.path().join(format!("{number}.rlv"));
        raster.write(&path);
        let reader = Reader::open(&path).unwrap();
        let side = f64::from(raster.header.tile() << raster.header.levels);
        let mut random = Random(77);
        let (mut shown, mut hidden) = (0, 0);
        for point in 0..20_000 {
            let quantum = [1.0, 16.0, 2.0, 1e-9, 1e-9, 1e-9][point % 6];
            let (column, row) = (random.unit() * side, random.unit() * side);
            let (column, row) =
                ((column / quantum).round() * quantum, if point % 2 == 0 { row } else { row.round() });
            let (validity, height, whole) = brute(&raster, column, row);
            if (validity - 0.5).abs() < 1e-9 {
                continue;
            }
            let got = height_at_sample(&reader, column, row).unwrap();
            assert_eq!(got.is_some(), validity >= 0.5, "at {column}, {row}: {got:?}, validity {validity}");
            let (x, y) = reader.geo().world_from_sample(column, row);
            if let Some(got) = got {
                assert!(whole, "a triangle that is shown has heights at its corners");
                assert!((got - height).abs() < 1e-6, "at {column}, {row}: {got}, not {height}");
                if let Some(world) = height_at(&reader, x, y).unwrap() {
                    assert!((world - height).abs() < 1e-3);
                }
                shown += 1;
            } else {
                hidden += 1;
            }
        }
        assert!(shown > 1000 && hidden > 1000);
        for (column, row) in [(-0.001, 3.0), (3.0, side + 0.001), (f64::NAN, 1.0), (f64::INFINITY, 0.0)] {
            assert_eq!(height_at_sample(&reader, column, row).unwrap(), None);
        }
    }
}

#[test]
fn tiles_agree_on_their_borders_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rlv");
    let raster = Raster::bumpy(80, 80, Coding::Float32, 30);
    raster.write(&path);
    let reader = Reader::open(&path).unwrap();
    let header = reader.header();
    let mut random = Random(78);
    let mut compared = 0;
    for id in reader.tiles(header.levels).unwrap() {
        for (dx, dy) in [(1, 0), (0, 1), (1, 1)] {
            let other = TileId::new(id.level, id.x + dx, id.y + dy);
            if reader.entry(other).unwrap().is_none() {
                continue;
            }
            let (one, two) = (reader.read_tile(id).unwrap(), reader.read_tile(other).unwrap());
            let (left, top) = header.origin(other);
            for turn in 0..200 {
                // Far from and very near to samples.
                let along = random.below(16) as f64 + random.unit().powi(1 + 40 * (turn % 2));
                let column = left as f64 + if dx == 0 { along } else { 0.0 };
                let row = top as f64 + if dy == 0 { along } else { 0.0 };
                let heights = [(id, &one), (other, &two)]
                    .map(|(id, lattice)| height_in_tile(header, id, lattice, column, row).map(f64::to_bits));
                assert_eq!(heights[0], heights[1], "at {column}, {row}");
                assert_eq!(heights[0], height_at_sample(&reader, column, row).unwrap().map(f64::to_bits));
                compared += usize::from(heights[0].is_some());
            }
        }
    }
    assert!(compared > 1000);
}
