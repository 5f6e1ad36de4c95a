//! Writes PNG files made in memory.

use std::path::Path;

use crate::error::{Error, Result};
use crate::output;

/// Writes pixels of a colour type and depth as a PNG, which replaces an existing file only when it
/// is complete. Each text is a keyword and its value.
pub(super) fn write_png(
    path: &Path,
    (width, height): (u32, u32),
    (kind, depth): (png::ColorType, png::BitDepth),
    pixels: &[u8],
    texts: &[(&str, &str)],
) -> Result<()> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(kind);
    encoder.set_depth(depth);
    let refused = |error: png::EncodingError| Error::usage(format!("this picture cannot be a PNG: {error}"));
    for (key, text) in texts {
        encoder.add_text_chunk((*key).to_owned(), (*text).to_owned()).map_err(refused)?;
    }
    let mut writer = encoder.write_header().map_err(refused)?;
    writer.write_image_data(pixels).map_err(refused)?;
    writer.finish().map_err(refused)?;
    output::write(path, &bytes, true)
}
