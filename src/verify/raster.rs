//! Compares every sample of the source with the decoded one.

use std::fmt;
use std::ops::Range;

use super::memory::{BATCH, Shape};
use super::report::{Check, Place};
use super::{VerifyOptions, words};
use crate::container::layout::Header;
use crate::container::reader::Reader;
use crate::error::Result;
use crate::progress::{Progress, Stage};
use crate::sample::{Lattice, SampleType, VALID};
use crate::source::{Rect, Source};
use crate::tile::TileId;

/// Compares the header, then the samples, in bands of at most `shape` within each row of leaf
/// tiles.
pub(super) fn check(
    reader: &Reader,
    source: &dyn Source,
    shape: Shape,
    options: &VerifyOptions,
    progress: &dyn Progress,
) -> Result<Vec<Check>> {
    let about = check_about(reader, source, options.keep);
    let mut samples = Check::new("source samples", "samples", options.keep);
    let (header, info) = (reader.header(), source.info());
    if (header.width, header.height) != (info.width, info.height) {
        samples.note = "not compared, for the sizes differ".into();
        return Ok(vec![about, samples]);
    }
    let tolerance = Tolerance::of(header, info.sample_type);
    let footprint = info.footprint.as_deref();
    let mut row = 0;
    while row < header.height {
        // The last row of the raster may be the lower border of the last row of tiles.
        let y = (row / header.tile()).min((1 << header.levels) - 1);
        let south = (u64::from(row) + u64::from(shape.rows)).min(u64::from(header.height)) as u32;
        // Tiles that the index does not lead to count as missing.
        let tiles = samples.take(reader.row(header.levels, y), Place::default())?.unwrap_or_default();
        let (parts, cut) = pieces(to_compare(header, &tiles, footprint, &(row..south)), shape.columns);
        for columns in parts {
            let band = Band::decode(reader, &columns, (row..south, y), &tiles, &mut samples)?;
            band.compare(source, &tolerance, &mut samples)?;
            if cut {
                // A sweep would keep blocks of each part for the next band, which exceeds the
                // memory limit.
                source.release();
            }
        }
        row = south;
        progress.step(Stage::Source, row.into(), header.height.into())?;
    }
    Ok(vec![about, samples])
}

/// The ranges cut into parts of at most `most`, and true if any was cut.
fn pieces(ranges: Vec<Range<u32>>, most: u32) -> (Vec<Range<u32>>, bool) {
    let count = ranges.len();
    let step = most.max(1) as usize;
    let parts = |range: Range<u32>| {
        let end = range.end;
        range.step_by(step).map(move |start| start..end.min(start.saturating_add(most.max(1))))
    };
    let cut: Vec<Range<u32>> = ranges.into_iter().flat_map(parts).collect();
    let is_cut = cut.len() > count;
    (cut, is_cut)
}

/// Columns to compare in some rows: those of tiles, and those where the source may have samples;
/// ascending and disjoint. All other columns are void in both.
fn to_compare(
    header: &Header,
    tiles: &[u32],
    footprint: Option<&[Rect]>,
    rows: &Range<u32>,
) -> Vec<Range<u32>> {
    let Some(footprint) = footprint else { return std::iter::once(0..header.width).collect() };
    let of_tile = |&x: &u32| {
        let west = u64::from(x) * u64::from(header.tile());
        west as u32..(west + u64::from(header.tile()) + 1).min(header.width.into()) as u32
    };
    let meets = |rect: &&Rect| rect.rows.start < rows.end && rows.start < rect.rows.end;
    let of_source = footprint.iter().filter(meets).map(|rect| rect.columns.clone());
    let mut all: Vec<Range<u32>> = tiles.iter().map(of_tile).chain(of_source).collect();
    all.sort_unstable_by_key(|range| range.start);
    let mut apart: Vec<Range<u32>> = Vec::new();
    for range in all {
        match apart.last_mut() {
            Some(last) if range.start <= last.end => last.end = last.end.max(range.end),
            _ => apart.push(range),
        }
    }
    apart
}

/// Compares size, type, georeference and units.
fn check_about(reader: &Reader, source: &dyn Source, keep: usize) -> Check {
    let mut check = Check::new("source header", "fields", keep);
    let (header, info) = (reader.header(), source.info());
    let mut same = |name: &str, is: bool, expected: &dyn fmt::Display, got: &dyn fmt::Display| {
        check.looked_at += 1;
        check.demand(is, || Place::of(name), expected, got);
    };
    let by = |(width, height): (u32, u32)| format!("{width} x {height} samples");
    let (size, stored) = ((info.width, info.height), (header.width, header.height));
    same("size", size == stored, &by(size), &by(stored));
    let (kind, stored) = (info.sample_type, header.source_type);
    same("sample type", kind == stored, &kind.gdal_name(), &stored.gdal_name());
    let (transform, stored) = (info.geo.transform, header.transform);
    same("geotransform", transform == stored, &words::transform(transform), &words::transform(stored));
    same("band scale", info.band_scale == header.band_scale, &info.band_scale, &header.band_scale);
    same("band offset", info.band_offset == header.band_offset, &info.band_offset, &header.band_offset);
    let metres = info.vertical_unit.0;
    same("metres of a vertical unit", metres == header.unit_metres, &metres, &header.unit_metres);
    let (crs, stored) = (&info.geo.crs, &reader.geo().crs);
    let (expected, got) = words::crs(crs, stored);
    same("coordinate system", crs == stored, &expected, &got);
    let (point, stored) = (info.geo.pixel_is_point, reader.geo().pixel_is_point);
    same("pixel is point", point == stored, &point, &stored);
    let (name, stored) = (&info.vertical_unit.1, &reader.metadata().vertical_unit);
    same("name of the vertical unit", name == stored, name, stored);
    // The build may have been given another nodata value (`--nodata`); then the samples decide.
    let given = header.nodata.is_some() || info.nodata.is_none();
    let text =
        |nodata: Option<f64>, kind: SampleType| nodata.map_or("none".to_owned(), |value| kind.text(value));
    let (nodata, stored) = (text(info.nodata, kind), text(header.nodata, header.source_type));
    same("nodata", given, &nodata, &stored);
    check
}

/// How much a decoded value may differ from the source's.
struct Tolerance {
    kind: SampleType,
    nodata: Option<f64>,
    /// Largest difference in value units; 0 means bit for bit.
    error: f64,
}

impl Tolerance {
    fn of(header: &Header, kind: SampleType) -> Self {
        Self { kind, nodata: header.nodata, error: header.quantisation_error }
    }

    /// True if a sample is void by the nodata value: GDAL's comparison as in its source
    /// (`GDALNoDataMaskBand`).
    fn is_nodata(&self, sample: f64) -> bool {
        const ULPS: f32 = 2.0;
        let Some(nodata) = self.nodata else { return false };
        // Integers are compared as bytes or in 32 bits, after a cast that drops the fraction.
        let (low, high) = match self.kind {
            SampleType::Float32 => {
                let (a, b) = (sample as f32, nodata as f32);
                return a == b || b.is_finite() && (a - b).abs() < f32::EPSILON * (a + b).abs() * ULPS;
            }
            SampleType::Float64 => {
                let (difference, sum) = ((sample - nodata).abs(), (sample + nodata).abs());
                let close = difference < f64::from(f32::EPSILON) * sum * f64::from(ULPS);
                return sample == nodata || nodata.is_finite() && close;
            }
            SampleType::Uint8 => (0, i64::from(u8::MAX)),
            SampleType::Uint16 | SampleType::Uint32 => (0, i64::from(u32::MAX)),
            SampleType::Int8 | SampleType::Int16 | SampleType::Int32 => {
                (i64::from(i32::MIN), i64::from(i32::MAX))
            }
        };
        nodata >= low as f64 && nodata <= high as f64 && sample as i64 == nodata as i64
    }

    /// A value rounded to the source's type.
    fn rounded(&self, value: f64) -> f64 {
        match self.kind {
            SampleType::Float64 => value,
            SampleType::Float32 => f64::from(value as f32),
            _ => value.round(),
        }
    }

    fn agrees(&self, decoded: f64, original: f64) -> bool {
        if self.error == 0.0 {
            return if self.kind.is_float() {
                decoded.to_bits() == original.to_bits()
            } else {
                decoded == original
            };
        }
        let most = self.error * (1.0 + 1e-12);
        (decoded - original).abs() <= most && (self.rounded(decoded) - original).abs() <= most
    }
}

/// Decoded rows of the raster.
struct Band {
    north: u32,
    south: u32,
    west: u32,
    width: usize,
    /// Values; `None` is void.
    value: Vec<Option<f64>>,
}

impl Band {
    /// Assembles the samples in `columns` of the leaves `tiles` of tile row `y`. Where there is no
    /// tile, all are void.
    fn decode(
        reader: &Reader,
        columns: &Range<u32>,
        (rows, y): (Range<u32>, u32),
        tiles: &[u32],
        check: &mut Check,
    ) -> Result<Self> {
        use rayon::prelude::*;
        let header = reader.header();
        let (north, south, west, width) = (rows.start, rows.end, columns.start, columns.len());
        let mut band = Self { north, south, west, width, value: vec![None; width * rows.len()] };
        let meets = |x: &&u32| {
            let left = u64::from(**x) * u64::from(header.tile());
            left < u64::from(columns.end) && u64::from(columns.start) <= left + u64::from(header.tile())
        };
        let ids: Vec<_> = tiles.iter().filter(meets).map(|&x| TileId::new(header.levels, x, y)).collect();
        for ids in ids.chunks(BATCH) {
            let tiles: Vec<_> = ids.par_iter().map(|&id| (id, reader.read_tile(id))).collect();
            for (id, tile) in tiles {
                if let Some(lattice) = check.take(tile, Place::tile(id))? {
                    band.place(header, id, &lattice);
                }
            }
        }
        Ok(band)
    }

    fn place(&mut self, header: &Header, id: TileId, lattice: &Lattice) {
        let (left, top) = header.origin(id);
        // Columns that both the band and the tile have.
        let start = left.max(self.west.into());
        let end = (left + lattice.n as u64 + 1).min(u64::from(self.west) + self.width as u64);
        let columns = end.saturating_sub(start) as usize;
        for row in self.north..self.south {
            let from = lattice.at((start - left) as usize, (u64::from(row) - top) as usize);
            let to = (row - self.north) as usize * self.width + (start - u64::from(self.west)) as usize;
            for (at, value) in (from..from + columns).zip(&mut self.value[to..to + columns]) {
                if lattice.state[at] == VALID {
                    *value = Some(header.coding.value(lattice.code[at], lattice.low_at(at)));
                }
            }
        }
    }

    fn compare(&self, source: &dyn Source, tolerance: &Tolerance, check: &mut Check) -> Result<()> {
        let columns = self.west..self.west + self.width as u32;
        let window = source.read_window(columns, self.north..self.south)?;
        check.looked_at += self.value.len() as u64;
        for (at, &decoded) in self.value.iter().enumerate() {
            let value = window.samples.value(at);
            let masked =
                window.mask.as_ref().is_some_and(|mask| mask.get(at).is_none_or(|&valid| valid == 0));
            let void = masked || !value.is_finite() || tolerance.is_nodata(value);
            let original = (!void).then_some(value);
            let good = match (decoded, original) {
                (None, None) => true,
                (Some(decoded), Some(original)) => tolerance.agrees(decoded, original),
                _ => false,
            };
            if !good {
                let word =
                    |value: Option<f64>| value.map_or_else(|| "void".to_owned(), |value| value.to_string());
                let (column, row) = (
                    u64::from(self.west) + (at % self.width) as u64,
                    u64::from(self.north) + (at / self.width) as u64,
                );
                check.fail(Place::default().sample(column, row), word(original), word(decoded));
            }
        }
        Ok(())
    }
}
