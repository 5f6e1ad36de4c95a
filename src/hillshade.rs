//! Shaded relief: a pure function from heights to an RGBA picture, and PNG encoding.
//!
//! Slopes are Horn's and light is that of `gdaldem hillshade`: [`Style::Grey`] gives its greys.
//! [`Style::Relief`] is a subdued map: a hypsometric tint over the range of the heights, lit from
//! several sides, blue below sea level. Voids are NaN and become transparent; where a neighbour is
//! void or beyond the border, the sample's own height is used for it.

use std::path::Path;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::output;

/// Look of the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Style {
    /// Light only, in greys from 1 (away from the light) to 255 (facing it).
    Grey,
    /// Hypsometric tint under soft light.
    #[default]
    Relief,
}

/// Options of shading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Metres from one column to the next, above 0.
    pub dx_m: f64,
    /// Metres from one row to the next, above 0; rows go south.
    pub dy_m: f64,
    /// Direction that the light comes from, in degrees clockwise from north.
    pub azimuth: f64,
    /// Height of the light above the horizon in degrees.
    pub altitude: f64,
    /// Factor on the heights.
    pub exaggeration: f64,
    /// Look of the picture.
    pub style: Style,
    /// Heights in metres at the two ends of the tint; `None` for the 1st and 99th percentile of the
    /// heights.
    pub tint_range: Option<(f32, f32)>,
}

impl Options {
    /// Light from the north-west, 45 degrees high, as in gdaldem; relief style.
    pub fn new(dx_m: f64, dy_m: f64) -> Self {
        Self {
            dx_m,
            dy_m,
            azimuth: 315.0,
            altitude: 45.0,
            exaggeration: 1.0,
            style: Style::default(),
            tint_range: None,
        }
    }
}

/// Tint of land from the low to the high end of the range: (position, sRGB).
const LAND: [(f32, [f32; 3]); 7] = [
    (0.00, [158.0, 184.0, 154.0]),
    (0.18, [188.0, 203.0, 165.0]),
    (0.36, [224.0, 219.0, 182.0]),
    (0.54, [221.0, 200.0, 164.0]),
    (0.70, [203.0, 178.0, 150.0]),
    (0.85, [205.0, 194.0, 184.0]),
    (1.00, [238.0, 236.0, 232.0]),
];
/// Tint of the sea from the deepest point to the shore.
const SEA: [(f32, [f32; 3]); 4] = [
    (0.00, [104.0, 143.0, 178.0]),
    (0.45, [140.0, 178.0, 204.0]),
    (0.85, [179.0, 208.0, 222.0]),
    (1.00, [204.0, 225.0, 230.0]),
];
/// Lights of the relief style: degrees from the main azimuth, and share. The side lights give shape
/// to slopes that face away from the main light.
const LIGHTS: [(f64, f32); 4] = [(0.0, 0.58), (-60.0, 0.18), (60.0, 0.18), (180.0, 0.06)];

/// Shades `width * height` heights in metres, row by row from the north; NaN is void.
///
/// Returns RGBA, 4 bytes for each sample.
///
/// # Errors
/// [`Error::Usage`] if the number of heights is not `width * height`, or a spacing is not above 0.
pub fn hillshade(heights: &[f32], width: usize, height: usize, options: &Options) -> Result<Vec<u8>> {
    if width.checked_mul(height) != Some(heights.len()) || heights.is_empty() {
        return Err(Error::usage(format!(
            "a hillshade of {width} x {height} samples needs as many heights, and has {}",
            heights.len()
        )));
    }
    if !(options.dx_m > 0.0 && options.dy_m > 0.0) {
        return Err(Error::usage("a hillshade needs a sample spacing above 0 metres"));
    }
    let shader = Shader::new(options, heights);
    let mut picture = vec![0; 4 * heights.len()];
    picture.par_chunks_exact_mut(4 * width).enumerate().for_each(|(y, line)| {
        let row = |y: usize| &heights[y * width..(y + 1) * width];
        let rows = [row(y.saturating_sub(1)), row(y), row((y + 1).min(height - 1))];
        let (pixels, _) = line.as_chunks_mut::<4>();
        for (x, pixel) in pixels.iter_mut().enumerate() {
            if let Some([r, g, b]) = shader.colour(rows, x) {
                *pixel = [r, g, b, 255];
            }
        }
    });
    Ok(picture)
}

/// Precomputed values of the options; a light is a unit vector (east, north, up).
struct Shader {
    east_per_metre: f32,
    north_per_metre: f32,
    lights: Vec<([f32; 3], f32)>,
    style: Style,
    /// Lowest and highest height of the tint.
    range: (f32, f32),
    /// Light on flat ground.
    flat: f32,
}

impl Shader {
    fn new(options: &Options, heights: &[f32]) -> Self {
        let light = |turn: f64| {
            let (sin_azimuth, cos_azimuth) = (options.azimuth + turn).to_radians().sin_cos();
            let (sin_altitude, cos_altitude) = options.altitude.to_radians().sin_cos();
            [sin_azimuth * cos_altitude, cos_azimuth * cos_altitude, sin_altitude].map(|x| x as f32)
        };
        let lights = match options.style {
            Style::Grey => vec![(light(0.0), 1.0)],
            Style::Relief => LIGHTS.iter().map(|&(turn, share)| (light(turn), share)).collect(),
        };
        let range = match options.style {
            Style::Grey => (0.0, 1.0),
            Style::Relief => options.tint_range.unwrap_or_else(|| percentiles(heights)),
        };
        Self {
            east_per_metre: (options.exaggeration / (8.0 * options.dx_m)) as f32,
            north_per_metre: (options.exaggeration / (8.0 * options.dy_m)) as f32,
            flat: lights.iter().map(|(light, share)| light[2] * share).sum(),
            lights,
            style: options.style,
            range,
        }
    }

    /// Colour of sample `x` of the middle of three rows; `None` for a void.
    fn colour(&self, rows: [&[f32]; 3], x: usize) -> Option<[u8; 3]> {
        let z = rows[1][x];
        if !z.is_finite() {
            return None;
        }
        let light = self.light(rows, x, z);
        match self.style {
            Style::Grey => Some([(1.0 + 254.0 * light + 0.5) as u8; 3]),
            Style::Relief => Some(tone(self.tint(z), light / self.flat)),
        }
    }

    /// Light on a sample of height `z`, 0 to 1.
    fn light(&self, rows: [&[f32]; 3], x: usize, z: f32) -> f32 {
        let at =
            |row: usize, column: usize| if rows[row][column].is_finite() { rows[row][column] } else { z };
        let (west, east) = (x.saturating_sub(1), (x + 1).min(rows[1].len() - 1));
        // Horn: the middle sample of each side counts twice.
        let side = |a: f32, b: f32, c: f32| a + 2.0 * b + c;
        let [nw, n, ne] = [at(0, west), at(0, x), at(0, east)];
        let [sw, s, se] = [at(2, west), at(2, x), at(2, east)];
        let to_east = (side(ne, at(1, east), se) - side(nw, at(1, west), sw)) * self.east_per_metre;
        let to_north = (side(nw, n, ne) - side(sw, s, se)) * self.north_per_metre;
        let length = (1.0 + to_east * to_east + to_north * to_north).sqrt();
        let facing = |light: &[f32; 3]| (light[2] - light[0] * to_east - light[1] * to_north).max(0.0);
        self.lights.iter().map(|(light, share)| facing(light) * share).sum::<f32>() / length
    }

    /// Tint of a height under the light of flat ground.
    fn tint(&self, z: f32) -> [f32; 3] {
        let (low, high) = self.range;
        let part = |from: f32, to: f32| if to > from { (z - from) / (to - from) } else { 0.5 };
        if low < 0.0 && z <= 0.0 { ramp(&SEA, part(low, 0.0)) } else { ramp(&LAND, part(low.max(0.0), high)) }
    }
}

/// 1st and 99th percentile of the valid heights, from about 65 536 of them.
fn percentiles(heights: &[f32]) -> (f32, f32) {
    let step = (heights.len() >> 16).max(1);
    let mut sample: Vec<f32> = heights.iter().step_by(step).copied().filter(|z| z.is_finite()).collect();
    sample.sort_unstable_by(f32::total_cmp);
    let at = |part: usize| sample.get(sample.len().saturating_sub(1) * part / 100).copied().unwrap_or(0.0);
    (at(1), at(99))
}

/// Colour at a position of a ramp; beyond its ends, that of the end.
fn ramp(stops: &[(f32, [f32; 3])], position: f32) -> [f32; 3] {
    let mut colour = stops.first().map_or([0.0; 3], |stop| stop.1);
    for pair in stops.windows(2) {
        let ((from, a), (to, b)) = (pair[0], pair[1]);
        if position > from {
            let part = ((position - from) / (to - from)).min(1.0);
            colour = std::array::from_fn(|i| a[i] + (b[i] - a[i]) * part);
        }
    }
    colour
}

/// A tint under light, which is 1 on flat ground: shade turns to a cool violet grey, light to a
/// warm white.
fn tone(tint: [f32; 3], light: f32) -> [u8; 3] {
    const SHADE: [f32; 3] = [62.0, 66.0, 92.0];
    const SUN: [f32; 3] = [255.0, 251.0, 240.0];
    let mix = |a: [f32; 3], b: [f32; 3], part: f32| std::array::from_fn(|i| a[i] + (b[i] - a[i]) * part);
    let colour: [f32; 3] = if light < 1.0 {
        // Multiplied rather than blended, so that the tint stays visible in the shade.
        let shaded = std::array::from_fn(|i| tint[i] * SHADE[i] / 150.0);
        mix(tint, shaded, (1.0 - light).min(1.0))
    } else {
        mix(tint, SUN, ((light - 1.0) * 1.1).min(0.6))
    };
    colour.map(|c| (c + 0.5) as u8)
}

/// The PNG encoding of an RGBA picture (4 bytes a pixel, row by row).
///
/// # Errors
/// [`Error::Usage`] if the picture is empty or its size is not `4 * width * height` bytes.
pub fn png_bytes(rgba: &[u8], width: u32, height: u32) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().map_err(|error| refused(&error))?;
    writer.write_image_data(rgba).map_err(|error| refused(&error))?;
    writer.finish().map_err(|error| refused(&error))?;
    Ok(bytes)
}

/// Writes a picture as a PNG at `path`; an existing file is replaced only when the new one is
/// complete.
pub fn write_png(path: &Path, rgba: &[u8], width: u32, height: u32) -> Result<()> {
    let bytes = png_bytes(rgba, width, height)?;
    output::write(path, &bytes, true)
}

/// The error for a picture that cannot be encoded, the only reason why writing to memory fails.
fn refused(error: &png::EncodingError) -> Error {
    Error::usage(format!("this picture cannot be a PNG: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(width: usize, height: usize, z: impl Fn(f32, f32) -> f32) -> Vec<f32> {
        (0..width * height).map(|i| z((i % width) as f32, (i / width) as f32)).collect()
    }

    #[test]
    fn a_slope_towards_the_light_is_brighter_than_flat_ground_and_one_away_darker() {
        let options = Options { style: Style::Grey, ..Options::new(10.0, 10.0) };
        let grey = |east: f32, south: f32| {
            let z = plane(5, 5, |x, y| east * x + south * y);
            hillshade(&z, 5, 5, &options).unwrap()[4 * 12]
        };
        let flat = grey(0.0, 0.0);
        assert_eq!(flat, (1.0 + 254.0 * 45_f64.to_radians().sin()).round() as u8);
        // The light is in the north-west: ground that rises to the south-east faces it.
        assert!(grey(5.0, 5.0) > flat);
        assert!(grey(-5.0, -5.0) < flat);
    }

    #[test]
    fn voids_are_transparent_and_do_not_cast_shade() {
        for style in [Style::Grey, Style::Relief] {
            let options = Options { style, ..Options::new(10.0, 10.0) };
            let mut z = plane(7, 7, |_, _| 100.0);
            z[24] = f32::NAN;
            z[0] = f32::INFINITY;
            let picture = hillshade(&z, 7, 7, &options).unwrap();
            for (i, pixel) in picture.chunks(4).enumerate() {
                assert_eq!(pixel[3], if i == 24 || i == 0 { 0 } else { 255 });
                assert!(pixel[3] == 0 || pixel == &picture[4..8]);
            }
        }
    }

    #[test]
    fn any_size_from_one_sample_on_and_all_void_give_a_picture() {
        for (width, height, z) in [(1, 1, 5.0), (1, 9, -3.0), (9, 1, f32::NAN)] {
            let picture =
                hillshade(&vec![z; width * height], width, height, &Options::new(1.0, 1.0)).unwrap();
            let png = png_bytes(&picture, width as u32, height as u32).unwrap();
            let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
            let mut back = vec![0; picture.len()];
            reader.next_frame(&mut back).unwrap();
            assert_eq!(back, picture);
        }
    }

    #[test]
    fn wrong_sizes_are_refused() {
        assert!(hillshade(&[0.0; 5], 2, 2, &Options::new(1.0, 1.0)).is_err());
        assert!(hillshade(&[], 0, 0, &Options::new(1.0, 1.0)).is_err());
        assert!(hillshade(&[0.0; 4], 2, 2, &Options::new(0.0, 1.0)).is_err());
        assert!(png_bytes(&[0; 3], 1, 1).is_err());
    }
}
