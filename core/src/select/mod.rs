//! What to draw of a terrain: runtime level of detail, without a GPU in it.
//!
//! From the index, the tables of the tiles that are loaded, and a camera: which tiles ([`select`]), at which step each of their patches and each edge
//! between them ([`Levels`]), with which triangles ([`pattern`]), and which tile of imagery lies on them ([`imagery`]).
//! Every function is plain: no thread, no file, no clock.
//!
//! **No cracks, and no error above the tolerance.** What is drawn is one conforming 4-8 mesh (paper 002; the restricted quadtrees of
//! paper 004): patches that share an edge differ by at most one step, the edge is drawn at the finer of the two, and the
//! coarser one splits the cells along it at their centres. Such a mesh has triangles of uniform steps, whose error the table of
//! the file bounds, and triangles of half a step along some edges, whose error [`tile::TileData`] bounds when a tile is loaded. A tile edge
//! needs no more vertices than its two sides need; where the coarser tile has not got them, it is split instead.
//! [`EdgeRule::Paper`] is the rule of papers 000 and 001 (full resolution of the coarser tile along every tile edge), for comparison.

pub mod imagery;
pub mod levels;
pub mod neighbours;
pub mod pattern;
mod strips;
pub mod tile;
pub mod traverse;
pub mod view;

pub use levels::Levels;
pub use neighbours::Side;
pub use pattern::EdgeRule;
pub use tile::{Node, TileData, TileTable};
pub use traverse::{Chosen, Options, Selection, Tiles, Wanted, select};
pub use view::{Box3, Frame, View};
