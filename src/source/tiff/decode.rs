//! Decodes one block from its bytes in the file to samples of one band in this machine's byte
//! order.
//!
//! The output size follows from the layout alone: a block that yields less is damaged, and anything
//! beyond is ignored, as libtiff does. LZW uses `weezl` directly, because the decoder of the `tiff`
//! crate (0.11.3) fails on valid blocks without an end code. Deflate uses libdeflate, which needs
//! the whole stream at once, and flate2 if a block ends in another place than it should.

use zstd::zstd_safe::{DCtx, InBuffer, OutBuffer, ResetDirective, get_error_name};

use super::layout::{Compression, Layout, Predictor, Stored};
use crate::error::{Error, Result};
use crate::sample::SampleType;

/// Buffers of one decoding thread, reused from block to block.
#[derive(Default)]
pub(super) struct Buffers {
    /// The block as in the file.
    pub(super) packed: Vec<u8>,
    /// The decoded block.
    pub(super) bytes: Vec<u8>,
    spare: Vec<u8>,
    inflater: Option<libdeflater::Decompressor>,
    zstd: Option<DCtx<'static>>,
}

impl Buffers {
    /// Bytes of all buffers.
    pub(super) fn bytes(&self) -> usize {
        self.packed.capacity() + self.bytes.capacity() + self.spare.capacity()
    }
}

/// Sets the length of a buffer that will be overwritten; its content is not cleared.
pub(super) fn resize(buffer: &mut Vec<u8>, length: usize) -> Result<()> {
    let more = length.saturating_sub(buffer.len());
    buffer.try_reserve_exact(more).map_err(|_| Error::out_of_memory("a block", length as u64))?;
    buffer.resize(length, 0);
    Ok(())
}

/// Decodes a packed block of `rows` coded rows. The result has `block_width` samples in each row
/// (bytes 0 or 1 for bits).
///
/// `name` names the block in messages.
pub(super) fn block(
    layout: &Layout,
    buffers: &mut Buffers,
    rows: u32,
    name: &dyn Fn() -> String,
) -> Result<()> {
    let row_bytes = layout.row_bytes() as usize;
    let expected = row_bytes * rows as usize;
    resize(&mut buffers.bytes, expected)?;
    let Buffers { packed, bytes, spare, inflater, zstd } = buffers;
    let got = match layout.compression {
        Compression::None => {
            let got = packed.len().min(expected);
            bytes[..got].copy_from_slice(&packed[..got]);
            Ok(got)
        }
        Compression::Lzw => lzw(packed, bytes),
        Compression::Deflate => deflate(packed, bytes, inflater),
        Compression::PackBits => Ok(pack_bits(packed, bytes)),
        Compression::Zstd => zstandard(packed, bytes, zstd),
        Compression::Jpeg => super::jpeg::decode(packed, layout, rows, bytes, name).map_err(Problem::Other),
    };
    let got = got.map_err(|problem| match problem {
        Problem::Damaged(got) => Error::format(name(), format!("{expected} bytes"), got),
        Problem::Other(error) => error,
    })?;
    if got < expected {
        return Err(Error::format(name(), format!("{expected} bytes"), format!("{got} bytes")));
    }
    match layout.stored {
        Stored::Bit => {
            bits(bytes, row_bytes, layout, rows, spare)?;
            std::mem::swap(bytes, spare);
        }
        Stored::Number(kind) => {
            unpredict(layout, kind, bytes, row_bytes, spare)?;
            if layout.all_bands {
                return Ok(());
            }
            one_band(bytes, kind.bytes(), (layout.bands as usize, layout.place as usize));
        }
    }
    Ok(())
}

/// The reason why a block cannot be decoded.
enum Problem {
    Damaged(String),
    Other(Error),
}

fn lzw(packed: &[u8], out: &mut [u8]) -> Result<usize, Problem> {
    use weezl::BitOrder::{Lsb, Msb};
    use weezl::decode::Configuration;
    // A block begins with the code that clears the table, in 9 bits. Before 1988 codes were packed
    // from the lowest bit up, and grew longer one code later, as in GIF; libtiff reads such files
    // too.
    let is_old = matches!(packed, [0, second, ..] if second & 1 == 1);
    let configuration =
        if is_old { Configuration::new(Lsb, 8) } else { Configuration::with_tiff_size_switch(Msb, 8) };
    let mut decoder = configuration.with_yield_on_full_buffer(true).build();
    let (mut read, mut written) = (0, 0);
    while written < out.len() {
        let result = decoder.decode_bytes(&packed[read..], &mut out[written..]);
        read += result.consumed_in;
        written += result.consumed_out;
        match result.status {
            Ok(weezl::LzwStatus::Ok) if result.consumed_in + result.consumed_out > 0 => {}
            Ok(_) => break,
            Err(error) => return Err(Problem::Damaged(format!("{written} bytes and then: {error}"))),
        }
    }
    Ok(written)
}

fn deflate(
    packed: &[u8],
    out: &mut [u8],
    inflater: &mut Option<libdeflater::Decompressor>,
) -> Result<usize, Problem> {
    let inflater = inflater.get_or_insert_with(libdeflater::Decompressor::new);
    // libdeflate refuses output that does not fit `out`, and does not say how far it came.
    inflater.zlib_decompress(packed, out).or_else(|_| inflate(packed, out))
}

/// Decodes as much of a stream as it has and `out` holds.
fn inflate(packed: &[u8], out: &mut [u8]) -> Result<usize, Problem> {
    let mut inflater = flate2::Decompress::new(true);
    let (mut read, mut written) = (0, 0);
    loop {
        // Called once more when `out` is full, to reach the checksum at the end of the stream.
        let full = written == out.len();
        let status = inflater
            .decompress(&packed[read..], &mut out[written..], flate2::FlushDecompress::None)
            .map_err(|error| Problem::Damaged(format!("{written} bytes and then: {error}")))?;
        let progress = (inflater.total_in() as usize, inflater.total_out() as usize);
        if status == flate2::Status::StreamEnd || progress == (read, written) || full {
            return Ok(progress.1);
        }
        (read, written) = progress;
    }
}

fn zstandard(packed: &[u8], out: &mut [u8], context: &mut Option<DCtx<'static>>) -> Result<usize, Problem> {
    let damaged = |code: usize| Problem::Damaged(get_error_name(code).to_owned());
    let context = context.get_or_insert_with(DCtx::create);
    context.reset(ResetDirective::SessionOnly).map_err(damaged)?;
    let mut input = InBuffer::around(packed);
    let mut output = OutBuffer::around(out);
    loop {
        let before = (input.pos(), output.pos());
        let left = context.decompress_stream(&mut output, &mut input).map_err(damaged)?;
        if left == 0 || output.pos() == output.capacity() || before == (input.pos(), output.pos()) {
            return Ok(output.pos());
        }
    }
}

fn pack_bits(packed: &[u8], out: &mut [u8]) -> usize {
    let mut written = 0;
    let mut rest = packed;
    while let [control, tail @ ..] = rest {
        rest = tail;
        let room = out.len() - written;
        if *control < 128 {
            let length = (usize::from(*control) + 1).min(rest.len()).min(room);
            out[written..written + length].copy_from_slice(&rest[..length]);
            rest = &rest[length..];
            written += length;
        } else if *control > 128 {
            let [value, tail @ ..] = rest else { break };
            let length = (257 - usize::from(*control)).min(room);
            out[written..written + length].fill(*value);
            rest = tail;
            written += length;
        }
        if written == out.len() {
            break;
        }
    }
    written
}

/// One byte, 0 or 1, for each bit of the band.
fn bits(bytes: &[u8], row_bytes: usize, layout: &Layout, rows: u32, out: &mut Vec<u8>) -> Result<()> {
    let (width, bands) = (layout.block_width as usize, layout.bands as usize);
    resize(out, width * rows as usize)?;
    for (row, out) in bytes.chunks_exact(row_bytes).zip(out.chunks_exact_mut(width)) {
        if bands == 1 {
            for (&byte, out) in row.iter().zip(out.chunks_mut(8)) {
                out.iter_mut().enumerate().for_each(|(at, bit)| *bit = byte >> (7 - at) & 1);
            }
        } else {
            for (out, at) in out.iter_mut().zip((layout.place as usize..).step_by(bands)) {
                *out = row[at / 8] >> (7 - at % 8) & 1;
            }
        }
    }
    Ok(())
}

/// Reverses the bytes of each number.
pub(super) fn swap(bytes: &mut [u8], size: usize) {
    match size {
        2 => bytes.as_chunks_mut::<2>().0.iter_mut().for_each(|b| b.reverse()),
        4 => bytes.as_chunks_mut::<4>().0.iter_mut().for_each(|b| b.reverse()),
        8 => bytes.as_chunks_mut::<8>().0.iter_mut().for_each(|b| b.reverse()),
        _ => {}
    }
}

/// Undoes the predictor; the result is in this machine's byte order.
fn unpredict(
    layout: &Layout,
    kind: SampleType,
    bytes: &mut [u8],
    row_bytes: usize,
    spare: &mut Vec<u8>,
) -> Result<()> {
    if layout.predictor == Predictor::FloatingPoint {
        // The bytes are sorted from the highest to the lowest, whatever the byte order of the file.
        resize(spare, row_bytes)?;
        sum_and_merge_bytes(bytes, row_bytes, kind.bytes(), layout.bands as usize, spare);
        return Ok(());
    }
    if layout.swapped {
        swap(bytes, kind.bytes());
    }
    if layout.predictor == Predictor::Horizontal {
        let bands = layout.bands as usize;
        for row in bytes.chunks_exact_mut(row_bytes) {
            match kind.bytes() {
                1 => sum(row, bands, |a: [u8; 1], b| {
                    u8::from_ne_bytes(a).wrapping_add(u8::from_ne_bytes(b)).to_ne_bytes()
                }),
                2 => sum(row, bands, |a, b| {
                    u16::from_ne_bytes(a).wrapping_add(u16::from_ne_bytes(b)).to_ne_bytes()
                }),
                4 => sum(row, bands, |a, b| {
                    u32::from_ne_bytes(a).wrapping_add(u32::from_ne_bytes(b)).to_ne_bytes()
                }),
                _ => sum(row, bands, |a, b| {
                    u64::from_ne_bytes(a).wrapping_add(u64::from_ne_bytes(b)).to_ne_bytes()
                }),
            }
        }
    }
    Ok(())
}

/// Adds to each sample of a row the preceding one of the same band.
#[inline]
fn sum<const N: usize>(row: &mut [u8], bands: usize, add: impl Fn([u8; N], [u8; N]) -> [u8; N]) {
    let samples = row.as_chunks_mut::<N>().0;
    if bands == 1 {
        let mut left = [0; N];
        for sample in samples {
            left = add(left, *sample);
            *sample = left;
        }
    } else {
        for index in bands..samples.len() {
            samples[index] = add(samples[index - bands], samples[index]);
        }
    }
}

/// Undoes predictor 3: adds up bytes along the row, then takes byte `k` of each number from the
/// `k`th part of the row. `planes` holds a row.
fn sum_and_merge_bytes(bytes: &mut [u8], row_bytes: usize, size: usize, bands: usize, planes: &mut [u8]) {
    for row in bytes.chunks_exact_mut(row_bytes) {
        sum(row, bands, |a: [u8; 1], b| [a[0].wrapping_add(b[0])]);
        planes.copy_from_slice(row);
        match size {
            4 => merge::<4>(planes, row),
            _ => merge::<8>(planes, row),
        }
    }
}

fn merge<const N: usize>(planes: &[u8], row: &mut [u8]) {
    let count = planes.len() / N;
    for (index, number) in row.as_chunks_mut::<N>().0.iter_mut().enumerate() {
        for (k, byte) in number.iter_mut().enumerate() {
            let plane = if cfg!(target_endian = "little") { N - 1 - k } else { k };
            *byte = planes[plane * count + index];
        }
    }
}

/// Keeps one band of interleaved samples.
fn one_band(bytes: &mut Vec<u8>, size: usize, (bands, band): (usize, usize)) {
    if bands > 1 {
        let count = bytes.len() / (size * bands);
        for index in 0..count {
            let from = (index * bands + band) * size;
            bytes.copy_within(from..from + size, index * size);
        }
        bytes.truncate(count * size);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pack_bits_of_the_specification() {
        // The example in TIFF 6.0, section 9.
        let packed =
            [0xFE, 0xAA, 0x02, 0x80, 0x00, 0x2A, 0xFD, 0xAA, 0x03, 0x80, 0x00, 0x2A, 0x22, 0xF7, 0xAA];
        let mut out = [0; 24];
        assert_eq!(pack_bits(&packed, &mut out), 24);
        let expected = [
            0xAA, 0xAA, 0xAA, 0x80, 0x00, 0x2A, 0xAA, 0xAA, 0xAA, 0xAA, 0x80, 0x00, 0x2A, 0x22, 0xAA, 0xAA,
            0xAA, 0xAA, 0xAA, 0xAA, 0xAA, 0xAA, 0xAA, 0xAA,
        ];
        assert_eq!(out, expected);
        assert_eq!(pack_bits(&packed[..3], &mut out), 3);
        assert_eq!(pack_bits(&packed[..5], &mut out), 5);
    }

    #[test]
    fn deflate_finds_a_wrong_checksum_and_ignores_what_follows() {
        use std::io::Write;
        let data: Vec<u8> = (0..10_000_u32).map(|n| ((n * n) >> 5) as u8).collect();
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
        encoder.write_all(&data).expect("memory");
        let mut packed = encoder.finish().expect("memory");
        let mut out = vec![0; data.len()];
        let mut inflater = None;
        let mut deflate = |packed: &[u8], out: &mut [u8]| super::deflate(packed, out, &mut inflater);
        assert!(matches!(deflate(&packed, &mut out), Ok(10_000)));
        assert_eq!(out, data);
        // A strip may hold more rows than the raster has left.
        assert!(matches!(deflate(&packed, &mut out[..5000]), Ok(5000)));
        packed.extend([1, 2, 3]);
        assert!(matches!(deflate(&packed, &mut out), Ok(10_000)));
        let end = packed.len() - 4;
        packed[end] ^= 1;
        assert!(deflate(&packed, &mut out).is_err());
        assert!(matches!(deflate(&packed[..end / 2], &mut out), Ok(count) if count < 10_000));
    }

    #[test]
    fn predictor_3_round_trip() {
        let heights = [1.5_f32, -2.25, 1e-30, f32::MAX, 0.0, 8848.86];
        let mut row: Vec<u8> = (0..4).flat_map(|k| heights.map(|z| z.to_be_bytes()[k])).collect();
        for index in (1..row.len()).rev() {
            row[index] = row[index].wrapping_sub(row[index - 1]);
        }
        let length = row.len();
        sum_and_merge_bytes(&mut row, length, 4, 1, &mut vec![0; length]);
        let back: Vec<f32> = row.as_chunks().0.iter().map(|&b| f32::from_ne_bytes(b)).collect();
        assert_eq!(back, heights);
    }

    #[test]
    fn each_band_of_three() {
        for (band, expected) in [[0, 1, 6, 7], [2, 3, 8, 9], [4, 5, 10, 11]].into_iter().enumerate() {
            let mut bytes = (0..12).collect();
            one_band(&mut bytes, 2, (3, band));
            assert_eq!(bytes, expected);
        }
    }
}
