//! Finds what marks valid samples besides their values, in GDAL's order: a mask in the file, a mask
//! beside it, the nodata value, an alpha band. Only the first found counts.
//!
//! GDAL looks only at 8-bit and 16-bit alpha, and only in files of two or four bands; here, as in
//! `gdalwarp`, an alpha band counts in any file.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use roxmltree::Document;
use tiff::tags::Tag;

use super::blocks::Band;
use super::directory::{Directory, GDAL_METADATA, Reader};
use super::file::TiffFile;
use super::layout::{Layout, Purpose, Stored};
use super::{MASK, REDUCED};
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::sample::SampleType;
use crate::source::account::{Account, Role};

/// GDAL's flag of a mask that is shared by all bands.
const PER_DATASET: u64 = 2;

/// The first full-size mask among the directories, for a band from 0.
pub(super) fn internal_mask(
    reader: &mut Reader<'_>,
    directories: &[Directory],
    (of, band): (&Layout, u32),
    limits: &Limits,
) -> Result<Option<Layout>> {
    for directory in directories.iter().skip(1) {
        let kind = reader.integer(directory, Tag::NewSubfileType)?.unwrap_or(0);
        if kind & MASK == 0 || kind & REDUCED != 0 {
            continue;
        }
        // As in GDAL, a mask of one band is that of all bands.
        let bands = reader.integer(directory, Tag::SamplesPerPixel)?.unwrap_or(1);
        let own = if bands == 1 { 0 } else { band };
        let mask = Layout::read(reader, directory, limits, Purpose::Band(own))?;
        if (mask.width, mask.height) == (of.width, of.height) {
            return check_mask(mask).map(Some);
        }
    }
    Ok(None)
}

fn check_mask(mask: Layout) -> Result<Layout> {
    match mask.stored {
        Stored::Bit | Stored::Number(SampleType::Uint8) => Ok(mask),
        Stored::Number(kind) => Err(Error::unsupported(
            format!("a mask of {} samples", kind.gdal_name()),
            "write it with 1 or 8 bits",
        )),
    }
}

/// The mask file `dem.tif.msk`, where GDAL writes masks by default; `None` if there is none, or
/// none for this band, from 0.
pub(super) fn external_mask(
    path: &Path,
    (of, band): (&Layout, u32),
    limits: &Limits,
) -> Result<Option<Band>> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".msk");
    let beside = PathBuf::from(beside);
    if !beside.is_file() {
        return Ok(None);
    }
    let read = || {
        let file = Arc::new(TiffFile::open(&beside, limits)?);
        let mut reader = Reader::new(&file, limits)?;
        let directories = reader.directories()?;
        let image = directories.first().ok_or_else(|| Error::format("TIFF header", "an image", "none"))?;
        let xml = reader.text(image, GDAL_METADATA)?;
        let Some(flags) = xml.and_then(|xml| mask_flags(&xml, band)) else { return Ok(None) };
        let own = if flags & PER_DATASET != 0 { 0 } else { band };
        let mask = check_mask(Layout::read(&mut reader, image, limits, Purpose::Band(own))?)?;
        if (mask.width, mask.height) != (of.width, of.height) {
            let expected = format!("a mask of {} x {}", of.width, of.height);
            return Err(Error::format("size", expected, format!("{} x {}", mask.width, mask.height)));
        }
        Ok(Some(Band::new(file, mask)))
    };
    read().map_err(|error: Error| error.at(&beside))
}

/// The mask flags of a band, from 0, in the GDAL metadata of a mask file; `None` if there are none,
/// in which case GDAL does not use the mask for that band.
fn mask_flags(xml: &str, band: u32) -> Option<u64> {
    let document = Document::parse(xml).ok()?;
    let name = format!("INTERNAL_MASK_FLAGS_{}", band + 1);
    let is_it = |node: &roxmltree::Node<'_, '_>| {
        node.has_tag_name("Item")
            && node.attribute("name").is_some_and(|own| own.eq_ignore_ascii_case(&name))
            && node.attribute("domain").is_none_or(str::is_empty)
    };
    let text = document.descendants().find(is_it)?.text().unwrap_or_default().trim();
    Some(text.parse().unwrap_or(0))
}

/// The last band, if it is an alpha band and not the band of heights. As in GDAL, an alpha band
/// before others is ignored: some writers mark the second of four bands.
pub(super) fn alpha(
    (reader, image): (&mut Reader<'_>, &Directory),
    (of, band): (&Layout, u32),
    account: &Account,
    limits: &Limits,
) -> Result<Option<Layout>> {
    let extra = reader.integers(image, Tag::ExtraSamples)?.unwrap_or_default();
    // Extra bands stand after the colours.
    let first = (of.band_count as usize).saturating_sub(extra.len());
    let of_tags = |at: usize| at.checked_sub(first).is_some_and(|at| matches!(extra.get(at), Some(1 | 2)));
    let is_alpha = |&at: &u32| account.role(at + 1).map_or(of_tags(at as usize), |role| role == Role::Alpha);
    match of.band_count.checked_sub(1).filter(is_alpha).filter(|&alpha| alpha != band) {
        Some(alpha) => Layout::read(reader, image, limits, Purpose::Band(alpha)).map(Some),
        None => Ok(None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mask_beside_a_file_says_whose_it_is() {
        let xml = "<GDALMetadata><!-- INTERNAL_MASK_FLAGS_3 --><Item name=\"INTERNAL_MASK_FLAGS_2\">0</Item>\
                   <Item name=\"INTERNAL_MASK_FLAGS_1\" domain=\"x\">2</Item></GDALMetadata>";
        assert_eq!([0, 1, 2].map(|band| mask_flags(xml, band)), [None, Some(0), None]);
        assert_eq!(mask_flags("<Item name='INTERNAL_MASK_FLAGS_1'> 2 </Item>", 0), Some(2));
        assert_eq!(mask_flags("<Item", 0), None);
    }
}
