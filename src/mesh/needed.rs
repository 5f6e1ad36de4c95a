//! The vertices that a mesh of a file must have, found tile by tile.
//!
//! Tiles are worked on from the leaves up, several at a time. A tile whose samples are known to
//! describe what is below them well enough stands for its descendants, which are then never read:
//! the work follows the mesh, not the file. A tile marks the vertices of its own lattice, and its
//! middle and the middles of its sides when its children are done. What the tiles find is put
//! together in one set, where each vertex brings its parents with it; so the result does not depend
//! on tiles, their order or the number of threads.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use super::marks::Marks;
use super::square::{Below, HAS_VOID, Square};
use super::terrain::Terrain;
use super::triangle::Triangle;
use super::vertex::Vertex;
use crate::container::TileEntry;
use crate::error::Result;
use crate::progress::{Progress, Stage};
use crate::tile::TileId;

/// A tile stands for what is below it if that is off by less than this part of the limit. The rest
/// of the limit is left for triangles whose verdict needs no look below.
const CLOSE: f64 = 1.0 / 8.0;

/// The vertices that a mesh must have so that no triangle of it is off by more than the limit of
/// the terrain; and the kinds of samples in the window.
pub(super) fn find(terrain: &Terrain<'_>, progress: &dyn Progress) -> Result<(Marks, u8)> {
    let side = terrain.side();
    let work = Work {
        terrain,
        marks: Mutex::new(Marks::new(side)),
        squares: Mutex::default(),
        done: AtomicU64::new(0),
        progress,
    };
    let kinds = work.visit(TileId::ROOT)?.kinds;
    let mut marks = work.marks.into_inner().unwrap_or_else(PoisonError::into_inner);
    for (x, y) in [(0, 0), (side, 0), (0, side), (side, side)] {
        marks.add(Vertex::new(x, y));
    }
    Ok((marks, kinds))
}

/// What the threads share.
struct Work<'a> {
    terrain: &'a Terrain<'a>,
    marks: Mutex<Marks>,
    /// Memory that no thread uses now.
    squares: Mutex<Vec<Square>>,
    /// Leaf tiles that are done, those that were not read included.
    done: AtomicU64,
    progress: &'a dyn Progress,
}

impl Work<'_> {
    /// Marks the vertices within a tile and the middles of its sides.
    fn visit(&self, id: TileId) -> Result<Below> {
        let terrain = self.terrain;
        let (corner, side) = terrain.square(id);
        if !terrain.extent.overlaps(corner, side) {
            self.report(id)?;
            return Ok(Below::default());
        }
        let Some(entry) = terrain.reader.entry(id)? else {
            self.report(id)?;
            return Ok(Below { kinds: HAS_VOID, ..Below::default() });
        };
        let is_close = terrain.between(&entry)? <= CLOSE * terrain.limit;
        if entry.is_leaf() || is_close {
            let below = self.measure(&entry, None)?;
            self.report(id)?;
            return Ok(below);
        }
        let [a, b, c, d] = [0, 1, 2, 3].map(|quadrant| id.child(quadrant));
        let ((a, b), (c, d)) = rayon::join(
            || rayon::join(|| self.visit(a), || self.visit(b)),
            || rayon::join(|| self.visit(c), || self.visit(d)),
        );
        let quadrants = [a?, b?, c?, d?];
        if quadrants.iter().all(|below| below.is_marked) {
            // The middle of a quadrant brings its parents with it: the middles of the sides and of
            // the tile are marked.
            let kinds = quadrants.iter().fold(0, |kinds, below| kinds | below.kinds);
            return Ok(Below { is_marked: true, bound: 0.0, kinds });
        }
        self.measure(&entry, Some(quadrants))
    }

    /// Marks the vertices of the lattice of a tile, or only the outermost ones if its quadrants are
    /// done.
    fn measure(&self, entry: &TileEntry, quadrants: Option<[Below; 4]>) -> Result<Below> {
        let terrain = self.terrain;
        let ((left, top), side) = terrain.square(entry.id);
        let pooled = self.squares.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut square = pooled.unwrap_or_default();
        terrain.fill(entry, &mut square)?;
        let n = square.n;
        let spacing = side / n as i64;
        let resolve = |triangle: &Triangle| {
            let mut kinds = 0;
            for &(x, y) in &triangle.corners {
                let vertex = Vertex::new(x as u32, y as u32);
                if !terrain.extent.contains(vertex) {
                    kinds |= terrain.outside(vertex).1;
                }
            }
            terrain.judge(entry.id, triangle, &mut kinds)
        };
        let below = match quadrants {
            Some(quadrants) => square.mark_outer(quadrants, &resolve)?,
            None => square.mark_all(&resolve)?,
        };
        self.keep(&square, (left, top), spacing);
        self.squares.lock().unwrap_or_else(PoisonError::into_inner).push(square);
        Ok(below)
    }

    /// Adds the vertices that a tile has marked to the set.
    fn keep(&self, square: &Square, (left, top): (i64, i64), spacing: i64) {
        if !square.marks.contains(&1) {
            return;
        }
        let side = self.terrain.side();
        let n = square.n;
        let mut marks = self.marks.lock().unwrap_or_else(PoisonError::into_inner);
        for (y, row) in square.marks.chunks_exact(n + 1).enumerate() {
            for x in row.iter().enumerate().filter(|(_, mark)| **mark == 1).map(|(x, _)| x) {
                let vertex =
                    Vertex::new((left + x as i64 * spacing) as u32, (top + y as i64 * spacing) as u32);
                // Within the tile the parents of a vertex are marked already.
                let is_inner = (1..n).contains(&x) && (1..n).contains(&y) && (x, y) != (n / 2, n / 2);
                if is_inner {
                    marks.add(vertex);
                } else {
                    marks.add_with_parents(vertex, side);
                }
            }
        }
    }

    /// Reports the leaf tiles below a tile as done.
    fn report(&self, id: TileId) -> Result<()> {
        let levels = self.terrain.reader.header().levels;
        let leaves = |level: u8| 1_u64 << (2 * u32::from(levels - level));
        let done = self.done.fetch_add(leaves(id.level), Ordering::Relaxed) + leaves(id.level);
        self.progress.step(Stage::Tiles, done, leaves(0))
    }
}
