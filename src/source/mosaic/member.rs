//! One raster of a mosaic: its place, and the conversion of its samples.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::sample::SampleType;
use crate::source::{Nodata, Rect, Source, SourceInfo};

/// Reopens a raster.
pub(crate) type Opener = Box<dyn Fn() -> Result<Box<dyn Source>> + Send + Sync>;

/// The source of a member.
pub(crate) enum MemberSource {
    /// A source that stays open.
    Open(Arc<dyn Source>),
    /// A source that is opened when needed.
    Lazy(Opener),
}

/// A linear conversion of samples: `offset + ratio * sample`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scaled {
    /// Factor.
    pub(crate) ratio: f64,
    /// Summand.
    pub(crate) offset: f64,
    /// True if the result is rounded to float32 in between, as GDAL does for short types.
    pub(crate) single: bool,
}

impl Scaled {
    /// The converted value of a sample.
    #[inline]
    pub(crate) fn of(self, value: f64) -> f64 {
        let value = self.offset + self.ratio * value;
        if self.single { f64::from(value as f32) } else { value }
    }
}

/// One raster of a mosaic.
pub(crate) struct Member {
    /// Path of the raster.
    pub(crate) path: PathBuf,
    /// Its rectangle in the mosaic, not empty.
    pub(crate) rect: Rect,
    /// Column and row of the raster that lie at the north-western corner of `rect`.
    pub(crate) origin: (u32, u32),
    /// Columns and rows of the raster.
    pub(crate) size: (u32, u32),
    /// Sample type of the raster.
    pub(crate) sample_type: SampleType,
    /// Nodata value of the raster.
    pub(crate) nodata: Option<f64>,
    /// Samples that the nodata value makes void.
    pub(crate) voids: Nodata,
    /// Conversion of the samples; `None`: unchanged.
    pub(crate) scaled: Option<Scaled>,
    /// Rectangles of the mosaic that hold all of its valid samples.
    pub(crate) footprint: Vec<Rect>,
    /// All files that are read for it.
    pub(crate) files: Vec<PathBuf>,
    /// The source of its samples.
    pub(crate) held: MemberSource,
}

impl Member {
    /// The part of a window that the member has samples for.
    pub(super) fn common(&self, columns: &Range<u32>, rows: &Range<u32>) -> Rect {
        self.rect.within(columns, rows)
    }

    /// A rectangle of the mosaic, inside `rect`, in columns and rows of the raster.
    pub(super) fn own(&self, rect: &Rect) -> Rect {
        let shift = |range: &Range<u32>, from: u32, to: u32| range.start - from + to..range.end - from + to;
        Rect {
            columns: shift(&rect.columns, self.rect.columns.start, self.origin.0),
            rows: shift(&rect.rows, self.rect.rows.start, self.origin.1),
        }
    }

    /// True if the member has samples for all of a window.
    pub(super) fn covers(&self, columns: &Range<u32>, rows: &Range<u32>) -> bool {
        let common = self.common(columns, rows);
        common.columns == *columns && common.rows == *rows
    }

    /// True if its samples, mask and voids are those of the mosaic, without conversion.
    pub(super) fn is_plain(&self, mosaic: &SourceInfo) -> bool {
        let nodata = self.nodata.filter(|value| !value.is_nan());
        self.sample_type == mosaic.sample_type
            && self.scaled.is_none()
            && (nodata.is_none() || nodata == mosaic.nodata)
    }

    /// The open source, or one opened now.
    pub(super) fn open(&self) -> Result<Arc<dyn Source>> {
        let open = match &self.held {
            MemberSource::Open(source) => return Ok(Arc::clone(source)),
            MemberSource::Lazy(open) => open,
        };
        let source = open().map_err(|error| error.at(&self.path))?;
        let info = source.info();
        let (now, before) =
            ((info.width, info.height, info.sample_type), (self.size.0, self.size.1, self.sample_type));
        if now != before {
            let text = |(width, height, kind): (u32, u32, SampleType)| {
                format!("{width} x {height} samples of type {}", kind.gdal_name())
            };
            let got = format!("{} (it has been replaced: start again)", text(now));
            return Err(Error::format("the raster", text(before), got).at(&self.path));
        }
        Ok(Arc::from(source))
    }
}
