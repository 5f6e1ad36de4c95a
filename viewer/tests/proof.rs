//! What the project stands on: with everything loaded, no sample in view is off by more than the
//! tolerance, on any frame; and the pictures of a fraction of the triangles are those of all of
//! them.

#![expect(clippy::expect_used, reason = "a test that cannot go on says why")]

mod common;

use std::ops::Range;
use std::path::{Path, PathBuf};

use relevo::limits::Limits;
use relevo::observed::{Observed, observe};
use relevo::pipeline::{self, BuildOptions, Silent};
use relevo::select::{EdgeRule, View};
use relevo::source::{self, Samples, Source, SourceInfo, Window};
use relevo_viewer::flyover;
use relevo_viewer::gpu::{Paint, RenderTarget, target};
use relevo_viewer::scene::Terrain;
use relevo_viewer::settings::{Lod, Settings};
use relevo_viewer::stage::{Drawing, Stage, headless_gpu, promised};

const SIZE: (u32, u32) = (640, 360);

/// A stage with its target.
struct Studio {
    stage: Stage,
    target: RenderTarget,
    settings: Settings,
    views: Vec<View>,
}

/// A frame.
struct Shown {
    observed: Observed,
    promised: f64,
    triangles: u64,
    pixels: Vec<u8>,
}

impl Studio {
    fn new(file: &Path, exaggeration: f64, rule: EdgeRule, frames: u32) -> Self {
        let settings = Settings {
            file: file.to_owned(),
            tolerance: 1.0,
            exaggeration,
            rule,
            lod: Lod::Hybrid,
            gpu_memory: 256 << 20,
            ram_cache: 64 << 20,
            size: SIZE,
            target: None,
            adapter: "software".into(),
            paint: Paint::Tint,
            wireframe: false,
            borders: false,
        };
        let terrain = Terrain::open(file, settings.ram_cache).expect("file");
        let path = flyover::path(terrain.reader(), exaggeration).expect("path");
        let gpu = headless_gpu("software").expect("software adapter (mesa-vulkan-drivers)");
        let stage = Stage::new(gpu, terrain, &settings, SIZE, target::FORMAT).expect("stage");
        let target = RenderTarget::new(&stage.gpu, SIZE, target::FORMAT).expect("picture");
        let (first, last) = path.span();
        let time = |i: u32| first + (last - first) * f64::from(i) / f64::from((frames - 1).max(1));
        let views = (0..frames).map(|i| path.at(time(i)).view(stage.scene.frame(), path.fov, SIZE)).collect();
        Self { stage, target, settings, views }
    }

    /// Draws a view with everything loaded and measures it.
    fn show(&mut self, view: &View, tolerance: f64) -> Shown {
        let chosen = self.stage.settle(view, tolerance).expect("loaded");
        assert_eq!(chosen.pending, 0, "all is loaded");
        let drawing = Drawing { view, tolerance, look: self.stage.look(&self.settings), levels: None };
        self.stage.draw(&chosen, &drawing, self.target.view(), SIZE).expect("drawn");
        let drawn = self.stage.renderer.drawn(&self.stage.gpu).expect("counters");
        let levels = self.stage.renderer.levels(&self.stage.gpu).expect("levels");
        let (scene, rule) = (&self.stage.scene, self.settings.rule);
        let selection = &chosen.selection;
        Shown {
            observed: observe(scene.reader(), selection, &levels, scene.frame(), view, rule)
                .expect("observed"),
            promised: promised(selection, &levels, scene.frame(), view),
            triangles: drawn.triangles,
            pixels: self.target.read(&self.stage.gpu).expect("pixels"),
        }
    }
}

/// Draws a flight over a file; nothing may be off by more than the tolerance.
fn fly(file: &Path, exaggeration: f64, tolerances: &[f64], frames: u32) {
    let mut studio = Studio::new(file, exaggeration, EdgeRule::Shared, frames);
    let mut vertices = 0;
    for &tolerance in tolerances {
        let mut worst = 0.0_f64;
        for view in studio.views.clone() {
            let shown = studio.show(&view, tolerance);
            let (pixels, promised) = (shown.observed.pixels, shown.promised);
            // The device rounds to single precision.
            assert!(
                promised <= tolerance * 1.0001,
                "{}: {promised} px promised of {tolerance}",
                file.display()
            );
            assert!(pixels <= promised * 1.0001, "{}: {pixels} px, {promised} promised", file.display());
            worst = worst.max(pixels);
            vertices += shown.observed.vertices;
        }
        println!("{}: {worst:.3} px observed of {tolerance}", file.display());
        assert!(worst > 0.1 * tolerance, "the error is used: {worst} of {tolerance}");
    }
    assert!(vertices > 10_000, "{vertices} samples in view");
}

fn build(dem: &Path, folder: &Path, tile: u32, patch: u32) -> PathBuf {
    let source = source::open(dem, &Limits::default()).expect("DEM");
    let output = folder.join("terrain.rlv");
    pipeline::build(&*source, &output, &BuildOptions { tile, patch, ..BuildOptions::default() }, &Silent)
        .expect("build");
    output
}

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/dem").join(name)
}

#[test]
fn no_sample_of_a_flight_over_colorado_is_off_by_more_than_the_tolerance() {
    let folder = tempfile::tempdir().expect("folder");
    let file = build(&fixture("co_elevation_float32_lzw.tif"), folder.path(), 64, 16);
    fly(&file, 1.0, &[0.7, 3.0], 7);
}

#[test]
fn nor_over_a_geographic_raster_with_threefold_heights() {
    let folder = tempfile::tempdir().expect("folder");
    let file = build(&fixture("rmnp_dem_uint16.tif"), folder.path(), 32, 8);
    fly(&file, 3.0, &[1.0, 8.0], 7);
}

#[test]
fn nor_over_a_horizon_with_holes() {
    let folder = tempfile::tempdir().expect("folder");
    let file = Horizon::new(700).build(folder.path(), 64, 8);
    fly(&file, 2.0, &[0.7, 4.0], 7);
}

/// The rasters with voids beside the project, where they are.
#[test]
fn nor_over_srtm_with_voids_and_coasts() {
    let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    for name in ["mt_rainier_srtm3_int16_voids.tif", "nz_elev_float32_nan.tif"] {
        let dem = shared.join(name);
        if !dem.exists() {
            println!("not run: {} is not beside the project", dem.display());
            continue;
        }
        let folder = tempfile::tempdir().expect("folder");
        fly(&build(&dem, folder.path(), 128, 32), 1.0, &[1.0], 5);
    }
}

/// Paper 000, figures 5.6 and 5.7: a third of the triangles, the same picture.
#[test]
fn a_third_of_the_triangles_shows_the_same_picture() {
    let folder = tempfile::tempdir().expect("folder");
    let file = Horizon::new(1025).build(folder.path(), 64, 8);
    let mut studio = Studio::new(&file, 1.0, EdgeRule::Shared, 5);
    let (mut few, mut all, mut differ, mut pixels) = (0, 0, 0, 0);
    for view in studio.views.clone() {
        let lod = studio.show(&view, 0.7);
        let full = studio.show(&view, 1e-6);
        assert!(full.observed.pixels <= 1e-6, "{} px at full resolution", full.observed.pixels);
        few += lod.triangles;
        all += full.triangles;
        let both = lod.pixels.chunks_exact(4).zip(full.pixels.chunks_exact(4));
        differ += both.filter(|(a, b)| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 24)).count();
        pixels += lod.pixels.len() / 4;
    }
    let (share, differing) = (few as f64 / all as f64, differ as f64 / pixels as f64);
    println!("{:.1} % of the triangles, {:.3} % of the pixels differ", 100.0 * share, 100.0 * differing);
    assert!(share <= 1.0 / 3.0, "{share} of the triangles");
    assert!(differing <= 0.01, "{differing} of the pixels differ");
}

/// A smooth surface with many holes, as a horizon picked from seismic data has.
struct Horizon(SourceInfo);

impl Horizon {
    fn new(side: u32) -> Self {
        Self(common::info(side, 12.5, "horizon"))
    }

    fn build(&self, folder: &Path, tile: u32, patch: u32) -> PathBuf {
        let output = folder.join("horizon.rlv");
        let options = BuildOptions { tile, patch, ..BuildOptions::default() };
        pipeline::build(self, &output, &options, &Silent).expect("build");
        output
    }

    fn height(x: u32, y: u32) -> f32 {
        let (u, v) = (f64::from(x) / 90.0, f64::from(y) / 70.0);
        let hole = (u * 1.9 + (v * 2.3).sin()).sin() * (v * 2.1 + (u * 1.3).cos()).sin();
        if hole > 0.8 {
            return f32::NAN;
        }
        let fault = if u * 0.6 + v > 9.0 { 60.0 } else { 0.0 };
        (-2500.0
            + 120.0 * (u / 2.0).sin() * (v / 3.0).cos()
            + 6.0 * (u * 3.1).sin() * (v * 2.7).cos()
            + fault) as f32
    }
}

impl Source for Horizon {
    fn info(&self) -> &SourceInfo {
        &self.0
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> relevo::Result<Window> {
        let heights = rows.flat_map(|y| columns.clone().map(move |x| Self::height(x, y)));
        Ok(Window { samples: Samples::Float32(heights.collect()), mask: None })
    }

    fn fingerprint(&self) -> relevo::Result<source::Fingerprint> {
        Ok(source::Fingerprint { files: Vec::new() })
    }
}
