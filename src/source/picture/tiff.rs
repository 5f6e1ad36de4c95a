//! TIFF pictures, natively.

use std::path::Path;

use super::PictureNote;
use super::PictureOptions;
use super::blocks::{Blocks, Parts, Raw, Shape};
use super::convert::Recipe;
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::sample::SampleType;
use crate::source::tiff::raster::{Meaning, Raster};
use crate::source::{Fingerprint, file_name};

/// Values of tag 262.
const WHITE_IS_ZERO: u64 = 0;
const BLACK_IS_ZERO: u64 = 1;
const RGB: u64 = 2;
const PALETTE: u64 = 3;
const YCBCR: u64 = 6;

/// Opens a TIFF and says what becomes of its bands.
pub(super) fn open(path: &Path, options: &PictureOptions, limits: &Limits) -> Result<Parts> {
    let (raster, meaning, mask) = Raster::open(path, limits)?;
    let recipe = recipe(&raster, &meaning, options.bands.as_deref())?;
    let note = PictureNote {
        name: file_name(path),
        description: meaning.description,
        bands: recipe.colours.iter().map(|&band| band as u32 + 1).collect(),
        stretch: Vec::new(),
    };
    let mask = mask.map(|mask| {
        let is_bit = mask.stored().is_none();
        let recipe = Recipe { kind: SampleType::Uint8, is_bit, colours: vec![0], ..plain() };
        (Box::new(mask) as Box<dyn Blocks>, recipe)
    });
    let has_alpha = recipe.alpha.is_some();
    Ok(Parts { blocks: Box::new(raster), recipe, geo: meaning.geo, note, has_alpha, mask })
}

/// One band of bytes.
pub(super) fn plain() -> Recipe {
    Recipe {
        kind: SampleType::Uint8,
        is_bit: false,
        colours: Vec::new(),
        alpha: None,
        premultiplied: false,
        palette: None,
        inverted: false,
        nodata: None,
        ramps: Vec::new(),
    }
}

fn recipe(raster: &Raster, meaning: &Meaning, wanted: Option<&[u32]>) -> Result<Recipe> {
    let bands = raster.band_count() as usize;
    let colours = match (meaning.photometric, raster.is_jpeg()) {
        (WHITE_IS_ZERO | BLACK_IS_ZERO | RGB, _) | (YCBCR, true) => None,
        (PALETTE, _) => Some(palette(raster, meaning)?),
        (5, _) => return Err(unsupported("CMYK colours")),
        (YCBCR, false) => return Err(unsupported("YCbCr colours without JPEG")),
        (8..=10, _) => return Err(unsupported("CIE L*a*b* colours")),
        (other, _) => return Err(unsupported(&format!("colours of an unknown kind ({other})"))),
    };
    // Extra bands stand after the colours.
    let extra = bands.saturating_sub(meaning.extra.len());
    let own = meaning
        .extra
        .iter()
        .position(|&kind| matches!(kind, 1 | 2))
        .map(|at| (extra + at, meaning.extra[at] == 1));
    let own = own.filter(|&(band, _)| band < bands);
    let (chosen, alpha) = choose(bands, own.map(|(band, _)| band), wanted, colours.is_some())?;
    Ok(Recipe {
        kind: raster.stored().unwrap_or(SampleType::Uint8),
        is_bit: raster.stored().is_none() && colours.is_none(),
        premultiplied: own.is_some_and(|(band, multiplied)| multiplied && alpha == Some(band)),
        colours: chosen,
        alpha,
        palette: colours,
        inverted: meaning.photometric == WHITE_IS_ZERO,
        nodata: meaning.nodata,
        ..plain()
    })
}

/// Bands that become colours, and the one that is alpha, from 0. `own` is what the file calls alpha.
pub(super) fn choose(
    bands: usize,
    own: Option<usize>,
    wanted: Option<&[u32]>,
    indexed: bool,
) -> Result<(Vec<usize>, Option<usize>)> {
    let Some(wanted) = wanted else {
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

/// The colours of each index, from their 16 bits.
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
    // Some writers put bytes there.
    let shift = if values.iter().all(|&value| value < 256) { 0 } else { 8 };
    let entry = |index: usize| [0, 1, 2].map(|colour| (values[colour * entries + index] >> shift) as u8);
    Ok((0..entries).map(entry).collect())
}

fn unsupported(what: &str) -> Error {
    Error::unsupported(what, "build with --features gdal, or convert it with gdal_translate or gdalwarp")
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

    fn fingerprint(&self) -> Result<Fingerprint> {
        Ok(Fingerprint { files: vec![self.stamp()?] })
    }

    fn locate(&self, error: Error) -> Error {
        error.at(self.path())
    }
}
