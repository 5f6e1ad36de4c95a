//! The mask inside a GeoTIFF, as GDAL writes it: a one-bit image behind the samples, with one strip
//! for each batch of rows.

use std::io::{self, Write};

use flate2::write::ZlibEncoder;

use super::{Tag, Value, tags};

/// The mask of a file that is being written.
#[derive(Debug)]
pub(super) struct Mask {
    width: u32,
    height: u32,
    rows_per_strip: u32,
    /// Rows of bits not yet in a strip; the first pixel is the highest bit, and each row takes
    /// whole bytes.
    pending: Vec<u8>,
    /// Offset and size of each strip written so far.
    pub(super) strips: Vec<(u64, u64)>,
}

impl Mask {
    pub(super) fn new((width, height): (u32, u32), rows_per_strip: u32) -> Self {
        Self { width, height, rows_per_strip, pending: Vec::new(), strips: Vec::new() }
    }

    /// Appends whole rows: true where a sample is valid.
    pub(super) fn take(&mut self, valid: &[bool]) {
        for row in valid.chunks_exact(self.width as usize) {
            let byte =
                |bits: &[bool]| (0..).zip(bits).fold(0, |byte, (at, &bit)| byte | u8::from(bit) << (7 - at));
            self.pending.extend(row.chunks(8).map(byte));
        }
    }

    /// The pending rows as a strip.
    pub(super) fn strip(&mut self) -> io::Result<Vec<u8>> {
        let mut encoder = ZlibEncoder::new(Vec::new(), flate2::Compression::default());
        encoder.write_all(&self.pending)?;
        self.pending.clear();
        encoder.finish()
    }

    /// Tags of the mask's directory, except those of the strips.
    pub(super) fn tags(&self) -> Vec<Tag> {
        let short = |id, value| Tag::new(id, Value::Shorts(vec![value]));
        let long = |id, value| Tag::new(id, Value::Long(value));
        vec![
            // A transparency mask, where 1 is valid.
            long(tags::NEW_SUBFILE_TYPE, 4),
            long(tags::IMAGE_WIDTH, self.width),
            long(tags::IMAGE_LENGTH, self.height),
            short(tags::BITS_PER_SAMPLE, 1),
            short(tags::COMPRESSION, 8),
            short(tags::PHOTOMETRIC, 4),
            short(tags::SAMPLES_PER_PIXEL, 1),
            long(tags::ROWS_PER_STRIP, self.rows_per_strip),
            short(tags::PLANAR_CONFIGURATION, 1),
            short(tags::SAMPLE_FORMAT, 1),
        ]
    }
}
