//! Runtime level of detail: what to draw of a terrain.
//!
//! Selection knows the index, the tables of the loaded tiles, and a camera. It chooses the tiles
//! ([`select`]), the step of each patch and each edge ([`Levels`]), their triangles ([`pattern`]),
//! and the imagery on them ([`imagery`]). All of it is plain functions: no GPU, no thread, no file,
//! no clock.
//!
//! **No cracks, and no error above the tolerance.** The mesh is one conforming 4-8 mesh (paper 002;
//! the restricted quadtrees of paper 004): patches that share an edge differ by at most one step,
//! the edge is drawn at the finer of the two, and the coarser one splits the cells along it at
//! their centres. Such a mesh has triangles of uniform steps, whose error the table of the file
//! bounds, and triangles of half a step along some edges, whose error [`tile::TileData`] bounds
//! when a tile is loaded. A tile edge gets no more vertices than its two sides need; a coarser tile
//! that lacks them is split. [`EdgeRule::Paper`] is the rule of papers 000 and 001 (full resolution
//! of the coarser tile along every tile edge), for comparison.

mod half_steps;
pub mod imagery;
pub mod levels;
pub mod neighbours;
pub mod pattern;
mod selection;
pub mod tile;
pub mod traverse;
pub mod view;

pub use levels::Levels;
pub use neighbours::Side;
pub use pattern::EdgeRule;
pub use selection::{Chosen, Selection, Wanted};
pub use tile::{Node, TileData, TileTable};
pub use traverse::{Options, Tiles, select};
pub use view::{Box3, Frame, View};
