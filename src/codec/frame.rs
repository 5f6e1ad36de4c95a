//! Zstandard frames as the container uses them: one frame, content size stated, no dictionary, no checksum.
//!
//! Level 1 throughout: on residuals the higher levels are larger, because short matches crowd out Huffman codes.

use std::cell::RefCell;
use std::io::Cursor;
use std::ops::RangeInclusive;

use zstd::zstd_safe::zstd_sys::ZSTD_EndDirective;
use zstd::zstd_safe::{self, CCtx, CParameter, DCtx, InBuffer, OutBuffer, ParamSwitch, ResetDirective};

use crate::error::{Error, Result};

/// Level of all frames.
const LEVEL: i32 = 1;
/// Shortest match in a plane of residuals: shorter ones cost more than the Huffman codes of what they replace, 1 to 3 per
/// cent of a file. What is smaller than a plane keeps the level's own (0).
const MIN_MATCH: u32 = 7;
/// Bytes of content from which on that holds.
const PLANE: usize = 4096;
/// Binary logarithm of the places where a match is looked up, in a plane of residuals: what repeats there does so nearby, and any other
/// match takes the place of Huffman codes that are shorter.
const HASH_LOG: u32 = 10;
/// What zstd's search for matches passes over between two places, in bytes, in a plane of residuals, for the same reason. That saves a
/// tenth of the instructions of a build of smooth terrain, and 2 to 3 per cent of its file; files of rough terrain with many voids
/// may be half a per cent larger.
const STRIDE: u32 = 7;

thread_local! {
    /// Contexts of this thread: setting one up costs more than a small frame.
    static COMPRESSOR: RefCell<Option<CCtx<'static>>> = const { RefCell::new(None) };
    static DECOMPRESSOR: RefCell<Option<DCtx<'static>>> = const { RefCell::new(None) };
}

/// Appends `content` as one frame.
pub fn compress(content: &[u8], out: &mut Vec<u8>) -> Result<()> {
    compress_parts(content, &[], out)
}

/// Appends `content`, a plane of residuals, as one frame. At the `cuts`, which ascend, new blocks start, with codes of their own: it
/// pays where the content changes.
pub fn compress_parts(content: &[u8], cuts: &[usize], out: &mut Vec<u8>) -> Result<()> {
    let start = out.len();
    // A block costs 3 bytes at most beyond what the bound allows for.
    out.reserve(zstd_safe::compress_bound(content.len()) + 8 * cuts.len());
    let written = COMPRESSOR.with_borrow_mut(|context| {
        let context = match context {
            Some(context) => context,
            None => context.insert(new_compressor()?),
        };
        let (is_plane, is_large) = (!cuts.is_empty(), content.len() >= PLANE);
        context.set_parameter(CParameter::MinMatch(if is_large { MIN_MATCH } else { 0 }))?;
        context.set_parameter(CParameter::HashLog(if is_plane && is_large { HASH_LOG } else { 0 }))?;
        context.set_parameter(CParameter::TargetLength(if is_plane && is_large { STRIDE } else { 0 }))?;
        if cuts.is_empty() {
            let mut behind = Cursor::new(&mut *out);
            behind.set_position(start as u64);
            context.compress2(&mut behind, content).map(|_| ())
        } else {
            stream(context, content, cuts, out)
        }
    });
    written.map_err(|code| {
        out.truncate(start);
        failed("compress", content.len(), code)
    })
}

/// Compresses to the end of `out`, which has the room, with a new block at every cut.
fn stream(context: &mut CCtx<'_>, content: &[u8], cuts: &[usize], out: &mut Vec<u8>) -> Result<(), usize> {
    context.reset(ResetDirective::SessionOnly)?;
    context.set_pledged_src_size(Some(content.len() as u64))?;
    let start = out.len();
    let mut output = OutBuffer::around_pos(out, start);
    let mut done = 0;
    for &cut in cuts.iter().filter(|cut| **cut < content.len()) {
        let mut input = InBuffer::around(&content[done..cut.max(done)]);
        while context.compress_stream2(&mut output, &mut input, ZSTD_EndDirective::ZSTD_e_flush)? > 0 {}
        done = cut.max(done);
    }
    let mut input = InBuffer::around(&content[done..]);
    while context.compress_stream2(&mut output, &mut input, ZSTD_EndDirective::ZSTD_e_end)? > 0 {}
    Ok(())
}

/// A context that writes frames of this module's kind.
fn new_compressor() -> Result<CCtx<'static>, usize> {
    let mut context = CCtx::create();
    context.set_parameter(CParameter::CompressionLevel(LEVEL))?;
    context.set_parameter(CParameter::ContentSizeFlag(true))?;
    context.set_parameter(CParameter::ChecksumFlag(false))?;
    context.set_parameter(CParameter::DictIdFlag(false))?;
    // Left alone, zstd would think that who wants a stride has no time for Huffman codes.
    context.set_parameter(CParameter::LiteralCompressionMode(ParamSwitch::Enable))?;
    Ok(context)
}

/// Puts the content of the one frame that is all of `frame` into `out`, in place of what was there.
///
/// A frame that states a size outside `sizes`, or is anything else than one whole frame, is an [`Error::Format`] of
/// `place`; nothing is allocated for it.
pub fn decompress(frame: &[u8], sizes: RangeInclusive<usize>, place: &str, out: &mut Vec<u8>) -> Result<()> {
    let size = match zstd_safe::get_frame_content_size(frame) {
        Ok(Some(size)) => size,
        Ok(None) => {
            return Err(Error::format(place, "a zstd frame that states its size", "one that does not"));
        }
        Err(_) => return Err(Error::format(place, "a zstd frame", describe(frame))),
    };
    let size = usize::try_from(size).unwrap_or(usize::MAX);
    if !sizes.contains(&size) {
        let expected = format!("a zstd frame of {} to {} bytes of content", sizes.start(), sizes.end());
        return Err(Error::format(place, expected, size));
    }
    match zstd_safe::find_frame_compressed_size(frame) {
        Ok(length) if length == frame.len() => {}
        Ok(length) => {
            return Err(Error::format(place, format!("one zstd frame of {length} bytes"), frame.len()));
        }
        Err(_) => {
            return Err(Error::format(
                place,
                "a whole zstd frame",
                format!("{} bytes, cut off", frame.len()),
            ));
        }
    }
    out.clear();
    out.reserve(size);
    let decoded = DECOMPRESSOR
        .with_borrow_mut(|context| context.get_or_insert_with(DCtx::create).decompress(out, frame));
    match decoded {
        Ok(length) if length == size => Ok(()),
        Ok(length) => Err(Error::format(place, format!("{size} bytes of content"), length)),
        Err(code) => Err(Error::format(place, "a zstd frame", zstd_safe::get_error_name(code))),
    }
}

/// The first bytes of what should be a frame.
fn describe(frame: &[u8]) -> String {
    format!("{} bytes that start {:02X?}", frame.len(), &frame[..frame.len().min(4)])
}

/// zstd refused to work: out of memory is all that is left to blame.
fn failed(action: &str, bytes: usize, code: usize) -> Error {
    let source = std::io::Error::other(zstd_safe::get_error_name(code));
    Error::io("", format!("{action} {bytes} bytes"), source)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_comes_back() {
        for content in [&[][..], &[7], &[1; 1000]] {
            let mut frame = vec![42];
            compress(content, &mut frame).unwrap();
            let mut out = vec![9; 3];
            decompress(&frame[1..], 0..=1000, "test", &mut out).unwrap();
            assert_eq!(out, content);
        }
    }

    #[test]
    fn only_one_whole_frame_of_the_right_size_is_accepted() {
        let mut frame = Vec::new();
        compress(&(0..200).collect::<Vec<u8>>(), &mut frame).unwrap();
        let mut out = Vec::new();
        for end in 0..frame.len() {
            assert!(decompress(&frame[..end], 0..=1000, "test", &mut out).is_err(), "cut at {end}");
        }
        assert!(decompress(&frame, 0..=199, "test", &mut out).is_err());
        assert!(decompress(&frame, 201..=1000, "test", &mut out).is_err());
        let twice = [&frame[..], &frame[..]].concat();
        assert!(decompress(&twice, 0..=1000, "test", &mut out).is_err());
        let skippable = [0x50, 0x2A, 0x4D, 0x18, 0, 0, 0, 0];
        assert!(decompress(&skippable, 1..=1000, "test", &mut out).is_err());
        let unsized_frame = zstd::stream::encode_all(&[1_u8; 50][..], 1).unwrap();
        assert!(decompress(&unsized_frame, 0..=1000, "test", &mut out).is_err());
    }
}
