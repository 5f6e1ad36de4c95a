//! Pictures to read from: windows of 8-bit colours with alpha, whatever the file holds.
//!
//! A picture gives what is to be seen: bands are chosen, palettes looked up, wide samples stretched
//! to 8 bits, colours that were multiplied by alpha divided again. Its pixels are areas: pixel (c,
//! r) covers columns c to c + 1 and rows r to r + 1 of its geotransform. A pixel is transparent if
//! its alpha or mask says so, or if all chosen bands have the nodata value (one that only some of
//! them have is a colour), as `gdalwarp` takes it.

mod blocks;
mod cache;
mod convert;
mod crs;
mod encoded;
#[cfg(feature = "gdal")]
mod gdal;
mod stretch;
mod tiff;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use self::blocks::{BlockPicture, Parts};
use self::cache::Cache;
pub use self::stretch::Stretch;
use crate::error::{Error, Result};
use crate::geo::{Crs, Geo};
use crate::limits::Limits;
use crate::source::Fingerprint;
use crate::source::open::NEEDS_GDAL;
use crate::texel::Colour;

/// Bytes of decoded blocks that are kept of all pictures together: those of a row of tiles over the
/// widest strips that one meets.
pub const KEPT: u64 = 512 << 20;

/// What to do about a picture without a place.
const NOWHERE: &str =
    "put a world file beside it, or give it its place with gdal_translate -a_ullr WEST NORTH EAST SOUTH";

/// Pixels of a window, row by row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pixels {
    /// Bytes of each pixel that follow each other: 1 for grey, 3 for red, green and blue; sRGB.
    pub colour: Vec<u8>,
    /// One byte a pixel, 0 transparent to 255 opaque; colours are not multiplied by it. `None` if
    /// all are opaque.
    pub alpha: Option<Vec<u8>>,
}

/// What is known of a picture when it is opened.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureInfo {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// What its colours are.
    pub kind: Colour,
    /// True if it has an alpha band, in which there are degrees of transparency; a mask or a nodata
    /// value knows none.
    pub has_alpha: bool,
    /// Where it lies.
    pub geo: Geo,
    /// What people should know of it.
    pub note: PictureNote,
    /// What looks wrong with it, a sentence each.
    pub warnings: Vec<String>,
}

/// A picture as recorded in the container.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PictureNote {
    /// Name of the file, without its folder.
    pub name: String,
    /// One line for people: `GeoTIFF, tiles 256 x 256, JPEG, 3 bands`.
    pub description: String,
    /// Bands that became grey, or red, green and blue, from 1.
    pub bands: Vec<u32>,
    /// For each of them the values that became 0 and 255; empty for 8-bit samples taken as they
    /// are.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stretch: Vec<(f64, f64)>,
}

/// A picture that windows can be read from, by several threads at once.
pub trait Picture: Send + Sync {
    /// What it is.
    fn info(&self) -> &PictureInfo;

    /// The pixels of a window that lies inside. Neither waits for nor uses other threads of a pool.
    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Pixels>;

    /// False if a window is known to be wholly transparent without reading it.
    fn may_show(&self, _columns: Range<u32>, _rows: Range<u32>) -> bool {
        true
    }

    /// Memory that reading takes, apart from the windows that are read.
    fn memory(&self) -> Memory {
        Memory::default()
    }

    /// Lets what is kept for later reads take so many bytes at most, in all pictures together that
    /// were opened with this one. The fewer they are, the more often the same is decoded again.
    fn keep(&self, _bytes: u64) {}

    /// The files it is made of, as they are on disk now.
    fn fingerprint(&self) -> Result<Fingerprint>;

    /// Every file that is read: the picture, its mask, what lies beside it and says what it is.
    /// None for a picture in memory.
    fn files(&self) -> Vec<PathBuf> {
        Vec::new()
    }
}

/// Bytes that reading a picture takes at most.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Memory {
    /// What each thread takes that reads from it.
    pub reading: u64,
    /// The largest block, converted: one of all pictures that were opened together stays whatever
    /// they may keep.
    pub block: u64,
    /// What is kept for later reads. Pictures that were opened together have [`KEPT`] in all unless
    /// [`Picture::keep`] says otherwise.
    pub kept: u64,
}

/// How pictures are read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PictureOptions {
    /// Bands from 1: one (grey) or three (red, green, blue), and one more as alpha; `None`: as the
    /// file says, or the first three.
    pub bands: Option<Vec<u32>>,
    /// How samples become 8 bits; `None`: 8-bit samples as they are, others by [`Stretch::Percent`]
    /// 2 and 98.
    pub stretch: Option<Stretch>,
}

/// Opens pictures that lie in the coordinate system `crs`.
///
/// A TIFF, PNG, JPEG or WebP is read natively, anything else by GDAL if that is built in, which
/// also brings pictures of other coordinate systems into this one. Values are stretched by the same
/// rule in all pictures of one sample type, so that they stay one mosaic.
pub fn open_all(
    paths: &[PathBuf],
    options: &PictureOptions,
    crs: &Crs,
    limits: &Limits,
) -> Result<Vec<Box<dyn Picture>>> {
    if options.bands.as_ref().is_some_and(|bands| !(1..=4).contains(&bands.len()) || bands.contains(&0)) {
        return Err(Error::usage(
            "bands of a picture are one (grey) or three (red, green, blue), and one more for alpha, counted from 1",
        ));
    }
    let cache = Arc::new(Cache::new(KEPT));
    let mut opened = Vec::new();
    for path in paths {
        opened.push(open(path, options, crs, limits, &cache).map_err(|error| error.at(path))?);
    }
    stretch::settle(&mut opened, options.stretch, limits)?;
    Ok(opened.into_iter().map(|picture| Box::new(picture) as Box<dyn Picture>).collect())
}

/// Opens one picture, not yet stretched.
fn open(
    path: &Path,
    options: &PictureOptions,
    crs: &Crs,
    limits: &Limits,
    cache: &Arc<Cache>,
) -> Result<BlockPicture> {
    let native = encoded::format(path).and_then(|format| match format {
        Some(format) => encoded::open(path, format, options, limits),
        None => tiff::open(path, options, limits),
    });
    let native = native.and_then(|parts| place(parts, crs));
    #[cfg(feature = "gdal")]
    let native = native.or_else(|error| {
        crate::source::open::or_by_gdal(path, error, || gdal::open(path, options, crs, limits))
    });
    let mut picture = BlockPicture::new(native?, cache);
    picture.settle_alpha(limits)?;
    Ok(picture)
}

/// Fails if threads that decode blocks of a picture take more than opening it may, and `more` bytes
/// with them.
fn check_opening(picture: &BlockPicture, more: u64, limits: &Limits) -> Result<()> {
    let threads = rayon::current_num_threads().min(picture.blocks()) as u64;
    let needed = (24 << 20) + picture.memory().reading.saturating_mul(threads).saturating_add(more);
    if needed <= limits.opening_bytes {
        return Ok(());
    }
    let mib = needed.div_ceil(1 << 20);
    Err(Error::usage(format!(
        "memory: finding out what {} holds takes about {mib} MiB, as its blocks are decoded whole; allow more, use fewer threads, say how \
         its values become 8 bits, or cut it into smaller blocks (gdal_translate -co TILED=YES)",
        picture.info().note.name
    )))
}

/// Refuses a picture that lies nowhere, or elsewhere. One that says where, but not in what, lies in
/// the coordinate system of the heights: a world file cannot name one.
fn place(mut parts: Parts, crs: &Crs) -> Result<Parts> {
    let geo = &mut parts.geo;
    if geo.transform.is_none() {
        let what = "a picture that does not say where it lies";
        let why = parts.warnings.first().map_or_else(|| what.to_owned(), |why| format!("{what} ({why})"));
        return Err(Error::unsupported(why, NOWHERE));
    }
    if parts.placed_beside && crs::is_unknown(&geo.crs) {
        geo.crs = crs.clone();
    }
    if crs::same(&geo.crs, crs) {
        return Ok(parts);
    }
    let what = format!("a picture in {} over heights in {}", crs::name(&geo.crs), crs::name(crs));
    let otherwise =
        "or bring it there with gdalwarp -t_srs (or, if it is the same, name it with gdal_edit.py -a_srs)";
    Err(Error::unsupported(what, format!("{NEEDS_GDAL}, {otherwise}")))
}
