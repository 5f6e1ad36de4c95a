//! What a build will be, known before a sample is read: lattice, levels, most tiles, memory and disk.

use serde_json::{Value, json};

use crate::container::layout::{Header, Metric, VERSION, leaf_level};
use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::limits::Limits;
use crate::patch::TileGeometry;
use crate::pipeline::imagery::Ground;
use crate::pipeline::occupied::Occupied;
use crate::pipeline::outcome;
use crate::pipeline::reach::Extent;
use crate::pipeline::{BuildOptions, merge, workers};
use crate::sample::Coding;
use crate::source::{Nodata, ReadMemory, SourceInfo};
use crate::tile::TileId;
use crate::tile::code::Recipe;

/// The plan of a build.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Columns of the lattice.
    pub width: u32,
    /// Rows of the lattice.
    pub height: u32,
    /// Intervals of a tile.
    pub tile: usize,
    /// Intervals of a patch.
    pub patch: usize,
    /// The leaves' level, L.
    pub levels: u8,
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
    check_power("--tile", options.tile, 16, 1024)?;
    check_power("--patch", options.patch, 4, 64)?;
    if options.patch > options.tile {
        return Err(Error::usage(format!(
            "--patch {} is larger than --tile {}; a tile holds at least one patch",
            options.patch, options.tile
        )));
    }
    if let Some(precision) = options.precision_m
        && !(precision.is_finite() && precision > 0.0)
    {
        return Err(Error::usage(format!("--precision {precision}: expected a length above 0, in metres")));
    }
    let side = Limits::default().raster_side;
    for (what, got) in [("raster width", info.width), ("raster height", info.height)] {
        if u64::from(got) > side {
            return Err(Error::limit(what, u64::from(got), side));
        }
    }
    outcome::check_input(info)?;
    let mut recipe = Recipe::lossless(info);
    recipe.nodata = Nodata::new(options.nodata.or(info.nodata), info.sample_type);
    let metres_of_value = info.band_scale.abs() * info.vertical_unit.0;
    let levels = leaf_level(info.width, info.height, options.tile);
    let all = Extent {
        columns: 0..tiles_along(info.width, options.tile.into(), 1 << levels),
        rows: 0..tiles_along(info.height, options.tile.into(), 1 << levels),
    };
    let plan = Plan {
        width: info.width,
        height: info.height,
        tile: options.tile as usize,
        patch: options.patch as usize,
        levels,
        occupied: Occupied::new(info.footprint.as_deref(), options.tile, &all),
        metric: options.metric,
        recipe,
        quantisation_error_m: options.precision_m.map_or(0.0, |p| p / 2.0),
        metres_of_value,
        geo: info.geo.clone(),
        jobs: workers(options.jobs),
        sample_bytes: info.sample_type.bytes() as u64,
        reading: (info.reading, info.block_rows),
        band: (info.band_scale, info.band_offset, info.vertical_unit.0),
    };
    merge::check_metadata(&plan, info, options)?;
    Ok(plan)
}

/// Tiles along an axis of so many samples. A tile is closed: one more that starts exactly at the last sample exists too, inside the root
/// square, which is `most` tiles wide.
fn tiles_along(samples: u32, span: u64, most: u32) -> u32 {
    ((u64::from(samples) - 1) / span + 1).min(most.into()) as u32
}

fn check_power(option: &str, value: u32, low: u32, high: u32) -> Result<()> {
    if value.is_power_of_two() && (low..=high).contains(&value) {
        return Ok(());
    }
    Err(Error::usage(format!("{option} {value}: expected a power of two from {low} to {high}")))
}

impl Plan {
    /// What imagery needs to know of the lattice.
    pub fn ground(&self) -> Ground<'_> {
        let (samples, tiles) = ((self.width, self.height), self.most_tiles().iter().sum());
        Ground { geo: &self.geo, intervals: self.span(0), samples, tiles }
    }

    /// Tile columns of a level that can hold samples.
    pub fn columns_of_tiles(&self, level: u8) -> u32 {
        tiles_along(self.width, self.span(level), 1 << level)
    }

    /// Tile rows of a level that can hold samples.
    pub fn rows_of_tiles(&self, level: u8) -> u32 {
        tiles_along(self.height, self.span(level), 1 << level)
    }

    /// Samples of the raster along the side of a tile.
    fn span(&self, level: u8) -> u64 {
        (self.tile as u64) << (self.levels - level)
    }

    /// Most tiles that a level, and the file, can have.
    pub fn most_tiles(&self) -> Vec<u64> {
        (0..=self.levels).map(|level| self.occupied.count(self.levels - level)).collect()
    }

    /// What the errors of a tile depend on.
    pub fn geometry(&self, id: TileId) -> TileGeometry {
        let step = 1_u64 << (self.levels - id.level);
        let span = step * self.tile as u64;
        let range = |tile: u32, samples: u32| {
            let first = (u64::from(tile) * span).min(u64::from(samples) - 1);
            let last = (u64::from(tile + 1) * span).min(u64::from(samples) - 1);
            (first as u32, last as u32)
        };
        let mut spacing = self.geo.spacing(range(id.x, self.width), range(id.y, self.height));
        spacing.dx *= step as f64;
        spacing.dy *= step as f64;
        let first = |tile: u32| u64::from(tile) * span;
        let metres = if let Coding::Integer { scale, .. } = self.recipe.coding { scale.abs() } else { 1.0 };
        TileGeometry {
            n: self.tile,
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
            width: self.width,
            height: self.height,
            tile_log2: self.tile.trailing_zeros() as u8,
            patch_log2: self.patch.trailing_zeros() as u8,
            levels: self.levels,
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

    /// Options as recorded in the metadata.
    pub fn options_json(&self, options: &BuildOptions, info: &SourceInfo) -> Value {
        let mut json = json!({
            "tile": self.tile,
            "patch": self.patch,
            "metric": self.metric,
            "precision_m": options.precision_m,
            "nodata": self.recipe.nodata.value().filter(|v| v.is_finite()),
        });
        if let Some(overlap) = info.overlap {
            json["overlap"] = json!(overlap);
        }
        json
    }

    /// Bytes of memory that the build takes at most.
    pub fn memory_estimate(&self, options: &BuildOptions) -> Result<u64> {
        Ok(self.memory_in_strips(&self.strips(options.memory)?))
    }
}
