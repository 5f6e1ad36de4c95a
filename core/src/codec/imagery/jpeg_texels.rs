//! Texels as baseline JPEG: encoded by `jpeg-encoder`, decoded by `zune-jpeg`, both pure Rust.

use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

use super::Form;
use super::jpeg::{END, JpegTables, split};
use crate::error::{Error, Result};
use crate::texel::Colour;

/// Least quality at which chroma is stored at full size.
const FULL_CHROMA: u8 = 90;

/// The tables of Annex K, with which [`encode`] codes.
pub(super) fn standard_tables(form: &Form) -> Result<JpegTables> {
    let grey = vec![0; form.side * form.side * form.colour.channels()];
    let file = write_file(form, &grey)?;
    let (prefix, _) = split(&file)?;
    JpegTables::parse(form, prefix)
}

/// The entropy-coded data of a tile, with the standard tables.
pub(super) fn encode(form: &Form, colour: &[u8]) -> Result<Vec<u8>> {
    let mut file = write_file(form, colour)?;
    let start = file.len() - split(&file)?.1.len();
    file.truncate(file.len() - END.len());
    Ok(file.split_off(start))
}

fn write_file(form: &Form, colour: &[u8]) -> Result<Vec<u8>> {
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, form.quality);
    encoder.set_sampling_factor(if form.quality < FULL_CHROMA {
        SamplingFactor::R_4_2_0
    } else {
        SamplingFactor::R_4_4_4
    });
    let kind = if form.colour == Colour::Grey { ColorType::Luma } else { ColorType::Rgb };
    let side = form.side as u16;
    encoder
        .encode(colour, side, side, kind)
        .map_err(|error| Error::io("", "encode an imagery tile", std::io::Error::other(error.to_string())))?;
    Ok(file)
}

/// The colour of a tile's chunk.
pub(super) fn decode(form: &Form, tables: &JpegTables, chunk: &[u8]) -> Result<Vec<u8>> {
    let space = if form.colour == Colour::Grey { ColorSpace::Luma } else { ColorSpace::RGB };
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(form.side)
        .set_max_height(form.side)
        .jpeg_set_out_colorspace(space);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(tables.file(chunk)), options);
    let bad = |what: String| Error::format("colour chunk", "entropy-coded data of a JPEG", what);
    let mut colour = vec![0; form.side * form.side * form.colour.channels()];
    decoder.decode_into(&mut colour).map_err(|error| bad(error.to_string()))?;
    Ok(colour)
}
