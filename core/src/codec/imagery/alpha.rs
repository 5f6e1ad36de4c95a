//! Alpha apart from the colour, lossless: one bit a texel if that is enough, else one byte a texel,
//! less the texel above.

use crate::codec::frame;
use crate::error::{Error, Result};

const BYTES: u8 = 0;
const BITS: u8 = 1;

/// The chunk of `side * side` alphas.
#[cfg(feature = "write")]
pub(super) fn encode(side: usize, alpha: &[u8]) -> Result<Vec<u8>> {
    let above = |i: usize| if i < side { 255 } else { alpha[i - side] };
    let binary = alpha.iter().all(|&a| a == 0 || a == 255);
    let mut content;
    if binary {
        content = vec![0; alpha.len().div_ceil(8)];
        for (i, &a) in alpha.iter().enumerate() {
            content[i / 8] |= u8::from(a != above(i)) << (i % 8);
        }
    } else {
        content = alpha.iter().enumerate().map(|(i, &a)| a.wrapping_sub(above(i))).collect();
    }
    let mut chunk = vec![if binary { BITS } else { BYTES }];
    frame::compress(&content, &mut chunk)?;
    Ok(chunk)
}

/// The alphas of a chunk.
pub(super) fn decode(side: usize, chunk: &[u8]) -> Result<Vec<u8>> {
    let place = "alpha chunk";
    let count = side * side;
    let Some((&form, frame)) = chunk.split_first() else {
        return Err(Error::format(place, "a form", "no bytes"));
    };
    let bytes = match form {
        BYTES => count,
        BITS => count.div_ceil(8),
        other => return Err(Error::format(place, "form 0 or 1", other)),
    };
    let mut content = Vec::new();
    frame::decompress(frame, bytes..=bytes, place, &mut content)?;
    let mut alpha = vec![255; count];
    if form == BITS {
        if content.last().is_some_and(|&last| !count.is_multiple_of(8) && last >> (count % 8) != 0) {
            return Err(Error::format(place, "unused bits 0", "others"));
        }
        for i in 0..count {
            let changes = content[i / 8] >> (i % 8) & 1 != 0;
            let above = if i < side { 255 } else { alpha[i - side] };
            alpha[i] = if changes { !above } else { above };
        }
    } else {
        for i in 0..count {
            let above: u8 = if i < side { 255 } else { alpha[i - side] };
            alpha[i] = above.wrapping_add(content[i]);
        }
    }
    Ok(alpha)
}
