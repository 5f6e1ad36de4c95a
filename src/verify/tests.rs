//! Compares the brute force with surfaces evaluated point by point.

use proptest::prelude::*;

use super::full::Full;
use super::ground::Ground;
use super::outline::Outline;
use super::shape::Occupancy;
use super::vertical::Surfaces;
use crate::sample::{VALID, VOID};

/// Validity and height of the surface drawn at spacing `s`, directly by section 2 of the
/// specification.
fn surface(full: &Full, s: u64, x: f64, y: f64) -> (f64, f64) {
    let last = full.side / s - 1;
    let (i, j) = (((x / s as f64) as u64).min(last), ((y / s as f64) as u64).min(last));
    let (u, v) = (x / s as f64 - i as f64, y / s as f64 - j as f64);
    let corner = |di: u64, dj: u64| {
        let (code, _, state) = full.sample((i + di) * s, (j + dj) * s);
        (f64::from(u8::from(state == VALID)), if state == VOID { 0.0 } else { f64::from(code) })
    };
    let (a, b, c, d) = (corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1));
    // From one corner along the two legs of its triangle.
    let (from, across, down, u, v) = if (i + j) % 2 == 0 {
        if u >= v { (b, a, d, 1.0 - u, v) } else { (c, d, a, u, 1.0 - v) }
    } else if u + v <= 1.0 {
        (a, b, c, u, v)
    } else {
        (d, c, b, 1.0 - u, 1.0 - v)
    };
    let at = |from: f64, across: f64, down: f64| from + u * (across - from) + v * (down - from);
    (at(from.0, across.0, down.0), at(from.1, across.1, down.1))
}

/// Points of a cell in quarters of an interval, borders included.
fn points(q: u32, column: u64, row: u64) -> impl Iterator<Item = (f64, f64)> {
    let s = 1_u64 << q;
    let along = move |cell: u64, i: u64| (cell * s) as f64 + i as f64 / 4.0;
    (0..=4 * s).flat_map(move |j| (0..=4 * s).map(move |i| (along(column, i), along(row, j))))
}

/// Lattices within root squares of `2^log` intervals.
fn lattices(logs: std::ops::RangeInclusive<u32>) -> impl Strategy<Value = Full> {
    logs.prop_flat_map(|log| {
        let side = 1_u64 << log;
        let size = (side / 2) as usize..=side as usize + 1;
        (size.clone(), size, 0.0..1.0_f64).prop_flat_map(move |(columns, rows, valid)| {
            let sample = prop::option::weighted(valid, -1000..1000_i32);
            prop::collection::vec(sample, columns * rows)
                .prop_map(move |codes| Full::of_codes(&codes, columns, side))
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn deviations_are_those_of_the_worst_point(full in lattices(3..=5)) {
        let occupancy = Occupancy::of(&full);
        let surfaces = Surfaces::new(&full, &occupancy);
        for q in 1..=full.side.trailing_zeros() {
            let found = surfaces.deviations(q, q);
            for (i, &deviation) in found.values.iter().enumerate() {
                let (column, row) = ((i % found.columns) as u64, (i / found.columns) as u64);
                let mut worst = 0.0_f64;
                for (x, y) in points(q, column, row) {
                    let (fine, drawn) = (surface(&full, 1, x, y), surface(&full, 1 << q, x, y));
                    if fine.0 >= 0.5 && drawn.0 >= 0.5 {
                        worst = worst.max((fine.1 - drawn.1).abs());
                    }
                }
                prop_assert!((deviation - worst).abs() < 1e-6, "{q} {column},{row}: {deviation} {worst}");
            }
        }
    }

    #[test]
    fn displacements_are_those_of_the_worst_point(full in lattices(3..=5), dy in 0.3..3.0_f64) {
        displacements(&full, Ground::plane(1.0, dy))?;
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn displacements_where_metres_depend_on_the_place(full in lattices(3..=4), dy in 0.3..3.0_f64, sheared: bool) {
        // Steep latitudes, and a sheared raster.
        let transform = if sheared { [3.0, 0.2, 0.15, 60.0, 0.1, -dy] } else { [0.0, 1.0, 0.0, 80.0, 0.0, -dy] };
        displacements(&full, Ground::degrees(transform))?;
    }
}

fn displacements(full: &Full, ground: Ground) -> Result<(), TestCaseError> {
    let occupancy = Occupancy::of(full);
    let outline = Outline::new(ground.clone(), full, &occupancy);
    let segments: Vec<_> =
        (0..full.side.pow(2)).flat_map(|i| outline.segments([i % full.side, i / full.side])).collect();
    for q in 1..=full.side.trailing_zeros() {
        let found = outline.displacements(q, q);
        for (i, &displacement) in found.values.iter().enumerate() {
            let (column, row) = ((i % found.columns) as u64, (i / found.columns) as u64);
            let mut worst = 0.0_f64;
            for (x, y) in points(q, column, row) {
                let shown = [surface(full, 1, x, y).0, surface(full, 1 << q, x, y).0];
                if (shown[0] > 0.5 && shown[1] < 0.5) || (shown[0] < 0.5 && shown[1] > 0.5) {
                    let nearest = segments.iter().fold(f64::INFINITY, |best, segment| {
                        ground.to_segment([x, y], *segment, best).unwrap_or(best)
                    });
                    worst = worst.max(nearest);
                }
            }
            // The search also examines the edges of misdrawn areas.
            let [dx, dy] = ground.longest_intervals(&[[0.0, 0.0], [full.side as f64; 2]]);
            let step = 0.2501 * if ground.is_sheared() { dx + dy } else { dx.hypot(dy) };
            prop_assert!(displacement >= worst * (1.0 - 1e-9), "{q} {column},{row}: {displacement} {worst}");
            prop_assert!(displacement <= worst + step, "{q} {column},{row}: {displacement} {worst}");
        }
    }
    Ok(())
}
