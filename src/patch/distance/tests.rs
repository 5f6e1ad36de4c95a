//! The transform against all features, one by one.

use super::*;
use proptest::prelude::*;

fn squared([ax, ay]: HalfPoint, [bx, by]: HalfPoint, spacing: Spacing) -> f64 {
    let (x, y) = (f64::from(ax - bx) * spacing.dx, f64::from(ay - by) * spacing.dy);
    x * x + y * y
}

/// A transform of `n` intervals with these features, not yet solved.
fn marked(n: usize, features: &[HalfPoint]) -> Nearest {
    let mut nearest = Nearest::default();
    nearest.start(n);
    (0..=2 * n).for_each(|row| nearest.row_mut(row).fill(0));
    for &[x, y] in features {
        nearest.row_mut(y as usize)[x as usize] = 1;
    }
    nearest
}

/// The nearest feature of every cell by the envelope of all half columns with a feature, one by one.
fn by_all_columns(n: usize, features: &[HalfPoint], spacing: Spacing) -> Vec<HalfPoint> {
    let ratio = (spacing.dy / spacing.dx) * (spacing.dy / spacing.dx);
    let mut cells = Vec::new();
    for here in (0..n as i16).map(|row| 2 * row + 1) {
        // The nearest of each half column; the northern one if there are two.
        let nearest: Vec<Option<i16>> = (0..=2 * n as i16)
            .map(|x| {
                let ys = features.iter().filter(|f| f[0] == x).map(|f| f[1]);
                ys.min_by_key(|y| ((y - here).abs(), *y))
            })
            .collect();
        let (mut envelope, mut count) = (vec![Parabola::default(); 2 * n + 1], 0);
        for (x, y) in nearest.iter().enumerate().filter_map(|(x, y)| Some((x, (*y)?))) {
            let rows = f64::from(y - here);
            count = push(&mut envelope, count, x as i32, rows * rows * ratio);
        }
        envelope.truncate(count);
        for centre in (0..n).map(|cell| (2 * cell + 1) as f64) {
            let last = envelope.iter().enumerate().take_while(|(i, p)| *i == 0 || p.from <= centre).last();
            let x = last.unwrap().1.x;
            cells.push([x as i16, nearest[x as usize].unwrap()]);
        }
    }
    cells
}

proptest! {
    #[test]
    fn finds_the_nearest(
        log_n in 0_u32..6,
        features in prop::collection::vec((0_u16..1000, 0_u16..1000), 0..40),
        dy in 0.1_f64..10.0,
    ) {
        let n = 1_usize << log_n;
        let spacing = Spacing { dx: 1.0, dy };
        let side = 2 * n as u16 + 1;
        let features: Vec<HalfPoint> =
            features.into_iter().map(|(x, y)| [(x % side) as i16, (y % side) as i16]).collect();
        let mut nearest = marked(n, &features);
        prop_assert_eq!(nearest.solve(spacing), !features.is_empty());
        prop_assert_eq!(nearest.at(0, 0).is_some(), !features.is_empty());
        for i in (0..n * n).filter(|_| !features.is_empty()) {
            let found = nearest.at(i % n, i / n).unwrap();
            prop_assert!(features.contains(&found));
            let centre = [2 * (i % n) as i16 + 1, 2 * (i / n) as i16 + 1];
            let best = features.iter().map(|&f| squared(f, centre, spacing)).fold(f64::INFINITY, f64::min);
            prop_assert!(squared(found, centre, spacing) <= best * (1.0 + 1e-9));
        }
    }

    /// Ties too: the errors in a file do not depend on how many half columns are ruled out beforehand.
    #[test]
    fn half_columns_ruled_out_make_no_difference(
        log_n in 2_u32..6,
        features in prop::collection::vec((0_u16..1000, 0_u16..1000), 1..400),
        clusters in 1_u16..65,
        dy in prop::sample::select(vec![0.001, 0.1, 0.5, 0.73, 1.0, 1.37, 2.0, 30.0, 2000.0]),
    ) {
        let n = 1_usize << log_n;
        let spacing = Spacing { dx: 1.0, dy };
        let side = 2 * n as u16 + 1;
        let rows = (side / clusters).max(1);
        let features: Vec<HalfPoint> =
            features.into_iter().map(|(x, y)| [(x % side) as i16, (y % rows) as i16]).collect();
        let mut nearest = marked(n, &features);
        nearest.solve(spacing);
        let found: Vec<_> = (0..n * n).map(|i| nearest.at(i % n, i / n).unwrap()).collect();
        prop_assert_eq!(found, by_all_columns(n, &features, spacing));
    }
}
