//! What a verification found: checks with counts, and the first problems of each with their places.
//!
//! A finding is data. A check that could not be made says why in its note; it is not a problem by
//! itself.

use std::fmt;

use serde::{Serialize, Serializer};

use crate::error::{Error, Result};
use crate::tile::TileId;

/// Everything that was checked.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct VerifyReport {
    /// The checks in the order in which they were made.
    pub checks: Vec<Check>,
    /// How close the stored errors are to the true ones; empty unless they were recomputed.
    pub tightness: Vec<Tightness>,
}

impl VerifyReport {
    /// Problems of all checks.
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
    /// Its name: `borders`.
    pub name: &'static str,
    /// What it counts: `samples`.
    pub unit: &'static str,
    /// How many of these it has looked at.
    pub looked_at: u64,
    /// How many problems it has found.
    pub problems: u64,
    /// The first of them, at most as many as the options say.
    pub first: Vec<Problem>,
    /// Why it was not made, or not fully; empty otherwise.
    pub note: String,
    #[serde(skip)]
    keep: usize,
}

impl Check {
    /// A check that has looked at nothing, and keeps the first `keep` problems.
    pub(super) fn new(name: &'static str, unit: &'static str, keep: usize) -> Self {
        Self { name, unit, looked_at: 0, problems: 0, first: Vec::new(), note: String::new(), keep }
    }

    /// A check of the same name for a part of the work; [`Check::join`] takes it back.
    pub(super) fn part(&self) -> Self {
        Self::new(self.name, self.unit, self.keep)
    }

    /// Adds what was found in a part of the work. Parts joined in a fixed order give a fixed
    /// report.
    pub(super) fn join(&mut self, part: Self) {
        self.looked_at += part.looked_at;
        self.problems += part.problems;
        let room = self.keep.saturating_sub(self.first.len());
        self.first.extend(part.first.into_iter().take(room));
    }

    /// Counts a problem. Its words are made only if they are kept.
    pub(super) fn fail(&mut self, place: Place, expected: impl ToString, got: impl ToString) {
        self.problems += 1;
        if self.first.len() < self.keep {
            self.first.push(Problem { place, expected: expected.to_string(), got: got.to_string() });
        }
    }

    /// Counts a problem unless it is none.
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

    /// Counts a problem that the file has; passes on those that are not its fault.
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

/// Something that is not as it should be.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// Where.
    pub place: Place,
    /// What should be there.
    pub expected: String,
    /// What is.
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
    /// The tile, `tile_id` and `level/x/y` in JSON, where a `tile` is a size.
    #[serde(rename = "tile_id", serialize_with = "as_text", skip_serializing_if = "Option::is_none")]
    pub tile: Option<TileId>,
    /// Column and row of the patch in its tile; a `patch` is a size in JSON.
    #[serde(rename = "patch_place", skip_serializing_if = "Option::is_none")]
    pub patch: Option<[u32; 2]>,
    /// The step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step: Option<u32>,
    /// Column and row of the sample in the lattice of full resolution.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sample: Option<[u64; 2]>,
    /// Anything else: a section, a member, a quantity.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub part: String,
}

impl Place {
    /// A part of the file as a whole.
    pub(super) fn of(part: impl Into<String>) -> Self {
        Self { part: part.into(), ..Self::default() }
    }

    /// A tile.
    pub(super) fn tile(id: TileId) -> Self {
        Self { tile: Some(id), ..Self::default() }
    }

    /// Patch `index` of `side x side` of the tile, at a step.
    pub(super) fn patch(self, index: usize, side: usize, step: usize) -> Self {
        let patch = [(index % side) as u32, (index / side) as u32];
        Self { patch: Some(patch), step: Some(step as u32), ..self }
    }

    /// A sample of the lattice.
    pub(super) fn sample(self, column: u64, row: u64) -> Self {
        Self { sample: Some([column, row]), ..self }
    }

    /// With a part named.
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

/// Stored errors over true ones, of one level and step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Tightness {
    /// The level.
    pub level: u8,
    /// The step.
    pub step: u32,
    /// Vertical errors.
    pub vertical: Option<Ratios>,
    /// Horizontal errors. The true one is estimated from below, to about half a sample.
    pub horizontal: Option<Ratios>,
}

/// A distribution of stored / true, over the patches whose true error is not small: above 1/256 of
/// the largest of the level and step. Since errors are monotone, the true one is taken as the
/// largest of this and all finer steps. Percentiles by nearest rank.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ratios {
    /// Patches counted.
    pub patches: u64,
    /// Least.
    pub min: f64,
    /// Middle.
    pub median: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Largest.
    pub max: f64,
}

impl Ratios {
    /// Of stored / true; `None` if there are none.
    pub(super) fn of(ratios: &[f32]) -> Option<Self> {
        let mut ratios: Vec<f64> = ratios.iter().copied().map(f64::from).collect();
        ratios.sort_unstable_by(f64::total_cmp);
        let rank = |percent: usize| ratios.get((ratios.len() * percent).div_ceil(100).max(1) - 1).copied();
        let (min, max) = (rank(0)?, rank(100)?);
        Some(Self { patches: ratios.len() as u64, min, median: rank(50)?, p99: rank(99)?, max })
    }
}
