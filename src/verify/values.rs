//! Checks decoded values against the source type and nodata value in the header: an export must
//! write each of them so that it reads back as valid.

use super::report::{Check, Place};
use crate::container::directory::TileEntry;
use crate::container::layout::Header;
use crate::sample::{Lattice, SampleType, VALID};

/// Checks that valid samples of a tile are finite, within the source's type, and not void in it.
pub(super) fn check(header: &Header, entry: &TileEntry, lattice: &Lattice, check: &mut Check) {
    let source = SourceValues::of(header);
    if !source.is_needed(header, lattice) {
        return;
    }
    let spacing = u64::from(header.spacing(entry.id.level));
    let (left, top) = header.origin(entry.id);
    for (at, _) in lattice.state.iter().enumerate().filter(|(_, state)| **state == VALID) {
        let value = lattice.value(at, header.coding);
        if let Some(expected) = source.broken(header, value) {
            let (x, y) = ((at % (lattice.n + 1)) as u64, (at / (lattice.n + 1)) as u64);
            let place = Place::tile(entry.id).sample(left + x * spacing, top + y * spacing);
            check.fail(place.part("value"), expected, value);
        }
    }
}

struct SourceValues {
    /// Smallest and largest value of the source's type.
    range: (f64, f64),
    /// The nodata value rounded to the source's type; `None` if rounding alone may meet it.
    nodata: Option<f64>,
    half: f64,
}

impl SourceValues {
    fn of(header: &Header) -> Self {
        let range = match header.source_type {
            SampleType::Int8 => (-128.0, 127.0),
            SampleType::Uint8 => (0.0, 255.0),
            SampleType::Int16 => (-32_768.0, 32_767.0),
            SampleType::Uint16 => (0.0, 65_535.0),
            SampleType::Int32 => (-2_147_483_648.0, 2_147_483_647.0),
            SampleType::Uint32 => (0.0, 4_294_967_295.0),
            SampleType::Float32 => (f64::from(f32::MIN), f64::from(f32::MAX)),
            SampleType::Float64 => (f64::MIN, f64::MAX),
        };
        let lossless = header.quantisation_error == 0.0;
        let nodata = header.nodata.filter(|_| lossless);
        let nodata = if header.source_type == SampleType::Float32 {
            nodata.map(|value| f64::from(value as f32))
        } else {
            nodata
        };
        Self { range, nodata, half: header.quantisation_error }
    }

    /// False if the extreme codes of a tile show that all values are good.
    fn is_needed(&self, header: &Header, lattice: &Lattice) -> bool {
        if header.coding.has_low() {
            return true;
        }
        let valid = || lattice.code.iter().zip(&lattice.state).filter(|(_, state)| **state == VALID);
        let extremes = [valid().map(|(code, _)| *code).min(), valid().map(|(code, _)| *code).max()];
        let values: Vec<f64> =
            extremes.into_iter().flatten().map(|code| header.coding.value(code, 0)).collect();
        let (Some(&a), Some(&b)) = (values.first(), values.last()) else { return false };
        let (low, high) = (a.min(b), a.max(b));
        let may_be_void = self.nodata.is_some_and(|nodata| low <= nodata && nodata <= high);
        may_be_void || [a, b].into_iter().any(|value| self.broken(header, value).is_some())
    }

    /// What a value should be, or `None` if it is good.
    fn broken(&self, header: &Header, value: f64) -> Option<String> {
        if !header.metres(value).is_finite() {
            return Some("a finite height".to_owned());
        }
        let (low, high) = (self.range.0 - self.half, self.range.1 + self.half);
        if !(low..=high).contains(&value) {
            return Some(format!("{low} to {high}, for the source is {:?}", header.source_type));
        }
        (self.nodata == Some(value)).then(|| "void, for it is the nodata value".to_owned())
    }
}
