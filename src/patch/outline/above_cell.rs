//! A look into one block of a tile above the leaves: its misdrawn points, and what is near it.

use super::leaf_cell::{around, farthest_corner};
use super::marks::{HalfPoint, Marks};
use super::search::{Bound, Ceilings, Cells, Corners};
use super::shape::{Farthest, Fault, Polygon, Somewhere, Somewheres, triangles};
use crate::simd;

/// Halvings of a triangle of a block: what the block hides is larger.
const ABOVE_HALVINGS: u32 = 2;

/// True if a mark of a tile above the leaves stands for a block, not for a sample.
fn is_block([x, y]: HalfPoint) -> bool {
    x % 2 == 1 && y % 2 == 1
}

/// Blocks of a tile above the leaves.
pub(super) struct AboveCells<'a> {
    /// 1 for each sample that is valid.
    pub(super) samples: &'a [u8],
    pub(super) n: usize,
    /// The next finer spacing.
    pub(super) finer: usize,
    /// What is known to hold something void: a valid point is no farther from the outline.
    pub(super) void: &'a Marks,
    /// What is known to hold something valid.
    pub(super) valid: &'a Marks,
    pub(super) half: (f64, f64),
    pub(super) places: &'a mut Somewheres,
}

impl AboveCells<'_> {
    /// Validity at sample `(x, y)`, drawn at the next finer spacing.
    fn drawn_finer(&self, (x, y): (usize, usize)) -> f64 {
        let s = self.finer;
        let (i, j) = ((x / s).min(self.n / s - 1), (y / s).min(self.n / s - 1));
        let at = |i: usize, j: usize| f64::from(self.samples[j * s * (self.n + 1) + i * s]);
        let (nw, ne, sw, se) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
        let (u, v) = ((x - i * s) as f64 / s as f64, (y - j * s) as f64 / s as f64);
        match ((i + j) % 2 == 0, u > v, u + v < 1.0) {
            (true, true, _) => nw + u * (ne - nw) + v * (se - ne),
            (true, false, _) => nw + u * (se - sw) + v * (sw - nw),
            (false, _, true) => nw + u * (ne - nw) + v * (sw - nw),
            (false, _, false) => se + (1.0 - u) * (sw - se) + (1.0 - v) * (ne - se),
        }
    }

    /// Collects what is near a block, of the kind that its misdrawn points are not.
    fn collect(&mut self, (x, y): (usize, usize), fault: Fault) {
        self.places.clear();
        let marks = if fault == Fault::Shown { self.valid } else { self.void };
        let half = self.half;
        around(marks, half, (x, y), |[fx, fy]| {
            let away = |mark: i16, cell: usize, half: f64| (f64::from(mark) - 2.0 * cell as f64) * half;
            self.places.push(Somewhere {
                centre: (away(fx, x, half.0), away(fy, y, half.1)),
                half: if is_block([fx, fy]) { half } else { (0.0, 0.0) },
            });
        });
    }
}

impl Cells for AboveCells<'_> {
    fn reach(&mut self, level: usize, at: (usize, usize), _: u8) -> [f64; 2] {
        let centre = [(2 * at.0 + 1) << level, (2 * at.1 + 1) << level];
        let reach = |mark: HalfPoint| farthest_corner(mark, level, at, self.half, i32::from(is_block(mark)));
        [self.valid, self.void].map(|marks| marks.nearest(centre, self.half).map_or(0.0, reach))
    }

    fn look(
        &mut self,
        (x, y): (usize, usize),
        drawn: Corners,
        faults: [bool; 2],
        _: &mut Ceilings,
        bound: &mut Bound,
    ) {
        let size = (2.0 * self.half.0, 2.0 * self.half.1);
        let at = |sample| self.drawn_finer(sample);
        let finer = [at((x, y)), at((x + 1, y)), at((x, y + 1)), at((x + 1, y + 1))];
        for fault in [Fault::Shown, Fault::Hidden] {
            if !faults[fault as usize] {
                continue;
            }
            let [first, second] = triangles((x + y) % 2 == 0);
            let misdrawn = |triangle| Polygon::misdrawn(triangle, size, finer, drawn, fault);
            let parts = [misdrawn(first), misdrawn(second)];
            if parts.iter().any(Option::is_some) {
                self.collect((x, y), fault);
                let things = &mut *self.places;
                simd::run(Farthest { polygons: &parts, things, halvings: ABOVE_HALVINGS, bound });
            }
        }
    }
}
