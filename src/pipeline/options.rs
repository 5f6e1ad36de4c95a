//! [`BuildOptions`]: what a build is asked for.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use wincode::{SchemaRead, SchemaWrite};

use crate::container::layout::Metric;
use crate::error::{Error, Result};

/// What a build is asked for. Options that do not change the file are not kept with the state of a
/// build.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, SchemaRead, SchemaWrite)]
pub struct BuildOptions {
    /// Intervals of a tile, a power of two in 16..=1024.
    pub tile: u32,
    /// Intervals of a patch, a power of two in 4..=64, at most `tile`.
    pub patch: u32,
    /// Which geometric error.
    pub metric: Metric,
    /// Quantise to this many metres: heights are then off by at most half of it. `None`: lossless.
    pub precision_m: Option<f64>,
    /// Value that means void, instead of what the source says.
    pub nodata: Option<f64>,
    /// True if a warning is an error: then nothing is built.
    #[serde(skip)]
    #[wincode(skip)]
    pub strict: bool,
    /// Threads; `None`: one for each core.
    #[serde(skip)]
    #[wincode(skip)]
    pub jobs: Option<usize>,
    /// Replace an existing output, and an unfinished build of it.
    #[serde(skip)]
    #[wincode(skip)]
    pub force: bool,
    /// Go on with an unfinished build, if there is one.
    #[serde(skip)]
    #[wincode(skip)]
    pub resume: bool,
    /// Time between two checkpoints. `None`: [`CHECKPOINT`].
    #[serde(skip)]
    #[wincode(skip)]
    pub checkpoint: Option<Duration>,
    /// Bytes of memory that the build keeps within, in several passes over strips of columns if it
    /// must. `None`: no limit.
    #[serde(skip)]
    #[wincode(skip)]
    pub memory: Option<u64>,
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self {
            tile: 256,
            patch: 32,
            metric: Metric::Bound,
            precision_m: None,
            nodata: None,
            strict: false,
            jobs: None,
            force: false,
            resume: false,
            checkpoint: None,
            memory: None,
        }
    }
}

/// Time between two checkpoints unless told otherwise: what is lost at most when a build is killed.
pub const CHECKPOINT: Duration = Duration::from_secs(4);

impl BuildOptions {
    /// Fails if an option has a value that no build can have.
    pub(super) fn check(&self) -> Result<()> {
        check_power("`tile`", self.tile, 16, 1024)?;
        check_power("`patch`", self.patch, 4, 64)?;
        if self.patch > self.tile {
            return Err(Error::usage(format!(
                "`patch` {} is larger than `tile` {}; a tile holds at least one patch",
                self.patch, self.tile
            )));
        }
        match self.precision_m {
            Some(precision) if !(precision.is_finite() && precision > 0.0) => {
                Err(Error::usage(format!("`precision_m` {precision}: expected a length above 0, in metres")))
            }
            _ => Ok(()),
        }
    }

    /// The first option that would make another file, and both its values.
    pub(super) fn difference(&self, other: &Self) -> Option<String> {
        let differ =
            |name: &str, a: String, b: String| (a != b).then(|| format!("{name} was {a}, now it is {b}"));
        let number = |value: Option<f64>| value.map_or("not given".to_owned(), |value| value.to_string());
        differ("`tile`", self.tile.to_string(), other.tile.to_string())
            .or_else(|| differ("`patch`", self.patch.to_string(), other.patch.to_string()))
            .or_else(|| differ("`metric`", self.metric.as_str().to_owned(), other.metric.as_str().to_owned()))
            .or_else(|| differ("`precision_m`", number(self.precision_m), number(other.precision_m)))
            .or_else(|| differ("`nodata`", number(self.nodata), number(other.nodata)))
    }
}

fn check_power(option: &str, value: u32, low: u32, high: u32) -> Result<()> {
    if value.is_power_of_two() && (low..=high).contains(&value) {
        return Ok(());
    }
    Err(Error::usage(format!("{option} {value}: expected a power of two from {low} to {high}")))
}
