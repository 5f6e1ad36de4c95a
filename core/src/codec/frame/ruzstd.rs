//! Frames read by `ruzstd`, which is Rust alone: for a reader without a C compiler, as on wasm32.
//! Some five times slower.

use ::ruzstd::decoding::{BlockDecodingStrategy, FrameDecoder};

use super::NoFrame;
use crate::error::{Error, Result};

/// The first bytes of a frame.
const MAGIC: [u8; 4] = [0x28, 0xB5, 0x2F, 0xFD];

/// The content size that a frame states; `None` if it states none (RFC 8878, section 3.1.1.1).
pub(super) fn content_size(frame: &[u8]) -> Result<Option<u64>, NoFrame> {
    let (&descriptor, rest) = frame.strip_prefix(&MAGIC).and_then(<[u8]>::split_first).ok_or(NoFrame)?;
    let (flag, is_single) = (descriptor >> 6, descriptor & 0x20 != 0);
    let window = usize::from(!is_single);
    let dictionary = [0, 1, 2, 4][usize::from(descriptor & 3)];
    let bytes = match flag {
        0 if !is_single => return Ok(None),
        0 => 1,
        flag => 1 << flag,
    };
    let field = rest.get(window + dictionary..).and_then(|field| field.get(..bytes)).ok_or(NoFrame)?;
    let number = field.iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte));
    Ok(Some(if flag == 1 { number + 256 } else { number }))
}

/// Sets the empty `out` to the content, of `size` bytes, of the one frame that is all of `frame`.
pub(super) fn decompress(frame: &[u8], size: usize, place: &str, out: &mut Vec<u8>) -> Result<()> {
    let mut decoder = FrameDecoder::new();
    let mut rest = frame;
    let bad = |error: &dyn std::fmt::Display| Error::format(place, "a zstd frame", error.to_string());
    decoder.init(&mut rest).map_err(|error| bad(&error))?;
    // One byte more than expected, so that a longer frame is noticed.
    let most = BlockDecodingStrategy::UptoBytes(size + 1);
    decoder.decode_blocks(&mut rest, most).map_err(|error| bad(&error))?;
    if !decoder.is_finished() {
        return Err(Error::format(place, format!("{size} bytes of content"), "more"));
    }
    if !rest.is_empty() {
        let length = frame.len() - rest.len();
        return Err(Error::format(place, format!("one zstd frame of {length} bytes"), frame.len()));
    }
    out.reserve(size);
    let length = decoder.collect_to_writer(&mut *out).map_err(|error| bad(&error))?;
    if length == size {
        Ok(())
    } else {
        Err(Error::format(place, format!("{size} bytes of content"), length))
    }
}
