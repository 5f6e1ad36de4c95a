//! A mesh of free triangles: the nested one with every vertex collapsed that can go within the
//! error.
//!
//! The mesh is worked on in squares, several at a time. A vertex goes only if all of its triangles
//! lie in the square, so borders stay as they are. A second pass with squares moved by half a side
//! takes what the borders of the first kept. The result does not depend on the number of threads.

mod ground;
mod part;

use rayon::prelude::*;

use self::ground::{Ground, Point};
use self::part::{Freedom, Part};
use super::nested::{Nested, Place, Triangle};
use super::terrain::{Extent, Terrain, height_of_number, number};
use crate::error::Result;
use crate::progress::{Progress, Stage};
use crate::sample::Coding;
use crate::surface::leaf_at;

/// Least samples on a side of a square.
const SIDE: u32 = 256;
/// Most samples on a side of a square.
const WIDEST: u32 = 2048;
/// Triangles that a square has on average, unless it is as wide as may be.
const ENOUGH: f64 = 4000.0;

/// What a triangle may be above the limit as it is computed, in codes: much more than rounding
/// does, and much less than such a triangle can be above it in truth.
const TIE: f64 = 1e-10;

/// A mesh of free triangles.
pub struct Collapsed {
    places: Vec<Place>,
    triangles: Vec<Triangle>,
    rounding_m: f64,
}

/// A mesh while it is worked on.
struct Work<'a> {
    terrain: &'a Terrain<'a>,
    points: Vec<Point>,
    triangles: Vec<Triangle>,
    /// What triangles may be off by as they are computed, in numbers.
    limit: f64,
    /// Smallest angle of a triangle, in radians.
    least_angle: f64,
    metres: (f64, f64),
}

impl Collapsed {
    /// The mesh of what is left of a nested one. It keeps the same error.
    ///
    /// New triangles have no angle below `least_angle` (radians), columns and rows being `metres`
    /// apart.
    pub fn new(
        nested: &Nested<'_>,
        least_angle: f64,
        metres: (f64, f64),
        progress: &dyn Progress,
    ) -> Result<Self> {
        let mut points = Vec::new();
        nested.each_point(&mut |piece| {
            points.extend(piece.iter().map(|&((x, y), height)| Point { x: x as i32, y: y as i32, height }));
            Ok(())
        })?;
        let mut triangles = Vec::new();
        let out = &mut |piece: &[Triangle]| {
            triangles.extend_from_slice(piece);
            Ok(())
        };
        nested.each_triangle(out, progress)?;
        let terrain = nested.terrain();
        // Planes through whole numbers are often off by just the limit; what is computed is then
        // above it by a rounding, and would be refused. Other numbers have no such ties.
        let limit = match terrain.reader.header().coding {
            Coding::Integer { .. } => terrain.limit + TIE,
            _ => terrain.limit - terrain.limit * 1e-12 - nested.highest() * 1e-13,
        };
        let mut work = Work { terrain, points, triangles, limit, least_angle, metres };
        let side = work.side();
        for moved in [0, side / 2] {
            work.pass(side, moved, progress)?;
        }
        Ok(work.finish())
    }

    /// What it can be off by more than the nested mesh promises, in metres: by rounding.
    pub fn rounding_m(&self) -> f64 {
        self.rounding_m
    }

    /// Vertices: column, row, height in metres.
    pub fn places(&self) -> &[Place] {
        &self.places
    }

    /// Triangles, counter-clockwise seen from above.
    pub fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }
}

impl Work<'_> {
    /// Samples on a side of a square.
    fn side(&self) -> u32 {
        let Extent { columns, rows } = self.terrain.extent;
        let samples = f64::from(columns.1 - columns.0) * f64::from(rows.1 - rows.0);
        let mut side = SIDE;
        while side < WIDEST && f64::from(side).powi(2) * self.triangles.len() as f64 / samples < ENOUGH {
            side *= 2;
        }
        side
    }

    /// Collapses within all squares of a side, moved by some columns and rows.
    fn pass(&mut self, side: u32, moved: u32, progress: &dyn Progress) -> Result<()> {
        let across = self.terrain.side().div_ceil(side) + 1;
        let square = |triangle: &Triangle| {
            let of = |value: fn(&Point) -> i32| {
                let values = triangle.map(|at| value(&self.points[at as usize]) + 2 * moved as i32);
                let (low, high) =
                    (values.into_iter().fold(i32::MAX, i32::min), values.into_iter().fold(0, i32::max));
                let first = low / (2 * side as i32);
                (high <= (first + 1) * 2 * side as i32).then_some(first as u32)
            };
            Some((of(|p| p.y)?, of(|p| p.x)?))
        };
        // Triangles by square, in the order that they have; those of none come last.
        let mut order: Vec<(u32, u32)> = self
            .triangles
            .iter()
            .zip(0..)
            .map(|(triangle, number)| {
                let key = square(triangle).map_or(u32::MAX, |(y, x)| y * across + x);
                (key, number)
            })
            .collect();
        order.par_sort_unstable();
        let mut count = vec![0_u32; self.points.len()];
        for at in self.triangles.iter().flatten() {
            count[*at as usize] += 1;
        }
        let squares: Vec<&[(u32, u32)]> = order.chunk_by(|a, b| a.0 == b.0).collect();
        let total = squares.len() as u64;
        let mut triangles = Vec::with_capacity(self.triangles.len());
        for (done, several) in squares.chunks(4 * rayon::current_num_threads()).enumerate() {
            let made: Vec<Result<Vec<Triangle>>> = several
                .par_iter()
                .map(|numbers| {
                    let own: Vec<Triangle> =
                        numbers.iter().map(|&(_, number)| self.triangles[number as usize]).collect();
                    let key = numbers.first().map_or(u32::MAX, |first| first.0);
                    if key == u32::MAX {
                        return Ok(own);
                    }
                    let (x, y) = (key % across, key / across);
                    let corner = [x, y].map(|at| i64::from(at) * i64::from(side) - i64::from(moved));
                    self.square(&own, corner, side, &count)
                })
                .collect();
            for made in made {
                triangles.extend(made?);
            }
            let step = (done * 4 * rayon::current_num_threads()) as u64;
            progress.step(Stage::Triangles, step.min(total), total)?;
        }
        self.triangles = triangles;
        Ok(())
    }

    /// Collapses within one square. `count` is the number of triangles of each vertex in the whole
    /// mesh.
    fn square(
        &self,
        own: &[Triangle],
        [left, top]: [i64; 2],
        side: u32,
        count: &[u32],
    ) -> Result<Vec<Triangle>> {
        let mut numbers: Vec<u32> = own.iter().flatten().copied().collect();
        numbers.sort_unstable();
        numbers.dedup();
        let local = |at: u32| numbers.binary_search(&at).unwrap_or_default() as u32;
        let triangles: Vec<Triangle> = own.iter().map(|triangle| triangle.map(local)).collect();
        let mut here = vec![0_u32; numbers.len()];
        for at in triangles.iter().flatten() {
            here[*at as usize] += 1;
        }
        let points: Vec<Point> = numbers.iter().map(|&at| self.points[at as usize]).collect();
        let freedom = |(at, (&number, &here)): (usize, (&u32, &u32))| {
            if here == count[number as usize] { self.freedom(&points[at]) } else { Freedom::Fixed }
        };
        let may_go = numbers.iter().zip(&here).enumerate().map(freedom).collect();
        let ground = self.ground([left, top], side)?;
        let mut part = Part::new(&ground, points, may_go, triangles);
        part.limit = self.limit;
        (part.least_angle, part.metres) = (self.least_angle, self.metres);
        Ok(part.run().into_iter().map(|triangle| triangle.map(|at| numbers[at as usize])).collect())
    }

    /// Where a vertex may go.
    fn freedom(&self, point: &Point) -> Freedom {
        if point.x % 2 != 0 || point.y % 2 != 0 {
            // A point of an outline.
            return Freedom::Fixed;
        }
        let (x, y) = ((point.x / 2) as u32, (point.y / 2) as u32);
        let Extent { columns, rows } = self.terrain.extent;
        match (x == columns.0 || x == columns.1, y == rows.0 || y == rows.1) {
            (true, true) => Freedom::Fixed,
            (true, false) => Freedom::AlongColumn,
            (false, true) => Freedom::AlongRow,
            (false, false) => Freedom::Free,
        }
    }

    /// The samples of a square, as far as it lies in the window.
    fn ground(&self, [left, top]: [i64; 2], side: u32) -> Result<Ground> {
        let reader = self.terrain.reader;
        let header = reader.header();
        let Extent { columns, rows } = self.terrain.extent;
        let range = |start: i64, (first, last): (u32, u32)| {
            let first = start.max(first.into()) as u32;
            (first, (start + i64::from(side)).clamp(0, last.into()) as u32)
        };
        let (columns, rows) = (range(left, columns), range(top, rows));
        let width = (columns.1 - columns.0 + 1) as usize;
        let mut heights = vec![0.0; width * (rows.1 - rows.0 + 1) as usize];
        let tile = header.tile();
        for ty in rows.0 / tile..=rows.1 / tile {
            for tx in columns.0 / tile..=columns.1 / tile {
                // The last column and row of the lattice belong to the tiles before them.
                let (x, y) = (f64::from(tx * tile), f64::from(ty * tile));
                let Some(leaf) = leaf_at(reader, x + 0.5, y + 0.5)?.or(leaf_at(reader, x, y)?) else {
                    continue;
                };
                let lattice = reader.read_tile(leaf.id)?;
                let ((west, north), _) = self.terrain.square(leaf.id);
                let within = |start: i64, (first, last): (u32, u32)| {
                    let first = start.max(first.into()) as u32;
                    first..=(start + i64::from(tile)).min(last.into()) as u32
                };
                for y in within(north, rows) {
                    for x in within(west, columns) {
                        let at = lattice.at((i64::from(x) - west) as usize, (i64::from(y) - north) as usize);
                        heights[(y - rows.0) as usize * width + (x - columns.0) as usize] =
                            number(&lattice, at, header.coding);
                    }
                }
            }
        }
        Ok(Ground { corner: (columns.0 as i32, rows.0 as i32), width, heights })
    }

    /// The mesh, without the vertices that have gone.
    fn finish(self) -> Collapsed {
        let mut numbers = vec![u32::MAX; self.points.len()];
        for at in self.triangles.iter().flatten() {
            numbers[*at as usize] = 0;
        }
        let header = self.terrain.reader.header();
        let mut places = Vec::new();
        for (number, point) in numbers.iter_mut().zip(&self.points) {
            if *number == 0 {
                *number = places.len() as u32;
                let height = height_of_number(header, point.height);
                places.push([f64::from(point.x) / 2.0, f64::from(point.y) / 2.0, height]);
            }
        }
        let triangles =
            self.triangles.iter().map(|triangle| triangle.map(|at| numbers[at as usize])).collect();
        let rounding_m = (self.limit - self.terrain.limit).max(0.0) * self.terrain.metres;
        Collapsed { places, triangles, rounding_m }
    }
}
