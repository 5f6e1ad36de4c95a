//! JPEG blocks of pictures, decoded by `zune-jpeg`.
//!
//! A block lacks the tables that all blocks share, so they are put in front of it. A block with
//! several scans of one component each is refused, because zune-jpeg 0.5.15 would decode it to
//! garbage without an error.

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::layout::Layout;
use crate::error::{Error, Result};
use crate::source::open::NEEDS_GDAL;

/// Decodes a block of `rows` rows into `out`, which is as wide as the block; returns the number of
/// bytes. `name` names the block in messages.
pub(super) fn decode(
    packed: &[u8],
    layout: &Layout,
    rows: u32,
    out: &mut [u8],
    name: &dyn Fn() -> String,
) -> Result<usize> {
    let (tables, is_ycbcr) = (&layout.jpeg.0, layout.jpeg.1);
    let bands = layout.bands as usize;
    let stream = join(tables, packed);
    check(&stream, Some(bands), name)?;
    // Otherwise what is missing of a block that is cut off would be grey, without a word.
    let options = DecoderOptions::new_fast()
        .set_max_width(usize::from(u16::MAX))
        .set_max_height(usize::from(u16::MAX))
        .set_strict_mode(true);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(&stream), options);
    let damaged = |error: &dyn std::fmt::Display| Error::format(name(), "a JPEG", error);
    decoder.decode_headers().map_err(|error| damaged(&error))?;
    let coded = decoder.input_colorspace().unwrap_or(ColorSpace::Unknown);
    // Unless the tags say YCbCr nothing is converted, whatever the decoder guesses.
    let wanted = if is_ycbcr && bands == 3 { ColorSpace::RGB } else { coded };
    decoder.set_options(options.jpeg_set_out_colorspace(wanted));
    let (width, height) = decoder.dimensions().unwrap_or_default();
    let components = wanted.num_components();
    let row_bytes = layout.row_bytes() as usize;
    if components != bands || width * bands < row_bytes {
        let expected = format!("{} x {rows} pixels of {bands} bands", layout.block_width);
        return Err(Error::format(name(), expected, format!("{width} x {height} of {components}")));
    }
    if width * bands == row_bytes && height == rows as usize {
        decoder.decode_into(out).map_err(|error| damaged(&error))?;
        return Ok(out.len());
    }
    let pixels = decoder.decode().map_err(|error| damaged(&error))?;
    let there = pixels.chunks_exact(width * bands).zip(out.chunks_exact_mut(row_bytes));
    Ok(there.map(|(from, to)| to.copy_from_slice(&from[..row_bytes])).count() * row_bytes)
}

/// The block with the shared tables inserted after its first marker.
fn join(tables: &[u8], packed: &[u8]) -> Vec<u8> {
    // Both begin with a start-of-image marker; the tables end with an end-of-image marker.
    let shared = tables.strip_prefix(&[0xFF, 0xD8]).unwrap_or_default();
    let shared = shared.strip_suffix(&[0xFF, 0xD9]).unwrap_or(shared);
    let image = packed.strip_prefix(&[0xFF, 0xD8]).unwrap_or(packed);
    [&[0xFF, 0xD8], shared, image].concat()
}

/// Checks the segments up to the first scan: it must have as many components as the frame (`bands`
/// if known), of 8 bits each.
pub(in crate::source) fn check(stream: &[u8], bands: Option<usize>, name: &dyn Fn() -> String) -> Result<()> {
    let mut rest = stream.get(2..).unwrap_or_default();
    let mut frame = None;
    while let [0xFF, marker, tail @ ..] = rest {
        if *marker == 0xFF {
            rest = &rest[1..];
            continue;
        }
        let [high, low, body @ ..] = tail else { break };
        let length = usize::from(u16::from_be_bytes([*high, *low])).saturating_sub(2);
        let (&[first, ..], Some(next)) = (body, body.get(length..)) else { break };
        match marker {
            0xC0..=0xC2 => {
                if first != 8 {
                    return Err(refused(format!("JPEG of {first} bits")));
                }
                frame = Some((*marker, usize::from(body.get(5).copied().unwrap_or(0))));
            }
            0xC3 | 0xC5..=0xC7 | 0xC9..=0xCB | 0xCD..=0xCF => {
                return Err(refused(format!("JPEG of an unusual kind (frame {marker:02X})")));
            }
            0xDA => {
                let several = frame.is_some_and(|(kind, count)| kind != 0xC2 && usize::from(first) < count);
                if several {
                    return Err(refused("JPEG in several scans".to_owned()));
                }
                return match (frame, bands) {
                    (Some((_, count)), Some(bands)) if count != bands => {
                        Err(Error::format(name(), format!("{bands} components"), count))
                    }
                    _ => Ok(()),
                };
            }
            _ => {}
        }
        rest = next;
    }
    Err(Error::format(name(), "a scan", "the end of its segments"))
}

fn refused(what: String) -> Error {
    Error::unsupported(what, format!("{NEEDS_GDAL}, or convert it with gdal_translate -co COMPRESS=DEFLATE"))
}
