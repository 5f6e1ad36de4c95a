//! Pictures as sources: windows of 8-bit colours with alpha, whatever the file holds.
//!
//! A picture gives final colours: bands are chosen, palettes looked up, wide samples stretched to 8
//! bits, and colours multiplied by alpha divided again. Pixels are areas: pixel (c, r) covers
//! columns c to c + 1 and rows r to r + 1 of the geotransform. As in `gdalwarp`, a pixel is
//! transparent if its alpha or mask says so, or if all chosen bands have the nodata value; if only
//! some have it, it is a colour.

pub(in crate::source) mod blocks;
mod cache;
pub(in crate::source) mod convert;
pub(in crate::source) mod crs;
mod encoded;
mod stretch;
pub(in crate::source) mod tiff;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use self::blocks::{BlockPicture, PictureParts};
use self::cache::Cache;
pub use self::stretch::Stretch;
use crate::error::{Error, Result};
use crate::geo::{Crs, Geo};
use crate::limits::Limits;
use crate::source::Fingerprint;
use crate::source::open::NEEDS_GDAL;
use crate::texel::Colour;

/// Bytes of decoded blocks kept for all pictures together: enough for a row of tiles over the
/// widest strips in use.
pub const KEPT: u64 = 512 << 20;

/// Advice for a picture without a place.
pub(in crate::source) const PLACE_ADVICE: &str =
    "put a world file beside it, or give it its place with gdal_translate -a_ullr WEST NORTH EAST SOUTH";

/// Pixels of a window, row by row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pixels {
    /// Colour bytes of each pixel, 1 for grey, 3 for red, green and blue; sRGB.
    pub colour: Vec<u8>,
    /// Alpha of each pixel, 0 transparent to 255 opaque; colours are not multiplied by it. `None`
    /// if all pixels are opaque.
    pub alpha: Option<Vec<u8>>,
}

/// Properties of a picture, known when it is opened.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureInfo {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Kind of colours: grey or RGB.
    pub kind: Colour,
    /// True if it has an alpha band, which allows partial transparency; a mask or a nodata value
    /// does not.
    pub has_alpha: bool,
    /// Georeference.
    pub geo: Geo,
    /// The record of the picture in the container.
    pub note: PictureNote,
    /// Oddities of the picture, a sentence each.
    pub warnings: Vec<String>,
}

/// A picture as recorded in the container.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PictureNote {
    /// Name of the file, without its folder.
    pub name: String,
    /// One line for people: `GeoTIFF, tiles 256 x 256, JPEG, 3 bands`.
    pub description: String,
    /// Bands used for grey, or for red, green and blue, from 1.
    pub bands: Vec<u32>,
    /// For each of these bands the values that became 0 and 255; empty if 8-bit samples were taken
    /// unchanged.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stretch: Vec<(f64, f64)>,
}

/// A picture that several threads can read windows from.
pub trait Picture: Send + Sync {
    /// Properties of the picture.
    fn info(&self) -> &PictureInfo;

    /// The pixels of a window inside the picture. Does not use or wait for other threads of a pool.
    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Pixels>;

    /// False if a window is known, without reading it, to be wholly transparent.
    fn may_show(&self, _columns: Range<u32>, _rows: Range<u32>) -> bool {
        true
    }

    /// Memory that reading takes, apart from the windows themselves.
    fn memory(&self) -> Memory {
        Memory::default()
    }

    /// Limits the bytes kept for later reads, by all pictures opened together. With fewer bytes,
    /// blocks are decoded again more often.
    fn keep(&self, _bytes: u64) {}

    /// The current state of its files on disk.
    fn fingerprint(&self) -> Result<Fingerprint>;

    /// All files that are read: the picture, its mask and sidecars. Empty for a picture in memory.
    fn files(&self) -> Vec<PathBuf> {
        Vec::new()
    }
}

/// Most bytes that reading a picture takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Memory {
    /// Bytes of each thread that reads from it.
    pub reading: u64,
    /// Bytes of the largest converted block: of all pictures opened together, one such block stays
    /// in memory whatever the limit.
    pub block: u64,
    /// Bytes of all converted blocks, to be kept for later reads. Pictures opened together keep
    /// [`KEPT`] bytes in all unless [`Picture::keep`] sets another limit.
    pub kept: u64,
}

/// How pictures are read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PictureOptions {
    /// Bands from 1: one (grey) or three (red, green, blue), and one more as alpha; `None`: as the
    /// file says, or the first three.
    pub bands: Option<Vec<u32>>,
    /// How samples become 8 bits; `None`: 8-bit samples unchanged, others by [`Stretch::Percent`] 2
    /// and 98.
    pub stretch: Option<Stretch>,
}

/// Opens pictures in the coordinate system `crs`.
///
/// TIFF, PNG, JPEG and WebP are read natively. Other formats, and pictures in other coordinate
/// systems, are read by GDAL if it is built in. All pictures of one sample type are stretched by
/// the same values, so that they match at their borders.
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
    let format = encoded::format(path);
    #[cfg(feature = "gdal")]
    let is_encoded = matches!(format, Ok(Some(_)));
    let native = format.and_then(|format| match format {
        Some(format) => encoded::open(path, format, options, limits),
        None => tiff::open(path, options, limits),
    });
    let native = native.and_then(|parts| place(parts, crs));
    #[cfg(feature = "gdal")]
    let native = match native {
        // GDAL would read what is cut off as grey.
        Err(error @ Error::Format { .. }) if is_encoded => Err(error),
        Err(error) => crate::source::open::or_by_gdal(path, error, || {
            crate::source::gdal::picture::open(path, options, crs, limits)
        }),
        native => native,
    };
    let mut picture = BlockPicture::new(native?, cache);
    picture.settle_alpha(limits)?;
    Ok(picture)
}

/// Fails if decoding blocks of a picture on all threads, with `more` bytes besides, exceeds the
/// memory limit.
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

/// Refuses a picture without a place or in another coordinate system. A picture with a world file
/// but no coordinate system is taken to lie in that of the heights, as a world file cannot name
/// one.
fn place(mut parts: PictureParts, crs: &Crs) -> Result<PictureParts> {
    let geo = &mut parts.geo;
    if geo.transform.is_none() {
        let what = "a picture that does not say where it lies";
        let why = parts.warnings.first().map_or_else(|| what.to_owned(), |why| format!("{what} ({why})"));
        return Err(Error::unsupported(why, PLACE_ADVICE));
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
