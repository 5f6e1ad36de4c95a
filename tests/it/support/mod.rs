//! Terrain to build from, and the truth about what is drawn of it.

#![allow(dead_code, reason = "not every test needs all of it")]

pub mod progress;
pub mod selection;
pub mod terrain;
pub mod truth;
