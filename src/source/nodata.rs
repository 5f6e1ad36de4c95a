//! The samples that a nodata value makes void, by GDAL's comparison, for all readers.

use crate::sample::SampleType;

/// The samples that a nodata value makes void, as GDAL 3.6 compares them (`GDALNoDataMaskBand`).
///
/// An integer sample is void if it equals the value without its fraction; a value outside the type
/// makes none void. A float sample is void within some 4 to 8 units in the last place of a float32
/// of the value, in float64 rasters too, since these values are printed and read with few digits.
/// It is also void if its sum with the value overflows the type, so that `-3.4e+38` also matches
/// the lowest float32. NaN and infinities are always void; [`Nodata::is`] does not cover them.
#[derive(Clone, Copy, Debug)]
pub struct Nodata {
    value: Option<f64>,
    /// Least and greatest sample near the value; the first is above the second if there is none.
    near: (f64, f64),
    /// Least and greatest sample at the end of a float's range whose sum with the value overflows.
    far: (f64, f64),
}

/// An empty range.
const EMPTY: (f64, f64) = (f64::INFINITY, f64::NEG_INFINITY);

impl Nodata {
    /// Makes no sample void.
    pub const NONE: Self = Self { value: None, near: EMPTY, far: EMPTY };

    /// The samples of type `kind` that `value` makes void.
    pub fn new(value: Option<f64>, kind: SampleType) -> Self {
        let Some(wanted) = value else { return Self::NONE };
        let (near, far) = match kind {
            SampleType::Float32 => mirrored(wanted, |size| around_f32(size as f32)),
            SampleType::Float64 => mirrored(wanted, around_f64),
            _ => (integer(wanted, kind), EMPTY),
        };
        Self { value, near, far }
    }

    /// The nodata value as given.
    pub fn value(self) -> Option<f64> {
        self.value
    }

    /// True if a sample is one of them.
    #[inline]
    pub fn is(self, sample: f64) -> bool {
        let within = |(low, high): (f64, f64)| low <= sample && sample <= high;
        within(self.near) || within(self.far)
    }

    /// True if GDAL takes the value for a nodata value of the type. If not, an alpha band counts.
    pub fn is_of(self, kind: SampleType) -> bool {
        self.value.is_some_and(|value| match kind {
            SampleType::Float32 => !value.is_finite() || value.abs() <= f64::from(f32::MAX),
            SampleType::Float64 => true,
            _ => {
                let (low, high) = compared(kind);
                (low..=high).contains(&value)
            }
        })
    }

    /// Least and greatest void sample near the value, both numbers of the type.
    pub fn near(self) -> Option<(f64, f64)> {
        (self.near.0 <= self.near.1).then_some(self.near)
    }

    /// Least and greatest void sample at the end of the type's range.
    pub fn far(self) -> Option<(f64, f64)> {
        (self.far.0 <= self.far.1).then_some(self.far)
    }

    /// A void sample of the type: the value itself if the type has it.
    pub fn sample(self, kind: SampleType) -> Option<f64> {
        let (low, _) = self.near()?;
        Some(match kind {
            SampleType::Float32 => self.value.map_or(low, |value| f64::from(value as f32)),
            SampleType::Float64 => self.value.unwrap_or(low),
            _ => low,
        })
    }

    /// The number nearest to a void sample that is not void.
    pub fn beside(self, sample: f64, kind: SampleType) -> f64 {
        let within = |(low, high): &(f64, f64)| *low <= sample && sample <= *high;
        let Some((low, high)) = [self.near, self.far].into_iter().find(within) else { return sample };
        let (below, above) = match kind {
            SampleType::Float32 => ((low as f32).next_down().into(), (high as f32).next_up().into()),
            SampleType::Float64 => (low.next_down(), high.next_up()),
            _ => (low - 1.0, high + 1.0),
        };
        let free = |number: f64| (limits(kind).0..=limits(kind).1).contains(&number) && !self.is(number);
        if free(above) { above } else { below }
    }

    /// True if the value matches the same numbers of `narrow` whether compared in that type or in
    /// `wide`, which holds all of them.
    pub fn is_alike(value: Option<f64>, narrow: SampleType, wide: SampleType) -> bool {
        let (own, other) = (Self::new(value, narrow), Self::new(value, wide));
        let inside = |range: Option<(f64, f64)>| {
            let (low, high) = range?;
            let (least_of_all, greatest) = limits(narrow);
            let (low, high) = (least(low, narrow).max(least_of_all), (-least(-high, narrow)).min(greatest));
            (low <= high).then_some((low, high))
        };
        narrow == wide || (inside(other.near()), inside(other.far())) == (own.near(), own.far())
    }
}

/// The least number of a type that is not below a value; the type is taken as unbounded.
fn least(value: f64, kind: SampleType) -> f64 {
    match kind {
        SampleType::Float32 => {
            let nearest = value as f32;
            f64::from(if f64::from(nearest) < value { nearest.next_up() } else { nearest })
        }
        SampleType::Float64 => value,
        _ => value.ceil(),
    }
}

/// The range that GDAL compares integers in: types of up to 32 bits as 32 bits with the same sign,
/// bytes as bytes.
fn compared(kind: SampleType) -> (f64, f64) {
    match kind {
        SampleType::Uint8 => limits(kind),
        SampleType::Uint16 | SampleType::Uint32 => limits(SampleType::Uint32),
        _ => limits(SampleType::Int32),
    }
}

fn integer(value: f64, kind: SampleType) -> (f64, f64) {
    let (low, high) = compared(kind);
    if !(low..=high).contains(&value) {
        return EMPTY;
    }
    let (whole, (low, high)) = (value.trunc() + 0.0, limits(kind));
    if (low..=high).contains(&whole) { (whole, whole) } else { EMPTY }
}

/// Least and greatest finite number of a type.
fn limits(kind: SampleType) -> (f64, f64) {
    match kind {
        SampleType::Int8 => (i8::MIN.into(), i8::MAX.into()),
        SampleType::Uint8 => (0.0, u8::MAX.into()),
        SampleType::Int16 => (i16::MIN.into(), i16::MAX.into()),
        SampleType::Uint16 => (0.0, u16::MAX.into()),
        SampleType::Int32 => (i32::MIN.into(), i32::MAX.into()),
        SampleType::Uint32 => (0.0, u32::MAX.into()),
        SampleType::Float32 => (f32::MIN.into(), f32::MAX.into()),
        SampleType::Float64 => (f64::MIN, f64::MAX),
    }
}

/// Both ranges of a value of either sign, computed from its magnitude.
fn mirrored(value: f64, around: impl Fn(f64) -> Ranges) -> Ranges {
    let (near, far) = around(value.abs());
    let turned = |(low, high): (f64, f64)| if low <= high { (-high, -low) } else { EMPTY };
    if value < 0.0 { (turned(near), turned(far)) } else { (near, far) }
}

/// The fields `near` and `far` of [`Nodata`].
type Ranges = ((f64, f64), (f64, f64));

/// GDAL's `ARE_REAL_EQUAL` solved for the sample. Non-negative floats are ordered as their bits
/// are, and the comparison changes once or twice along them.
macro_rules! around {
    ($name:ident, $float:ty, $bits:ty) => {
        fn $name(value: $float) -> Ranges {
            if !value.is_finite() {
                return (EMPTY, EMPTY);
            }
            let number = |bits: $bits| <$float>::from_bits(bits);
            let alike = |bits: $bits| {
                let (sample, epsilon) = (number(bits), <$float>::from(f32::EPSILON));
                sample == value || (sample - value).abs() < epsilon * (sample + value).abs() * 2.0
            };
            let first = |mut low: $bits, mut high: $bits, is: &dyn Fn($bits) -> bool| {
                while low < high {
                    let middle = low + (high - low) / 2;
                    if is(middle) { high = middle } else { low = middle + 1 }
                }
                low
            };
            let wide = |bits: $bits| f64::from(number(bits));
            let (own, end) = (value.to_bits(), <$float>::MAX.to_bits() + 1);
            let low = first(0, own, &alike);
            let far = first(own, end, &|bits| (number(bits) + value).is_infinite());
            let high = first(own, far, &|bits| !alike(bits)).max(own + 1) - 1;
            ((wide(low), wide(high)), if far < end { (wide(far), wide(end - 1)) } else { EMPTY })
        }
    };
}

around!(around_f32, f32, u32);
around!(around_f64, f64, u64);

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::source::metadata;

    /// The lines of GDAL's table: sample type, nodata text, samples that are void, and samples that
    /// are not.
    fn lines() -> Vec<(SampleType, String, Vec<f64>, Vec<f64>)> {
        let table = include_str!("../../fixtures/nodata.txt");
        let line = |line: &str| {
            let mut words = line.split(' ');
            let name = words.next().expect("type");
            let kind = SampleType::ALL.into_iter().find(|kind| kind.gdal_name() == name).expect("type");
            let text = words.next().expect("text").replace('_', " ");
            // GDAL's reading of the text comes first.
            let rest: Vec<&str> = words.skip(1).collect();
            let bar = rest.iter().position(|&word| word == "|").expect("bar");
            let numbers = |words: &[&str]| words.iter().map(|word| number(kind, word)).collect();
            (kind, text, numbers(&rest[..bar]), numbers(&rest[bar + 1..]))
        };
        table.lines().filter(|line| !line.starts_with('#')).map(line).collect()
    }

    /// A sample from its bits.
    fn number(kind: SampleType, hex: &str) -> f64 {
        let bits = u64::from_str_radix(hex, 16).expect("bits");
        match kind {
            SampleType::Int8 => (bits as u8).cast_signed().into(),
            SampleType::Int16 => (bits as u16).cast_signed().into(),
            SampleType::Int32 => (bits as u32).cast_signed().into(),
            SampleType::Uint8 | SampleType::Uint16 | SampleType::Uint32 => bits as f64,
            SampleType::Float32 => f32::from_bits(bits as u32).into(),
            SampleType::Float64 => f64::from_bits(bits),
        }
    }

    #[test]
    fn samples_are_void_to_us_as_they_are_to_gdal() {
        let lines = lines();
        assert!(lines.len() > 440, "{} lines", lines.len());
        for (kind, text, void, valid) in lines {
            let nodata =
                Nodata::new(metadata::number(&text).map(|value| metadata::rounded(value, kind)), kind);
            for (samples, expected) in [(void, true), (valid, false)] {
                for sample in samples {
                    let place = format!("nodata {text} of {kind:?}, sample {sample:e}");
                    // NaN is always void here, in GDAL only if it is the nodata value.
                    if !sample.is_nan() {
                        assert_eq!(nodata.is(sample), expected, "{place}");
                    }
                }
            }
            if let Some(sample) = nodata.sample(kind) {
                assert!(nodata.is(sample), "{text} of {kind:?}: {sample} is to be void");
            }
        }
    }

    /// GDAL's comparison as in its source (`ARE_REAL_EQUAL`).
    fn alike_f32(a: f32, b: f32) -> bool {
        a == b || (a - b).abs() < f32::EPSILON * (a + b).abs() * 2.0
    }

    fn alike_f64(a: f64, b: f64) -> bool {
        a == b || (a - b).abs() < f64::from(f32::EPSILON) * (a + b).abs() * 2.0
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]

        #[test]
        fn ranges_are_those_of_the_comparison(
            bits: u32, wide: u64, other: u32, step in -40_i32..40, far in -(1_i64 << 32)..1 << 32
        ) {
            let value = f32::from_bits(bits);
            let nodata = Nodata::new(Some(value.into()), SampleType::Float32);
            for bits in [bits.wrapping_add_signed(step), other, bits ^ 1 << 31, other & 0x7F | 0x7F7F_FF80] {
                let sample = f32::from_bits(bits);
                let void = sample.is_finite() && value.is_finite() && alike_f32(sample, value);
                prop_assert_eq!(sample.is_finite() && nodata.is(sample.into()), void, "{:e} {:e}", value, sample);
            }
            let value = f64::from_bits(wide);
            let nodata = Nodata::new(Some(value), SampleType::Float64);
            let steps = [i64::from(step), far, far >> 3, far * 100];
            let near = steps.map(|step| wide.wrapping_add_signed(step));
            for bits in near.into_iter().chain([wide ^ 1 << 63, 0x7FEF_FFFF_FFFF_FFFF, 0xFFEF_FFFF_FFFF_FFFF]) {
                let sample = f64::from_bits(bits);
                let void = sample.is_finite() && value.is_finite() && alike_f64(sample, value);
                prop_assert_eq!(sample.is_finite() && nodata.is(sample), void, "{:e} {:e}", value, sample);
            }
        }

        #[test]
        fn a_value_is_alike_in_two_types_if_it_stands_for_the_same_samples(
            value in prop_oneof![-70_000.0..70_000.0_f64, (-70_000_i32..70_000).prop_map(f64::from), any::<f64>()],
            sample: u16,
        ) {
            let value = Some(value);
            for (narrow, wide, sample) in [
                (SampleType::Int16, SampleType::Float32, f64::from(sample.cast_signed())),
                (SampleType::Uint16, SampleType::Int32, f64::from(sample)),
                (SampleType::Uint8, SampleType::Int16, f64::from(sample % 256)),
            ] {
                if Nodata::is_alike(value, narrow, wide) {
                    prop_assert_eq!(Nodata::new(value, narrow).is(sample), Nodata::new(value, wide).is(sample));
                }
            }
        }
    }

    #[test]
    fn values_that_are_alike_in_two_types() {
        use SampleType::{Float32, Float64, Int16, Int32, Uint8};
        let alike = |value, narrow, wide| Nodata::is_alike(Some(value), narrow, wide);
        assert!(alike(-9999.0, Int16, Float32) && alike(-9999.0, Int16, Float64) && alike(2.0, Uint8, Int16));
        assert!(alike(-9999.0, Int32, Float64) && Nodata::is_alike(None, Int16, Float32));
        // Other numbers lie within a millionth of a large one.
        assert!(!alike(123_456_789.0, Int32, Float64) && !alike(-0.4, Uint8, Int16));
        assert!(alike(f64::NAN, Float32, Float64));
    }
}
