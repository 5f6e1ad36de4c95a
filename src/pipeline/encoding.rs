//! Numbers as bytes and back, for what a build keeps in its work folder. Every length is checked
//! before it is used.

use crate::codec::frame;
use crate::error::{Error, Result};

/// Bytes to be packed.
#[derive(Default)]
pub struct Writer(Vec<u8>);

impl Writer {
    /// Bytes as they are.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.0.extend_from_slice(bytes);
    }

    /// A count.
    pub fn number(&mut self, number: usize) {
        self.bytes(&(number as u32).to_le_bytes());
    }

    /// Numbers that differ little from one to the next: their differences, byte plane by byte
    /// plane, pack well.
    pub fn integers(&mut self, numbers: &[i32]) {
        let before = std::iter::once(&0).chain(numbers);
        let zigzag: Vec<u32> = numbers
            .iter()
            .zip(before)
            .map(|(number, before)| {
                let step = number.wrapping_sub(*before);
                ((step << 1) ^ (step >> 31)) as u32
            })
            .collect();
        for shift in [0, 8, 16, 24] {
            self.0.extend(zigzag.iter().map(|number| (number >> shift) as u8));
        }
    }

    /// All of it as one zstd frame.
    pub fn packed(self) -> Result<Vec<u8>> {
        let mut out = Vec::new();
        frame::compress(&self.0, &mut out)?;
        Ok(out)
    }
}

/// The content of a frame that belongs to a tile of `n` intervals.
pub fn unpacked(packed: &[u8], n: usize) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    // A summary with 64-bit samples, blocks and errors of patches as small as 4 is below this.
    frame::decompress(
        packed,
        0..=(n + 2) * (n + 2) * 64 + 4096,
        "what a tile left for its parent",
        &mut bytes,
    )?;
    Ok(bytes)
}

/// Reads what a [`Writer`] wrote.
pub struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    /// From the first byte on.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    /// The next bytes.
    pub fn take(&mut self, count: usize) -> Result<&'a [u8]> {
        let Some((taken, rest)) = self.0.split_at_checked(count) else {
            return Err(Error::format("work folder", format!("{count} more bytes"), self.0.len()));
        };
        self.0 = rest;
        Ok(taken)
    }

    /// Four bytes as a number.
    pub fn word(&mut self) -> Result<u32> {
        Ok(self.take(4)?.iter().rev().fold(0, |word, &byte| word << 8 | u32::from(byte)))
    }

    /// Eight bytes as a number.
    pub fn long(&mut self) -> Result<u64> {
        Ok(u64::from(self.word()?) | u64::from(self.word()?) << 32)
    }

    /// A count up to `most`.
    pub fn number(&mut self, most: usize) -> Result<usize> {
        let number = self.word()? as usize;
        if number > most {
            return Err(Error::format("work folder", format!("a count up to {most}"), number));
        }
        Ok(number)
    }

    /// A float.
    pub fn float(&mut self) -> Result<f64> {
        Ok(f64::from_bits(self.long()?))
    }

    /// The inverse of [`Writer::integers`].
    pub fn integers(&mut self, count: usize) -> Result<Vec<i32>> {
        let bytes = self.take(4 * count)?;
        let (a, rest) = bytes.split_at(count);
        let (b, rest) = rest.split_at(count);
        let (c, d) = rest.split_at(count);
        let mut before = 0_i32;
        let numbers = a.iter().zip(b).zip(c.iter().zip(d)).map(|((&a, &b), (&c, &d))| {
            let zigzag = u32::from_le_bytes([a, b, c, d]);
            before = before.wrapping_add((zigzag >> 1) as i32 ^ -((zigzag & 1) as i32));
            before
        });
        Ok(numbers.collect())
    }

    /// Fails if something is left.
    pub fn end(&self) -> Result<()> {
        if self.0.is_empty() {
            return Ok(());
        }
        Err(Error::format("work folder", "nothing more", format!("{} bytes", self.0.len())))
    }
}
