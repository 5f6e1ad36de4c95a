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
/// Bytes between the places where zstd looks for matches in a plane of residuals, for the same
/// reason. It saves a tenth of the instructions of a build of smooth terrain, and 2 to 3 per cent
/// of its file; files of rough terrain with many voids may be half a per cent larger.
const STRIDE: u32 = 7;

thread_local! {
    /// The context of this thread: setting one up costs more than a small frame.
    static COMPRESSOR: RefCell<Option<CCtx<'static>>> = const { RefCell::new(None) };
}

/// Appends `content` as one frame.
pub fn compress(content: &[u8], out: &mut Vec<u8>) -> Result<()> {
    compress_parts(content, &[], out)
}

/// Appends `content`, a plane of residuals, as one frame. A new block, with codes of its own,
/// starts at each of the ascending `cuts`; this pays where the content changes.
pub fn compress_parts(content: &[u8], cuts: &[usize], out: &mut Vec<u8>) -> Result<()> {
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
