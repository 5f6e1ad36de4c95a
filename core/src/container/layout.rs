//! The header (section 4 of the specification), and the sizes that follow from it.
//!
//! [`Header`] describes the terrain; the file itself is described in [`super::opening`]. Decoding
//! checks every field against its range and against the others: a header that decodes is sound.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::bytes::Bytes;
use super::directory::Quadtree;
use crate::error::{Error, Result};
use crate::sample::{Coding, SampleType};
use crate::tile::TileId;

/// The version that this program writes; it also reads earlier ones.
pub const VERSION: u16 = 2;
/// Largest number of columns or rows.
pub const MAX_SIDE: u32 = 1 << 30;
/// Largest leaf level: `2^30` samples of tiles of 16.
pub const MAX_LEVEL: u8 = 26;

const HAS_TRANSFORM: u16 = 1;
const HAS_NODATA: u16 = 2;
const QUANTISED: u16 = 4;

/// The meaning of the errors of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "write", derive(wincode::SchemaRead, wincode::SchemaWrite))]
#[serde(rename_all = "lowercase")]
#[repr(u8)]
pub enum Metric {
    /// The largest one-step error of the dropped vertices; not a bound.
    Paper = 1,
    /// A bound: no point of the surface deviates by more.
    #[default]
    Bound = 2,
}

impl Metric {
    /// The name: `paper` or `bound`.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Bound => "bound",
        }
    }
}

impl fmt::Display for Metric {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl FromStr for Metric {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        match name {
            "paper" => Ok(Self::Paper),
            "bound" => Ok(Self::Bound),
            _ => Err(Error::usage(format!("there is no metric {name:?}; use bound or paper"))),
        }
    }
}

/// The leaf level `L`: the least with `tile * 2^L >= max(width, height) - 1`. `tile` is in
/// intervals, at least 1.
///
/// ```
/// use relevo_core::container::leaf_level;
///
/// assert_eq!(leaf_level(70, 50, 16), 3);
/// ```
pub fn leaf_level(width: u32, height: u32, tile: u32) -> u8 {
    let intervals = u64::from(width.max(height).max(1) - 1);
    let mut level = 0;
    while u64::from(tile.max(1)) << level < intervals {
        level += 1;
    }
    level
}

/// The terrain of a file: sizes, numbers and place.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    /// Version of the format, 1 or [`VERSION`]. In version 1 the horizontal errors of geographic
    /// rasters are not proven bounds.
    pub version: u16,
    /// Columns of the lattice.
    pub width: u32,
    /// Rows of the lattice.
    pub height: u32,
    /// Binary logarithm of the tile size in intervals, 4..=10.
    pub tile_log2: u8,
    /// Binary logarithm of the patch size in intervals, 2..=6, at most `tile_log2`.
    pub patch_log2: u8,
    /// The leaf level `L`; [`leaf_level`] gives it.
    pub levels: u8,
    /// The meaning of the errors.
    pub metric: Metric,
    /// How codes become values.
    pub coding: Coding,
    /// Type of the source's samples, which an export writes.
    pub source_type: SampleType,
    /// Metres are `(band_offset + band_scale * value) * unit_metres`. Finite, not 0.
    pub band_scale: f64,
    /// See `band_scale`. Finite.
    pub band_offset: f64,
    /// Metres of the vertical unit. Finite, above 0.
    pub unit_metres: f64,
    /// Largest difference between a stored value and the source's, in value units; 0 if lossless.
    pub quantisation_error: f64,
    /// The source's void value.
    pub nodata: Option<f64>,
    /// GDAL geotransform of pixel corners.
    pub transform: Option<[f64; 6]>,
    /// Existing tiles of all levels.
    pub tile_count: u64,
}

impl Header {
    /// Tile size in intervals, `T`.
    pub fn tile(&self) -> u32 {
        1 << self.tile_log2
    }

    /// Patch size in intervals, `P`.
    pub fn patch(&self) -> u32 {
        1 << self.patch_log2
    }

    /// Patches along a side of a tile, `T / P`.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// assert_eq!(reader.header().patches(), 4);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn patches(&self) -> u32 {
        1 << (self.tile_log2 - self.patch_log2)
    }

    /// Steps that a patch can be drawn at, `p + 1`.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// assert_eq!(reader.header().steps(), 3);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn steps(&self) -> u32 {
        u32::from(self.patch_log2) + 1
    }

    /// Lattice samples from one sample of a level to the next: `2^(L - level)`; 1 below the leaf
    /// level.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// assert_eq!([0, 1, 2, 3].map(|level| reader.header().spacing(level)), [8, 4, 2, 1]);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn spacing(&self, level: u8) -> u32 {
        1 << self.levels.saturating_sub(level)
    }

    /// Metres of a value.
    pub fn metres(&self, value: f64) -> f64 {
        (self.band_offset + self.band_scale * value) * self.unit_metres
    }

    /// Metres of a code.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// let tile = reader.read_tile(TileId::ROOT)?;
    /// assert_eq!(reader.header().metres_of(250, 0), 250.0);
    /// assert_eq!(tile.code.len(), 289);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn metres_of(&self, code: i32, low: u32) -> f64 {
        self.metres(self.coding.value(code, low))
    }

    /// Columns and rows of a level's lattice within the raster.
    pub fn level_size(&self, level: u8) -> (u32, u32) {
        let spacing = self.spacing(level);
        ((self.width - 1) / spacing + 1, (self.height - 1) / spacing + 1)
    }

    /// Samples of the first column and row of a tile; they may lie outside the raster.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// assert_eq!(reader.header().origin(TileId::new(3, 1, 2)), (16, 32));
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn origin(&self, id: TileId) -> (u64, u64) {
        let side = u64::from(self.tile()) * u64::from(self.spacing(id.level));
        (u64::from(id.x) * side, u64::from(id.y) * side)
    }

    /// True if a tile of this id can exist: it has a level, lies in the root square and touches the
    /// raster.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// let header = reader.header();
    /// assert!(header.holds(TileId::new(3, 4, 3)) && !header.holds(TileId::new(3, 5, 3)));
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn holds(&self, id: TileId) -> bool {
        if id.level > self.levels || id.x >> id.level != 0 || id.y >> id.level != 0 {
            return false;
        }
        let (column, row) = self.origin(id);
        column < u64::from(self.width) && row < u64::from(self.height)
    }

    /// Most bytes of a stored chunk: enough for any terrain.
    pub fn max_chunk_bytes(&self) -> u64 {
        16 * (u64::from(self.tile()) + 1).pow(2) + 65_536
    }

    /// Fails unless every field is within its range and fits the others.
    pub fn check(&self) -> Result<()> {
        let side = |name: &str, got: u32| {
            if got == 0 {
                return Err(Error::format(format!("header, {name}"), "at least 1", got));
            }
            if got > MAX_SIDE {
                return Err(Error::limit(format!("{name} of the lattice"), got.into(), MAX_SIDE.into()));
            }
            Ok(())
        };
        demand((1..=VERSION).contains(&self.version), "version", &format!("1 to {VERSION}"), self.version)?;
        side("width", self.width)?;
        side("height", self.height)?;
        demand((4..=10).contains(&self.tile_log2), "log2 of the tile size", "4 to 10", self.tile_log2)?;
        let finest = self.tile_log2.min(6);
        let range = format!("2 to {finest}");
        demand((2..=finest).contains(&self.patch_log2), "log2 of the patch size", &range, self.patch_log2)?;
        let level = leaf_level(self.width, self.height, self.tile());
        demand(self.levels == level, "leaf level", &level.to_string(), self.levels)?;
        let source = match self.coding {
            Coding::Integer { .. } => self.source_type,
            Coding::Float32 => SampleType::Float32,
            Coding::Float64 => SampleType::Float64,
        };
        let name = "source type of float samples";
        demand(self.source_type == source, name, &format!("{source:?}"), format!("{:?}", self.source_type))?;
        if let Coding::Integer { scale, offset } = self.coding {
            demand(scale.is_finite() && scale != 0.0, "scale", "a finite number, not 0", scale)?;
            demand(offset.is_finite(), "offset", "a finite number", offset)?;
        }
        let scale = self.band_scale;
        demand(scale.is_finite() && scale != 0.0, "band scale", "a finite number, not 0", scale)?;
        demand(self.band_offset.is_finite(), "band offset", "a finite number", self.band_offset)?;
        let unit = self.unit_metres;
        demand(unit.is_finite() && unit > 0.0, "unit metres", "a finite number above 0", unit)?;
        let error = self.quantisation_error;
        demand(
            error.is_finite() && error >= 0.0,
            "quantisation error",
            "a finite number, at least 0",
            error,
        )?;
        let rounded = error == 0.0 || matches!(self.coding, Coding::Integer { .. });
        demand(rounded, "quantisation error", "0, for its samples are floats", error)?;
        let finite = self.transform.is_none_or(|transform| transform.iter().all(|term| term.is_finite()));
        demand(finite, "geotransform", "finite numbers", "others")?;
        demand(self.tile_count > 0, "tile count", "at least 1", self.tile_count)
    }

    fn flags(&self) -> u16 {
        let flag = |is: bool, bit| if is { bit } else { 0 };
        flag(self.transform.is_some(), HAS_TRANSFORM)
            | flag(self.nodata.is_some(), HAS_NODATA)
            | flag(self.quantisation_error > 0.0, QUANTISED)
    }

    /// Appends the fields from offset 32 to 160.
    pub(super) fn encode(&self, out: &mut Vec<u8>) {
        let (kind, scale, offset) = match self.coding {
            Coding::Integer { scale, offset } => (1, scale, offset),
            Coding::Float32 => (2, 1.0, 0.0),
            Coding::Float64 => (3, 1.0, 0.0),
        };
        out.extend(self.width.to_le_bytes());
        out.extend(self.height.to_le_bytes());
        out.extend([self.tile_log2, self.patch_log2, self.levels, self.metric as u8]);
        out.extend([kind, self.source_type as u8]);
        out.extend(self.flags().to_le_bytes());
        let unit = [self.band_scale, self.band_offset, self.unit_metres, self.quantisation_error];
        let numbers = [scale, offset].into_iter().chain(unit).chain([self.nodata.unwrap_or(0.0)]);
        for number in numbers.chain(self.transform.unwrap_or([0.0; 6])) {
            out.extend(number.to_le_bytes());
        }
        out.extend(self.tile_count.to_le_bytes());
    }

    /// Decodes the fields of [`Header::encode`] in a file of this version.
    pub(super) fn decode(version: u16, bytes: &mut Bytes) -> Result<Self> {
        let (width, height) = (bytes.u32()?, bytes.u32()?);
        let (tile_log2, patch_log2, levels) = (bytes.u8()?, bytes.u8()?, bytes.u8()?);
        let metric = match bytes.u8()? {
            1 => Metric::Paper,
            2 => Metric::Bound,
            other => return Err(newer(format!("metric {other}"))),
        };
        let kind = bytes.u8()?;
        let number = bytes.u8()?;
        let source_type =
            SampleType::from_number(number).ok_or_else(|| newer(format!("source type {number}")))?;
        let flags = bytes.u16()?;
        demand(flags & !(HAS_TRANSFORM | HAS_NODATA | QUANTISED) == 0, "flags", "bits 0 to 2", flags)?;
        let (scale, offset) = (bytes.f64()?, bytes.f64()?);
        let (band_scale, band_offset) = (bytes.f64()?, bytes.f64()?);
        let (unit_metres, quantisation_error) = (bytes.f64()?, bytes.f64()?);
        let nodata = bytes.f64()?;
        let mut transform = [0.0; 6];
        for term in &mut transform {
            *term = bytes.f64()?;
        }
        let tile_count = bytes.u64()?;
        let coding = match kind {
            1 => Coding::Integer { scale, offset },
            2 => Coding::Float32,
            3 => Coding::Float64,
            other => return Err(newer(format!("sample kind {other}"))),
        };
        let plain = kind == 1 || (scale == 1.0 && offset == 0.0);
        demand(plain, "scale and offset of float samples", "1 and 0", format!("{scale} and {offset}"))?;
        let given = flags & HAS_NODATA != 0;
        demand(given || nodata == 0.0, "nodata", "0, for none is given", nodata)?;
        let nodata = given.then_some(nodata);
        let given = flags & HAS_TRANSFORM != 0;
        demand(given || transform == [0.0; 6], "geotransform", "zeros, for none is given", "others")?;
        let transform = given.then_some(transform);
        let quantised = flags & QUANTISED != 0;
        let name = "quantisation error";
        demand(
            quantised == (quantisation_error > 0.0),
            name,
            "above 0 if flagged, else 0",
            quantisation_error,
        )?;
        #[rustfmt::skip]
        let header = Self {
            version, width, height, tile_log2, patch_log2, levels, metric, coding, source_type, band_scale, band_offset,
            unit_metres, quantisation_error, nodata, transform, tile_count,
        };
        header.check()?;
        Ok(header)
    }
}

impl Quadtree for Header {
    fn leaf(&self) -> u8 {
        self.levels
    }

    fn holds(&self, id: TileId) -> bool {
        Self::holds(self, id)
    }

    fn max_chunk_bytes(&self) -> u64 {
        Self::max_chunk_bytes(self)
    }
}

/// Fails with the name of the field unless `is` holds.
pub(super) fn demand(is: bool, field: &str, expected: &str, got: impl ToString) -> Result<()> {
    if is { Ok(()) } else { Err(Error::format(format!("header, {field}"), expected, got)) }
}

/// The error for a file that a later program has written.
pub(super) fn newer(what: String) -> Error {
    Error::unsupported(what, "written by a newer relevo; use one that knows it")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header() -> Header {
        Header {
            version: VERSION,
            width: 1000,
            height: 70_000,
            tile_log2: 8,
            patch_log2: 6,
            levels: leaf_level(1000, 70_000, 256),
            metric: Metric::Paper,
            coding: Coding::Integer { scale: 0.01, offset: -3.0 },
            source_type: SampleType::Float32,
            band_scale: -2.0,
            band_offset: 0.5,
            unit_metres: 0.3048,
            quantisation_error: 0.005,
            nodata: Some(-32768.0),
            transform: Some([1.0, 2.0, 3.0, 4.0, 5.0, -6.0]),
            tile_count: 1 << 40,
        }
    }

    fn round_trip(header: &Header) -> Header {
        let mut out = Vec::new();
        header.encode(&mut out);
        assert_eq!(out.len(), 128);
        let mut bytes = Bytes::new(&out, "header");
        let back = Header::decode(header.version, &mut bytes).unwrap();
        bytes.end().unwrap();
        back
    }

    #[test]
    fn headers_round_trip() {
        let full = header();
        assert_eq!(round_trip(&full), full);
        let bare = Header { nodata: None, transform: None, quantisation_error: 0.0, ..header() };
        assert_eq!(round_trip(&bare), bare);
        for (coding, source_type) in
            [(Coding::Float32, SampleType::Float32), (Coding::Float64, SampleType::Float64)]
        {
            let float = Header { coding, source_type, ..bare.clone() };
            assert_eq!(round_trip(&float), float);
            assert!(Header { source_type: SampleType::Int16, ..float.clone() }.check().is_err());
            assert!(Header { quantisation_error: 0.1, ..float }.check().is_err());
        }
        let odd = round_trip(&Header { nodata: Some(f64::NAN), ..header() });
        assert!(odd.nodata.is_some_and(f64::is_nan));
    }

    #[test]
    fn the_leaf_level_is_the_least_that_covers_the_raster() {
        for (width, height, tile, level) in [
            (1, 1, 16, 0),
            (17, 1, 16, 0),
            (18, 1, 16, 1),
            (1, 33, 16, 1),
            (34, 33, 16, 2),
            (65_537, 65_537, 256, 8),
            (1 << 30, 5, 16, 26),
        ] {
            assert_eq!(leaf_level(width, height, tile), level, "{width} x {height}, tiles of {tile}");
        }
    }

    #[test]
    fn levels_keep_every_second_sample() {
        let header = header();
        assert_eq!(header.levels, 9);
        assert_eq!(header.level_size(9), (1000, 70_000));
        assert_eq!(header.level_size(8), (500, 35_000));
        assert_eq!(header.level_size(0), (2, 137));
        assert_eq!(header.metres(10.0), (0.5 - 2.0 * 10.0) * 0.3048);
        assert!(header.holds(TileId::new(9, 3, 273)) && !header.holds(TileId::new(9, 4, 0)));
        assert!(!header.holds(TileId::new(10, 0, 0)) && !header.holds(TileId::new(0, 0, 1)));
    }
}
