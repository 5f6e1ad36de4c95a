//! Pictures drawn without a window: cracks, coverage, holes, levels, images, large worlds, wrong
//! input.

#![expect(clippy::expect_used, reason = "a test that cannot go on says why")]

mod cracks;
mod images;
mod levels;
mod patterns;
mod scene;
mod world;
