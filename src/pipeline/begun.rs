//! [`Begun`]: a build that has taken its work folder, with what an earlier build left there.

use std::path::Path;

use super::carry::Carried;
use super::job::Job;
use super::plan::recipe;
use super::state::State;
use super::statistics::StatisticsBuilder;
use crate::error::{Error, Result};
use crate::progress::Stage;
use crate::rect::Rect;
use crate::source::Nodata;
use crate::tile::code::max_magnitude;
use crate::work_folder::{Earlier, Mark, WorkFolder};

/// A build whose work folder has been taken.
pub struct Begun {
    /// The folder.
    pub work: WorkFolder,
    /// How far the build is.
    pub state: State,
    /// What an earlier build left for this one.
    pub carried: Carried,
    /// True if an earlier build left a state.
    pub resumed: bool,
}

impl Begun {
    /// Takes the work folder of `output`, with what an earlier build of the same window left there,
    /// and completes the plan. `largest` is the largest height of the source, if that is known.
    pub fn new(job: &mut Job<'_>, output: &Path, window: Rect, largest: Option<f64>) -> Result<Self> {
        let (source, options) = (job.source, job.options);
        let fingerprint = source.fingerprint()?;
        let earlier = match (options.resume, options.force) {
            (true, _) => Earlier::Resume,
            (false, true) => Earlier::Discard,
            (false, false) => Earlier::Refuse,
        };
        let work = WorkFolder::take(output, options.force, earlier)?;
        let mut carried = Carried::default();
        let mut state = State {
            tool: concat!("relevo ", env!("CARGO_PKG_VERSION")).to_owned(),
            fingerprint,
            info: source.info().clone(),
            options: options.clone(),
            next: window.rows.start,
            window,
            passes: Vec::new(),
            largest: 0.0,
            mark: Mark::default(),
            carry: ("seam-0".to_owned(), 0),
            statistics: StatisticsBuilder::new(&job.plan),
        };
        let resumed = work.has_state();
        if resumed {
            let earlier = State::read(work.folder(), &mut carried)?;
            earlier.check_same(&state, work.folder())?;
            state = State { options: state.options, ..earlier };
        } else {
            state.largest = match largest {
                Some(largest) => largest,
                None => self::largest(job)?,
            };
        }
        job.plan.recipe = recipe(source.info(), options, state.largest)?;
        Ok(Self { work, state, carried, resumed })
    }

    /// True if no earlier build left a state.
    pub fn is_new(&self) -> bool {
        !self.resumed
    }

    /// The folder and the state, for a build in several passes.
    pub fn into_work(self) -> (WorkFolder, State) {
        (self.work, self.state)
    }
}

/// The largest height of the source, which quantising needs first. Reads the whole source once.
fn largest(job: &Job<'_>) -> Result<f64> {
    let Job { source, plan, options, progress } = job;
    let info = source.info();
    let nodata = Nodata::new(options.nodata.or(info.nodata), info.sample_type);
    let mut largest = 0.0_f64;
    if options.precision_m.is_none() {
        return Ok(largest);
    }
    let pyramid = &plan.pyramid;
    for y in pyramid.leaves().rows {
        if progress.is_cancelled() {
            return Err(Error::Interrupted);
        }
        for run in plan.occupied.runs(y, &(0..u32::MAX)) {
            let (columns, rows) = (pyramid.sample_columns(&run), pyramid.sample_rows(&(y..y + 1)));
            largest = largest.max(max_magnitude(&source.read_window(columns, rows)?, nodata));
        }
        progress.report(Stage::Scan, pyramid.rows_down_to(y), u64::from(info.height));
    }
    Ok(largest)
}
