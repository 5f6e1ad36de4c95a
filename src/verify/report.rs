//! The result of a verification: checks with counts, and the first problems of each with their
//! places.
//!
//! Problems are data. A check that could not be made gives the reason in its note; that is not a
//! problem.

use std::fmt;

use serde::{Serialize, Serializer};

use crate::error::{Error, Result};
use crate::tile::TileId;

/// The result of a verification.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct VerifyReport {
    /// The checks in the order in which they were made.
    pub checks: Vec<Check>,
    /// How close stored errors are to the true ones; empty unless these were recomputed.
    pub tightness: Vec<Tightness>,
}

impl VerifyReport {
    /// Number of problems of all checks.
    pub fn problems(&self) -> u64 {
        self.checks.iter().map(|check| check.problems).sum()
    }

    /// True if no check found a problem.
    pub fn is_good(&self) -> bool {
        self.problems() == 0
    }

    /// The check of this name, if it was made.
    pub fn check(&self, name: &str) -> Option<&Check> {
        self.checks.iter().find(|check| check.name == name)
    }
}

/// One check.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Check {
    /// Name of the check, such as `borders`.
    pub name: &'static str,
    /// Name of the things that were checked, such as `samples`.
    pub unit: &'static str,
    /// Number of things checked.
    pub looked_at: u64,
    /// Number of problems found.
    pub problems: u64,
    /// The first problems, as many as the options allow.
    pub first: Vec<Problem>,
    /// The reason why it was not made, or not completely; else empty.
    pub note: String,
    #[serde(skip)]
    keep: usize,
}

impl Check {
    /// A check without any result yet, which keeps the first `keep` problems.
    pub(super) fn new(name: &'static str, unit: &'static str, keep: usize) -> Self {
        Self { name, unit, looked_at: 0, problems: 0, first: Vec::new(), note: String::new(), keep }
    }

    /// An empty check of the same name, for a part of the work; [`Check::join`] adds its result.
    pub(super) fn part(&self) -> Self {
        Self::new(self.name, self.unit, self.keep)
    }

    /// Adds the result of a part of the work. Joining parts in a fixed order gives a fixed report.
    pub(super) fn join(&mut self, part: Self) {
        self.looked_at += part.looked_at;
        self.problems += part.problems;
        let room = self.keep.saturating_sub(self.first.len());
        self.first.extend(part.first.into_iter().take(room));
    }

    /// Counts a problem. Its text is made only if it is kept.
    pub(super) fn fail(&mut self, place: Place, expected: impl ToString, got: impl ToString) {
        self.problems += 1;
        if self.first.len() < self.keep {
            self.first.push(Problem { place, expected: expected.to_string(), got: got.to_string() });
        }
    }

    /// Counts a problem if `is` is false.
    pub(super) fn demand(
        &mut self,
        is: bool,
        place: impl FnOnce() -> Place,
        expected: impl ToString,
        got: impl ToString,
    ) {
        if !is {
            self.fail(place(), expected, got);
        }
    }

    /// Counts a problem if the error is damage of the file; returns other errors.
    pub(super) fn take<T>(&mut self, result: Result<T>, place: Place) -> Result<Option<T>> {
        match result {
            Ok(value) => Ok(Some(value)),
            Err(Error::Format { place: part, expected, got, .. }) => {
                self.fail(place.part(part), expected, got);
                Ok(None)
            }
            Err(Error::Limit { what, got, max, .. }) => {
                self.fail(place.part(what), format!("at most {max}"), got);
                Ok(None)
            }
            Err(Error::Usage { what }) => {
                self.fail(place, "a file that agrees with itself", what);
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }
}

/// A difference between what a file should have and what it has.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// Place of the problem.
    pub place: Place,
    /// What should be there.
    pub expected: String,
    /// What is there.
    pub got: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let place = self.place.to_string();
        let colon = if place.is_empty() { "" } else { ": " };
        write!(f, "{place}{colon}expected {}, got {}", self.expected, self.got)
    }
}

/// A place in a file, as exact as it is known.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Place {
    /// The tile; in JSON `tile_id` and `level/x/y`, since `tile` is a size there.
    #[serde(rename = "tile_id", serialize_with = "as_text", skip_serializing_if = "Option::is_none")]
    pub tile: Option<TileId>,
    /// Column and row of the patch in its tile; in JSON `patch` is a size.
    #[serde(rename = "patch_place", skip_serializing_if = "Option::is_none")]
    pub patch: Option<[u32; 2]>,
    /// The step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step: Option<u32>,
    /// Column and row of the sample in the lattice of full resolution.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sample: Option<[u64; 2]>,
    /// Another part of the file: a section, a member, a quantity.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub part: String,
}

impl Place {
    /// The place of a part of the file.
    pub(super) fn of(part: impl Into<String>) -> Self {
        Self { part: part.into(), ..Self::default() }
    }

    /// The place of a tile.
    pub(super) fn tile(id: TileId) -> Self {
        Self { tile: Some(id), ..Self::default() }
    }

    /// The place narrowed to patch `index` of `side x side` patches, at a step.
    pub(super) fn patch(self, index: usize, side: usize, step: usize) -> Self {
        let patch = [(index % side) as u32, (index / side) as u32];
        Self { patch: Some(patch), step: Some(step as u32), ..self }
    }

    /// The place narrowed to a sample of the lattice.
    pub(super) fn sample(self, column: u64, row: u64) -> Self {
        Self { sample: Some([column, row]), ..self }
    }

    /// The place with a part named.
    pub(super) fn part(self, part: impl Into<String>) -> Self {
        let mut part = part.into();
        // An error that names the tile itself need not name it twice.
        if let Some(rest) =
            self.tile.and_then(|id| part.strip_prefix(&format!("tile {id}")).map(str::to_owned))
            && !rest.starts_with(|c: char| c.is_ascii_alphanumeric())
        {
            rest.trim_start_matches([',', ':', ' ']).clone_into(&mut part);
        }
        Self { part, ..self }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut parts = Vec::new();
        parts.extend(self.tile.map(|id| format!("tile {id}")));
        parts.extend(self.patch.map(|[x, y]| format!("patch {x},{y}")));
        parts.extend(self.step.map(|step| format!("step {step}")));
        parts.extend(self.sample.map(|[column, row]| format!("sample {column},{row}")));
        parts.extend(Some(self.part.clone()).filter(|part| !part.is_empty()));
        f.write_str(&parts.join(", "))
    }
}

#[expect(clippy::ref_option, reason = "serde's signature")]
fn as_text<S: Serializer>(id: &Option<TileId>, serializer: S) -> Result<S::Ok, S::Error> {
    match id {
        Some(id) => serializer.collect_str(id),
        None => serializer.serialize_none(),
    }
}

/// Ratios of stored to true errors, of one level and step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Tightness {
    /// The level.
    pub level: u8,
    /// The step.
    pub step: u32,
    /// Ratios of vertical errors.
    pub vertical: Option<Ratios>,
    /// Ratios of horizontal errors. The true error is estimated from below, to about half a sample.
    pub horizontal: Option<Ratios>,
}

/// Distribution of the ratios of stored to true errors. Only patches count whose true error is
/// above 1/256 of the largest of the level and step. Since errors are monotone, the true error is
/// the largest of this and all finer steps. Percentiles are by nearest rank.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ratios {
    /// Number of patches.
    pub patches: u64,
    /// Minimum.
    pub min: f64,
    /// Median.
    pub median: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Maximum.
    pub max: f64,
}

impl Ratios {
    /// The distribution of some ratios; `None` if there are none.
    pub(super) fn of(ratios: &[f32]) -> Option<Self> {
        let mut ratios: Vec<f64> = ratios.iter().copied().map(f64::from).collect();
        ratios.sort_unstable_by(f64::total_cmp);
        let rank = |percent: usize| ratios.get((ratios.len() * percent).div_ceil(100).max(1) - 1).copied();
        let (min, max) = (rank(0)?, rank(100)?);
        Some(Self { patches: ratios.len() as u64, min, median: rank(50)?, p99: rank(99)?, max })
    }
}
