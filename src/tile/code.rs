//! Raw samples to codes: which are void, what integer stands for the others, and quantisation if asked for.
//!
//! Everything after this module works on what a reader will decode: quantise first, then measure errors.

use crate::error::{Error, Result};
use crate::sample::{Coding, SampleType, VALID, VOID, code_from_f32, code_from_f64};
use crate::source::{Samples, SourceInfo, Window};

/// How raw samples become codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recipe {
    /// The coding of the result.
    pub coding: Coding,
    /// Value that means void, in the source's type; NaN and infinities are void whatever it is.
    pub nodata: Option<f64>,
    /// True if values are rounded to multiples of the coding's scale.
    pub quantised: bool,
}

/// Rows of a raster as codes, all of its width.
#[derive(Clone, Debug, Default)]
pub struct CodeRows {
    /// Codes, row by row.
    pub code: Vec<i32>,
    /// Lower halves of float64 samples; empty otherwise.
    pub low: Vec<u32>,
    /// `VALID` or `VOID`.
    pub state: Vec<u8>,
    /// Largest difference between a decoded and a source value, in value units; 0 unless quantised.
    pub max_error: f64,
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
        Self { coding, nodata: info.nodata, quantised: false }
    }

    /// The recipe whose decoded values differ from the source's by at most half of `precision_m` metres, also after
    /// they have been rounded to the source's own type. `max_magnitude` is the largest absolute value of the source.
    ///
    /// A float32 `f` near the largest height is itself off by half a unit in the last place, so the step is
    /// `precision - ulp`. An integer raster finer than the precision stays lossless.
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
                "--precision {precision_m}: {} samples of heights up to {max_magnitude} cannot carry it; \
                 leave the option away (lossless) or ask for at least {:.1e}",
                info.sample_type.gdal_name(),
                4.0 * ulp * metres
            )));
        }
        if max_magnitude / step >= f64::from(i32::MAX) {
            return Err(Error::usage(format!(
                "--precision {precision_m} needs more than 32 bits for heights up to {max_magnitude}; ask for at least {:.1e}",
                max_magnitude * metres / f64::from(1 << 30)
            )));
        }
        Ok(Self { coding: Coding::Integer { scale: step, offset: 0.0 }, quantised: true, ..lossless })
    }

    /// Codes of a window.
    pub fn encode(&self, window: &Window, out: &mut CodeRows) {
        let count = window.samples.len();
        *out = CodeRows {
            code: vec![0; count],
            low: vec![0; if self.coding.has_low() { count } else { 0 }],
            state: vec![VOID; count],
            max_error: 0.0,
        };
        match &window.samples {
            Samples::Int8(v) => self.integers(v, out),
            Samples::Uint8(v) => self.integers(v, out),
            Samples::Int16(v) => self.integers(v, out),
            Samples::Uint16(v) => self.integers(v, out),
            Samples::Int32(v) => self.integers(v, out),
            Samples::Uint32(v) => self.integers(v, out),
            Samples::Float32(v) => self.float32(v, out),
            Samples::Float64(v) => self.float64(v, out),
        }
        if let Some(mask) = &window.mask {
            for (state, &valid) in out.state.iter_mut().zip(mask) {
                if valid == 0 {
                    *state = VOID;
                }
            }
        }
    }

    fn integers<T: Copy + Into<i64>>(&self, values: &[T], out: &mut CodeRows) {
        // A nodata value that is no integer of this type matches nothing, as in GDAL.
        let nodata =
            self.nodata.filter(|v| v.fract() == 0.0 && v.abs() < 9e15).map_or(i64::MIN, |v| v as i64);
        let Coding::Integer { offset, .. } = self.coding else { return };
        if self.quantised {
            for (i, &raw) in values.iter().enumerate() {
                let value: i64 = raw.into();
                if value != nodata {
                    self.quantise(i, value as f64, f64::round, out);
                }
            }
            return;
        }
        let offset = offset as i64;
        for ((&raw, code), state) in values.iter().zip(&mut out.code).zip(&mut out.state) {
            let value: i64 = raw.into();
            *code = (value - offset) as i32;
            *state = if value == nodata { VOID } else { VALID };
        }
    }

    fn float32(&self, values: &[f32], out: &mut CodeRows) {
        let nodata = self.nodata.map(|v| v as f32);
        for (i, &value) in values.iter().enumerate() {
            if !value.is_finite() || Some(value) == nodata {
                continue;
            }
            if self.quantised {
                self.quantise(i, f64::from(value), |decoded| f64::from(decoded as f32), out);
            } else {
                (out.code[i], out.state[i]) = (code_from_f32(value), VALID);
            }
        }
    }

    fn float64(&self, values: &[f64], out: &mut CodeRows) {
        for (i, &value) in values.iter().enumerate() {
            if !value.is_finite() || Some(value) == self.nodata {
                continue;
            }
            if self.quantised {
                self.quantise(i, value, |decoded| decoded, out);
            } else {
                (out.code[i], out.low[i]) = code_from_f64(value);
                out.state[i] = VALID;
            }
        }
    }

    /// Nearest multiple of the step; the error is measured as decoded and as rounded to the source's type.
    fn quantise(&self, index: usize, value: f64, rounded: impl Fn(f64) -> f64, out: &mut CodeRows) {
        let Coding::Integer { scale, .. } = self.coding else { return };
        let code = (value / scale).round() as i32;
        let decoded = self.coding.value(code, 0);
        out.max_error = out.max_error.max((decoded - value).abs()).max((rounded(decoded) - value).abs());
        (out.code[index], out.state[index]) = (code, VALID);
    }
}

/// Largest absolute value of the valid samples of a window; 0 if there are none.
pub fn max_magnitude(window: &Window, nodata: Option<f64>) -> f64 {
    let largest = |values: &mut dyn Iterator<Item = f64>| {
        values.filter(|v| v.is_finite() && Some(*v) != nodata).fold(0.0, |a: f64, v| a.max(v.abs()))
    };
    match &window.samples {
        Samples::Float32(v) => {
            let nodata = nodata.map(|n| n as f32);
            v.iter()
                .filter(|v| v.is_finite() && Some(**v) != nodata)
                .fold(0.0, |a, v| a.max(f64::from(v.abs())))
        }
        Samples::Float64(v) => largest(&mut v.iter().copied()),
        Samples::Int8(v) => largest(&mut v.iter().map(|&v| f64::from(v))),
        Samples::Uint8(v) => largest(&mut v.iter().map(|&v| f64::from(v))),
        Samples::Int16(v) => largest(&mut v.iter().map(|&v| f64::from(v))),
        Samples::Uint16(v) => largest(&mut v.iter().map(|&v| f64::from(v))),
        Samples::Int32(v) => largest(&mut v.iter().map(|&v| f64::from(v))),
        Samples::Uint32(v) => largest(&mut v.iter().map(|&v| f64::from(v))),
    }
}
