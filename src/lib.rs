//! Relevo: digital elevation models as tile pyramids with a proven geometric error for every patch.

pub mod codec;
pub mod container;
pub mod error;
pub mod error_code;
pub mod export;
pub mod geo;
pub mod geotiff_write;
pub mod hillshade;
pub mod limits;
pub mod patch;
pub mod pipeline;
pub mod sample;
pub mod source;
pub mod surface;
pub mod tile;
pub mod verify;

pub use error::{Error, Result};
pub use tile::TileId;
