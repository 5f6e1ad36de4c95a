//! Lossless WebP (`image-webp`) and PNG (`png`), both of the image-rs group and pure Rust: alpha is
//! a channel of the image.

use std::io::{self, Cursor};

use image_webp::{ColorType, WebPDecoder, WebPEncoder};

use super::{Form, take_colour};
use crate::error::{Error, Result};
use crate::texel::Colour;

type Decoded = (Vec<u8>, Option<Vec<u8>>);

const PLACE: &str = "colour chunk";

/// Pixels of colour and alpha.
fn join(form: &Form, colour: &[u8], alpha: Option<&[u8]>) -> Vec<u8> {
    let Some(alpha) = alpha else { return colour.to_vec() };
    let channels = form.colour.channels();
    let mut pixels = Vec::with_capacity(colour.len() + alpha.len());
    for (colour, &alpha) in colour.chunks_exact(channels).zip(alpha) {
        pixels.extend_from_slice(colour);
        pixels.push(alpha);
    }
    pixels
}

/// Colour and alpha of pixels of `channels` bytes; with 2 or 4 channels the last is alpha.
fn part(form: &Form, pixels: &[u8], channels: usize) -> Decoded {
    let has_alpha = channels.is_multiple_of(2);
    let alpha = has_alpha.then(|| pixels.chunks_exact(channels).map(|pixel| pixel[channels - 1]).collect());
    let colour = match (form.colour, channels) {
        (Colour::Grey, 1 | 2) => pixels.chunks_exact(channels).map(|pixel| pixel[0]).collect(),
        _ => take_colour(pixels, channels, form.colour),
    };
    (colour, alpha)
}

fn failed(what: impl ToString) -> Error {
    Error::io("", "encode an imagery tile", io::Error::other(what.to_string()))
}

fn check_size(form: &Form, (width, height): (u32, u32)) -> Result<()> {
    if (width as usize, height as usize) == (form.side, form.side) {
        return Ok(());
    }
    let expected = format!("a picture of {0} x {0} texels", form.side);
    Err(Error::format(PLACE, expected, format!("{width} x {height}")))
}

/// A lossless WebP file.
pub(super) fn encode_webp(form: &Form, colour: &[u8], alpha: Option<&[u8]>) -> Result<Vec<u8>> {
    let kind = match (form.colour, alpha.is_some()) {
        (Colour::Grey, false) => ColorType::L8,
        (Colour::Grey, true) => ColorType::La8,
        (Colour::Rgb, false) => ColorType::Rgb8,
        (Colour::Rgb, true) => ColorType::Rgba8,
    };
    let mut chunk = Vec::new();
    let side = form.side as u32;
    WebPEncoder::new(&mut chunk).encode(&join(form, colour, alpha), side, side, kind).map_err(failed)?;
    Ok(chunk)
}

/// Colour and alpha of a WebP file.
pub(super) fn decode_webp(form: &Form, chunk: &[u8]) -> Result<Decoded> {
    let bad = |error: image_webp::DecodingError| Error::format(PLACE, "a WebP picture", error);
    let mut decoder = WebPDecoder::new(Cursor::new(chunk)).map_err(bad)?;
    check_size(form, decoder.dimensions())?;
    if decoder.is_animated() {
        return Err(Error::format(PLACE, "one picture", "an animation"));
    }
    let channels = if decoder.has_alpha() { 4 } else { 3 };
    let mut pixels = vec![0; form.side * form.side * channels];
    decoder.set_memory_limit(4 * pixels.len());
    decoder.read_image(&mut pixels).map_err(bad)?;
    Ok(part(form, &pixels, channels))
}

/// A PNG file.
pub(super) fn encode_png(form: &Form, colour: &[u8], alpha: Option<&[u8]>) -> Result<Vec<u8>> {
    let mut chunk = Vec::new();
    let side = form.side as u32;
    let mut encoder = png::Encoder::new(&mut chunk, side, side);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_color(match (form.colour, alpha.is_some()) {
        (Colour::Grey, false) => png::ColorType::Grayscale,
        (Colour::Grey, true) => png::ColorType::GrayscaleAlpha,
        (Colour::Rgb, false) => png::ColorType::Rgb,
        (Colour::Rgb, true) => png::ColorType::Rgba,
    });
    // Twenty times as fast as the next level, for a sixth more bytes; where bytes matter WebP is
    // better.
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(&join(form, colour, alpha)).map_err(failed)?;
    writer.finish().map_err(failed)?;
    Ok(chunk)
}

/// The name of a PNG colour type, for errors.
fn name(colours: png::ColorType) -> &'static str {
    match colours {
        png::ColorType::Grayscale => "grey",
        png::ColorType::GrayscaleAlpha => "grey and alpha",
        png::ColorType::Rgb => "RGB",
        png::ColorType::Rgba => "RGB and alpha",
        png::ColorType::Indexed => "a palette",
    }
}

/// Colour and alpha of a PNG file.
pub(super) fn decode_png(form: &Form, chunk: &[u8]) -> Result<Decoded> {
    let bad = |error: png::DecodingError| Error::format(PLACE, "a PNG picture", error);
    let limits = png::Limits { bytes: 16 * form.side * form.side + (1 << 16) };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(chunk), limits);
    decoder.set_transformations(png::Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(bad)?;
    let info = reader.info();
    check_size(form, info.size())?;
    let channels = match (form.colour, info.color_type) {
        (Colour::Grey, png::ColorType::Grayscale) => 1,
        (Colour::Grey, png::ColorType::GrayscaleAlpha) => 2,
        (Colour::Rgb, png::ColorType::Rgb) => 3,
        (Colour::Rgb, png::ColorType::Rgba) => 4,
        (_, other) => return Err(Error::format(PLACE, "the layer's colour", name(other))),
    };
    if info.bit_depth != png::BitDepth::Eight || info.animation_control.is_some() {
        return Err(Error::format(PLACE, "one picture of 8 bits", "another"));
    }
    let mut pixels = vec![0; form.side * form.side * channels];
    reader.next_frame(&mut pixels).map_err(bad)?;
    Ok(part(form, &pixels, channels))
}
