//! One block from its bytes in the file to samples of one band in this machine's byte order.
//!
//! Output sizes come from the layout alone: a block that yields less is damaged, what it yields beyond is ignored, as
//! libtiff does. LZW goes through `weezl` itself, because the decoder of the `tiff` crate (0.11.3) gives up on
//! valid blocks without an end code.

use super::layout::{Compression, Layout, Predictor, Stored};
use crate::error::{Error, Result};
use crate::sample::SampleType;

/// Decodes a block of `rows` coded rows; the result has `block_width` samples (bytes 0 or 1 for bits) in each row.
///
/// `name` says which block it is in messages.
pub(super) fn block(layout: &Layout, packed: &[u8], rows: u32, name: &dyn Fn() -> String) -> Result<Vec<u8>> {
    let row_bytes = layout.row_bytes() as usize;
    let expected = row_bytes * rows as usize;
    let mut bytes = Vec::new();
    bytes
        .try_reserve_exact(expected)
        .map_err(|_| Error::limit("memory for a decoded block", expected as u64, 0))?;
    bytes.resize(expected, 0);
    let got = match layout.compression {
        Compression::None => {
            let got = packed.len().min(expected);
            bytes[..got].copy_from_slice(&packed[..got]);
            Ok(got)
        }
        Compression::Lzw => lzw(packed, &mut bytes),
        Compression::Deflate => deflate(packed, &mut bytes),
        Compression::PackBits => Ok(pack_bits(packed, &mut bytes)),
        Compression::Zstd => zstandard(packed, &mut bytes),
    };
    let got = got.map_err(|problem| match problem {
        Problem::Damaged(got) => Error::format(name(), format!("{expected} bytes"), got),
        Problem::OldLzw => {
            Error::unsupported("LZW of before 1988 (bits reversed)", "build with --features gdal")
        }
    })?;
    if got < expected {
        return Err(Error::format(name(), format!("{expected} bytes"), format!("{got} bytes")));
    }
    match layout.stored {
        Stored::Bit => Ok(bits(&bytes, row_bytes, layout)),
        Stored::Number(kind) => {
            unpredict(layout, kind, &mut bytes, row_bytes);
            Ok(first_band(bytes, kind.bytes(), layout.bands as usize))
        }
    }
}

/// Why a block cannot be decoded.
enum Problem {
    Damaged(String),
    OldLzw,
}

fn lzw(packed: &[u8], out: &mut [u8]) -> Result<usize, Problem> {
    if let [0, second, ..] = packed
        && second & 1 == 1
    {
        return Err(Problem::OldLzw);
    }
    let mut decoder = weezl::decode::Configuration::with_tiff_size_switch(weezl::BitOrder::Msb, 8)
        .with_yield_on_full_buffer(true)
        .build();
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

fn deflate(packed: &[u8], out: &mut [u8]) -> Result<usize, Problem> {
    let mut inflater = flate2::Decompress::new(true);
    let (mut read, mut written) = (0, 0);
    loop {
        // Once more when `out` is full: the end of the stream holds a checksum of what came before.
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

fn zstandard(packed: &[u8], out: &mut [u8]) -> Result<usize, Problem> {
    use zstd::stream::raw::{Decoder, InBuffer, Operation, OutBuffer};
    let damaged = |error: std::io::Error| Problem::Damaged(error.to_string());
    let mut decoder = Decoder::new().map_err(damaged)?;
    let mut input = InBuffer::around(packed);
    let mut output = OutBuffer::around(out);
    loop {
        let before = (input.pos(), output.pos());
        let left = decoder.run(&mut input, &mut output).map_err(damaged)?;
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

/// One byte, 0 or 1, for each bit of the first band.
fn bits(bytes: &[u8], row_bytes: usize, layout: &Layout) -> Vec<u8> {
    let (width, bands) = (layout.block_width as usize, layout.bands as usize);
    let bit = |row: &[u8], at: usize| row[at / 8] >> (7 - at % 8) & 1;
    bytes.chunks_exact(row_bytes).flat_map(|row| (0..width).map(move |x| bit(row, x * bands))).collect()
}

/// Turns differences into samples of this machine's byte order.
fn unpredict(layout: &Layout, kind: SampleType, bytes: &mut [u8], row_bytes: usize) {
    if layout.predictor == Predictor::FloatingPoint {
        // Its bytes are sorted from the highest to the lowest, whatever the byte order of the file.
        return sum_and_merge_bytes(bytes, row_bytes, kind.bytes(), layout.bands as usize);
    }
    if layout.swapped {
        match kind.bytes() {
            2 => bytes.as_chunks_mut::<2>().0.iter_mut().for_each(|b| b.reverse()),
            4 => bytes.as_chunks_mut::<4>().0.iter_mut().for_each(|b| b.reverse()),
            8 => bytes.as_chunks_mut::<8>().0.iter_mut().for_each(|b| b.reverse()),
            _ => {}
        }
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
}

/// Adds to each sample of a row the one of the same band before it.
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

/// Predictor 3: sums bytes along the row, then takes byte `k` of a number from the `k`th part of the row.
fn sum_and_merge_bytes(bytes: &mut [u8], row_bytes: usize, size: usize, bands: usize) {
    let mut planes = vec![0; row_bytes];
    for row in bytes.chunks_exact_mut(row_bytes) {
        sum(row, bands, |a: [u8; 1], b| [a[0].wrapping_add(b[0])]);
        planes.copy_from_slice(row);
        match size {
            4 => merge::<4>(&planes, row),
            _ => merge::<8>(&planes, row),
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

/// Keeps the first of `bands` interleaved samples.
fn first_band(mut bytes: Vec<u8>, size: usize, bands: usize) -> Vec<u8> {
    if bands > 1 {
        let count = bytes.len() / (size * bands);
        for index in 1..count {
            bytes.copy_within(index * size * bands..(index * bands + 1) * size, index * size);
        }
        bytes.truncate(count * size);
        bytes.shrink_to_fit();
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pack_bits_of_the_specification() {
        // The example of TIFF 6.0, section 9.
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
        sum_and_merge_bytes(&mut row, length, 4, 1);
        let back: Vec<f32> = row.as_chunks().0.iter().map(|&b| f32::from_ne_bytes(b)).collect();
        assert_eq!(back, heights);
    }

    #[test]
    fn first_band_of_three() {
        assert_eq!(first_band((0..12).collect(), 2, 3), [0, 1, 6, 7]);
    }
}
