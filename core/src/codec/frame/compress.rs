//! Frames written by libzstd.
//!
//! Level 1 throughout: on residuals the higher levels are larger, because short matches crowd out
//! Huffman codes.

use std::cell::RefCell;
use std::io::Cursor;

use zstd_safe::zstd_sys::ZSTD_EndDirective;
use zstd_safe::{CCtx, CParameter, InBuffer, OutBuffer, ParamSwitch, ResetDirective};

use crate::error::{Error, Result};

/// Compression level of all frames.
const LEVEL: i32 = 1;
/// Shortest match in a plane of residuals: shorter ones cost more than the Huffman codes of what
/// they replace, 1 to 3 per cent of a file. Content smaller than a plane keeps the default of the
/// level (0).
const MIN_MATCH: u32 = 7;
/// Least bytes of content that is compressed as a plane of residuals.
const PLANE: usize = 4096;
/// Binary logarithm of the size of the match table for a plane of residuals: repetitions there are
/// near each other, and any other match replaces Huffman codes that are shorter.
const HASH_LOG: u32 = 10;
/// Bytes between the places where zstd looks for matches in a plane of residuals that has them.
/// Against 3, files of rasters with many voids are 0.4 to 0.9 per cent larger with 7 and 0.8 to 1.8
/// with 15, others 0.0 to 0.4; 1 saves nothing more. A build takes 0.4 to 1.0 per cent more
/// instructions than with 7.
const STRIDE: u32 = 3;
/// The same in a plane where a match would only replace Huffman codes that are shorter: zstd looks
/// once or twice in a block. A plane of one value is still found.
const RARELY: u32 = 131_071;

/// How matches are looked for in a plane of residuals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Matches {
    /// Every few bytes.
    Often,
    /// Hardly ever, which is faster.
    Rarely,
}

thread_local! {
    /// The context of this thread: setting one up costs more than a small frame.
    static COMPRESSOR: RefCell<Option<CCtx<'static>>> = const { RefCell::new(None) };
}

/// Appends `content` as one frame.
pub fn compress(content: &[u8], out: &mut Vec<u8>) -> Result<()> {
    compress_plane(content, &[], Matches::Often, out)
}

/// Appends `content`, a plane of residuals, as one frame. A new block, with codes of its own,
/// starts at each of the ascending `cuts`; this pays where the content changes.
pub fn compress_plane(content: &[u8], cuts: &[usize], matches: Matches, out: &mut Vec<u8>) -> Result<()> {
    let start = out.len();
    // A block costs at most 3 bytes more than the bound allows for.
    out.reserve(zstd_safe::compress_bound(content.len()) + 8 * cuts.len());
    let written = COMPRESSOR.with_borrow_mut(|context| {
        let context = match context {
            Some(context) => context,
            None => context.insert(new_compressor()?),
        };
        let (is_plane, is_large) = (!cuts.is_empty(), content.len() >= PLANE);
        context.set_parameter(CParameter::MinMatch(if is_large { MIN_MATCH } else { 0 }))?;
        context.set_parameter(CParameter::HashLog(if is_plane && is_large { HASH_LOG } else { 0 }))?;
        let stride = if matches == Matches::Often { STRIDE } else { RARELY };
        context.set_parameter(CParameter::TargetLength(if is_plane && is_large { stride } else { 0 }))?;
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

/// Appends the compressed content to `out`, which has the capacity, with a new block at every cut.
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
    // With a target length set, zstd disables literal compression by default: force it on.
    context.set_parameter(CParameter::LiteralCompressionMode(ParamSwitch::Enable))?;
    Ok(context)
}

/// The error of a call that zstd failed: it can only be out of memory.
fn failed(action: &str, bytes: usize, code: usize) -> Error {
    let source = std::io::Error::other(zstd_safe::get_error_name(code));
    Error::io("", format!("{action} {bytes} bytes"), source)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn length(content: &[u8], matches: Matches) -> usize {
        let mut out = Vec::new();
        compress_plane(content, &[content.len() / 2], matches, &mut out).unwrap();
        out.len()
    }

    #[test]
    fn small_residuals_are_shorter_without_matches_and_runs_with_them() {
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            state >> 33
        };
        // Two thirds are 0, the rest 1 or 2.
        let small: Vec<u8> = (0..50_000).map(|_| [0, 0, 0, 0, 1, 2][random() as usize % 6]).collect();
        assert!(length(&small, Matches::Rarely) < length(&small, Matches::Often));
        // Zeros, but for a fiftieth of the plane.
        let runs: Vec<u8> =
            (0..50_000_u64).map(|at| if at % 5_000 < 100 { random() as u8 } else { 0 }).collect();
        assert!(length(&runs, Matches::Often) * 3 < length(&runs, Matches::Rarely));
        let constant = vec![7; 50_000];
        assert!(length(&constant, Matches::Rarely) < 100);
    }
}
