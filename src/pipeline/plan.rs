//! [`Plan`]: what a build will be, known before a sample is read.

use super::metadata;
use super::occupied::Occupied;
use super::options::BuildOptions;
use super::outcome;
use super::pyramid::Pyramid;
use super::threads::workers;
use crate::container::layout::{Header, Metric, VERSION};
use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::imagery::Ground;
use crate::limits::Limits;
use crate::patch::TileGeometry;
use crate::sample::Coding;
use crate::source::{Nodata, ReadMemory, SourceInfo};
use crate::tile::TileId;
use crate::tile::code::Recipe;

/// The plan of a build.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Sizes of the levels.
    pub pyramid: Pyramid,
    /// Intervals of a patch.
    pub patch: usize,
    /// Which geometric error.
    pub metric: Metric,
    /// How samples become codes.
    pub recipe: Recipe,
    /// Largest error of a decoded height, metres.
    pub quantisation_error_m: f64,
    /// Metres of one unit of a value: GDAL scale and vertical unit.
    pub metres_of_value: f64,
    /// Where the lattice lies.
    pub geo: Geo,
    /// Which leaf tiles can hold samples.
    pub occupied: Occupied,
    /// Bytes of a sample of the source.
    pub sample_bytes: u64,
    /// Threads that work.
    pub jobs: usize,
    /// Memory that reading the source takes, and the height of its blocks.
    pub reading: (ReadMemory, u32),
    /// Scale, offset, and metres of the vertical unit.
    band: (f64, f64, f64),
}

/// Makes the plan of a build, or says what is wrong with its options.
pub fn plan(info: &SourceInfo, options: &BuildOptions) -> Result<Plan> {
    options.check()?;
    let side = Limits::default().raster_side;
    for (what, got) in [("raster width", info.width), ("raster height", info.height)] {
        if u64::from(got) > side {
            return Err(Error::limit(what, u64::from(got), side));
        }
    }
    outcome::check_input(info)?;
    let mut recipe = Recipe::lossless(info);
    recipe.nodata = Nodata::new(options.nodata.or(info.nodata), info.sample_type);
    let pyramid = Pyramid::new(info.width, info.height, options.tile);
    metadata::check(info, options, recipe.nodata)?;
    Ok(Plan {
        pyramid,
        patch: options.patch as usize,
        occupied: Occupied::new(info.footprint.as_deref(), options.tile, &pyramid.leaves()),
        metric: options.metric,
        recipe,
        quantisation_error_m: options.precision_m.map_or(0.0, |p| p / 2.0),
        metres_of_value: info.band_scale.abs() * info.vertical_unit.0,
        geo: info.geo.clone(),
        jobs: workers(options.jobs),
        sample_bytes: info.sample_type.bytes() as u64,
        reading: (info.reading, info.block_rows),
        band: (info.band_scale, info.band_offset, info.vertical_unit.0),
    })
}

/// How samples become codes. `largest` is the largest height of the source, if the options ask for
/// a precision.
pub fn recipe(info: &SourceInfo, options: &BuildOptions, largest: f64) -> Result<Recipe> {
    let info = SourceInfo { nodata: options.nodata.or(info.nodata), ..info.clone() };
    match options.precision_m {
        None => Ok(Recipe::lossless(&info)),
        Some(precision) => Recipe::quantised(&info, precision, largest),
    }
}

impl Plan {
    /// What imagery needs to know of the lattice.
    pub fn ground(&self) -> Ground<'_> {
        let Pyramid { width, height, .. } = self.pyramid;
        let tiles = self.most_tiles().iter().sum();
        Ground { geo: &self.geo, intervals: self.pyramid.span(0), samples: (width, height), tiles }
    }

    /// Most tiles that each level can have, the root first.
    pub fn most_tiles(&self) -> Vec<u64> {
        let levels = self.pyramid.levels;
        (0..=levels).map(|level| self.occupied.count(levels - level)).collect()
    }

    /// What the errors of a tile depend on.
    pub fn geometry(&self, id: TileId) -> TileGeometry {
        let step = 1_u64 << (self.pyramid.levels - id.level);
        let span = step * self.pyramid.tile as u64;
        let range = |tile: u32, samples: u32| {
            let first = (u64::from(tile) * span).min(u64::from(samples) - 1);
            let last = (u64::from(tile + 1) * span).min(u64::from(samples) - 1);
            (first as u32, last as u32)
        };
        let mut spacing = self.geo.spacing(range(id.x, self.pyramid.width), range(id.y, self.pyramid.height));
        spacing.dx *= step as f64;
        spacing.dy *= step as f64;
        let first = |tile: u32| u64::from(tile) * span;
        let metres = if let Coding::Integer { scale, .. } = self.recipe.coding { scale.abs() } else { 1.0 };
        TileGeometry {
            n: self.pyramid.tile,
            patch: self.patch,
            odd: (id.x + id.y) % 2 == 1,
            spacing,
            scale: self.geo.scale((first(id.x), first(id.y)), step),
            // One part in 10^12 covers the rounding of this product and of those with it.
            metres: metres * self.metres_of_value * (1.0 + 1e-12),
        }
    }

    /// Height in metres of a value, to the last bit what a reader makes of it.
    pub fn metres_of(&self, value: f64) -> f64 {
        let (scale, offset, unit) = self.band;
        (offset + scale * value) * unit
    }

    /// True if decoded heights differ from the source's.
    pub fn quantised(&self) -> bool {
        self.recipe.quantised
    }

    /// The header of the file.
    pub fn header(&self, info: &SourceInfo, tile_count: u64) -> Header {
        let quantisation_error =
            if self.quantised() { self.quantisation_error_m / self.metres_of_value } else { 0.0 };
        Header {
            version: VERSION,
            width: self.pyramid.width,
            height: self.pyramid.height,
            tile_log2: self.pyramid.tile.trailing_zeros() as u8,
            patch_log2: self.patch.trailing_zeros() as u8,
            levels: self.pyramid.levels,
            metric: self.metric,
            coding: self.recipe.coding,
            source_type: info.sample_type,
            band_scale: info.band_scale,
            band_offset: info.band_offset,
            unit_metres: info.vertical_unit.0,
            quantisation_error,
            nodata: self.recipe.nodata.value(),
            transform: info.geo.transform,
            tile_count,
        }
    }
}
