//! Rasters in memory that are meant to be difficult.

use std::ops::Range;

use relevo::Result;
use relevo::geo::Geo;
use relevo::sample::SampleType;
use relevo::source::{Fingerprint, Samples, Source, SourceInfo, Window};

/// The void value of the integer rasters here.
pub const NODATA: i16 = -32768;

/// A raster in memory.
pub struct Memory {
    pub info: SourceInfo,
    pub samples: Samples,
    pub mask: Option<Vec<u8>>,
}

impl Source for Memory {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Window> {
        let width = self.info.width as usize;
        let range = rows.start as usize * width..rows.end as usize * width;
        let samples = match &self.samples {
            Samples::Int8(v) => Samples::Int8(v[range.clone()].to_vec()),
            Samples::Uint8(v) => Samples::Uint8(v[range.clone()].to_vec()),
            Samples::Int16(v) => Samples::Int16(v[range.clone()].to_vec()),
            Samples::Uint16(v) => Samples::Uint16(v[range.clone()].to_vec()),
            Samples::Int32(v) => Samples::Int32(v[range.clone()].to_vec()),
            Samples::Uint32(v) => Samples::Uint32(v[range.clone()].to_vec()),
            Samples::Float32(v) => Samples::Float32(v[range.clone()].to_vec()),
            Samples::Float64(v) => Samples::Float64(v[range.clone()].to_vec()),
        };
        let window = Window { samples, mask: self.mask.as_ref().map(|mask| mask[range].to_vec()) };
        Ok(window.cropped(self.info.width, &columns))
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        Ok(Fingerprint { files: Vec::new() })
    }
}

/// What a raster in memory says of itself.
pub fn info(width: u32, height: u32, sample_type: SampleType) -> SourceInfo {
    SourceInfo {
        width,
        height,
        sample_type,
        nodata: None,
        band_scale: 1.0,
        band_offset: 0.0,
        vertical_unit: (1.0, String::new()),
        geo: Geo::default(),
        description: "memory".into(),
        parts: Vec::new(),
        footprint: None,
        overlap: None,
        block_rows: 16,
        reading: relevo::source::ReadMemory::default(),
        warnings: Vec::new(),
        origins: relevo::source::Origins::default(),
    }
}

/// A number that depends on nothing but where it stands (splitmix64).
pub fn noise(seed: u64, x: u32, y: u32) -> u64 {
    let mut z = seed ^ (u64::from(x) << 32 | u64::from(y)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    for _ in 0..2 {
        z = (z ^ (z >> 30)).wrapping_add(0x9E37_79B9_7F4A_7C15).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    }
    z ^ (z >> 31)
}

/// Ways to be difficult.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Random heights.
    Rough,
    /// Flat but for a few samples.
    Spikes,
    /// Two heights in turn.
    Checkerboard,
    /// Valid and void in turn.
    VoidCheckerboard,
    /// Holes of one sample.
    Pinholes,
    /// Valid lines one sample wide, void between them.
    Stripes,
    /// Half of the samples void.
    RandomVoids,
    /// Blobs of land.
    Islands,
    /// Plateaus that end at corners of tiles.
    Plateaus,
    /// One valid sample.
    OneValid,
    /// One void sample.
    OneVoid,
    /// A diagonal line of valid samples.
    Diagonal,
    /// A slope that any step draws exactly, with a frame of voids.
    Framed,
}

impl Kind {
    pub const ALL: [Self; 13] = [
        Self::Rough,
        Self::Spikes,
        Self::Checkerboard,
        Self::VoidCheckerboard,
        Self::Pinholes,
        Self::Stripes,
        Self::RandomVoids,
        Self::Islands,
        Self::Plateaus,
        Self::OneValid,
        Self::OneVoid,
        Self::Diagonal,
        Self::Framed,
    ];

    /// Height at a sample; `None` is void.
    fn at(self, x: u32, y: u32, (width, height): (u32, u32), seed: u64) -> Option<i16> {
        let random = noise(seed, x, y);
        let rough = (random >> 20) as i16 / 2;
        let one = (noise(seed, 0, 1) % u64::from(width)) as u32 == x
            && (noise(seed, 1, 0) % u64::from(height)) as u32 == y;
        match self {
            Self::Rough => Some(rough),
            Self::Spikes => Some(if random.is_multiple_of(97) || one { rough } else { 0 }),
            Self::Checkerboard => Some(if (x + y).is_multiple_of(2) { 1000 } else { -1000 }),
            Self::VoidCheckerboard => (x + y).is_multiple_of(2).then_some(rough / 16),
            Self::Pinholes => (!random.is_multiple_of(31) || one).then_some(rough / 64),
            Self::Stripes => (x % 9 == (seed % 9) as u32 || y % 13 == 4).then_some(rough / 8),
            Self::RandomVoids => (random.is_multiple_of(2) || one).then_some(rough),
            Self::Islands => {
                let wave = (f64::from(x) * 0.21 + seed as f64).sin()
                    + (f64::from(y) * 0.17).cos()
                    + (f64::from(x + y) * 0.05).sin();
                (wave > 0.3 || one).then_some((wave * 500.0) as i16 + (random % 7) as i16)
            }
            Self::Plateaus => {
                let land = !(x / 16 + y / 16).is_multiple_of(3)
                    || x.is_multiple_of(16)
                    || y.is_multiple_of(32)
                    || one;
                land.then_some(((x / 16 * 7 + y / 16 * 3) % 11) as i16 * 100)
            }
            Self::OneValid => one.then_some(rough),
            Self::OneVoid => (!one || width * height == 1).then_some(rough / 100),
            Self::Diagonal => (x.abs_diff(y) <= 1 || one).then_some(rough / 4),
            Self::Framed => {
                let inside = x > 2 && y > 4 && x + 4 < width && y + 3 < height;
                (inside || one).then_some((3 * x as i16) - (2 * y as i16))
            }
        }
    }
}

/// A raster of 16-bit integers.
pub fn int16(width: u32, height: u32, kind: Kind, seed: u64) -> Memory {
    let samples =
        (0..width * height).map(|i| kind.at(i % width, i / width, (width, height), seed).unwrap_or(NODATA));
    let samples = Samples::Int16(samples.collect());
    let info = SourceInfo { nodata: Some(NODATA.into()), ..info(width, height, SampleType::Int16) };
    Memory { info, samples, mask: None }
}

/// Samples at the ends of their type and around 0, some void by a mask.
pub fn extreme(width: u32, height: u32, kind: SampleType, seed: u64) -> Memory {
    macro_rules! pick {
        ($variant:ident, $type:ty, $small:expr) => {{
            let choices =
                [<$type>::MIN, <$type>::MAX, 0 as $type, 1 as $type, $small, <$type>::MAX / 3 as $type];
            let at = |i: u32| choices[(noise(seed, i % width, i / width) % 6) as usize];
            Samples::$variant((0..width * height).map(at).collect())
        }};
    }
    let samples = match kind {
        SampleType::Int8 => pick!(Int8, i8, -3),
        SampleType::Uint8 => pick!(Uint8, u8, 3),
        SampleType::Int16 => pick!(Int16, i16, -300),
        SampleType::Uint16 => pick!(Uint16, u16, 300),
        SampleType::Int32 => pick!(Int32, i32, -70_000),
        SampleType::Uint32 => pick!(Uint32, u32, 70_000),
        SampleType::Float32 => pick!(Float32, f32, -1e-30),
        SampleType::Float64 => pick!(Float64, f64, -1e-300),
    };
    let mask = (0..width * height)
        .map(|i| u8::from(!noise(seed + 1, i % width / 5, i / width / 3).is_multiple_of(4)))
        .collect();
    Memory { info: info(width, height, kind), samples, mask: Some(mask) }
}

/// Rolling hills in floats or, a hundred times as high, integers; with `voids`, a lake of NaN (a
/// mask for integers).
pub fn smooth(width: u32, height: u32, kind: SampleType, voids: bool) -> Memory {
    let lake = |x: u32, y: u32| voids && (f64::from(x) - 50.3).hypot(f64::from(y) - 30.7) < 17.2;
    let hill = |x: u32, y: u32| {
        let (x, y) = (f64::from(x), f64::from(y));
        1500.0 + 300.0 * (x * 0.05).sin() * (y * 0.07).cos() + 10.0 * (x * 0.9 + y * 1.3).sin()
    };
    let places = || (0..width * height).map(|i| (i % width, i / width));
    let value = |(x, y): (u32, u32)| if lake(x, y) { f64::NAN } else { hill(x, y) };
    let mut mask = None;
    let samples = match kind {
        SampleType::Float32 => Samples::Float32(places().map(|place| value(place) as f32).collect()),
        SampleType::Float64 => Samples::Float64(places().map(value).collect()),
        _ => {
            mask = Some(places().map(|(x, y)| u8::from(!lake(x, y))).collect());
            Samples::Int32(places().map(|(x, y)| (100.0 * hill(x, y)) as i32).collect())
        }
    };
    let kind = samples.sample_type();
    Memory { info: info(width, height, kind), samples, mask }
}
