//! BC1 and BC7 blocks (`block_compression`: Intel's ISPC kernels in plain Rust, the same bytes on
//! any processor), packed by zstd.

use block_compression::decode::decompress_blocks_as_rgba8;
use block_compression::encode::compress_rgba8;
use block_compression::{BC7Settings, CompressionVariant};

use super::{Codec, Form, content_bytes, take_colour, unpack_blocks};
use crate::codec::frame;
use crate::error::Result;
use crate::texel::Colour;

/// The colour chunk of a tile. BC7 blocks also have the alpha, with the error of BC7; the exact
/// alpha is stored apart.
#[cfg(feature = "write")]
pub(super) fn encode(form: &Form, colour: &[u8], alpha: Option<&[u8]>) -> Result<Vec<u8>> {
    let carried = alpha.filter(|_| form.codec == Codec::Bc7);
    let rgba = rgba(form, colour, carried);
    let variant = match (form.codec, carried) {
        (Codec::Bc1, _) => CompressionVariant::BC1,
        (_, None) => CompressionVariant::BC7(BC7Settings::opaque_ultra_fast()),
        (_, Some(_)) => CompressionVariant::BC7(BC7Settings::alpha_ultrafast()),
    };
    let side = form.side as u32;
    let mut blocks = vec![0; content_bytes(form)?];
    compress_rgba8(variant, &rgba, &mut blocks, side, side, 4 * side);
    let mut chunk = Vec::new();
    frame::compress(&blocks, &mut chunk)?;
    Ok(chunk)
}

fn rgba(form: &Form, colour: &[u8], alpha: Option<&[u8]>) -> Vec<u8> {
    let mut rgba = vec![255; 4 * form.side * form.side];
    let (pixels, _) = rgba.as_chunks_mut::<4>();
    match form.colour {
        Colour::Grey => {
            for (pixel, &grey) in pixels.iter_mut().zip(colour) {
                pixel[..3].fill(grey);
            }
        }
        Colour::Rgb => {
            for (pixel, rgb) in pixels.iter_mut().zip(colour.as_chunks::<3>().0) {
                pixel[..3].copy_from_slice(rgb);
            }
        }
    }
    if let Some(alpha) = alpha {
        for (pixel, &a) in pixels.iter_mut().zip(alpha) {
            pixel[3] = a;
        }
    }
    rgba
}

/// The colour of a chunk.
pub(super) fn decode(form: &Form, chunk: &[u8]) -> Result<Vec<u8>> {
    let blocks = unpack_blocks(form, chunk)?;
    let side = form.side as u32;
    let variant = if form.codec == Codec::Bc1 {
        CompressionVariant::BC1
    } else {
        CompressionVariant::BC7(BC7Settings::alpha_ultrafast())
    };
    let mut rgba = vec![0; 4 * form.side * form.side];
    decompress_blocks_as_rgba8(variant, side, side, &blocks, &mut rgba);
    Ok(take_colour(&rgba, 4, form.colour))
}
