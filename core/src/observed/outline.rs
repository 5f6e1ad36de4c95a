//! The nearest points of the outline at full resolution: where validity, linear in the triangles of
//! the leaves, is 1/2.
//!
//! The search goes through rings of cells around a vertex, inside out.

use std::collections::HashMap;
use std::sync::Arc;

use crate::container::Reader;
use crate::error::Result;
use crate::sample::{Lattice, VALID};
use crate::select::view::Frame;
use crate::surface;

/// Most leaves that are cached.
const KEPT: usize = 64;
/// Largest ratio of two distances that count as equal.
const TIE: f64 = 1.0 + 1e-9;

/// A leaf, by the column and row of its square among those of the finest level.
type Square = (u64, u64);

/// A search for the outline of a file.
pub(super) struct Outline<'a> {
    reader: &'a Reader,
    frame: &'a Frame,
    /// Samples on a side of the root square, less 1.
    side: i64,
    squares: HashMap<Square, Option<Arc<Found>>>,
    last: Option<(Square, Option<Arc<Found>>)>,
}

/// A leaf and its place.
struct Found {
    lattice: Arc<Lattice>,
    /// Binary logarithm of its spacing.
    shift: u32,
    /// Its first sample.
    origin: [i64; 2],
}

/// The nearest points of the outline.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Nearest {
    /// Metres of the frame; infinite if there is no outline.
    pub metres: f64,
    /// Columns and rows of the points; several if they are equally near.
    pub points: Vec<[f64; 2]>,
}

impl<'a> Outline<'a> {
    /// The search of a file.
    pub fn new(reader: &'a Reader, frame: &'a Frame) -> Self {
        let header = reader.header();
        let side = i64::from(header.tile()) << header.levels;
        Self { reader, frame, side, squares: HashMap::new(), last: None }
    }

    /// The nearest points to a vertex, none of which is nearer than `least` metres.
    pub fn nearest(&mut self, vertex: [i64; 2], least: f64) -> Result<Nearest> {
        let (dx, dy) = (self.frame.dx, self.frame.dy);
        let mut nearest = Nearest { metres: f64::INFINITY, points: Vec::new() };
        // Cells of ring r reach (r + 1) columns and rows away at most.
        let mut ring = ((least * (1.0 - 1e-9) / dx.hypot(dy)) as i64).max(0);
        while ring <= self.side && ring as f64 * dx.min(dy) <= nearest.metres * TIE {
            let [(west, east), (north, south)] = vertex.map(|v| (v - 1 - ring, v + ring));
            for x in west..=east {
                self.cell([x, north], vertex, &mut nearest)?;
                self.cell([x, south], vertex, &mut nearest)?;
            }
            for y in north + 1..south {
                self.cell([west, y], vertex, &mut nearest)?;
                self.cell([east, y], vertex, &mut nearest)?;
            }
            ring += 1;
        }
        Ok(nearest)
    }

    /// The outline in the cell of a leaf that holds a cell of the finest level.
    fn cell(&mut self, [x, y]: [i64; 2], vertex: [i64; 2], nearest: &mut Nearest) -> Result<()> {
        if x < 0 || y < 0 || x >= self.side || y >= self.side {
            return Ok(());
        }
        let away = |from: i64, to: i64| (from - to).max(to - from - 1).max(0) as f64;
        let (ax, ay) = (away(x, vertex[0]) * self.frame.dx, away(y, vertex[1]) * self.frame.dy);
        if ax.hypot(ay) > nearest.metres * TIE {
            return Ok(());
        }
        let Some(found) = self.at(x, y)? else { return Ok(()) };
        let shift = found.shift;
        let (i, j) = ((x - found.origin[0]) >> shift, (y - found.origin[1]) >> shift);
        let at = found.lattice.at(i as usize, j as usize);
        let row = found.lattice.n + 1;
        let valid = [at, at + 1, at + row, at + row + 1].map(|at| found.lattice.state[at] == VALID);
        if valid == [valid[0]; 4] {
            return Ok(());
        }
        let (column, line) = (x >> shift, y >> shift);
        let triangles =
            if (column + line) % 2 == 0 { [[0, 1, 3], [0, 2, 3]] } else { [[0, 1, 2], [1, 2, 3]] };
        let size = (1_i64 << shift) as f64;
        let middle = |a: usize, b: usize| {
            let half = |cell: i64, bits: usize| (cell as f64 + 0.5 * bits as f64) * size;
            [half(column, (a & 1) + (b & 1)), half(line, (a >> 1) + (b >> 1))]
        };
        let frame = *self.frame;
        for corners in triangles {
            let pairs = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (corners[i], corners[j]));
            let mut ends =
                pairs.into_iter().filter(|&(a, b)| valid[a] != valid[b]).map(|(a, b)| middle(a, b));
            if let (Some(p), Some(q)) = (ends.next(), ends.next()) {
                nearest.add(&frame, vertex.map(|v| v as f64), p, q);
            }
        }
        Ok(())
    }

    /// The leaf of a cell.
    fn at(&mut self, x: i64, y: i64) -> Result<Option<&Found>> {
        let header = self.reader.header();
        let tile = u64::from(header.tile());
        let square = (x as u64 / tile, y as u64 / tile);
        if self.last.as_ref().is_none_or(|last| last.0 != square) {
            if !self.squares.contains_key(&square) {
                let leaf = surface::leaf_at(self.reader, x as f64 + 0.5, y as f64 + 0.5)?;
                let found = match leaf {
                    None => None,
                    Some(leaf) => {
                        let (left, top) = header.origin(leaf.id);
                        Some(Arc::new(Found {
                            lattice: self.reader.read_tile(leaf.id)?,
                            shift: header.spacing(leaf.id.level).trailing_zeros(),
                            origin: [left as i64, top as i64],
                        }))
                    }
                };
                if self.squares.len() >= KEPT {
                    self.squares.clear();
                }
                self.squares.insert(square, found);
            }
            self.last = self.squares.get(&square).map(|found| (square, found.clone()));
        }
        Ok(self.last.as_ref().and_then(|(_, found)| found.as_deref()))
    }
}

impl Nearest {
    /// Adds a piece of the outline.
    fn add(&mut self, frame: &Frame, from: [f64; 2], p: [f64; 2], q: [f64; 2]) {
        let metres = |point: [f64; 2]| ((point[0] - from[0]) * frame.dx, (point[1] - from[1]) * frame.dy);
        let ((ax, ay), (bx, by)) = (metres(p), metres(q));
        let (ex, ey) = (bx - ax, by - ay);
        let along = (-(ax * ex + ay * ey) / (ex * ex + ey * ey)).clamp(0.0, 1.0);
        let distance = (ax + along * ex).hypot(ay + along * ey);
        if distance > self.metres * TIE {
            return;
        }
        if distance * TIE < self.metres {
            self.points.clear();
        }
        self.metres = self.metres.min(distance);
        self.points.push([p[0] + along * (q[0] - p[0]), p[1] + along * (q[1] - p[1])]);
    }
}
