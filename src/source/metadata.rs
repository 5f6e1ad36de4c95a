//! Values that GDAL keeps beside samples: nodata, scale, offset, and the vertical unit.

use super::unit;
use crate::error::{Error, Result};
use crate::sample::SampleType;

/// A number as GDAL reads it from text: the longest prefix that is a number; `None` if there is
/// none.
pub(crate) fn number(text: &str) -> Option<f64> {
    let text = text.trim_start().replace(',', ".");
    let signed = text.strip_prefix(['-', '+']).unwrap_or(&text);
    if signed.starts_with("1.#") {
        let infinite = signed.starts_with("1.#INF");
        let value = if infinite { f64::INFINITY } else { f64::NAN };
        return Some(if text.starts_with('-') { -value } else { value });
    }
    // Longer prefixes need no try: GDAL writes 18 digits.
    let mut ends = (1..=text.len().min(64)).rev().filter(|&end| text.is_char_boundary(end));
    ends.find_map(|end| text[..end].trim_end().parse().ok())
}

/// A nodata value rounded to a sample type.
pub(crate) fn rounded(value: f64, kind: SampleType) -> f64 {
    if kind == SampleType::Float32 { nearest_f32(value) } else { value }
}

/// A value rounded to float32; one far outside its range stays unchanged, so that no sample equals
/// it. Texts of the largest float are often rounded up in their last digit; this rounds them back.
fn nearest_f32(value: f64) -> f64 {
    let nearest = f64::from(value as f32);
    if nearest.is_infinite() { value } else { nearest }
}

/// Refuses a scale or an offset that is not finite, or a scale of 0.
pub(crate) fn check_scale(scale: f64, offset: f64) -> Result<()> {
    if !scale.is_finite() || scale == 0.0 {
        return Err(Error::format("scale of the samples", "a finite number other than 0", scale));
    }
    if !offset.is_finite() {
        return Err(Error::format("offset of the samples", "a finite number", offset));
    }
    Ok(())
}

/// Metres and name of the vertical unit: the unit type of the band, else that of the vertical CRS.
/// An unknown name counts as metres, and is kept for a warning.
pub(crate) fn vertical_unit(unit_type: Option<&str>, of_crs: Option<(f64, String)>) -> (f64, String) {
    match unit_type.map(str::trim).filter(|name| !name.is_empty()) {
        Some(name) => (unit::metres_of(name).unwrap_or(1.0), name.to_owned()),
        None => of_crs.unwrap_or((1.0, String::new())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_as_gdal_reads_them() {
        assert_eq!(number("-9999 "), Some(-9999.0));
        assert_eq!(number("  -3.4028234663852886e+38"), Some(-3.402_823_466_385_288_6e38));
        assert_eq!(number("1,5"), Some(1.5));
        assert_eq!(number("12abc"), Some(12.0));
        assert!(number("nan").is_some_and(f64::is_nan) && number("-1.#IND").is_some_and(f64::is_nan));
        assert_eq!(number("-inf"), Some(f64::NEG_INFINITY));
        assert_eq!(number(""), None);
        assert_eq!(number("none"), None);
    }

    #[test]
    fn nodata_of_a_float32() {
        let nodata = |text, kind| number(text).map(|value| rounded(value, kind));
        assert_eq!(nodata("0.1", SampleType::Float32), Some(f64::from(0.1_f32)));
        assert_eq!(nodata("-3.4028235e+38", SampleType::Float32), Some(-f64::from(f32::MAX)));
        assert_eq!(nodata("-1e300", SampleType::Float32), Some(-1e300));
        assert_eq!(nodata("0.1", SampleType::Float64), Some(0.1));
        assert_eq!(nodata("-9999", SampleType::Uint8), Some(-9999.0));
    }

    #[test]
    fn units() {
        assert_eq!(
            vertical_unit(Some("US survey foot"), None),
            (1200.0 / 3937.0, "US survey foot".to_owned())
        );
        assert_eq!(vertical_unit(Some("ft"), Some((1.0, "metre".to_owned()))).0, 0.3048);
        assert_eq!(vertical_unit(None, Some((0.3048, "foot".to_owned()))).0, 0.3048);
        assert_eq!(vertical_unit(Some("cubits"), None), (1.0, "cubits".to_owned()));
        assert_eq!(vertical_unit(Some(""), None), (1.0, String::new()));
    }
}
