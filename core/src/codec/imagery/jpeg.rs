//! The headers and Huffman codes that the JPEG tiles of a layer share; `jpeg_texels` encodes and
//! decodes.
//!
//! The tiles of a layer have one size, one quality and one set of Huffman tables, so all bytes
//! before the entropy-coded data are the same: the prefix. The tables are made for the layer as a
//! whole once all tiles are known ([`JpegTables::fitted`]). A table for each tile would cost more
//! bytes than it saves; and `jpeg-encoder` would then write one scan a colour, which `zune-jpeg`
//! decodes wrongly.

use super::huffman::{self, Code, Histograms, Scan};
use super::{Form, ImageryChunks};
use crate::error::{Error, Result};

/// Most bytes of a prefix: tables at their largest, and room for optional segments.
pub const MAX_PREFIX: usize = 4096;
pub(super) const END: [u8; 2] = [0xFF, 0xD9];
const PLACE: &str = "imagery header, JPEG prefix";

/// The bytes that all JPEGs of a layer begin with, and the Huffman codes in them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JpegTables {
    /// The file up to its entropy-coded data.
    prefix: Vec<u8>,
    scan: Scan,
}

impl JpegTables {
    /// The tables of a prefix. Fails unless it begins a baseline JPEG of the form.
    pub fn parse(form: &Form, prefix: &[u8]) -> Result<Self> {
        let scan = parse(form, prefix)?;
        Ok(Self { prefix: prefix.to_vec(), scan })
    }

    /// The file up to its entropy-coded data.
    pub fn prefix(&self) -> &[u8] {
        &self.prefix
    }

    /// The JPEG file of a chunk.
    pub fn file(&self, chunk: &[u8]) -> Vec<u8> {
        [&self.prefix, chunk, &END].concat()
    }

    /// Adds the counts of the symbols of a tile to `into`.
    pub fn count(&self, chunks: &ImageryChunks, into: &mut Histograms) -> Result<()> {
        huffman::count(&self.scan, &chunks.colour, into)
    }

    /// Tables with the shortest codes for the counted symbols.
    pub fn fitted(&self, form: &Form, histograms: &Histograms) -> Result<Self> {
        let mut prefix = Vec::new();
        let mut rest = &self.prefix[2..];
        prefix.extend(&self.prefix[..2]);
        while let Some((marker, segment, behind)) = next_segment(rest)? {
            if marker == 0xDA {
                for (index, code) in histograms.codes().iter().enumerate() {
                    if !code.symbols.is_empty() {
                        write_code(index, code, &mut prefix);
                    }
                }
            }
            if marker != 0xC4 {
                prefix.extend(&rest[..segment.len() + 4]);
            }
            rest = behind;
        }
        Self::parse(form, &prefix)
    }

    /// A chunk that was coded with `self`, coded anew with `other`.
    pub fn recode(&self, other: &Self, chunk: &[u8]) -> Result<Vec<u8>> {
        huffman::recode(&self.scan, &other.scan, chunk)
    }
}

/// Splits a JPEG file into its prefix and the bytes after it.
#[cfg(feature = "imagery")]
pub(super) fn split(file: &[u8]) -> Result<(&[u8], &[u8])> {
    let mut rest = file.get(2..).unwrap_or_default();
    while let Some((marker, _, behind)) = next_segment(rest)? {
        rest = behind;
        if marker == 0xDA {
            return Ok(file.split_at(file.len() - rest.len()));
        }
    }
    Err(Error::format(PLACE, "a start of scan", "none"))
}

/// A segment: its marker, its content, and the bytes after it.
type Segment<'a> = (u8, &'a [u8], &'a [u8]);

/// The next segment; `None` at the end.
fn next_segment(bytes: &[u8]) -> Result<Option<Segment<'_>>> {
    if bytes.is_empty() {
        return Ok(None);
    }
    let bad = || Error::format(PLACE, "a whole segment", format!("{} bytes", bytes.len()));
    let Some(&[0xFF, marker, high, low]) = bytes.first_chunk::<4>() else { return Err(bad()) };
    let length = usize::from(u16::from_be_bytes([high, low]));
    let content = bytes.get(4..2 + length).ok_or_else(bad)?;
    Ok(Some((marker, content, &bytes[2 + length..])))
}

/// Checks a prefix. Returns how its scan is coded.
fn parse(form: &Form, prefix: &[u8]) -> Result<Scan> {
    let demand = |is: bool, expected: &str, got: String| {
        if is { Ok(()) } else { Err(Error::format(PLACE, expected, got)) }
    };
    demand(prefix.len() <= MAX_PREFIX, "at most 4096 bytes", prefix.len().to_string())?;
    demand(prefix.starts_with(&[0xFF, 0xD8]), "a start of image", "none".into())?;
    let mut scan = Scan::default();
    let mut ended = false;
    let mut rest = &prefix[2..];
    while let Some((marker, segment, behind)) = next_segment(rest)? {
        demand(!ended, "nothing behind the start of scan", "a segment".into())?;
        match marker {
            0xC4 => read_codes(segment, &mut scan)?,
            0xC0 => scan.components = read_frame(form, segment)?,
            0xDA => {
                read_scan(segment, &mut scan)?;
                ended = true;
            }
            0xDB | 0xE0..=0xEF | 0xFE => {}
            other => demand(false, "segments of a baseline JPEG", format!("marker FF{other:02X}"))?,
        }
        rest = behind;
    }
    demand(ended, "a start of scan", "none".into())?;
    scan.mcus = mcus(form, &scan);
    Ok(scan)
}

/// How many coded units an image has.
fn mcus(form: &Form, scan: &Scan) -> usize {
    // With one component a unit is one block, whatever the factors.
    let factor = if scan.components.len() == 1 { 1 } else { scan.factor() };
    form.side.div_ceil(8 * factor).pow(2)
}

/// SOF0: 8 bits, the form's size; number of blocks of each component in a unit.
fn read_frame(form: &Form, segment: &[u8]) -> Result<Vec<huffman::Component>> {
    let bad = || {
        let expected =
            format!("a frame of {0} x {0} texels, {1} components", form.side, form.colour.channels());
        Error::format(PLACE, expected, format!("{segment:02X?}"))
    };
    let side = (form.side as u16).to_be_bytes();
    let head = [8, side[0], side[1], side[0], side[1], form.colour.channels() as u8];
    let components = segment.strip_prefix(&head).ok_or_else(bad)?;
    let (components, more) = components.as_chunks::<3>();
    let count = form.colour.channels();
    // 4:2:0 or 4:4:4: the first component has one factor both ways, the others have 1.
    let fits = |(index, &[_, factors, _]): (usize, &[u8; 3])| {
        factors == 0x11 || (index == 0 && count == 3 && factors == 0x22)
    };
    if components.len() != count || !more.is_empty() || !components.iter().enumerate().all(fits) {
        return Err(bad());
    }
    Ok(components
        .iter()
        .map(|&[id, factors, _]| huffman::Component {
            id,
            blocks: usize::from(factors >> 4).pow(2),
            codes: [0; 2],
        })
        .collect())
}

/// DHT: codes by class (0 DC, 1 AC) and number.
fn read_codes(mut segment: &[u8], scan: &mut Scan) -> Result<()> {
    let bad = |what: &str| Error::format(PLACE, "Huffman tables 0 and 1", what);
    while let Some((&place, rest)) = segment.split_first() {
        let index = usize::from(place >> 4) * 2 + usize::from(place & 15);
        if place & 0x0E != 0 || index > 3 {
            return Err(bad("another number"));
        }
        let (lengths, rest) = rest.split_first_chunk::<16>().ok_or_else(|| bad("a cut one"))?;
        let count: usize = lengths.iter().map(|&n| usize::from(n)).sum();
        let (symbols, rest) = rest.split_at_checked(count).ok_or_else(|| bad("a cut one"))?;
        scan.codes[index] = Code::new(*lengths, symbols).ok_or_else(|| bad("no prefix code"))?;
        segment = rest;
    }
    Ok(())
}

/// SOS: all components in their order, the whole spectrum.
fn read_scan(segment: &[u8], scan: &mut Scan) -> Result<()> {
    let bad = || Error::format(PLACE, "one scan of all components", format!("{segment:02X?}"));
    let count = scan.components.len();
    let body = segment.strip_prefix(&[count as u8]).and_then(|rest| rest.strip_suffix(&[0, 63, 0]));
    let (places, more) = body.ok_or_else(bad)?.as_chunks::<2>();
    if count == 0 || places.len() != count || !more.is_empty() {
        return Err(bad());
    }
    for (component, &[id, tables]) in scan.components.iter_mut().zip(places) {
        let codes = [usize::from(tables >> 4), 2 + usize::from(tables & 15)];
        let there = |&code: &usize| scan.codes.get(code).is_some_and(|code| !code.symbols.is_empty());
        if component.id != id || tables & 0xEE != 0 || !codes.iter().all(there) {
            return Err(bad());
        }
        component.codes = codes;
    }
    Ok(())
}

/// A DHT segment.
fn write_code(index: usize, code: &Code, out: &mut Vec<u8>) {
    out.extend([0xFF, 0xC4]);
    out.extend((19 + code.symbols.len() as u16).to_be_bytes());
    out.push(((index as u8 / 2) << 4) | (index as u8 % 2));
    out.extend(code.lengths);
    out.extend(&code.symbols);
}
