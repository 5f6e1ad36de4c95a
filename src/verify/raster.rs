//! Every sample of the source against what a reader decodes.

use std::ops::Range;

use super::report::{Check, Place};
use super::{VerifyOptions, Watch, tell};
use crate::container::layout::Header;
use crate::container::reader::Reader;
use crate::error::Result;
use crate::sample::{Lattice, SampleType, VALID};
use crate::source::{Rect, Source};
use crate::tile::TileId;

/// What the header says, then the samples, a row of leaf tiles at a time.
pub(super) fn check(
    reader: &Reader,
    source: &dyn Source,
    options: &VerifyOptions,
    progress: Watch,
) -> Result<Vec<Check>> {
    let about = check_about(reader, source, options.keep);
    let mut samples = Check::new("source samples", "samples", options.keep);
    let (header, info) = (reader.header(), source.info());
    if (header.width, header.height) != (info.width, info.height) {
        samples.note = "not compared, for the sizes differ".into();
        return Ok(vec![about, samples]);
    }
    let rule = Rule::of(header, info.sample_type);
    let tile = u64::from(header.tile());
    let footprint = info.footprint.as_deref();
    let mut row = 0;
    while row < header.height {
        let south = (u64::from(row) + tile).min(u64::from(header.height)) as u32;
        // The last row of the raster may be the lower border of the last row of tiles.
        let y = (row / header.tile()).min((1 << header.levels) - 1);
        // Tiles that the index does not lead to are missing, and found so.
        let tiles = samples.take(reader.row(header.levels, y), Place::default())?.unwrap_or_default();
        for columns in to_compare(header, &tiles, footprint, &(row..south)) {
            let band = Band::decode(reader, &columns, (row..south, y), &tiles, &mut samples)?;
            band.compare(source, &rule, &mut samples)?;
        }
        row = south;
        tell(progress, "source", row.into(), header.height.into())?;
    }
    Ok(vec![about, samples])
}

/// Columns of samples of some rows where there are tiles, or where the source may have samples: ascending, apart. All else is void on
/// both sides.
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

/// Size, type, georeference and units.
fn check_about(reader: &Reader, source: &dyn Source, keep: usize) -> Check {
    let mut check = Check::new("source header", "fields", keep);
    let (header, info) = (reader.header(), source.info());
    let mut same = |name: &str, is: bool, expected: &dyn std::fmt::Debug, got: &dyn std::fmt::Debug| {
        check.looked_at += 1;
        check.demand(is, || Place::of(name), format_args!("{expected:?}"), format_args!("{got:?}"));
    };
    let (size, stored) = ((info.width, info.height), (header.width, header.height));
    same("size", size == stored, &size, &stored);
    same("sample type", info.sample_type == header.source_type, &info.sample_type, &header.source_type);
    let (transform, stored) = (info.geo.transform, header.transform);
    same("geotransform", transform == stored, &transform, &stored);
    same("band scale", info.band_scale == header.band_scale, &info.band_scale, &header.band_scale);
    same("band offset", info.band_offset == header.band_offset, &info.band_offset, &header.band_offset);
    let metres = info.vertical_unit.0;
    same("vertical unit", metres == header.unit_metres, &metres, &header.unit_metres);
    same("coordinate system", info.geo.crs == reader.geo().crs, &info.geo.crs, &reader.geo().crs);
    // Another value may have been given to the build (`--nodata`); then the samples decide.
    let given = header.nodata.is_some() || info.nodata.is_none();
    same("nodata", given, &info.nodata, &header.nodata);
    check
}

/// How a decoded value may differ from the source's.
struct Rule {
    kind: SampleType,
    nodata: Option<f64>,
    /// In value units; 0 means bit for bit.
    error: f64,
}

impl Rule {
    fn of(header: &Header, kind: SampleType) -> Self {
        // A nodata value is compared as a number of the source's type.
        let nodata = if kind == SampleType::Float32 {
            header.nodata.map(|value| f64::from(value as f32))
        } else {
            header.nodata
        };
        Self { kind, nodata, error: header.quantisation_error }
    }

    /// A value as it would be written back to the source's type.
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

/// Rows of the raster as decoded.
struct Band {
    north: u32,
    south: u32,
    west: u32,
    width: usize,
    /// `None` where void.
    value: Vec<Option<f64>>,
}

impl Band {
    /// Puts those of the leaves `tiles` of tile row `y` together that meet `columns`. Where no tile is, all is void.
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
        for ids in ids.chunks(64) {
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
        // Columns of the raster that both have.
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

    fn compare(&self, source: &dyn Source, rule: &Rule, check: &mut Check) -> Result<()> {
        let columns = self.west..self.west + self.width as u32;
        let window = source.read_window(columns, self.north..self.south)?;
        check.looked_at += self.value.len() as u64;
        for (at, &decoded) in self.value.iter().enumerate() {
            let value = window.samples.value(at);
            let masked =
                window.mask.as_ref().is_some_and(|mask| mask.get(at).is_none_or(|&valid| valid == 0));
            let void = masked || !value.is_finite() || rule.nodata == Some(value);
            let original = (!void).then_some(value);
            let good = match (decoded, original) {
                (None, None) => true,
                (Some(decoded), Some(original)) => rule.agrees(decoded, original),
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
