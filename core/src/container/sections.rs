//! The section table (section 4 of the specification): the parts of a file and where they lie.
//!
//! Sections follow one another without gaps from the end of the table to the end of the file, in
//! any order.

use std::ops::Range;

use super::bytes::Bytes;
use super::layout::newer;
use crate::error::{Error, Result};

/// Most sections of a file.
pub const MAX_SECTIONS: u32 = 64;

/// Kind of the metadata section.
pub const METADATA: u32 = 1;
/// Kind of the root index page.
pub const ROOT_PAGE: u32 = 2;
/// Kind of the statistics section.
pub const STATISTICS: u32 = 3;
/// Kind of the section of all other index pages.
pub const PAGES: u32 = 4;
/// Kind of the section of chunks.
pub const TILES: u32 = 5;

/// Kind of the imagery section: header and root page of the imagery layer.
pub const IMAGERY: u32 = 16;
/// Kind of the section of the imagery's other index pages.
pub const IMAGERY_PAGES: u32 = 17;
/// Kind of the section of the imagery's chunks.
pub const IMAGERY_TILES: u32 = 18;

/// A reader that does not know the kind must refuse the file.
pub const REQUIRED: u32 = 1;
/// The CRC field covers the section.
pub const COVERED: u32 = 2;

/// Kind, name, flags, and whether it must be there, of the sections that version 1 knows.
const KNOWN: [(u32, &str, u32, bool); 8] = [
    (METADATA, "metadata", COVERED, true),
    (ROOT_PAGE, "root page", REQUIRED | COVERED, true),
    (STATISTICS, "statistics", COVERED, false),
    (PAGES, "pages", REQUIRED, true),
    (TILES, "tiles", REQUIRED, true),
    (IMAGERY, "imagery", COVERED, false),
    (IMAGERY_PAGES, "imagery pages", 0, false),
    (IMAGERY_TILES, "imagery tiles", 0, false),
];

/// One section.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SectionEntry {
    /// The kind of the section: [`METADATA`] and so on, or one that this program does not know.
    pub kind: u32,
    /// [`REQUIRED`], [`COVERED`].
    pub flags: u32,
    /// Bytes from the start of the file.
    pub offset: u64,
    /// Bytes.
    pub length: u64,
    /// CRC of the section if it is [`COVERED`], else 0.
    pub crc: u32,
}

impl SectionEntry {
    /// Bytes of an entry in the table.
    pub const BYTES: usize = 32;

    /// Entry of a section that this program writes.
    pub fn of(kind: u32, offset: u64, length: u64, crc: u32) -> Self {
        let flags = KNOWN.iter().find(|known| known.0 == kind).map_or(0, |known| known.2);
        Self { kind, flags, offset, length, crc }
    }

    /// Offset of the first byte after the section. Does not overflow once `check` has passed.
    pub fn end(&self) -> u64 {
        self.offset.saturating_add(self.length)
    }

    /// Its name for people.
    pub fn name(&self) -> String {
        let known = KNOWN.iter().find(|known| known.0 == self.kind);
        known.map_or_else(|| format!("kind {}", self.kind), |known| known.1.to_owned())
    }

    pub(super) fn encode(&self, out: &mut Vec<u8>) {
        out.extend(self.kind.to_le_bytes());
        out.extend(self.flags.to_le_bytes());
        out.extend(self.offset.to_le_bytes());
        out.extend(self.length.to_le_bytes());
        out.extend(self.crc.to_le_bytes());
        out.extend([0; 4]);
    }

    pub(super) fn decode(bytes: &mut Bytes) -> Result<Self> {
        let (kind, flags) = (bytes.u32()?, bytes.u32()?);
        let (offset, length) = (bytes.u64()?, bytes.u64()?);
        let (crc, reserved) = (bytes.u32()?, bytes.u32()?);
        let section = Self { kind, flags, offset, length, crc };
        section.check_fields(reserved)?;
        Ok(section)
    }

    fn check_fields(&self, reserved: u32) -> Result<()> {
        let place = format!("section table, {}", self.name());
        if self.flags & !(REQUIRED | COVERED) != 0 {
            return Err(Error::format(place, "flags 0 to 3", self.flags));
        }
        if reserved != 0 {
            return Err(Error::format(place, "reserved field 0", reserved));
        }
        if self.flags & COVERED == 0 && self.crc != 0 {
            return Err(Error::format(place, "CRC field 0, for it is not used", format!("{:08X}", self.crc)));
        }
        match KNOWN.iter().find(|known| known.0 == self.kind) {
            Some(known) if known.2 != self.flags => {
                Err(Error::format(place, format!("flags {}", known.2), self.flags))
            }
            None if self.flags & REQUIRED != 0 => {
                Err(newer(format!("required section of kind {}", self.kind)))
            }
            _ => Ok(()),
        }
    }
}

/// Fails unless the sections fill `place`, the known ones are there as often as they must be, and
/// root page and metadata end within the first `opening_bytes` of the file.
pub(super) fn check(sections: &[SectionEntry], place: Range<u64>, opening_bytes: u64) -> Result<()> {
    for (kind, name, _, must) in KNOWN {
        let count = sections.iter().filter(|section| section.kind == kind).count();
        if count > 1 || (must && count == 0) {
            return Err(Error::format("section table", format!("one section {name}"), count));
        }
    }
    let layer = [IMAGERY, IMAGERY_PAGES, IMAGERY_TILES];
    let count = layer.iter().filter(|kind| sections.iter().any(|section| section.kind == **kind)).count();
    if !count.is_multiple_of(layer.len()) {
        return Err(Error::format("section table", "all three sections of the imagery, or none", count));
    }
    let mut sorted: Vec<_> = sections.iter().collect();
    sorted.sort_by_key(|section| (section.offset, section.length));
    let Range { start: mut end, end: file_length } = place;
    for section in sorted {
        let place = || format!("section table, {}", section.name());
        if section.offset != end {
            return Err(Error::format(place(), format!("offset {end}"), section.offset));
        }
        end = end.checked_add(section.length).filter(|&end| end <= file_length).ok_or_else(|| {
            let most = format!("at most {} bytes, to the end of the file", file_length - end);
            Error::format(place(), most, section.length)
        })?;
        if matches!(section.kind, METADATA | ROOT_PAGE) && end > opening_bytes {
            return Err(Error::format(
                place(),
                format!("its end within the first {opening_bytes} bytes"),
                end,
            ));
        }
    }
    if end == file_length {
        return Ok(());
    }
    Err(Error::format("section table", format!("sections up to the end of the file, {file_length}"), end))
}
