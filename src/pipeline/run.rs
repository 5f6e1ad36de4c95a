//! One run over a window: bands of the source to rows of leaf tiles to the sweep, with checkpoints.
//!
//! While a row is worked on, the next band is read.

use std::fs::File;
use std::ops::Range;
use std::path::Path;
use std::time::Instant;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::pipeline::buffers::Buffers;
use crate::pipeline::checkpoint::Checkpoints;
use crate::pipeline::plan::Plan;
use crate::pipeline::reach::{Extent, Reach};
use crate::pipeline::seam::{SeamFile, Seams};
use crate::pipeline::state::{State, difference};
use crate::pipeline::sweep::{Slot, Sweep, TileRow};
use crate::pipeline::tally::Tally;
use crate::pipeline::work::Work;
use crate::pipeline::{BuildOptions, CHECKPOINT, Observer, Stage};
use crate::source::{Nodata, Source, SourceInfo};
use crate::tile::code::{Recipe, max_magnitude};
use crate::tile::{fill, split};
use crate::work_folder::{Earlier, Mark, NewState, WorkFolder};
use crate::writer::ContainerWriter;

/// A window all of whose rows have been through the sweep.
pub struct Done {
    /// Has all tiles that could be finished.
    pub writer: ContainerWriter,
    /// What has been counted.
    pub tally: Tally,
    /// The state to be kept with a piece.
    state: Vec<u8>,
}

impl Done {
    /// Nothing left to be merged.
    pub fn new(writer: ContainerWriter, tally: Tally) -> Self {
        Self { writer, tally, state: Vec::new() }
    }

    /// Gives the work folder the output's name.
    pub fn into_piece(self) -> Result<()> {
        self.writer.finish_piece(&self.state)
    }
}

/// A work folder that has been taken, and what is to be done in it.
pub struct Begun {
    work: WorkFolder,
    /// How far it is.
    pub state: State,
    seams: Seams,
    resumed: bool,
}

impl Begun {
    /// Takes the work folder of `output`, with what an earlier build of the same window left there, and completes the plan.
    /// `strips` are kept with a new state; `largest` is the largest height of the source if that is known.
    pub fn new(
        source: &dyn Source,
        output: &Path,
        options: &BuildOptions,
        observer: &dyn Observer,
        plan: &mut Plan,
        window: Extent,
        largest: Option<f64>,
    ) -> Result<Self> {
        let fingerprint = source.fingerprint()?;
        let earlier = match (options.resume, options.force) {
            (true, _) => Earlier::Resume,
            (false, true) => Earlier::Discard,
            (false, false) => Earlier::Refuse,
        };
        let work = WorkFolder::take(output, options.force, earlier)?;
        let mut seams = Seams::default();
        let mut state = State {
            tool: concat!("relevo ", env!("CARGO_PKG_VERSION")).to_owned(),
            fingerprint,
            info: source.info().clone(),
            options: options.clone(),
            next: window.rows.start,
            window,
            strips: Vec::new(),
            largest: 0.0,
            mark: Mark::default(),
            seam: ("seam-0".to_owned(), 0),
            tally: Tally::new(plan),
        };
        let resumed = work.has_state();
        if resumed {
            let earlier = State::read(work.folder(), &mut seams)?;
            earlier.check_same(&state, work.folder())?;
            state = State { options: state.options, ..earlier };
        } else {
            state.largest = match largest {
                Some(largest) => largest,
                None => self::largest(source, options, observer, plan)?,
            };
        }
        plan.recipe = recipe(source.info(), options, state.largest)?;
        Ok(Self { work, state, seams, resumed })
    }

    /// True if nothing has been done yet.
    pub fn is_new(&self) -> bool {
        !self.resumed
    }

    /// The folder, to be worked in by others.
    pub fn into_work(self) -> (WorkFolder, State) {
        (self.work, self.state)
    }

    /// Runs over the window.
    pub fn run(
        self,
        source: &dyn Source,
        options: &BuildOptions,
        observer: &dyn Observer,
        plan: &Plan,
    ) -> Result<Done> {
        let Self { work, mut state, seams, resumed } = self;
        let writer =
            if resumed { ContainerWriter::resume(work, &state.mark)? } else { ContainerWriter::begin(work)? };
        // The old seam file belongs to the old state until there is a new one.
        let generation: u64 = state.seam.0.rsplit('-').next().and_then(|n| n.parse().ok()).unwrap_or(0);
        let name = format!("seam-{}", generation + u64::from(resumed));
        let seam = SeamFile::create(writer.store().folder().path(&name))?;
        state.seam = (name, 0);
        let reach = Reach::new(plan, &state.window);
        let buffers = Buffers::default();
        let sweep = Sweep::new((plan, &buffers), reach, (writer, state.tally.clone()), seams, seam);
        let checkpoints = Checkpoints::new(options.checkpoint.unwrap_or(CHECKPOINT), resumed);
        let window = state.window.clone();
        let mut run = Run { source, plan, buffers: &buffers, observer, window, state, sweep, checkpoints };
        let result = run.rows();
        run.end(result)
    }
}

/// The largest height, which quantising needs first: one more pass over the source.
fn largest(source: &dyn Source, options: &BuildOptions, observer: &dyn Observer, plan: &Plan) -> Result<f64> {
    let info = source.info();
    let nodata = Nodata::new(options.nodata.or(info.nodata), info.sample_type);
    let mut largest = 0.0_f64;
    if options.precision_m.is_none() {
        return Ok(largest);
    }
    for y in 0..plan.rows_of_tiles(plan.levels) {
        if observer.cancelled() {
            return Err(Error::Interrupted);
        }
        for run in plan.occupied.runs(y, &(0..u32::MAX)) {
            let (columns, rows) =
                (plan.samples_of(&run, info.width), plan.samples_of(&(y..y + 1), info.height));
            largest = largest.max(max_magnitude(&source.read_window(columns, rows)?, nodata));
        }
        observer.rows(Stage::Scan, plan.sample_rows(y), u64::from(info.height));
    }
    Ok(largest)
}

/// The recipe of the samples.
pub fn recipe(info: &SourceInfo, options: &BuildOptions, largest: f64) -> Result<Recipe> {
    let info = SourceInfo { nodata: options.nodata.or(info.nodata), ..info.clone() };
    match options.precision_m {
        None => Ok(Recipe::lossless(&info)),
        Some(precision) => Recipe::quantised(&info, precision, largest),
    }
}

struct Run<'a> {
    source: &'a dyn Source,
    plan: &'a Plan,
    buffers: &'a Buffers,
    observer: &'a dyn Observer,
    window: Extent,
    state: State,
    sweep: Sweep<'a>,
    checkpoints: Checkpoints,
}

impl Run<'_> {
    /// Sends all rows of the window, and those around it, through the sweep.
    fn rows(&mut self) -> Result<()> {
        for y in self.window.rows.start..self.state.next {
            self.sweep.pass(y)?;
        }
        let last = self.plan.rows_of_tiles(self.plan.levels);
        if self.state.next < self.window.rows.end {
            let mut rows = self.state.next.saturating_sub(1)..(self.window.rows.end + 1).min(last);
            let (plan, buffers) = (self.plan, self.buffers);
            let bands = Bands { source: self.source, plan, buffers, window: self.window.clone() };
            let mut row = rows.next().map(|y| bands.row(y, self.state.next));
            while let Some(this) = row.take() {
                if self.observer.cancelled() {
                    return Err(Error::Interrupted);
                }
                let (this, next) = (this?, rows.next());
                let (y, first) = (this.y, self.state.next);
                let sweep = &mut self.sweep;
                let (pushed, read) = rayon::join(|| sweep.push(this), || next.map(|y| bands.row(y, first)));
                pushed?;
                row = read;
                self.observer.rows(Stage::Build, self.plan.sample_rows(y), u64::from(self.plan.height));
                if self.window.rows.contains(&y) && y > self.state.next && self.checkpoints.is_due()? {
                    self.checkpoint(y)?;
                }
            }
            self.check_source()?;
        }
        self.sweep.finish()?;
        self.state.next = self.window.rows.end;
        Ok(())
    }

    /// Writes the state, of which the rows before `next` are finished.
    fn checkpoint(&mut self, next: u32) -> Result<()> {
        let begun = Instant::now();
        self.check_source()?;
        let mut new = NewState::create(self.sweep.writer().store().folder().folder())?;
        let files = self.snapshot(next, &mut |bytes| new.append(bytes))?;
        self.checkpoints.publish(files, new, begun);
        Ok(())
    }

    /// Gives `put` the state as bytes; gives back the files to be synced before it counts.
    fn snapshot(&mut self, next: u32, put: &mut dyn FnMut(&[u8]) -> Result<()>) -> Result<Vec<File>> {
        self.sweep.settle()?;
        let mark = self.sweep.writer().store_mut().mark()?;
        let mut files = self.sweep.writer().store().files()?;
        let (length, file) = self.sweep.seam().mark()?;
        files.push(file);
        let seam = (self.state.seam.0.clone(), length);
        let state = State { next, mark, seam, tally: self.sweep.tally().clone(), ..self.state.clone() };
        put(&state.encode()?)?;
        self.sweep.standing(put)?;
        Ok(files)
    }

    /// Fails if the source is not what it was when the build began.
    fn check_source(&self) -> Result<()> {
        let now = self.source.fingerprint()?;
        if now == self.state.fingerprint {
            return Ok(());
        }
        let how = difference(&self.state.fingerprint, &now);
        Err(Error::usage(format!("the input has changed while it was read: {how}; begin anew with --force")))
    }

    /// Ends the run, well or not: the folder is kept if there is a state to go on from.
    fn end(mut self, result: Result<()>) -> Result<Done> {
        let result = result.and_then(|()| {
            self.checkpoints.wait()?;
            let mut state = Vec::new();
            let files = self.snapshot(self.state.next, &mut |bytes| {
                state.extend_from_slice(bytes);
                Ok(())
            })?;
            if self.checkpoints.is_written() {
                // Putting the file together may fail too.
                let mut new = NewState::create(self.sweep.writer().store().folder().folder())?;
                new.append(&state)?;
                self.checkpoints.publish(files, new, Instant::now());
            }
            Ok(state)
        });
        let waited = self.checkpoints.wait();
        if self.checkpoints.is_written() {
            self.sweep.writer().store_mut().folder_mut().keep();
        }
        let state = result?;
        waited?;
        let (writer, tally) = self.sweep.into_writer();
        Ok(Done { writer, tally, state })
    }
}

/// The bands of the source that a window needs.
struct Bands<'a> {
    source: &'a dyn Source,
    plan: &'a Plan,
    buffers: &'a Buffers,
    window: Extent,
}

impl Bands<'_> {
    /// Row `y` of leaf tiles, with the tiles beside the window; those in rows before `first` are only looked at.
    fn row(&self, y: u32, first: u32) -> Result<TileRow> {
        let (plan, spares, info) = (self.plan, &self.buffers.lattices, self.source.info());
        let columns = self.window.columns.start.saturating_sub(1)
            ..(self.window.columns.end + 1).min(plan.columns_of_tiles(plan.levels));
        let rows = plan.samples_of(&(y..y + 1), info.height);
        let own = |x: u32| y >= first && self.window.contains(x, y);
        let mut slots = Vec::new();
        for run in plan.occupied.runs(y, &columns) {
            let samples = plan.samples_of(&run, info.width);
            let window = self.source.read_window(samples.clone(), rows.clone())?;
            slots.par_extend(run.clone().into_par_iter().filter_map(|x| {
                let local = (x - run.start) as usize;
                let mut lattice = spares.take(plan.tile);
                if !split::leaf((&window, samples.len()), local, plan.tile, &plan.recipe, &mut lattice) {
                    spares.give(plan.tile, lattice);
                    return None;
                }
                if !own(x) {
                    return Some((x, Slot::Seen(lattice)));
                }
                fill::inside(&mut lattice);
                Some((x, Slot::Work(Box::new(Work::leaf(lattice)))))
            }));
            self.source.take_back(window);
        }
        Ok(TileRow { y, slots })
    }
}

impl Plan {
    /// Samples along one axis, of which there are `most`, of some leaf tiles, the shared ones at both ends included.
    pub(super) fn samples_of(&self, tiles: &Range<u32>, most: u32) -> Range<u32> {
        let size = self.tile as u64;
        let end = (u64::from(tiles.end) * size + 1).min(u64::from(most));
        tiles.start * self.tile as u32..end as u32
    }

    /// Raster rows down to the end of a row of leaf tiles.
    fn sample_rows(&self, y: u32) -> u64 {
        self.samples_of(&(0..y + 1), self.height).end.into()
    }
}
