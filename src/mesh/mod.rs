//! Triangle meshes of the terrain: what is promised of them, and the check that holds any mesh to
//! it.

pub mod check;
