//! Single tags of a directory, checked against the features of this reader.

use tiff::tags::Tag;

use super::{Compression, Predictor, Purpose, Stored};
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::sample::SampleType;
use crate::source::tiff::directory::{Directory, Reader, place};

/// Advice for samples of 64-bit integers.
const NO_LONGS: &str = "convert them with gdal_translate -ot Int32 (heights that fit 32 bits) or -ot Float64";

/// Advice for complex samples.
const NO_COMPLEX: &str = "take their real parts with gdal_translate -ot Float64";

pub(super) fn unsupported(what: impl Into<String>) -> Error {
    Error::unsupported(what, crate::source::open::NEEDS_GDAL)
}

pub(super) fn side(reader: &mut Reader<'_>, directory: &Directory, tag: Tag, limits: &Limits) -> Result<u32> {
    let value = reader.required(directory, tag)?;
    if value == 0 {
        return Err(Error::format(place(tag), "at least 1", 0));
    }
    if u64::from(value) > limits.raster_side {
        let what =
            if tag == Tag::ImageWidth { "the width of the raster" } else { "the height of the raster" };
        return Err(Error::limit(what, u64::from(value), limits.raster_side));
    }
    Ok(value)
}

pub(super) fn block_side(reader: &mut Reader<'_>, directory: &Directory, tag: Tag) -> Result<u32> {
    match reader.required(directory, tag)? {
        0 => Err(Error::format(place(tag), "at least 1", 0)),
        value => Ok(value),
    }
}

pub(super) fn rows_per_strip(reader: &mut Reader<'_>, directory: &Directory, height: u32) -> Result<u32> {
    match reader.integer(directory, Tag::RowsPerStrip)? {
        None => Ok(height),
        Some(0) => Err(Error::format(place(Tag::RowsPerStrip), "at least 1", 0)),
        Some(rows) => Ok(u32::try_from(rows).unwrap_or(u32::MAX).min(height)),
    }
}

pub(super) fn compression(
    reader: &mut Reader<'_>,
    directory: &Directory,
    purpose: Purpose,
) -> Result<Compression> {
    let name = match reader.integer(directory, Tag::Compression)?.unwrap_or(1) {
        1 => return Ok(Compression::None),
        5 => return Ok(Compression::Lzw),
        8 | 32946 => return Ok(Compression::Deflate),
        32773 => return Ok(Compression::PackBits),
        50000 => return Ok(Compression::Zstd),
        7 if purpose == Purpose::Picture => return Ok(Compression::Jpeg),
        2..=4 | 32771 => "fax",
        6 | 7 => "JPEG",
        34712 => "JPEG 2000",
        34887 => "LERC",
        34892 => "lossy JPEG (DNG)",
        34925 => "LZMA",
        50001 => "WebP",
        50002 | 52546 => "JPEG XL",
        other => return Err(unsupported(format!("compression {other}"))),
    };
    Err(unsupported(format!("{name} compression")))
}

/// Tables that all JPEG blocks share, and whether the blocks are YCbCr: any other colour space is
/// left unconverted.
pub(super) fn jpeg(reader: &mut Reader<'_>, directory: &Directory) -> Result<(Vec<u8>, bool)> {
    let tables = reader.integers(directory, Tag::JPEGTables)?.unwrap_or_default();
    let tables = tables.into_iter().map(|byte| byte as u8).collect();
    Ok((tables, reader.integer(directory, Tag::PhotometricInterpretation)? == Some(6)))
}

pub(super) fn stored(reader: &mut Reader<'_>, directory: &Directory) -> Result<Stored> {
    let bits = reader.integers(directory, Tag::BitsPerSample)?.unwrap_or_default();
    let first = bits.first().copied().unwrap_or(1);
    if bits.iter().any(|&other| other != first) {
        return Err(unsupported(format!("bands of different widths ({bits:?} bits)")));
    }
    let format = reader.integer(directory, Tag::SampleFormat)?.unwrap_or(1);
    let kind = match (first, format) {
        (1, _) => return Ok(Stored::Bit),
        (8, 2) => SampleType::Int8,
        (16, 2) => SampleType::Int16,
        (32, 2) => SampleType::Int32,
        // Format 4 is "undefined", which GDAL also reads as unsigned.
        (8, 1 | 4) => SampleType::Uint8,
        (16, 1 | 4) => SampleType::Uint16,
        (32, 1 | 4) => SampleType::Uint32,
        (32, 3) => SampleType::Float32,
        (64, 3) => SampleType::Float64,
        // GDAL reads these as heights, but the tiles of a container cannot hold them.
        (64, 2) => return Err(Error::unsupported("64-bit signed samples", NO_LONGS)),
        (64, 1 | 4) => return Err(Error::unsupported("64-bit unsigned samples", NO_LONGS)),
        (bits, 5 | 6) => return Err(Error::unsupported(format!("{bits}-bit complex samples"), NO_COMPLEX)),
        (bits, 1 | 4) => return Err(unsupported(format!("{bits}-bit unsigned samples"))),
        (bits, 2) => return Err(unsupported(format!("{bits}-bit signed samples"))),
        (bits, 3) => return Err(unsupported(format!("{bits}-bit floating-point samples"))),
        (_, other) => return Err(Error::format(place(Tag::SampleFormat), "1 to 6", other)),
    };
    Ok(Stored::Number(kind))
}

/// The predictor, if the compression supports one.
pub(super) fn predictor(
    reader: &mut Reader<'_>,
    directory: &Directory,
    compression: Compression,
    stored: Stored,
) -> Result<Predictor> {
    if matches!(compression, Compression::None | Compression::PackBits | Compression::Jpeg) {
        return Ok(Predictor::None);
    }
    let is_float = matches!(stored, Stored::Number(kind) if kind.is_float());
    match reader.integer(directory, Tag::Predictor)?.unwrap_or(1) {
        1 => Ok(Predictor::None),
        2 if stored != Stored::Bit => Ok(Predictor::Horizontal),
        3 if is_float => Ok(Predictor::FloatingPoint),
        number @ (2 | 3) => Err(Error::format(
            place(Tag::Predictor),
            "one that suits the samples",
            format!("predictor {number} for samples of {} bits", stored.bits()),
        )),
        other => Err(unsupported(format!("predictor {other}"))),
    }
}
