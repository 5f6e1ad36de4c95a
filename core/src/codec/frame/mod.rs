//! Zstandard frames as the container uses them: one frame, content size stated, no dictionary, no
//! checksum.

use std::ops::RangeInclusive;

use crate::error::{Error, Result};

#[cfg(feature = "write")]
mod compress;
#[cfg(feature = "libzstd")]
mod libzstd;
#[cfg(any(test, all(feature = "ruzstd", not(feature = "libzstd"))))]
mod ruzstd;

#[cfg(feature = "write")]
pub use compress::{Matches, compress, compress_plane};
#[cfg(feature = "libzstd")]
use libzstd as library;
#[cfg(all(feature = "ruzstd", not(feature = "libzstd")))]
use ruzstd as library;

#[cfg(not(any(feature = "libzstd", feature = "ruzstd")))]
compile_error!("relevo-core needs one of its features `libzstd` and `ruzstd`");

/// The error for bytes that do not begin a frame.
#[derive(Debug, PartialEq)]
struct NoFrame;

/// Sets `out` to the content of the one frame that is all of `frame`.
///
/// Bytes that state a size outside `sizes`, or are not one whole frame, give an [`Error::Format`]
/// of `place`; nothing is allocated for them.
pub fn decompress(frame: &[u8], sizes: RangeInclusive<usize>, place: &str, out: &mut Vec<u8>) -> Result<()> {
    let size = match library::content_size(frame) {
        Ok(Some(size)) => usize::try_from(size).unwrap_or(usize::MAX),
        Ok(None) => {
            return Err(Error::format(place, "a zstd frame that states its size", "one that does not"));
        }
        Err(NoFrame) => return Err(Error::format(place, "a zstd frame", describe(frame))),
    };
    if !sizes.contains(&size) {
        let expected = format!("a zstd frame of {} to {} bytes of content", sizes.start(), sizes.end());
        return Err(Error::format(place, expected, size));
    }
    out.clear();
    library::decompress(frame, size, place, out)
}

/// A text for errors: the first bytes of `frame`.
fn describe(frame: &[u8]) -> String {
    format!("{} bytes that start {:02X?}", frame.len(), &frame[..frame.len().min(4)])
}

/// The error of a frame that is cut off.
#[cfg(feature = "libzstd")]
fn cut_off(place: &str, frame: &[u8]) -> Error {
    Error::format(place, "a whole zstd frame", format!("{} bytes, cut off", frame.len()))
}

#[cfg(all(test, feature = "write"))]
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

    /// Both libraries give the same content, and refuse the same frames.
    #[test]
    fn two_libraries_read_the_same() {
        let noise = |count: usize, of: u64| {
            let mut state = 7_u64;
            let mut next = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 33) % of
            };
            (0..count).map(|_| next() as u8).collect::<Vec<u8>>()
        };
        let mut contents = vec![vec![], vec![1], vec![7; 300], noise(70_000, 3), noise(200_000, 40)];
        contents.push(noise(300_000, 256));
        for content in contents {
            let mut frame = Vec::new();
            compress_plane(&content, &[content.len() / 3], Matches::Often, &mut frame).unwrap();
            let read = |bytes: &[u8]| {
                let [mut one, mut other] = [Vec::new(), Vec::new()];
                let first = libzstd::decompress(bytes, content.len(), "test", &mut one).is_ok();
                let second = ruzstd::decompress(bytes, content.len(), "test", &mut other).is_ok();
                assert_eq!(libzstd::content_size(bytes), ruzstd::content_size(bytes));
                ((first, one), (second, other))
            };
            let (one, other) = read(&frame);
            assert!(one == other && one == (true, content.clone()));
            for end in [frame.len() - 1, frame.len() / 2, 10.min(frame.len() - 1)] {
                let ((first, _), (second, _)) = read(&frame[..end]);
                assert!(!first && !second, "{end} of {}", frame.len());
            }
            let longer = [&frame[..], &[0]].concat();
            let ((first, _), (second, _)) = read(&longer);
            assert!(!first && !second);
        }
    }
}
