//! Renders pictures and measures frames without a window.

use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::time::Instant;

use relevo_core::container::Reader;
use relevo_core::geo::CrsKind;
use relevo_core::output::{Inputs, NewFile, check_apart};
use relevo_core::select::{EdgeRule, Frame, Levels, Selection, View};
use relevo_core::{Error, Result, observed, surface};

use crate::camera::{FOV, Pose, moved, near};
use crate::flyover;
use crate::governor::{Governor, Load};
use crate::gpu::{Look, RenderTarget, target};
use crate::metrics::{Row, Writer};
use crate::path::CameraPath;
use crate::scene::Terrain;
use crate::settings::{Coordinates, Lod, Settings};
use crate::stage::{Drawing, Stage, headless_gpu, promised};

/// Options of a run along a camera path.
#[derive(Clone, Debug, Default)]
pub struct Journey {
    /// The path's file; `None`: a flight over the terrain.
    pub path: Option<PathBuf>,
    /// Number of frames, evenly from the first key to the last; `None`: as `fps` says.
    pub count: Option<u32>,
    /// Frames for each second of the path.
    pub fps: f64,
    /// Folder for one PNG a frame.
    pub frames: Option<PathBuf>,
    /// CSV file with one row a frame.
    pub metrics: Option<PathBuf>,
    /// Draw what is loaded at that moment instead of waiting for everything.
    pub streaming: bool,
    /// Measure the error of what is drawn.
    pub observe: bool,
    /// Replace frames and metrics that are there.
    pub force: bool,
}

/// Largest number of frames of a run.
const MOST_FRAMES: f64 = 1e6;

/// A tolerance in pixels that only full resolution meets.
const NOTHING: f64 = 1e-9;

/// Returns the levels that draw every patch at the full resolution of its tile.
fn full_resolution(selection: &Selection, rule: EdgeRule) -> Levels {
    let patches = (selection.patches * selection.patches) as usize;
    let base = selection.tiles.iter().flat_map(|tile| std::iter::repeat_n(tile.exponent, patches)).collect();
    Levels::from_base(selection, base, rule)
}

/// Options of a single picture.
#[derive(Clone, Copy, Debug, Default)]
pub struct Shot {
    /// Where the camera stands: two coordinates and a height in metres.
    pub eye: Option<[f64; 3]>,
    /// What it looks at, in the same terms.
    pub target: Option<[f64; 3]>,
    /// The system of the two coordinates.
    pub coordinates: Coordinates,
    /// Replace a picture that is there.
    pub force: bool,
}

impl Shot {
    /// Returns the pose: what is not given is that of an overview. The eye is raised above the
    /// ground.
    fn pose(&self, reader: &Reader, frame: &Frame, report: &mut dyn FnMut(&str)) -> Result<Pose> {
        let all = flyover::overview(reader, frame.exaggeration)?;
        let place = |place: Option<[f64; 3]>, or: [f64; 3]| {
            place.map_or(Ok(or), |place| lattice(place, self.coordinates, reader))
        };
        let mut pose = Pose { eye: place(self.eye, all.eye)?, target: place(self.target, all.target)? };
        if pose.eye == pose.target {
            return Err(Error::usage("--target: it is where --eye is"));
        }
        let [column, row, _] = pose.eye;
        if let Some(ground) = surface::height_at_sample(reader, column, row)? {
            let least = ground * frame.exaggeration + CLEARANCE * near(frame);
            let missing = least - pose.places(frame).0[2];
            if missing > 0.0 {
                pose.eye[2] += missing;
                let (ground, raised) = (ground.round(), pose.eye[2].round());
                report(&format!(
                    "--eye is below the ground, which is {ground} m high there: it is raised to {raised} m"
                ));
            }
        }
        Ok(pose)
    }
}

/// Least height of a camera above the ground, in distances of the near plane.
const CLEARANCE: f64 = 4.0;

/// Returns column, row and height of a place.
fn lattice([x, y, height]: [f64; 3], coordinates: Coordinates, reader: &Reader) -> Result<[f64; 3]> {
    let geo = reader.geo();
    let (x, y) = match coordinates {
        Coordinates::Samples => return Ok([x, y, height]),
        Coordinates::Crs => (x, y),
        Coordinates::LonLat if geo.crs.kind == CrsKind::Geographic => {
            (x.to_radians() / geo.crs.unit, y.to_radians() / geo.crs.unit)
        }
        Coordinates::LonLat => {
            return Err(Error::usage(format!(
                "{}: its coordinates are not longitude and latitude; give them in its own system (--coordinates crs)",
                reader.path().display()
            )));
        }
    };
    let place = geo.transform.and_then(|_| geo.sample_from_world(x, y));
    let (column, row) = place.ok_or_else(|| {
        let name = reader.path().display();
        Error::usage(format!(
            "{name}: it has no usable georeference; give columns and rows (--coordinates samples)"
        ))
    })?;
    Ok([column, row, height])
}

/// Fails if a file is there that may not be replaced.
fn check_free(file: &Path, force: bool) -> Result<()> {
    if force || !file.exists() {
        return Ok(());
    }
    Err(Error::usage(format!("{}: exists already; --force replaces it", file.display())))
}

/// Fails if a run of `frames` frames would replace a file that it reads, or one that must stay.
fn check_outputs(journey: &Journey, inputs: &Inputs, frames: usize) -> Result<()> {
    let folder = journey.frames.iter();
    let pictures = folder.flat_map(|folder| (0..frames as u32).map(|frame| folder.join(frame_name(frame))));
    pictures.chain(journey.metrics.clone()).try_for_each(|file| {
        inputs.check(&file)?;
        check_free(&file, journey.force)
    })
}

/// Returns the file name of a frame.
fn frame_name(frame: u32) -> String {
    format!("{frame:06}.png")
}

/// Figures of all frames of a run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Name of the graphics adapter.
    pub adapter: String,
    /// Number of frames.
    pub frames: u32,
    /// Largest promised error of a frame, pixels.
    pub promised: f64,
    /// Largest observed error of a frame, pixels, if it was measured.
    pub observed: Option<f64>,
    /// Triangles of all frames.
    pub triangles: u64,
    /// Milliseconds that all frames took.
    pub frame_ms: f64,
    /// Most bytes on the GPU.
    pub gpu_bytes: u64,
}

/// Draws every frame of a camera path. `report` is called with a sentence for each tile that cannot
/// be read.
pub fn journey(settings: &Settings, journey: &Journey, report: &mut dyn FnMut(&str)) -> Result<Summary> {
    let inputs = Inputs::new(std::iter::once(&settings.file).chain(&journey.path));
    let terrain = Terrain::open(&settings.file, settings.ram_cache)?;
    let path = match &journey.path {
        Some(path) => CameraPath::read(path, terrain.reader().geo())?,
        None => flyover::path(terrain.reader(), settings.exaggeration)?,
    };
    let times = times(&path, journey)?;
    check_outputs(journey, &inputs, times.len())?;
    if let Some(folder) = &journey.frames {
        std::fs::create_dir_all(folder).map_err(|error| Error::io(folder, "create", error))?;
    }
    let open = |file: &PathBuf| open_metrics(file, journey.force);
    let mut rows = journey.metrics.as_ref().map(open).transpose()?;
    let mut offscreen = Offscreen::new(settings, terrain)?;
    let mut summary = Summary { adapter: offscreen.stage.gpu.name(), ..Summary::default() };
    let mut governor = Governor::new(settings.target, settings.tolerance);
    let mut tolerance = settings.tolerance;
    let mut before: Option<(View, Instant)> = None;
    for (frame, time) in (0..).zip(times) {
        let view = path.at(time).view(offscreen.stage.scene.frame(), path.fov, settings.size);
        let begun = Instant::now();
        let mut row = offscreen.frame(&view, tolerance, journey)?;
        (row.frame, row.time) = (frame, time);
        offscreen.stage.scene.take_problems().iter().for_each(|problem| report(problem));
        if let Some(folder) = &journey.frames {
            let file = folder.join(frame_name(frame));
            inputs.check(&file)?;
            offscreen.target.save(&offscreen.stage.gpu, &file, journey.force)?;
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
    if let (Some(rows), Some(file)) = (rows, &journey.metrics) {
        let whole = rows.into_inner().into_inner();
        whole.map_err(|error| Error::io(file, "write", error.into_error()))?.commit()?;
    }
    Ok(summary)
}

/// Draws one picture with everything loaded and writes it as PNG.
pub fn shot(settings: &Settings, shot: Shot, output: &Path, report: &mut dyn FnMut(&str)) -> Result<Summary> {
    if !output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png")) {
        let name = output.display();
        return Err(Error::usage(format!("{name}: expected a name that ends in .png, which pictures are")));
    }
    check_apart(output, std::slice::from_ref(&settings.file))?;
    check_free(output, shot.force)?;
    let terrain = Terrain::open(&settings.file, settings.ram_cache)?;
    let frame = Frame { exaggeration: settings.exaggeration, ..Frame::of(terrain.reader()) };
    let pose = shot.pose(terrain.reader(), &frame, report)?;
    let mut offscreen = Offscreen::new(settings, terrain)?;
    let view = pose.view(offscreen.stage.scene.frame(), FOV, settings.size);
    let row = offscreen.frame(&view, settings.tolerance, &Journey::default())?;
    offscreen.stage.scene.take_problems().iter().for_each(|problem| report(problem));
    offscreen.target.save(&offscreen.stage.gpu, output, shot.force)?;
    let mut summary = Summary { adapter: offscreen.stage.gpu.name(), ..Summary::default() };
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

/// A stage that draws on a texture.
struct Offscreen {
    stage: Stage,
    lod: Lod,
    target: RenderTarget,
    look: Look,
}

impl Offscreen {
    fn new(settings: &Settings, terrain: Terrain) -> Result<Self> {
        let gpu = headless_gpu(&settings.adapter)?;
        let stage = Stage::new(gpu, terrain, settings, settings.size, target::FORMAT)?;
        let target = RenderTarget::new(&stage.gpu, settings.size, target::FORMAT)?;
        let look = stage.look(settings);
        Ok(Self { stage, lod: settings.lod, target, look })
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
        stage.draw(&chosen, &drawing, self.target.view(), self.target.size())?;
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

/// Returns the error for a leaf that cannot be read: without it no error can be measured.
fn unmeasured(why: Error) -> Error {
    Error::usage(format!("--observe needs every sample in view: {why}"))
}

/// Returns the times of the frames in seconds.
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

fn open_metrics(path: &Path, force: bool) -> Result<Writer<BufWriter<NewFile>>> {
    Writer::new(BufWriter::new(NewFile::create(path, force)?))
        .map_err(|error| Error::io(path, "write", error))
}
