//! Frames read by libzstd.

use std::cell::RefCell;

use zstd_safe::DCtx;

use super::NoFrame;
use crate::error::{Error, Result};

thread_local! {
    /// The context of this thread: setting one up costs more than a small frame.
    static DECOMPRESSOR: RefCell<Option<DCtx<'static>>> = const { RefCell::new(None) };
}

/// The content size that a frame states; `None` if it states none.
pub(super) fn content_size(frame: &[u8]) -> Result<Option<u64>, NoFrame> {
    zstd_safe::get_frame_content_size(frame).map_err(|_| NoFrame)
}

/// Sets the empty `out` to the content, of `size` bytes, of the one frame that is all of `frame`.
pub(super) fn decompress(frame: &[u8], size: usize, place: &str, out: &mut Vec<u8>) -> Result<()> {
    match zstd_safe::find_frame_compressed_size(frame) {
        Ok(length) if length == frame.len() => {}
        Ok(length) => {
            return Err(Error::format(place, format!("one zstd frame of {length} bytes"), frame.len()));
        }
        Err(_) => return Err(super::cut_off(place, frame)),
    }
    out.reserve(size);
    let decoded = DECOMPRESSOR
        .with_borrow_mut(|context| context.get_or_insert_with(DCtx::create).decompress(out, frame));
    match decoded {
        Ok(length) if length == size => Ok(()),
        Ok(length) => Err(Error::format(place, format!("{size} bytes of content"), length)),
        Err(code) => Err(Error::format(place, "a zstd frame", zstd_safe::get_error_name(code))),
    }
}
