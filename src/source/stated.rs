//! A raster of which the user says something else than its file does: the unit of its heights, or
//! their sense.

use std::ops::Range;
use std::path::PathBuf;

use super::{Fingerprint, OpenOptions, Origin, Source, SourceInfo, Window, advice};
use crate::error::Result;

/// A raster with another description; its samples are untouched.
struct Stated {
    info: SourceInfo,
    source: Box<dyn Source>,
}

/// The raster as the options have it; its samples stay as they are.
pub fn apply(source: Box<dyn Source>, options: &OpenOptions) -> Box<dyn Source> {
    let mut info = source.info().clone();
    state(&mut info, options);
    // NaN is not NaN, and costs a box.
    if info == *source.info() { source } else { Box::new(Stated { info, source }) }
}

/// The raster with more to say about it.
pub fn warned(source: Box<dyn Source>, warnings: Vec<String>) -> Box<dyn Source> {
    if warnings.is_empty() {
        return source;
    }
    let mut info = source.info().clone();
    info.warnings.extend(warnings);
    Box::new(Stated { info, source })
}

/// Vertical unit and sense as the options have them; without the warnings whose advice is taken.
/// Metres are `(offset + scale * sample) * unit`, so a depth is a height by the signs of scale and
/// offset.
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
    // No negative zero.
    info.band_offset = 0.0 - info.band_offset;
    let crs = &mut info.geo.crs;
    if crs.vertical_down {
        // A vertical system that counts downwards is not what the negated values are in.
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
