//! Codes of raw samples: which samples are void, the integers of the others, and quantisation.
//!
//! Everything after this module works on the values that a reader will decode: quantise first, then
//! measure errors.

use std::ops::Range;

use crate::error::{Error, Result};
use crate::sample::{Coding, SampleType, VALID, VOID, code_from_f32, code_from_f64};
use crate::simd::{self, Kernel};
use crate::source::{Nodata, Samples, SourceInfo, Window};

/// The rules by which raw samples become codes.
#[derive(Clone, Copy, Debug)]
pub struct Recipe {
    /// The coding of the result.
    pub coding: Coding,
    /// Samples of the source's type that are void; NaN and infinities are always void.
    pub nodata: Nodata,
    /// True if values are rounded to multiples of the coding's scale.
    pub quantised: bool,
}

/// A list of codes under construction.
#[derive(Clone, Debug, Default)]
pub struct Codes {
    /// Codes.
    pub code: Vec<i32>,
    /// Lower halves of float64 samples; empty otherwise.
    pub low: Vec<u32>,
    /// `VALID` or `VOID`.
    pub state: Vec<u8>,
}

impl Codes {
    /// Removes all codes, and reserves memory for `count`.
    pub fn restart(&mut self, count: usize, coding: Coding) {
        self.code.clear();
        self.code.reserve_exact(count);
        self.state.clear();
        self.state.reserve_exact(count);
        self.low.clear();
        self.low.reserve_exact(if coding.has_low() { count } else { 0 });
    }

    /// Appends `count` void samples.
    pub fn add_void(&mut self, count: usize, coding: Coding) {
        self.code.resize(self.code.len() + count, 0);
        self.state.resize(self.state.len() + count, VOID);
        if coding.has_low() {
            self.low.resize(self.low.len() + count, 0);
        }
    }
}

/// Kernel: codes of integers, without rounding.
struct Integers<'a, T> {
    values: &'a [T],
    offset: i64,
    nodata: Option<T>,
    out: &'a mut Codes,
}

impl<T: Copy + PartialEq + Into<i64>> Kernel for Integers<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let offset = self.offset;
        self.out.code.extend(self.values.iter().map(|&raw| (raw.into() - offset) as i32));
        match self.nodata {
            Some(nodata) => {
                let state = |&raw: &T| if raw == nodata { VOID } else { VALID };
                self.out.state.extend(self.values.iter().map(state));
            }
            None => self.out.state.resize(self.out.state.len() + self.values.len(), VALID),
        }
    }
}

impl Recipe {
    /// The lossless recipe of a source.
    pub fn lossless(info: &SourceInfo) -> Self {
        let coding = match info.sample_type {
            SampleType::Float32 => Coding::Float32,
            SampleType::Float64 => Coding::Float64,
            // uint32 shifted into the range of i32: code = value - 2^31.
            SampleType::Uint32 => Coding::Integer { scale: 1.0, offset: 2_147_483_648.0 },
            _ => Coding::Integer { scale: 1.0, offset: 0.0 },
        };
        Self { coding, nodata: info.voids(), quantised: false }
    }

    /// The recipe whose decoded values differ from the source's by at most half of `precision_m`
    /// metres, also after they have been rounded to the source's own type. `max_magnitude` is the
    /// largest absolute value of the source.
    ///
    /// A float32 `f` near the largest height is itself off by half a unit in the last place, so the
    /// step is `precision - ulp`. An integer raster finer than the precision stays lossless.
    pub fn quantised(info: &SourceInfo, precision_m: f64, max_magnitude: f64) -> Result<Self> {
        let metres = info.band_scale.abs() * info.vertical_unit.0;
        let wanted = precision_m / metres;
        let reach = max_magnitude + wanted;
        let ulp = match info.sample_type {
            SampleType::Float32 => f64::from((reach as f32).next_up()) - f64::from(reach as f32),
            _ => reach.next_up() - reach,
        };
        let lossless = Self::lossless(info);
        let step = if info.sample_type.is_float() { (wanted - ulp) * (1.0 - 1e-9) } else { wanted.floor() };
        if !info.sample_type.is_float() && step < 2.0 {
            return Ok(lossless);
        }
        if step.is_nan() || step < wanted / 2.0 {
            return Err(Error::usage(format!(
                "`precision_m` {precision_m}: {} samples of heights up to {max_magnitude} cannot carry it; \
                 leave the option away (lossless) or ask for at least {:.1e}",
                info.sample_type.gdal_name(),
                4.0 * ulp * metres
            )));
        }
        if max_magnitude / step >= f64::from(i32::MAX) {
            return Err(Error::usage(format!(
                "`precision_m` {precision_m} needs more than 32 bits for heights up to {max_magnitude}; ask for at least {:.1e}",
                max_magnitude * metres / f64::from(1 << 30)
            )));
        }
        Ok(Self { coding: Coding::Integer { scale: step, offset: 0.0 }, quantised: true, ..lossless })
    }

    /// Appends the codes of some samples of a window.
    pub fn encode(&self, window: &Window, run: Range<usize>, out: &mut Codes) {
        let from = out.state.len();
        match &window.samples {
            Samples::Int8(v) => self.integers(&v[run.clone()], out),
            Samples::Uint8(v) => self.integers(&v[run.clone()], out),
            Samples::Int16(v) => self.integers(&v[run.clone()], out),
            Samples::Uint16(v) => self.integers(&v[run.clone()], out),
            Samples::Int32(v) => self.integers(&v[run.clone()], out),
            Samples::Uint32(v) => self.integers(&v[run.clone()], out),
            Samples::Float32(v) => self.float32(&v[run.clone()], out),
            Samples::Float64(v) => self.float64(&v[run.clone()], out),
        }
        if let Some(mask) = &window.mask {
            for (state, &valid) in out.state[from..].iter_mut().zip(&mask[run]) {
                if valid == 0 {
                    *state = VOID;
                }
            }
        }
    }

    /// True if none of some samples of a window is void.
    pub fn is_valid(&self, window: &Window, run: Range<usize>) -> bool {
        let valid = match &window.samples {
            Samples::Int8(v) => self.integers_are_valid(&v[run.clone()]),
            Samples::Uint8(v) => self.integers_are_valid(&v[run.clone()]),
            Samples::Int16(v) => self.integers_are_valid(&v[run.clone()]),
            Samples::Uint16(v) => self.integers_are_valid(&v[run.clone()]),
            Samples::Int32(v) => self.integers_are_valid(&v[run.clone()]),
            Samples::Uint32(v) => self.integers_are_valid(&v[run.clone()]),
            Samples::Float32(v) => self.floats_are_valid(&v[run.clone()]),
            Samples::Float64(v) => self.floats_are_valid(&v[run.clone()]),
        };
        valid && window.mask.as_ref().is_none_or(|mask| every(&mask[run], |&valid| valid != 0))
    }

    fn integers_are_valid<T: Copy + PartialEq + TryFrom<i64>>(&self, values: &[T]) -> bool {
        self.nodata_integer().is_none_or(|nodata: T| every(values, |&raw| raw != nodata))
    }

    fn floats_are_valid<T: Copy + Into<f64>>(&self, values: &[T]) -> bool {
        every(values, |&value| value.into().is_finite() & !self.nodata.is(value.into()))
    }

    /// The nodata value, if a sample can have it.
    fn nodata_integer<T: TryFrom<i64>>(&self) -> Option<T> {
        self.nodata.near().and_then(|(value, _)| T::try_from(value as i64).ok())
    }

    fn integers<T: Copy + PartialEq + Into<i64> + TryFrom<i64>>(&self, values: &[T], out: &mut Codes) {
        let nodata = self.nodata_integer();
        let Coding::Integer { offset, .. } = self.coding else { return };
        if self.quantised {
            let values = values.iter().map(|&raw| (Some(raw) != nodata).then(|| raw.into() as f64));
            self.add(values, out);
        } else {
            simd::run(Integers { values, offset: offset as i64, nodata, out });
        }
    }

    fn float32(&self, values: &[f32], out: &mut Codes) {
        // Most rasters need only a few of the possible comparisons.
        match (self.nodata.near(), self.nodata.far()) {
            (None, None) => self.float32_where(values, f32::is_finite, out),
            (Some((low, high)), None) => {
                let (low, high) = (low as f32, high as f32);
                let is_valid = |value: f32| value.is_finite() && !(low..=high).contains(&value);
                self.float32_where(values, is_valid, out);
            }
            _ => {
                let is_valid = |value: f32| value.is_finite() && !self.nodata.is(value.into());
                self.float32_where(values, is_valid, out);
            }
        }
    }

    fn float32_where(&self, values: &[f32], is_valid: impl Fn(f32) -> bool, out: &mut Codes) {
        if self.quantised {
            self.add(values.iter().map(|&value| is_valid(value).then_some(f64::from(value))), out);
            return;
        }
        out.code.extend(values.iter().map(|&value| if is_valid(value) { code_from_f32(value) } else { 0 }));
        out.state.extend(values.iter().map(|&value| if is_valid(value) { VALID } else { VOID }));
    }

    fn float64(&self, values: &[f64], out: &mut Codes) {
        let is_valid = |value: f64| value.is_finite() && !self.nodata.is(value);
        if self.quantised {
            self.add(values.iter().map(|&value| is_valid(value).then_some(value)), out);
            return;
        }
        let halves = |value: f64| if is_valid(value) { code_from_f64(value) } else { (0, 0) };
        out.code.extend(values.iter().map(|&value| halves(value).0));
        out.low.extend(values.iter().map(|&value| halves(value).1));
        out.state.extend(values.iter().map(|&value| if is_valid(value) { VALID } else { VOID }));
    }

    /// Appends values as the nearest multiples of the step, `None` as void.
    fn add(&self, values: impl Iterator<Item = Option<f64>>, out: &mut Codes) {
        let Coding::Integer { scale, .. } = self.coding else { return };
        for value in values {
            out.code.push(value.map_or(0, |value| (value / scale).round() as i32));
            out.state.push(if value.is_some() { VALID } else { VOID });
        }
    }
}

/// True if a condition holds for all samples. Has no early end, so that the compiler uses vectors.
fn every<T>(samples: &[T], condition: impl Fn(&T) -> bool) -> bool {
    samples.iter().fold(true, |all, sample| all & condition(sample))
}

/// Largest absolute value of the valid samples of a window; 0 if there are none.
pub fn max_magnitude(window: &Window, nodata: Nodata) -> f64 {
    fn largest<T: Copy + Into<f64>>(samples: &[T], mask: Option<&[u8]>, nodata: Nodata) -> f64 {
        let size = |sample: T| {
            let value: f64 = sample.into();
            if value.is_finite() && !nodata.is(value) { value.abs() } else { 0.0 }
        };
        match mask {
            None => samples.iter().fold(0.0, |a, &sample| size(sample).max(a)),
            Some(mask) => {
                let valid = samples.iter().zip(mask).filter(|&(_, &valid)| valid != 0);
                valid.fold(0.0, |a, (&sample, _)| size(sample).max(a))
            }
        }
    }
    let mask = window.mask.as_deref();
    match &window.samples {
        Samples::Float32(v) => largest(v, mask, nodata),
        Samples::Float64(v) => largest(v, mask, nodata),
        Samples::Int8(v) => largest(v, mask, nodata),
        Samples::Uint8(v) => largest(v, mask, nodata),
        Samples::Int16(v) => largest(v, mask, nodata),
        Samples::Uint16(v) => largest(v, mask, nodata),
        Samples::Int32(v) => largest(v, mask, nodata),
        Samples::Uint32(v) => largest(v, mask, nodata),
    }
}
