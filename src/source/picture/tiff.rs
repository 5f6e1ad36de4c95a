//! TIFF pictures, read natively.

use std::path::{Path, PathBuf};

use super::PictureNote;
use super::PictureOptions;
use super::blocks::{Blocks, PictureParts, Raw, Shape};
use super::convert::Conversion;
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::sample::SampleType;
use crate::source::account::{Account, Origin, Role};
use crate::source::open::NEEDS_GDAL;
use crate::source::tiff::raster::{Meaning, Raster};
use crate::source::{file_name, metadata};

/// Values of tag 262 (photometric interpretation).
const WHITE_IS_ZERO: u64 = 0;
const BLACK_IS_ZERO: u64 = 1;
const RGB: u64 = 2;
const PALETTE: u64 = 3;
const YCBCR: u64 = 6;
/// Values of tag 338 (extra samples): alpha with and without colours multiplied by it.
const ASSOCIATED: u64 = 1;
const UNASSOCIATED: u64 = 2;

/// Opens a TIFF and decides on the conversion of its bands.
pub(in crate::source) fn open(
    path: &Path,
    options: &PictureOptions,
    limits: &Limits,
) -> Result<PictureParts> {
    let (raster, meaning, mask) = Raster::open(path, limits)?;
    let mut conversion = conversion(&raster, &meaning, options.bands.as_deref())?;
    if mask.is_some() {
        // As in GDAL, a mask overrides the nodata value.
        conversion.nodata = None;
    }
    let note = PictureNote {
        name: file_name(path),
        description: meaning.description,
        bands: conversion.colours.iter().map(|&band| band as u32 + 1).collect(),
        stretch: Vec::new(),
    };
    let mask = mask.map(|mask| {
        let is_bit = mask.stored().is_none();
        let conversion = Conversion { kind: SampleType::Uint8, is_bit, colours: vec![0], ..plain() };
        (Box::new(mask) as Box<dyn Blocks>, conversion)
    });
    let has_alpha = conversion.alpha.is_some();
    let Account { geo, files: beside, warnings, origins, .. } = meaning.account;
    let placed_beside = matches!(origins.place, Some(Origin::WorldFile(_)));
    let blocks = Box::new(raster);
    Ok(PictureParts { blocks, conversion, geo, note, has_alpha, mask, beside, placed_beside, warnings })
}

/// The conversion of one band of bytes, unchanged.
pub(in crate::source) fn plain() -> Conversion {
    Conversion {
        kind: SampleType::Uint8,
        is_bit: false,
        colours: Vec::new(),
        alpha: None,
        opaque: 65535.0,
        premultiplied: false,
        palette: None,
        inverted: false,
        nodata: None,
        ramps: Vec::new(),
    }
}

fn conversion(raster: &Raster, meaning: &Meaning, wanted: Option<&[u32]>) -> Result<Conversion> {
    let bands = raster.band_count() as usize;
    let colours = match (meaning.photometric, raster.is_jpeg()) {
        (WHITE_IS_ZERO | BLACK_IS_ZERO | RGB, _) | (YCBCR, true) => None,
        (PALETTE, _) => Some(palette(raster, meaning)?),
        (5, _) => return Err(unsupported("CMYK colours")),
        (YCBCR, false) => return Err(unsupported("YCbCr colours without JPEG")),
        (8..=10, _) => return Err(unsupported("CIE L*a*b* colours")),
        (other, _) => return Err(unsupported(&format!("colours of an unknown kind ({other})"))),
    };
    let roles = roles(bands, meaning);
    let (chosen, alpha) = choose(&roles, wanted, colours.is_some())?;
    let kind = raster.stored().unwrap_or(SampleType::Uint8);
    // Extra bands stand after the colours.
    let first_extra = bands.saturating_sub(meaning.extra.len());
    let multiplied = |band: usize| {
        let kind = band.checked_sub(first_extra).and_then(|at| meaning.extra.get(at));
        kind == Some(&ASSOCIATED)
    };
    Ok(Conversion {
        kind,
        is_bit: raster.stored().is_none() && colours.is_none(),
        premultiplied: alpha.is_some_and(multiplied),
        nodata: nodata(&chosen, |band| {
            let said = meaning.account.nodata(band as u32 + 1);
            said.map(|(value, _)| metadata::rounded(value, kind))
        }),
        colours: chosen,
        alpha,
        palette: colours,
        inverted: meaning.photometric == WHITE_IS_ZERO,
        ..plain()
    })
}

/// The role of each band: from sidecar or GDAL's metadata, else from the tags.
fn roles(bands: usize, meaning: &Meaning) -> Vec<Role> {
    let first_extra = bands.saturating_sub(meaning.extra.len());
    let of_tags = |band: usize| {
        if band >= first_extra {
            let is_alpha = matches!(meaning.extra[band - first_extra], ASSOCIATED | UNASSOCIATED);
            return if is_alpha { Role::Alpha } else { Role::Undefined };
        }
        match (meaning.photometric, band) {
            (RGB | YCBCR, 0) if first_extra >= 3 => Role::Red,
            (RGB | YCBCR, 1) => Role::Green,
            (RGB | YCBCR, 2) => Role::Blue,
            (PALETTE, 0) => Role::Palette,
            (_, 0) => Role::Grey,
            _ => Role::Undefined,
        }
    };
    (0..bands).map(|band| meaning.account.role(band as u32 + 1).unwrap_or_else(|| of_tags(band))).collect()
}

/// Nodata values of some bands; `None` if one of them has none, since a pixel is transparent only
/// if all bands have theirs.
pub(in crate::source) fn nodata(bands: &[usize], of: impl Fn(usize) -> Option<f64>) -> Option<Vec<f64>> {
    bands.iter().map(|&band| of(band)).collect()
}

/// Bands for colours, and the band for alpha, from 0: as requested, else by their roles, else the
/// first bands.
pub(in crate::source) fn choose(
    roles: &[Role],
    wanted: Option<&[u32]>,
    indexed: bool,
) -> Result<(Vec<usize>, Option<usize>)> {
    let bands = roles.len();
    let of = |role: Role| roles.iter().position(|&own| own == role);
    let own = of(Role::Alpha);
    let Some(wanted) = wanted else {
        if let (Some(red), Some(green), Some(blue), false) =
            (of(Role::Red), of(Role::Green), of(Role::Blue), indexed)
        {
            return Ok((vec![red, green, blue], own));
        }
        let others: Vec<usize> = (0..bands).filter(|&band| Some(band) != own).collect();
        return match others[..] {
            [] => Err(Error::format("bands", "a colour", "alpha only")),
            [a, b, c, ..] if !indexed => Ok((vec![a, b, c], own)),
            [a, ..] => Ok((vec![a], own)),
        };
    };
    if let Some(&band) = wanted.iter().find(|&&band| band == 0 || band as usize > bands) {
        return Err(Error::usage(format!("there is no band {band}: the picture has {bands}")));
    }
    let mut chosen: Vec<usize> = wanted.iter().map(|&band| band as usize - 1).collect();
    let alpha =
        if chosen.len().is_multiple_of(2) { chosen.pop() } else { own.filter(|band| !chosen.contains(band)) };
    if indexed && chosen.len() != 1 {
        return Err(Error::usage("a picture with a palette has one band of colours"));
    }
    Ok((chosen, alpha))
}

/// Palette colours, reduced from 16 bits.
fn palette(raster: &Raster, meaning: &Meaning) -> Result<Vec<[u8; 3]>> {
    let entries = match raster.stored() {
        None => 2,
        Some(SampleType::Uint8) => 256,
        Some(SampleType::Uint16) => 65_536,
        Some(kind) => return Err(unsupported(&format!("a palette for {} samples", kind.gdal_name()))),
    };
    let values = meaning.palette.as_deref().unwrap_or_default();
    if values.len() != 3 * entries {
        return Err(Error::format(
            "TIFF tag 320 (ColorMap)",
            format!("{} numbers", 3 * entries),
            values.len(),
        ));
    }
    // Some writers store 8-bit values in the 16 bits.
    let shift = if values.iter().all(|&value| value < 256) { 0 } else { 8 };
    let entry = |index: usize| [0, 1, 2].map(|colour| (values[colour * entries + index] >> shift) as u8);
    Ok((0..entries).map(entry).collect())
}

fn unsupported(what: &str) -> Error {
    Error::unsupported(what, format!("{NEEDS_GDAL}, or convert it with gdal_translate or gdalwarp"))
}

impl Blocks for Raster {
    fn shape(&self) -> Shape {
        let ((width, height), (block_width, block_height)) = (self.size(), self.block_size());
        Shape { width, height, block_width, block_height }
    }

    fn is_absent(&self, block: usize, bands: &[usize]) -> bool {
        if self.planes() == 1 {
            return Raster::is_absent(self, block, 0);
        }
        bands.iter().all(|&band| Raster::is_absent(self, block, band as u32))
    }

    fn samples_read(&self, bands: &[usize]) -> usize {
        if self.planes() == 1 { self.block_bands() } else { bands.len() }
    }

    fn read(&self, block: usize, bands: &[usize]) -> Result<Raw> {
        if self.planes() == 1 {
            let stride = self.block_bands();
            let planes = bands.iter().map(|&band| (0, band, stride)).collect();
            return Ok(Raw { bytes: vec![self.decode(block, 0)?], planes });
        }
        let plane = |&band: &usize| match band as u32 {
            absent if Raster::is_absent(self, block, absent) => Ok(Vec::new()),
            band => self.decode(block, band),
        };
        let bytes: Result<_> = bands.iter().map(plane).collect();
        Ok(Raw { bytes: bytes?, planes: (0..bands.len()).map(|at| (at, 0, 1)).collect() })
    }

    fn files(&self) -> Vec<PathBuf> {
        vec![self.path().to_owned()]
    }

    fn locate(&self, error: Error) -> Error {
        error.at(self.path())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_chosen_by_their_roles() {
        use Role::{Alpha, Blue, Green, Grey, Red, Undefined};
        let choose = |roles: &[Role]| choose(roles, None, false).expect("bands");
        assert_eq!(choose(&[Red, Green, Blue]), (vec![0, 1, 2], None));
        assert_eq!(choose(&[Blue, Green, Red]), (vec![2, 1, 0], None));
        assert_eq!(choose(&[Alpha, Blue, Green, Red]), (vec![3, 2, 1], Some(0)));
        assert_eq!(choose(&[Grey, Undefined, Blue, Green, Red]), (vec![4, 3, 2], None));
        assert_eq!(choose(&[Grey, Undefined, Undefined, Alpha]), (vec![0, 1, 2], Some(3)));
        assert_eq!(choose(&[Grey, Alpha]), (vec![0], Some(1)));
        assert_eq!(choose(&[Undefined, Green, Red]), (vec![0, 1, 2], None));
        let wanted = super::choose(&[Blue, Green, Red, Alpha], Some(&[1, 2, 3]), false).expect("bands");
        assert_eq!(wanted, (vec![0, 1, 2], Some(3)));
        assert!(super::choose(&[Alpha], None, false).is_err());
    }
}
