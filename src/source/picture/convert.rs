//! Conversion of raw samples to 8-bit colours and alpha.

use super::Pixels;
use crate::sample::SampleType;
use crate::source::Nodata;

/// How the bands of a picture become colours and alpha.
#[derive(Clone, Debug)]
pub(in crate::source) struct Conversion {
    /// Sample type of all bands; bits are bytes 0 and 1.
    pub(in crate::source) kind: SampleType,
    /// True if samples are single bits.
    pub(in crate::source) is_bit: bool,
    /// Bands for grey, or for red, green and blue, from 0.
    pub(in crate::source) colours: Vec<usize>,
    /// Band of alpha or of a mask, from 0.
    pub(in crate::source) alpha: Option<usize>,
    /// Alpha value that is opaque. For 16-bit alpha this is 65535, or 255 if the writer used bytes.
    pub(in crate::source) opaque: f64,
    /// True if colours are multiplied by alpha.
    pub(in crate::source) premultiplied: bool,
    /// Colours of a palette, indexed by the band's samples.
    pub(in crate::source) palette: Option<Vec<[u8; 3]>>,
    /// True if 0 is white.
    pub(in crate::source) inverted: bool,
    /// Nodata value of each colour band.
    pub(in crate::source) nodata: Option<Vec<f64>>,
    /// Values of each band that become 0 and 255; empty if bytes are taken unchanged.
    pub(in crate::source) ramps: Vec<(f64, f64)>,
}

/// Samples of one band of a block, possibly interleaved with others.
#[derive(Clone, Copy)]
pub(in crate::source) struct BandSamples<'a> {
    /// Buffer in this machine's byte order.
    pub(in crate::source) bytes: &'a [u8],
    /// Index of the first sample of this band.
    pub(in crate::source) first: usize,
    /// Samples from one of this band to the next.
    pub(in crate::source) stride: usize,
}

/// Calls `$visit` with index and value of each sample of a plane.
macro_rules! visit {
    ($type:ty, $plane:expr, $visit:expr) => {{
        const SIZE: usize = size_of::<$type>();
        let samples = $plane.bytes.as_chunks::<SIZE>().0.iter();
        for (index, &sample) in samples.skip($plane.first).step_by($plane.stride).enumerate() {
            $visit(index, f64::from(<$type>::from_ne_bytes(sample)));
        }
    }};
}

impl BandSamples<'_> {
    /// Calls `visit` with index and value of each sample.
    #[inline]
    pub(in crate::source) fn each(self, kind: SampleType, mut visit: impl FnMut(usize, f64)) {
        match kind {
            SampleType::Int8 => visit!(i8, self, visit),
            SampleType::Uint8 => visit!(u8, self, visit),
            SampleType::Int16 => visit!(i16, self, visit),
            SampleType::Uint16 => visit!(u16, self, visit),
            SampleType::Int32 => visit!(i32, self, visit),
            SampleType::Uint32 => visit!(u32, self, visit),
            SampleType::Float32 => visit!(f32, self, visit),
            SampleType::Float64 => visit!(f64, self, visit),
        }
    }
}

impl Conversion {
    /// Colour bytes of a pixel.
    pub(in crate::source) fn channels(&self) -> usize {
        if self.palette.is_some() { 3 } else { self.colours.len() }
    }

    /// All bands that are read, alpha last.
    pub(in crate::source) fn bands(&self) -> impl Iterator<Item = usize> + '_ {
        self.colours.iter().copied().chain(self.alpha)
    }

    /// True if pixels can be transparent.
    pub(in crate::source) fn hides(&self) -> bool {
        self.alpha.is_some() || self.nodata.is_some() || self.kind.is_float()
    }

    /// Converts `count` pixels from the planes of [`Self::bands`].
    pub(in crate::source) fn pixels(&self, planes: &[BandSamples<'_>], count: usize) -> Pixels {
        let channels = self.channels();
        let mut colour = vec![0; count * channels];
        match &self.palette {
            Some(palette) => planes[0].each(self.kind, |index, value| {
                let entry = palette.get(value as usize).copied().unwrap_or_default();
                colour[3 * index..][..3].copy_from_slice(&entry);
            }),
            None if self.is_as_it_is(planes) => colour.copy_from_slice(&planes[0].bytes[..count * channels]),
            None => {
                for (channel, plane) in planes.iter().take(channels).enumerate() {
                    self.channel(*plane, channel, &mut colour);
                }
            }
        }
        let mut alpha = self
            .hidden(planes, count)
            .map(|hidden| hidden.into_iter().map(|hidden| if hidden { 0 } else { 255 }).collect::<Vec<u8>>());
        if self.alpha.is_some() {
            let alpha = alpha.get_or_insert_with(|| vec![255; count]);
            planes[self.colours.len()].each(self.kind, |index, value| {
                alpha[index] = alpha[index].min(self.opacity(value));
            });
        }
        let alpha = alpha.filter(|alpha| alpha.iter().any(|&a| a < 255));
        if let Some(alpha) = alpha.as_ref().filter(|_| self.premultiplied) {
            divide(&mut colour, alpha, channels);
        }
        Pixels { colour, alpha }
    }

    /// True if the samples are the colours already, in order.
    fn is_as_it_is(&self, planes: &[BandSamples<'_>]) -> bool {
        let channels = self.channels();
        let in_order = |(at, plane): (usize, &BandSamples<'_>)| (plane.first, plane.stride) == (at, channels);
        self.kind == SampleType::Uint8
            && self.ramps.is_empty()
            && !self.is_bit
            && !self.inverted
            && planes.len() == channels
            && planes.iter().enumerate().all(in_order)
            && planes.iter().all(|plane| std::ptr::eq(plane.bytes, planes[0].bytes))
    }

    /// Converts one band into its channel of `out`.
    fn channel(&self, plane: BandSamples<'_>, channel: usize, out: &mut [u8]) {
        let channels = self.channels();
        let to = out.iter_mut().skip(channel).step_by(channels);
        if let Some(&(low, high)) = self.ramps.get(channel) {
            let scale = 255.0 / (high - low);
            let mut to = to;
            // The cast clamps to 0..=255 and turns NaN into 0.
            plane.each(self.kind, |_, value| {
                if let Some(to) = to.next() {
                    *to = ((value - low) * scale + 0.5) as u8;
                }
            });
        } else {
            let from = plane.bytes.iter().skip(plane.first).step_by(plane.stride);
            let factor = if self.is_bit { 255 } else { 1 };
            to.zip(from).for_each(|(to, from)| *to = *from * factor);
        }
        if self.inverted {
            out.iter_mut().skip(channel).step_by(channels).for_each(|value| *value = 255 - *value);
        }
    }

    /// For each pixel, whether all its colours equal the nodata value; `None` if no pixel can.
    pub(in crate::source) fn hidden(&self, planes: &[BandSamples<'_>], count: usize) -> Option<Vec<bool>> {
        if self.nodata.is_none() && !self.kind.is_float() {
            return None;
        }
        let mut hidden = vec![true; count];
        for (band, plane) in planes.iter().take(self.colours.len()).enumerate() {
            let value = self.nodata.as_ref().and_then(|values| values.get(band)).copied();
            let nodata = Nodata::new(value, self.kind);
            plane.each(self.kind, |index, value| hidden[index] &= nodata.is(value) || value.is_nan());
        }
        Some(hidden)
    }

    /// An alpha sample as 8 bits.
    pub(in crate::source) fn opacity(&self, value: f64) -> u8 {
        match self.kind {
            SampleType::Uint8 if !self.is_bit => value as u8,
            SampleType::Uint16 => (value * 255.0 / self.opaque + 0.5) as u8,
            _ if value > 0.0 => 255,
            _ => 0,
        }
    }
}

/// Divides colours that were multiplied by alpha.
fn divide(colour: &mut [u8], alpha: &[u8], channels: usize) {
    for (pixel, &alpha) in colour.chunks_exact_mut(channels).zip(alpha) {
        let alpha = u32::from(alpha);
        if (1..255).contains(&alpha) {
            for value in pixel {
                *value = ((u32::from(*value) * 255 + alpha / 2) / alpha).min(255) as u8;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn conversion(kind: SampleType, colours: &[usize]) -> Conversion {
        Conversion {
            kind,
            is_bit: false,
            colours: colours.to_vec(),
            alpha: None,
            opaque: 65535.0,
            premultiplied: false,
            palette: None,
            inverted: false,
            nodata: None,
            ramps: Vec::new(),
        }
    }

    #[test]
    fn a_pixel_is_hidden_where_all_colours_are_nodata() {
        let samples = [0_u8, 0, 0, 7, 0, 0, 1, 2, 3];
        let planes = [0, 1, 2].map(|first| BandSamples { bytes: &samples, first, stride: 3 });
        let conversion =
            Conversion { nodata: Some(vec![0.0; 3]), ..conversion(SampleType::Uint8, &[0, 1, 2]) };
        let pixels = conversion.pixels(&planes, 3);
        assert_eq!((&pixels.colour[..], pixels.alpha), (&samples[..], Some(vec![0, 255, 255])));
    }

    #[test]
    fn a_ramp_is_rounded_and_clamped() {
        let samples: Vec<u8> = [99_u16, 100, 151, 200, 900].iter().flat_map(|v| v.to_ne_bytes()).collect();
        let plane = BandSamples { bytes: &samples, first: 0, stride: 1 };
        let conversion = Conversion { ramps: vec![(100.0, 200.0)], ..conversion(SampleType::Uint16, &[0]) };
        assert_eq!(conversion.pixels(&[plane], 5).colour, [0, 0, 130, 255, 255]);
    }

    #[test]
    fn premultiplied_colours_are_divided() {
        let samples = [50_u8, 100, 0, 0, 80, 255];
        let planes = [0, 1].map(|first| BandSamples { bytes: &samples, first, stride: 2 });
        let conversion =
            Conversion { alpha: Some(1), premultiplied: true, ..conversion(SampleType::Uint8, &[0]) };
        let pixels = conversion.pixels(&planes, 3);
        assert_eq!((pixels.colour, pixels.alpha), (vec![128, 0, 80], Some(vec![100, 0, 255])));
    }
}
