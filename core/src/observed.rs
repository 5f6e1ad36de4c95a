//! The observed error of a view: every vertex of full resolution against the triangles that are
//! drawn over it.
//!
//! Nothing here trusts an error table. The geometry is that of the renderer: the heights of the
//! selected tiles as f32, the steps of their patches and edges, the triangles of
//! [`crate::select::pattern`]. The truth is decoded from the leaves. Their difference at a vertex
//! in the view is
//! - if the vertex is valid and the surface is drawn there: the distance on the screen between both
//!   points;
//! - if it is valid and no surface is drawn there, or void and a surface is: the distance on the
//!   screen to the nearest points of the outline at full resolution (as `relevo::verify`
//!   measures), at the same height.
//!
//! Vertices that cannot have a larger error than the largest of their patch so far are skipped, by
//! bounds that are taken from the samples themselves.

mod block;
mod drawn;
mod leaves;
mod outline;

#[cfg(feature = "threads")]
use rayon::prelude::*;

use crate::container::Reader;
use crate::error::{Error, Result};
use crate::select::neighbours::edges_of_patch;
use crate::select::pattern::{Meshes, Piece};
use crate::select::tile::Heights;
use crate::select::{EdgeRule, Frame, Levels, Selection, View};
use block::Work;
use drawn::{Patch, Tile};
use outline::Outline;

/// The largest error of a view.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Observed {
    /// The error in pixels; 0 if no vertex is in the view.
    pub pixels: f64,
    /// Column of the vertex with this error.
    pub column: u64,
    /// Row of that vertex.
    pub row: u64,
    /// The error in metres of the frame: heights are exaggerated.
    pub metres: f64,
    /// True if the vertex is misdrawn: drawn though void, or not drawn though valid.
    pub misdrawn: bool,
    /// Vertices in the view: valid ones, and void ones where a surface is drawn (at its height). A
    /// vertex on the border of two selected tiles counts for both.
    pub vertices: u64,
    /// How many of them are misdrawn.
    pub misdrawn_vertices: u64,
    /// The largest error of each patch that has a vertex in the view.
    pub patches: Vec<PatchError>,
}

/// The largest error of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatchError {
    /// Index in [`Selection::tiles`].
    pub tile: u32,
    /// Patch of the tile, row by row from the north-west.
    pub patch: u32,
    /// Pixels.
    pub pixels: f64,
}

impl Observed {
    /// Joins the results of two parts of a view.
    fn and(mut self, other: Self) -> Self {
        let (vertices, misdrawn) =
            (self.vertices + other.vertices, self.misdrawn_vertices + other.misdrawn_vertices);
        let mut patches = std::mem::take(&mut self.patches);
        patches.extend_from_slice(&other.patches);
        let larger = if other.pixels > self.pixels { other } else { self };
        Self { vertices, misdrawn_vertices: misdrawn, patches, ..larger }
    }
}

/// The error of a view of a selection drawn with these levels, over all vertices of the leaves
/// under the selected tiles.
///
/// Tiles are worked on in parallel, the leaves of each one after the other: memory is that of the
/// reader's cache and a few leaves for each thread.
///
/// # Errors
/// If a tile cannot be read, or if levels and selection do not belong together.
pub fn observe(
    reader: &Reader,
    selection: &Selection,
    levels: &Levels,
    frame: &Frame,
    view: &View,
    rule: EdgeRule,
) -> Result<Observed> {
    let header = reader.header();
    let m = header.patches();
    if levels.inner.len() != selection.tiles.len() * (m * m) as usize
        || selection.patches != m
        || selection.patch_log2 != header.patch_log2
    {
        return Err(Error::usage("the levels are not those of the selection, or it is not one of this file"));
    }
    let meshes = Meshes::new(header.patch_log2);
    let observe = |index: usize| {
        let tile = drawn_tile(reader, selection, levels, index, rule)?;
        let mut work = Work::new(Outline::new(reader, frame), tile, &meshes, frame, view);
        work.run(reader)?;
        Ok(work.finish(index as u32))
    };
    let indices = 0..selection.tiles.len();
    #[cfg(feature = "threads")]
    let mut observed =
        indices.into_par_iter().map(observe).try_reduce(Observed::default, |a, b| Ok(a.and(b)))?;
    #[cfg(not(feature = "threads"))]
    let mut observed = indices
        .map(observe)
        .try_fold(Observed::default(), |all, one: Result<_>| one.map(|one| all.and(one)))?;
    observed.patches.sort_unstable_by_key(|patch| (patch.tile, patch.patch));
    Ok(observed)
}

/// A tile of the selection with the pieces that draw each of its patches.
fn drawn_tile(
    reader: &Reader,
    selection: &Selection,
    levels: &Levels,
    index: usize,
    rule: EdgeRule,
) -> Result<Tile> {
    let (header, chosen) = (reader.header(), &selection.tiles[index]);
    let (m, p) = (header.patches(), header.patch_log2);
    let absent = || Error::usage(format!("there is no tile {}", chosen.id));
    let entry = reader.entry(chosen.id)?.ok_or_else(absent)?;
    let heights = Heights::new(header, &entry, &*reader.read_tile(chosen.id)?);
    let strange =
        || Error::usage(format!("tile {} of the selection has edges that no levels are known of", chosen.id));
    let mut patches = Vec::new();
    for patch in 0..m * m {
        let (x, y) = (patch % m, patch / m);
        let step = |exponent: u8| exponent.saturating_sub(chosen.exponent).min(p);
        let inner = step(levels.inner[index * (m * m) as usize + patch as usize]);
        let mut outer = [0; 4];
        for (step_of, edge) in outer.iter_mut().zip(edges_of_patch(index as u32, &chosen.sides, m, x, y)) {
            *step_of = step(*levels.edges.get(edge as usize).ok_or_else(strange)?);
        }
        let odd = (u64::from(chosen.id.x + chosen.id.y) * u64::from(m) + u64::from(x + y)) % 2 == 1;
        let drawable = chosen.table.drawable.get(patch as usize).copied().unwrap_or(false);
        let pieces: Vec<Piece> =
            if drawable { Meshes::pieces(p, inner, outer, odd, rule).collect() } else { Vec::new() };
        patches.push(Patch { pieces, finest: drawable && inner == 0 && outer == [0; 4] });
    }
    Ok(Tile {
        entry,
        spacing: u64::from(header.spacing(chosen.id.level)),
        patch: header.patch(),
        m,
        heights,
        patches,
    })
}
