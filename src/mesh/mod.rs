//! Triangle meshes of a file's terrain, with a proven error.
//!
//! [`nested`] makes the mesh of right isosceles triangles (papers 002 and 004), tile by tile: which
//! vertices a tile needs (`square`), the set of all of them (`marks`), their triangles, cut at the
//! window's sides and at outlines of voids (`cut`). [`collapse`] takes all vertices out of it that
//! can go within the error. [`save()`] writes either. [`mod@check`] holds any mesh to
//! what it promises, by code that shares nothing with the builders.

mod budget;
pub mod check;
pub mod collapse;
mod cut;
mod lookup;
mod made;
mod marks;
mod needed;
pub mod nested;
mod placing;
mod save;
mod square;
mod terrain;
mod triangle;
mod vertex;

pub use made::Method;
pub use nested::Nested;
pub use save::{Frame, LEAST_ANGLE, MeshOptions, MeshReport, Target, save};
