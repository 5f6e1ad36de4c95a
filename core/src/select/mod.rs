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
//!
//! ```
//! use std::collections::HashMap;
//! use std::sync::Arc;
//!
//! use relevo_core::select::{Frame, Node, Options, TileData, TileTable, Tiles, View, select};
//! use relevo_core::{Header, Reader, TileId};
//!
//! /// A terrain whose tiles are all loaded.
//! struct Terrain {
//!     header: Header,
//!     tiles: HashMap<TileId, (Node, Arc<TileTable>)>,
//! }
//!
//! impl Tiles for Terrain {
//!     fn header(&self) -> &Header {
//!         &self.header
//!     }
//!     fn node(&self, id: TileId) -> Option<Node> {
//!         self.tiles.get(&id).map(|tile| tile.0)
//!     }
//!     fn table(&self, id: TileId) -> Option<Arc<TileTable>> {
//!         self.tiles.get(&id).map(|tile| Arc::clone(&tile.1))
//!     }
//! }
//!
//! # fn main() -> relevo_core::Result<()> {
//! # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
//! let reader = Reader::open(path)?;
//! let (header, geo, frame) = (reader.header().clone(), reader.geo(), Frame::of(&reader));
//! let mut tiles = HashMap::new();
//! reader.walk(&mut |entry| {
//!     let (lattice, errors) = (reader.read_tile(entry.id)?, reader.read_errors(entry.id)?);
//!     let data = TileData::new(&header, geo, &frame, entry, &lattice, &errors)?;
//!     let node = Node::new(&header, geo, &frame, entry);
//!     tiles.insert(entry.id, (node, Arc::new(data.table)));
//!     Ok(())
//! })?;
//! let terrain = Terrain { header, tiles };
//!
//! let target = frame.position(35.0, 25.0, 400.0);
//! let from = |metres: f64| {
//!     let eye = [target[0], target[1] - metres, target[2] + metres];
//!     let view = View::look_at(eye, target, 0.8, (1280, 720), 1.0);
//!     select(&terrain, &frame, &view, &Options::default())
//! };
//! let (near, far) = (from(20e3), from(20e6));
//! assert!(near.tiles.len() > 4 && far.tiles.len() == 1);
//! // No sample is drawn more than a pixel from its true place.
//! assert!(near.promised <= 1.0 && far.promised <= 1.0);
//! # Ok(())
//! # }
//! ```

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
