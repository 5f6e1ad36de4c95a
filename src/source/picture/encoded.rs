//! PNG, JPEG and WebP pictures, read natively; a world file or sidecar gives their place.
//!
//! The crate `image` decodes PNG and WebP. It would fill in the missing part of a JPEG that is cut
//! off, so JPEG goes directly to `zune-jpeg`, which can refuse it.
//!
//! A picture is one block, since its format is decoded as a whole. The memory for that is known
//! beforehand (`Memory`), so a build within a memory limit refuses a picture that is too large.

use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

use super::blocks::{Blocks, PictureParts, Raw, Shape};
use super::convert::Conversion;
use super::tiff::{choose, nodata, plain};
use super::{PictureNote, PictureOptions};
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::sample::SampleType;
use crate::source::account::{Account, Origin, Role, Tags};
use crate::source::tiff::jpeg::check as check_jpeg;
use crate::source::{file_name, metadata};

/// Most pixels along a side: the limit of the formats themselves, except PNG.
const MAX_SIDE: u32 = 65_535;
/// Most bytes of a JPEG file, which is held in memory while it is decoded.
const MAX_JPEG_BYTES: u64 = 1 << 30;

/// The picture format of a file, by its first bytes, if it is read here.
pub(super) fn format(path: &Path) -> Result<Option<ImageFormat>> {
    let mut start = [0; 16];
    let mut file = crate::file::open(path).map_err(|source| Error::io(path, "open", source))?;
    let mut length = 0;
    while length < start.len() {
        match file.read(&mut start[length..]).map_err(|source| Error::io(path, "read", source))? {
            0 => break,
            count => length += count,
        }
    }
    let format = image::guess_format(&start[..length]).ok();
    Ok(format.filter(|format| matches!(format, ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::WebP)))
}

/// A picture that is decoded as a whole.
struct Encoded {
    path: PathBuf,
    format: ImageFormat,
    width: u32,
    height: u32,
    colour: ColorType,
}

/// Opens a picture of a known format and decides on its conversion.
pub(super) fn open(
    path: &Path,
    format: ImageFormat,
    options: &PictureOptions,
    limits: &Limits,
) -> Result<PictureParts> {
    let mut picture = Encoded { path: path.to_owned(), format, width: 0, height: 0, colour: ColorType::L8 };
    ((picture.width, picture.height), picture.colour) = picture.head()?;
    for (name, side) in [("width", picture.width), ("height", picture.height)] {
        if side > MAX_SIDE {
            return Err(Error::limit(format!("{name} of the picture"), side.into(), MAX_SIDE.into()));
        }
    }
    let (kind, own) = bands(picture.colour)?;
    let account = Account::gathered(path, Tags::default(), limits)?;
    let role = |(band, &own): (usize, &Role)| account.role(band as u32 + 1).unwrap_or(own);
    let roles: Vec<Role> = own.iter().enumerate().map(role).collect();
    let (colours, alpha) = choose(&roles, options.bands.as_deref(), false)?;
    let conversion = Conversion {
        kind,
        alpha,
        nodata: nodata(&colours, |band| {
            account.nodata(band as u32 + 1).map(|(value, _)| metadata::rounded(value, kind))
        }),
        colours,
        ..plain()
    };
    let note = PictureNote {
        name: file_name(path),
        description: format!("{}, {} bands of {}", picture.name(), roles.len(), kind.gdal_name()),
        bands: conversion.colours.iter().map(|&band| band as u32 + 1).collect(),
        stretch: Vec::new(),
    };
    let Account { geo, files: beside, warnings, origins, .. } = account;
    Ok(PictureParts {
        blocks: Box::new(picture),
        has_alpha: conversion.alpha.is_some(),
        conversion,
        geo,
        note,
        mask: None,
        beside,
        placed_beside: matches!(origins.place, Some(Origin::WorldFile(_))),
        warnings,
    })
}

/// Sample type and role of each band for a colour type.
fn bands(colour: ColorType) -> Result<(SampleType, &'static [Role])> {
    const RGBA: [Role; 4] = [Role::Red, Role::Green, Role::Blue, Role::Alpha];
    const GREY: [Role; 2] = [Role::Grey, Role::Alpha];
    Ok(match colour {
        ColorType::L8 => (SampleType::Uint8, &GREY[..1]),
        ColorType::La8 => (SampleType::Uint8, &GREY),
        ColorType::Rgb8 => (SampleType::Uint8, &RGBA[..3]),
        ColorType::Rgba8 => (SampleType::Uint8, &RGBA),
        ColorType::L16 => (SampleType::Uint16, &GREY[..1]),
        ColorType::La16 => (SampleType::Uint16, &GREY),
        ColorType::Rgb16 => (SampleType::Uint16, &RGBA[..3]),
        ColorType::Rgba16 => (SampleType::Uint16, &RGBA),
        other => {
            return Err(Error::unsupported(format!("{other:?} samples"), "convert it with gdal_translate"));
        }
    })
}

impl Encoded {
    fn name(&self) -> &'static str {
        match self.format {
            ImageFormat::Png => "PNG",
            ImageFormat::WebP => "WebP",
            _ => "JPEG",
        }
    }

    /// Size and colour type, from the header.
    fn head(&self) -> Result<((u32, u32), ColorType)> {
        if self.format != ImageFormat::Jpeg {
            let decoder = self.decoder()?;
            return Ok((decoder.dimensions(), decoder.color_type()));
        }
        let bytes = self.jpeg_bytes()?;
        let mut decoder = jpeg(&bytes, ColorSpace::RGB);
        decoder.decode_headers().map_err(|error| self.damaged(&error))?;
        let (width, height) = decoder.dimensions().unwrap_or_default();
        let is_grey = decoder.input_colorspace() == Some(ColorSpace::Luma);
        Ok(((width as u32, height as u32), if is_grey { ColorType::L8 } else { ColorType::Rgb8 }))
    }

    /// All samples, interleaved by pixel, in this machine's byte order.
    fn samples(&self) -> Result<Vec<u8>> {
        if self.head()? != ((self.width, self.height), self.colour) {
            let expected = format!("{} x {} pixels of {:?}", self.width, self.height, self.colour);
            return Err(Error::format("the picture", expected, "others since it was opened"));
        }
        if self.format != ImageFormat::Jpeg {
            let decoded = DynamicImage::from_decoder(self.decoder()?);
            return decoded.map(DynamicImage::into_bytes).map_err(|error| self.damaged(&error));
        }
        let bytes = self.jpeg_bytes()?;
        let space = if self.colour == ColorType::L8 { ColorSpace::Luma } else { ColorSpace::RGB };
        jpeg(&bytes, space).decode().map_err(|error| self.damaged(&error))
    }

    /// A decoder for PNG and WebP.
    fn decoder(&self) -> Result<impl ImageDecoder + use<>> {
        let file = crate::file::open(&self.path).map_err(|source| Error::io(&self.path, "open", source))?;
        let mut reader = ImageReader::with_format(BufReader::new(file), self.format);
        // The build's memory limit has been checked before.
        reader.no_limits();
        reader.into_decoder().map_err(|error| self.damaged(&error))
    }

    /// The content of a JPEG file.
    fn jpeg_bytes(&self) -> Result<Vec<u8>> {
        let bytes = crate::file::read(&self.path, MAX_JPEG_BYTES)
            .map_err(|source| Error::io(&self.path, "read", source))?;
        check_jpeg(&bytes, None, &|| "the picture".to_owned())?;
        Ok(bytes)
    }

    fn damaged(&self, error: &dyn std::fmt::Display) -> Error {
        let got = format!("{error} (if other programs read it, gdal_translate makes a TIFF of it)");
        Error::format("the picture", format!("a {}", self.name()), got)
    }
}

/// A JPEG decoder that refuses incomplete files.
fn jpeg(bytes: &[u8], space: ColorSpace) -> JpegDecoder<ZCursor<&[u8]>> {
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(MAX_SIDE as usize)
        .set_max_height(MAX_SIDE as usize)
        .jpeg_set_out_colorspace(space);
    JpegDecoder::new_with_options(ZCursor::new(bytes), options)
}

impl Blocks for Encoded {
    fn shape(&self) -> Shape {
        Shape { width: self.width, height: self.height, block_width: self.width, block_height: self.height }
    }

    fn is_absent(&self, _: usize, _: &[usize]) -> bool {
        false
    }

    fn samples_read(&self, _: &[usize]) -> usize {
        usize::from(self.colour.channel_count())
    }

    fn read(&self, _: usize, bands: &[usize]) -> Result<Raw> {
        let stride = usize::from(self.colour.channel_count());
        let planes = bands.iter().map(|&band| (0, band, stride)).collect();
        Ok(Raw { bytes: vec![self.samples()?], planes })
    }

    fn files(&self) -> Vec<PathBuf> {
        vec![self.path.clone()]
    }

    fn locate(&self, error: Error) -> Error {
        error.at(&self.path)
    }
}
