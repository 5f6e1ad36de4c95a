//! Pictures and figures without a window.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::time::Instant;

use relevo::select::{EdgeRule, Levels, Selection, View};
use relevo::{Error, Result, observed};

use crate::camera::{FOV, Pose, moved};
use crate::flyover;
use crate::governor::{Governor, Load};
use crate::gpu::picture;
use crate::metrics::{Row, Writer};
use crate::path::CameraPath;
use crate::scene::Terrain;
use crate::settings::{Lod, Settings};
use crate::stage::{Drawing, Stage, headless_gpu, promised};

/// What to make of a camera path.
#[derive(Clone, Debug, Default)]
pub struct Journey {
    /// The path's file; `None`: a flight over the terrain.
    pub path: Option<PathBuf>,
    /// Frames, evenly from its first key to its last; `None`: as many as `fps` says.
    pub count: Option<u32>,
    /// Frames of a second of the path.
    pub fps: f64,
    /// Folder for one PNG a frame.
    pub frames: Option<PathBuf>,
    /// CSV file with one row a frame.
    pub metrics: Option<PathBuf>,
    /// Draw what is loaded at that moment instead of waiting for everything.
    pub streaming: bool,
    /// Measure the error of what is drawn.
    pub observe: bool,
}

/// Most frames of a journey.
const MOST_FRAMES: f64 = 1e6;

/// Pixels that only full resolution is within.
const NOTHING: f64 = 1e-9;

/// Every patch at the full resolution of its tile.
fn full_resolution(selection: &Selection, rule: EdgeRule) -> Levels {
    let patches = (selection.patches * selection.patches) as usize;
    let base = selection.tiles.iter().flat_map(|tile| std::iter::repeat_n(tile.exponent, patches)).collect();
    Levels::from_base(selection, base, rule)
}

/// Where a single picture is taken from.
#[derive(Clone, Copy, Debug, Default)]
pub struct Shot {
    /// Column, row, height.
    pub eye: Option<[f64; 3]>,
    /// Likewise.
    pub target: Option<[f64; 3]>,
}

/// What was seen on a journey.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Adapter.
    pub adapter: String,
    /// Frames.
    pub frames: u32,
    /// Largest promised error of a frame, pixels.
    pub promised: f64,
    /// Largest observed one, if it was measured.
    pub observed: Option<f64>,
    /// Triangles of all frames.
    pub triangles: u64,
    /// Milliseconds of all frames.
    pub frame_ms: f64,
    /// Most bytes on the GPU.
    pub gpu_bytes: u64,
}

/// Draws every frame of a path. `tell` hears of tiles that cannot be read.
pub fn journey(settings: &Settings, journey: &Journey, tell: &mut dyn FnMut(&str)) -> Result<Summary> {
    let terrain = Terrain::open(&settings.file, settings.ram_cache)?;
    let path = match &journey.path {
        Some(path) => CameraPath::read(path, terrain.reader().geo())?,
        None => flyover::path(terrain.reader())?,
    };
    let times = times(&path, journey)?;
    if let Some(folder) = &journey.frames {
        std::fs::create_dir_all(folder).map_err(|error| Error::io(folder, "create", error))?;
    }
    let mut rows = journey.metrics.as_deref().map(open_metrics).transpose()?;
    let mut booth = Booth::new(settings, terrain)?;
    let mut summary = Summary { adapter: booth.stage.gpu.name(), ..Summary::default() };
    let mut governor = Governor::new(settings.target, settings.tolerance);
    let mut tolerance = settings.tolerance;
    let mut before: Option<(View, Instant)> = None;
    for (frame, time) in (0..).zip(times) {
        let view = path.at(time).view(booth.stage.scene.frame(), path.fov, settings.size);
        let begun = Instant::now();
        let mut row = booth.frame(&view, tolerance, journey)?;
        (row.frame, row.time) = (frame, time);
        booth.stage.scene.take_problems().iter().for_each(|problem| tell(problem));
        if let Some(folder) = &journey.frames {
            booth.picture.save(&booth.stage.gpu, &folder.join(format!("{frame:06}.png")))?;
        }
        if let (Some(rows), Some(file)) = (&mut rows, &journey.metrics) {
            rows.row(&row).map_err(|error| Error::io(file, "write", error))?;
        }
        summary.add(&row);
        let moving = before.is_none_or(|(before, _)| moved(&before, &view));
        let seconds = begun.elapsed().as_secs_f64();
        before = Some((view, begun));
        tolerance = governor.next(settings.tolerance, Load { seconds, triangles: row.triangles, moving });
    }
    Ok(summary)
}

/// Draws one picture with everything loaded and writes it as PNG.
pub fn shot(settings: &Settings, shot: Shot, output: &Path, tell: &mut dyn FnMut(&str)) -> Result<Summary> {
    let terrain = Terrain::open(&settings.file, settings.ram_cache)?;
    let all = flyover::overview(terrain.reader())?;
    let pose = Pose { eye: shot.eye.unwrap_or(all.eye), target: shot.target.unwrap_or(all.target) };
    if pose.eye == pose.target {
        return Err(Error::usage("--target: it is where --eye is"));
    }
    let mut booth = Booth::new(settings, terrain)?;
    let view = pose.view(booth.stage.scene.frame(), FOV, settings.size);
    let row = booth.frame(&view, settings.tolerance, &Journey::default())?;
    booth.stage.scene.take_problems().iter().for_each(|problem| tell(problem));
    booth.picture.save(&booth.stage.gpu, output)?;
    let mut summary = Summary { adapter: booth.stage.gpu.name(), ..Summary::default() };
    summary.add(&row);
    Ok(summary)
}

impl Summary {
    fn add(&mut self, row: &Row) {
        self.frames += 1;
        self.promised = self.promised.max(row.promised);
        self.observed = row.observed.map(|pixels| self.observed.unwrap_or(0.0).max(pixels)).or(self.observed);
        self.triangles += row.triangles;
        self.frame_ms += row.frame_ms;
        self.gpu_bytes = self.gpu_bytes.max(row.gpu_bytes);
    }
}

/// A stage with an offscreen target.
struct Booth {
    stage: Stage,
    lod: Lod,
    picture: picture::Picture,
    look: crate::gpu::Look,
}

impl Booth {
    fn new(settings: &Settings, terrain: Terrain) -> Result<Self> {
        let gpu = headless_gpu(&settings.adapter)?;
        let stage = Stage::new(gpu, terrain, settings, settings.size, picture::FORMAT)?;
        let picture = picture::Picture::new(&stage.gpu, settings.size, picture::FORMAT)?;
        let look = stage.look(settings);
        Ok(Self { stage, lod: settings.lod, picture, look })
    }

    /// Draws a frame to its end.
    fn frame(&mut self, view: &View, tolerance: f64, journey: &Journey) -> Result<Row> {
        let stage = &mut self.stage;
        let wanted = if self.lod == Lod::Full { NOTHING } else { tolerance };
        let chosen =
            if journey.streaming { stage.stream(view, wanted)? } else { stage.settle(view, wanted)? };
        let begun = Instant::now();
        let levels = (self.lod == Lod::Tiles).then(|| full_resolution(&chosen.selection, stage.scene.rule()));
        let drawing = Drawing { view, tolerance: wanted, look: self.look, levels: levels.as_ref() };
        stage.draw(&chosen, &drawing, self.picture.view(), self.picture.size())?;
        let drawn = stage.renderer.drawn(&stage.gpu)?;
        let frame_ms = begun.elapsed().as_secs_f64() * 1e3;
        let levels: Levels = stage.renderer.levels(&stage.gpu)?;
        let scene = &stage.scene;
        let observed = if journey.observe {
            let (selection, rule) = (&chosen.selection, scene.rule());
            let observed = observed::observe(scene.reader(), selection, &levels, scene.frame(), view, rule);
            Some(observed.map_err(unmeasured)?.pixels)
        } else {
            None
        };
        Ok(Row {
            observed,
            select_ms: chosen.select_ms,
            frame_ms,
            tiles: chosen.selection.tiles.len(),
            patches: drawn.patches,
            triangles: drawn.triangles,
            draws: chosen.draws.len(),
            gpu_bytes: stage.gpu_bytes(),
            pending: chosen.pending,
            tolerance,
            promised: promised(&chosen.selection, &levels, scene.frame(), view),
            ..Row::default()
        })
    }
}

/// The truth is in the leaves: without one there is no error to tell.
fn unmeasured(why: Error) -> Error {
    Error::usage(format!("--observe needs every sample in view: {why}"))
}

/// Times of the frames.
fn times(path: &CameraPath, journey: &Journey) -> Result<Vec<f64>> {
    let (first, last) = path.span();
    let by_fps = || ((last - first) * journey.fps).floor() + 1.0;
    let count = journey.count.map_or_else(by_fps, f64::from);
    if !(1.0..=MOST_FRAMES).contains(&count) {
        let what = format!(
            "{count} frames: the path of {} s makes 1 to {MOST_FRAMES} (--count, --fps)",
            last - first
        );
        return Err(Error::usage(what));
    }
    let step = match journey.count {
        Some(_) if count > 1.0 => (last - first) / (count - 1.0),
        Some(_) => 0.0,
        None => 1.0 / journey.fps,
    };
    Ok((0..count as u32).map(|frame| first + step * f64::from(frame)).collect())
}

fn open_metrics(path: &Path) -> Result<Writer<BufWriter<File>>> {
    let file = File::create(path).map_err(|error| Error::io(path, "create", error))?;
    Writer::new(BufWriter::new(file)).map_err(|error| Error::io(path, "write", error))
}
