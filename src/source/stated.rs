//! Properties that the user states in place of those in the file: vertical unit, and depths for
//! heights.

use std::ops::Range;
use std::path::PathBuf;

use super::{Fingerprint, OpenOptions, Origin, Source, SourceInfo, Window, advice};
use crate::error::Result;

/// A raster with other properties; its samples are unchanged.
struct Stated {
    info: SourceInfo,
    source: Box<dyn Source>,
}

/// The raster with the properties that the options state.
pub fn apply(source: Box<dyn Source>, options: &OpenOptions) -> Box<dyn Source> {
    let mut info = source.info().clone();
    state(&mut info, options);
    // A NaN in the properties makes them differ: that costs a box, no more.
    if info == *source.info() { source } else { Box::new(Stated { info, source }) }
}

/// The raster with more warnings.
pub fn warned(source: Box<dyn Source>, warnings: Vec<String>) -> Box<dyn Source> {
    if warnings.is_empty() {
        return source;
    }
    let mut info = source.info().clone();
    info.warnings.extend(warnings);
    Box::new(Stated { info, source })
}

/// Sets vertical unit and sign as the options state, and drops the warnings that this answers.
/// Metres are `(offset + scale * sample) * unit`, so a depth becomes a height by the signs of scale
/// and offset.
pub fn state(info: &mut SourceInfo, options: &OpenOptions) {
    if let Some(unit) = &options.vertical_unit {
        info.vertical_unit.clone_from(unit);
        info.origins.unit = Some(Origin::User);
    }
    if options.nodata.is_some() {
        info.origins.nodata = Some(Origin::User);
    }
    let is_taken = |warning: &String| {
        options.vertical_unit.is_some() && warning.contains(advice::UNIT)
            || options.nodata.is_some() && warning.contains(advice::NODATA)
    };
    info.warnings.retain(|warning| !is_taken(warning));
    if !options.depth {
        return;
    }
    info.band_scale = -info.band_scale;
    // Avoids negative zero.
    info.band_offset = 0.0 - info.band_offset;
    let crs = &mut info.geo.crs;
    if crs.vertical_down {
        // The negated values are not in a vertical system that counts downwards.
        (crs.vertical_epsg, crs.vertical_down) = (None, false);
        crs.vertical_name += " (negated)";
        if let Some(keys) = &mut crs.keys {
            crate::crs::geokeys::drop_vertical(keys);
        }
    }
}

impl Source for Stated {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Window> {
        self.source.read_window(columns, rows)
    }

    fn take_back(&self, window: Window) {
        self.source.take_back(window);
    }

    fn release(&self) {
        self.source.release();
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        self.source.fingerprint()
    }

    fn files(&self) -> Vec<PathBuf> {
        self.source.files()
    }
}
