//! Relevo: digital elevation models as tile pyramids with a proven geometric error for every patch.

pub mod error;
pub mod error_code;
pub mod geo;
pub mod limits;
pub mod sample;
pub mod source;
pub mod tile;

pub use error::{Error, Result};
pub use tile::TileId;
