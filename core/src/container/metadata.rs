//! The JSON of a container: metadata (section 5 of the specification) and statistics (section 11).
//!
//! A reader ignores members that it does not know. An infinite number is `null` in JSON.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

use serde::de::{SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;

use super::layout::MAX_LEVEL;
use crate::error::{Error, Result};
use crate::error_code::MAX_CODE;
use crate::geo::Crs;

/// Facts for people and for an export. No tile needs them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Metadata {
    /// Program and version that wrote the file.
    pub tool: String,
    /// Coordinate system.
    pub crs: Crs,
    /// True if the source said PixelIsPoint; only an export cares.
    pub pixel_is_point: bool,
    /// West, south, east and north outer pixel edge, if the file is georeferenced.
    pub bounds: Option<[f64; 4]>,
    /// Name of the vertical unit; empty if unknown.
    pub vertical_unit: String,
    /// Where each of `place`, `crs`, `nodata`, `unit`, `scale`, `offset` and `mask` was found, for
    /// people; those that were found nowhere are absent.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub origins: BTreeMap<String, String>,
    /// The rasters that the file was made of; only the first of them if there is no room for all.
    pub sources: Vec<SourceNote>,
    /// How many rasters `sources` leaves out.
    #[serde(skip_serializing_if = "is_zero")]
    pub more_sources: u64,
    /// The options of the build: an object.
    pub options: Value,
    /// The levels, root first.
    pub levels: Vec<LevelNote>,
    /// The imagery layer, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub imagery: Option<ImageryNote>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde calls it")]
fn is_zero(number: &u64) -> bool {
    *number == 0
}

/// The sources and options that an imagery layer was made of.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ImageryNote {
    /// Program and version that made it.
    pub tool: String,
    /// How many pictures the layer was made of.
    pub pictures: u64,
    /// The pictures; only the first of them if there is no room for all.
    pub sources: Vec<PictureSourceNote>,
    /// The options: an object.
    pub options: Value,
}

/// One picture that a layer was made of.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PictureSourceNote {
    /// File name without folders.
    pub name: String,
    /// One line for people.
    pub description: String,
    /// Bands that became grey, or red, green and blue, from 1.
    pub bands: Vec<u32>,
    /// For each band the values that became 0 and 255; empty for 8-bit samples taken as they are.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub stretch: Vec<(f64, f64)>,
    /// The finest level that the picture was resampled to.
    pub level: u8,
}

/// One raster that a file was made of.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct SourceNote {
    /// File name without folders.
    pub name: String,
    /// One line for people.
    pub description: String,
}

/// The summary of a level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LevelNote {
    /// Existing tiles.
    pub tiles: u64,
    /// Bytes of the chunks of these tiles.
    pub bytes: u64,
    /// Largest vertical error of a tile at step 0, metres.
    #[serde(with = "infinite")]
    pub max_vertical_m: f64,
    /// Largest horizontal error of a tile at step 0, metres.
    #[serde(with = "infinite")]
    pub max_horizontal_m: f64,
}

/// Most levels of a file: 0 to the deepest leaf level.
const MAX_LEVELS: usize = MAX_LEVEL as usize + 1;
/// Most steps of a patch: 64 intervals halved down to one.
const MAX_STEPS: usize = 7;
/// Most bins of a histogram: the upper bits of the error codes from 0 to infinity.
const MAX_BINS: usize = (MAX_CODE >> 6) as usize + 1;

/// Distributions of the errors of a file, by level and step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    /// The levels, root first.
    #[serde(deserialize_with = "at_most::<_, _, MAX_LEVELS>")]
    pub levels: Vec<LevelStatistics>,
}

/// Statistics of one level.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LevelStatistics {
    /// The level.
    pub level: u8,
    /// Existing tiles.
    pub tiles: u64,
    /// Their drawable patches.
    pub patches: u64,
    /// Columns of the level's lattice within the raster.
    pub columns: u64,
    /// Rows of the level's lattice within the raster.
    pub rows: u64,
    /// Valid samples of the level's lattice.
    pub valid: u64,
    /// Lowest height in metres; `None` if the level has no valid sample.
    pub min_m: Option<f64>,
    /// Greatest height in metres, likewise.
    pub max_m: Option<f64>,
    /// Bytes of all heights chunks.
    pub heights_bytes: u64,
    /// Bytes of all masks.
    pub masks_bytes: u64,
    /// Bytes of all error tables.
    pub errors_bytes: u64,
    /// The steps, finest first.
    #[serde(deserialize_with = "at_most::<_, _, MAX_STEPS>")]
    pub steps: Vec<StepStatistics>,
}

/// Statistics of one step of a level.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepStatistics {
    /// Metres from sample to sample at this step, east and south: the largest of the level.
    pub spacing_m: [f64; 2],
    /// Vertical errors of the patches.
    pub vertical: ErrorStatistics,
    /// Horizontal errors of the patches.
    pub horizontal: ErrorStatistics,
}

/// Distribution of errors, in metres.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ErrorStatistics {
    /// Patches that have a valid sample in or below them.
    pub count: u64,
    /// Least error.
    #[serde(with = "infinite")]
    pub min: f64,
    /// Mean of the errors.
    #[serde(with = "infinite")]
    pub mean: f64,
    /// Largest error.
    #[serde(with = "infinite")]
    pub max: f64,
    /// Median (nearest rank).
    #[serde(with = "infinite")]
    pub p50: f64,
    /// 90th percentile.
    #[serde(with = "infinite")]
    pub p90: f64,
    /// 99th percentile.
    #[serde(with = "infinite")]
    pub p99: f64,
    /// `(b, count)`: patches whose error code `c` has `c >> 6 = b`; only those with a count.
    #[serde(deserialize_with = "at_most::<_, _, MAX_BINS>")]
    pub histogram: Vec<(u16, u64)>,
}

impl Metadata {
    /// The bytes of the section.
    pub fn encode(&self) -> Result<Vec<u8>> {
        encode(self, "metadata")
    }

    /// The metadata in the bytes of a section.
    pub fn decode(bytes: &[u8]) -> Result<Self> {
        decode(bytes, "metadata")
    }
}

impl Statistics {
    /// The JSON of the section, before compression.
    pub fn encode(&self) -> Result<Vec<u8>> {
        encode(self, "statistics")
    }

    /// The statistics in the JSON of the section.
    pub fn decode(bytes: &[u8]) -> Result<Self> {
        decode(bytes, "statistics")
    }
}

fn encode(value: &impl Serialize, what: &str) -> Result<Vec<u8>> {
    serde_json::to_vec(value).map_err(|error| Error::format(what, "what JSON can say", error))
}

fn decode<'a, T: Deserialize<'a>>(bytes: &'a [u8], what: &str) -> Result<T> {
    serde_json::from_slice(bytes)
        .map_err(|error| Error::format(what, "JSON as the specification says", error))
}

/// Deserialises a list of at most `MOST` elements. A small section into which millions are packed
/// is refused before they take memory.
fn at_most<'de, D: Deserializer<'de>, T: Deserialize<'de>, const MOST: usize>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    struct List<T, const MOST: usize>(PhantomData<T>);

    impl<'de, T: Deserialize<'de>, const MOST: usize> Visitor<'de> for List<T, MOST> {
        type Value = Vec<T>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "a list of at most {MOST}")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut from: A) -> Result<Vec<T>, A::Error> {
            let mut list = Vec::new();
            while let Some(element) = from.next_element()? {
                if list.len() == MOST {
                    return Err(serde::de::Error::custom(format_args!("a list of more than {MOST}")));
                }
                list.push(element);
            }
            Ok(list)
        }
    }

    deserializer.deserialize_seq(List::<T, MOST>(PhantomData))
}

/// Serialises a number whose infinity, which JSON lacks, is `null`.
mod infinite {
    use serde::{Deserialize, Deserializer, Serializer};

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's signature")]
    pub fn serialize<S: Serializer>(number: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        if number.is_finite() { serializer.serialize_f64(*number) } else { serializer.serialize_none() }
    }

    pub fn deserialize<'a, D: Deserializer<'a>>(deserializer: D) -> Result<f64, D::Error> {
        Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metadata_round_trips_and_ignores_what_it_does_not_know() {
        let mut metadata =
            Metadata { tool: "relevo 0".into(), bounds: Some([0.5, -1.0, 2.0, 3.0]), ..<_>::default() };
        metadata.levels.push(LevelNote {
            tiles: 1,
            bytes: 2,
            max_vertical_m: f64::INFINITY,
            max_horizontal_m: 0.1,
        });
        metadata.options = serde_json::json!({"tile": 256});
        let bytes = metadata.encode().unwrap();
        assert_eq!(Metadata::decode(&bytes).unwrap(), metadata);
        let text = String::from_utf8(bytes).unwrap().replacen('{', "{\"later\":[1,{}],", 1);
        assert_eq!(Metadata::decode(text.as_bytes()).unwrap(), metadata);
        assert_eq!(Metadata::decode(b"{}").unwrap(), Metadata::default());
        assert!(Metadata::decode(b"[").is_err());
    }

    #[test]
    fn statistics_round_trip() {
        let errors = ErrorStatistics {
            count: 3,
            max: f64::INFINITY,
            histogram: vec![(4, 2), (1020, 1)],
            ..<_>::default()
        };
        let step = StepStatistics { spacing_m: [0.1, 30.0], vertical: errors, ..<_>::default() };
        let level = LevelStatistics { level: 2, min_m: Some(-3.25), steps: vec![step], ..<_>::default() };
        let statistics = Statistics { levels: vec![level] };
        assert_eq!(Statistics::decode(&statistics.encode().unwrap()).unwrap(), statistics);
    }

    #[test]
    fn lists_that_are_too_long_are_refused() {
        let whole = Statistics {
            levels: vec![
                LevelStatistics { steps: vec![<_>::default(); MAX_STEPS], ..<_>::default() };
                MAX_LEVELS
            ],
        };
        assert_eq!(Statistics::decode(&whole.encode().unwrap()).unwrap(), whole);
        let edits: [fn(&mut Statistics); 3] = [
            |s| s.levels.push(<_>::default()),
            |s| s.levels[9].steps.push(<_>::default()),
            |s| s.levels[9].steps[2].vertical.histogram = vec![(3, 1); MAX_BINS + 1],
        ];
        for edit in edits {
            let mut longer = whole.clone();
            edit(&mut longer);
            let refusal = Statistics::decode(&longer.encode().unwrap()).unwrap_err();
            assert!(refusal.to_string().contains("a list of more than"), "{refusal}");
        }
    }
}
