//! Everything that is asked of the library and of the program from outside, in one crate: what
//! several tests share is in `support`, and it is linked once.

#![allow(
    clippy::expect_used,
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test that cannot go on says why"
)]

mod support;

mod cli;
mod cli_json;
mod cli_pages;
mod comments;
mod container;
mod crs;
mod differential;
mod each;
mod export;
mod fuzz_corpus;
mod geotiff_write;
mod golden;
mod half_steps;
mod hillshade;
mod horizontal;
mod hostile_text;
mod imagery;
mod imagery_pictures;
mod imagery_pyramid;
mod layers;
mod memory;
mod mesh_cli;
mod mesh_file;
mod mesh_nested;
mod mesh_save;
mod observed;
mod outputs;
mod pieces;
mod reader_scale;
mod real_data;
mod refused;
mod resume;
mod select;
mod source_account;
mod source_damage;
mod source_gdal;
mod source_inputs;
mod source_mosaic;
mod source_tiff_odd;
mod source_warp;
mod source_windows;
mod sparse;
mod spec;
mod state;
mod validity;
mod vectors;
mod verify;
mod verify_mesh;
