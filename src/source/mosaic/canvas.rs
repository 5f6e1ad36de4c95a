//! A window of a mosaic while its members are added, one after the other, in the sample type of the
//! mosaic.

use std::ops::Range;

use super::member::Member;
use crate::error::{Error, Result};
use crate::sample::SampleType;
use crate::source::{Nodata, Overlap, Rect, Samples, Window};

/// A sample type.
pub(super) trait Number: Copy + PartialOrd + Send + Sync + Default {
    /// The number as float64.
    fn value(self) -> f64;
    /// The nearest number of this type, halves away from zero; values outside the range give its
    /// end.
    fn nearest(value: f64) -> Self;
    /// True if the number is neither NaN nor infinite.
    fn is_finite(self) -> bool;
    /// Wraps samples of this type.
    fn pack(samples: Vec<Self>) -> Samples;
    /// The samples if they are of this type.
    fn unpack(samples: &Samples) -> Option<&[Self]>;
}

macro_rules! number {
    ($type:ty, $variant:ident, $nearest:expr, $finite:expr) => {
        impl Number for $type {
            #[inline]
            fn value(self) -> f64 {
                self.into()
            }
            #[inline]
            fn nearest(value: f64) -> Self {
                $nearest(value) as $type
            }
            #[inline]
            fn is_finite(self) -> bool {
                $finite(self)
            }
            fn pack(samples: Vec<Self>) -> Samples {
                Samples::$variant(samples)
            }
            fn unpack(samples: &Samples) -> Option<&[Self]> {
                match samples {
                    Samples::$variant(samples) => Some(samples),
                    _ => None,
                }
            }
        }
    };
}

number!(i8, Int8, f64::round, |_| true);
number!(u8, Uint8, f64::round, |_| true);
number!(i16, Int16, f64::round, |_| true);
number!(u16, Uint16, f64::round, |_| true);
number!(i32, Int32, f64::round, |_| true);
number!(u32, Uint32, f64::round, |_| true);
number!(f32, Float32, std::convert::identity, f32::is_finite);
number!(f64, Float64, std::convert::identity, f64::is_finite);

/// Runs `$body` with the number type of a sample type as `$number`.
macro_rules! with_number {
    ($kind:expr, $number:ident => $body:expr) => {
        match $kind {
            SampleType::Int8 => {
                type $number = i8;
                $body
            }
            SampleType::Uint8 => {
                type $number = u8;
                $body
            }
            SampleType::Int16 => {
                type $number = i16;
                $body
            }
            SampleType::Uint16 => {
                type $number = u16;
                $body
            }
            SampleType::Int32 => {
                type $number = i32;
                $body
            }
            SampleType::Uint32 => {
                type $number = u32;
                $body
            }
            SampleType::Float32 => {
                type $number = f32;
                $body
            }
            SampleType::Float64 => {
                type $number = f64;
                $body
            }
        }
    };
}

/// True if type `wide` holds every value of type `narrow`.
pub(crate) fn holds_all(wide: SampleType, narrow: SampleType) -> bool {
    // Bits that hold integers exactly, and whether the type is signed.
    let bits = |kind| match kind {
        SampleType::Int8 => (7, true),
        SampleType::Uint8 => (8, false),
        SampleType::Int16 => (15, true),
        SampleType::Uint16 => (16, false),
        SampleType::Int32 => (31, true),
        SampleType::Uint32 => (32, false),
        SampleType::Float32 => (24, true),
        SampleType::Float64 => (53, true),
    };
    let ((wide_bits, wide_sign), (bits, sign)) = (bits(wide), bits(narrow));
    wide_bits >= bits && (wide_sign || !sign) && (wide.is_float() || !narrow.is_float())
}

/// A window under construction.
pub(super) struct Canvas<T> {
    area: Rect,
    overlap: Overlap,
    fill: Option<f64>,
    samples: Vec<T>,
    /// 1 where there is a valid sample.
    valid: Vec<u8>,
    /// Sum and number of samples, for `Overlap::Mean`.
    sums: Vec<(f64, u32)>,
}

/// A row of a member.
struct MemberRow<T> {
    samples: Vec<T>,
    values: Vec<f64>,
    valid: Vec<u8>,
}

impl<T: Number> Canvas<T> {
    /// A window without valid samples. Voids hold `fill`, or if there is none, are marked in a
    /// mask.
    pub(super) fn new(
        columns: &Range<u32>,
        rows: &Range<u32>,
        overlap: Overlap,
        fill: Option<f64>,
    ) -> Result<Self> {
        let count = columns.len().saturating_mul(rows.len());
        let void = fill.map_or(T::default(), T::nearest);
        let sums = if overlap == Overlap::Mean { count } else { 0 };
        Ok(Self {
            area: Rect { columns: columns.clone(), rows: rows.clone() },
            overlap,
            fill,
            samples: filled(void, count)?,
            valid: filled(0, count)?,
            sums: filled((0.0, 0), sums)?,
        })
    }

    /// Adds the samples of a member; those that `nodata` makes void in the mosaic are skipped.
    pub(super) fn paint(&mut self, member: &Member, window: &Window, nodata: Nodata) {
        let area = member.common(&self.area.columns, &self.area.rows);
        let width = area.columns.len();
        let (mut at, stride) = (
            (area.rows.start - self.area.rows.start) as usize * self.area.columns.len()
                + (area.columns.start - self.area.columns.start) as usize,
            self.area.columns.len(),
        );
        let mut row = MemberRow { samples: Vec::new(), values: Vec::new(), valid: vec![0; width] };
        for y in 0..area.rows.len() {
            let own = y * width..(y + 1) * width;
            row.take_validity(window, &own, member.voids);
            row.take_samples(member, &window.samples, &own);
            mask_nodata(&row.samples, nodata, &mut row.valid);
            self.add(at, &row.samples, &row.valid);
            at += stride;
        }
    }

    /// Adds a run of samples starting at index `at`.
    pub(super) fn add(&mut self, at: usize, samples: &[T], valid: &[u8]) {
        let run = at..at + samples.len();
        let (out, known) = (&mut self.samples[run.clone()], &mut self.valid[run.clone()]);
        let places = out.iter_mut().zip(known).zip(samples.iter().zip(valid));
        match self.overlap {
            Overlap::First => put(places, |_, _| false),
            Overlap::Last => put(places, |_, _| true),
            Overlap::Min => put(places, |new, old| new < old),
            Overlap::Max => put(places, |new, old| new > old),
            Overlap::Mean => {
                for (((_, known), (&sample, &valid)), (sum, count)) in places.zip(&mut self.sums[run]) {
                    if valid != 0 {
                        *sum = if *count == 0 { sample.value() } else { *sum + sample.value() };
                        *count = count.saturating_add(1);
                        *known = 1;
                    }
                }
            }
        }
    }

    /// The finished window.
    pub(super) fn finish(mut self) -> Window {
        for (sample, &(sum, count)) in self.samples.iter_mut().zip(&self.sums) {
            if count > 0 {
                // The sum may overflow float64, the mean does not.
                *sample = T::nearest((sum / f64::from(count)).clamp(f64::MIN, f64::MAX));
            }
        }
        let masked = self.fill.is_none() && self.valid.contains(&0);
        Window { samples: T::pack(self.samples), mask: masked.then_some(self.valid) }
    }
}

/// Writes valid samples where there is none yet, or where they win over the one there.
#[inline]
fn put<'a, T: Number + 'a>(
    places: impl Iterator<Item = ((&'a mut T, &'a mut u8), (&'a T, &'a u8))>,
    before: impl Fn(T, T) -> bool,
) {
    for ((out, known), (&sample, &valid)) in places {
        let counts = valid != 0 && (*known == 0 || before(sample, *out));
        *out = if counts { sample } else { *out };
        *known |= valid;
    }
}

impl<T: Number> MemberRow<T> {
    /// Sets `valid` to 1 where a sample of a member is valid.
    fn take_validity(&mut self, window: &Window, own: &Range<usize>, nodata: Nodata) {
        with_number!(window.samples.sample_type(), S => {
            if let Some(samples) = S::unpack(&window.samples) {
                let samples = &samples[own.clone()];
                let places = samples.iter().zip(&mut self.valid);
                places.for_each(|(&sample, valid)| *valid = u8::from(sample.is_finite()));
                mask_nodata(samples, nodata, &mut self.valid);
            }
        });
        if let Some(mask) = &window.mask {
            let masked = self.valid.iter_mut().zip(&mask[own.clone()]);
            masked.for_each(|(valid, &mask)| *valid &= u8::from(mask != 0));
        }
    }

    /// Converts the samples of a member to the type of the mosaic. Void samples get any value.
    fn take_samples(&mut self, member: &Member, samples: &Samples, own: &Range<usize>) {
        self.samples.clear();
        if let (Some(same), None) = (T::unpack(samples), member.scaled) {
            self.samples.extend_from_slice(&same[own.clone()]);
            return;
        }
        self.values.clear();
        with_number!(samples.sample_type(), S => {
            if let Some(samples) = S::unpack(samples) {
                self.values.extend(samples[own.clone()].iter().map(|&sample| sample.value()));
            }
        });
        if let Some(scaled) = member.scaled {
            for (value, valid) in self.values.iter_mut().zip(&mut self.valid) {
                *value = scaled.of(*value);
                *valid &= u8::from(value.is_finite());
            }
        }
        self.samples.extend(self.values.iter().map(|&value| T::nearest(value)));
    }
}

/// Sets `valid` to 0 where `nodata` makes a sample void.
fn mask_nodata<S: Number>(samples: &[S], nodata: Nodata, valid: &mut [u8]) {
    for (low, high) in nodata.near().into_iter().chain(nodata.far()) {
        let (low, high) = (S::nearest(low), S::nearest(high));
        let places = samples.iter().zip(valid.iter_mut());
        places.for_each(|(&sample, valid)| *valid &= u8::from(!(low..=high).contains(&sample)));
    }
}

/// A vector of `count` equal elements.
fn filled<E: Clone>(element: E, count: usize) -> Result<Vec<E>> {
    let mut all = Vec::new();
    all.try_reserve_exact(count)
        .map_err(|_| Error::out_of_memory("a window of samples", (count * size_of::<E>()) as u64))?;
    all.resize(count, element);
    Ok(all)
}
