//! The fixed start of a file (sections 3 and 4 of the specification): header and section table
//! under one CRC.
//!
//! Refuses, in this order: a file that is no container, one that a newer program wrote, one that is
//! damaged, truncated or longer than it states. An opening that decodes is sound, and its sections
//! fill the file.

use super::bytes::Bytes;
use super::layout::{Header, VERSION, demand, newer};
use super::sections::{self, SectionEntry};
use crate::error::{Error, Result};

/// First bytes of every file.
pub const MAGIC: [u8; 8] = *b"\x89RLV\r\n\x1a\n";
/// Bytes of the header.
pub const HEADER_BYTES: usize = 256;
/// Root page and metadata end within this many bytes of the start: one request opens a file.
pub const OPENING_BYTES: u64 = 65_536;
/// Header and section table: the fixed start of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Opening {
    /// What the file says about its terrain.
    pub header: Header,
    /// Its sections in the order of the table.
    pub sections: Vec<SectionEntry>,
    /// Its length in bytes.
    pub file_length: u64,
}

impl Opening {
    /// Bytes of the header and a table of `sections` sections: the offset of the first section.
    pub fn bytes(sections: usize) -> u64 {
        (HEADER_BYTES + sections * SectionEntry::BYTES) as u64
    }

    /// The first bytes of the file.
    pub fn encode(&self) -> Vec<u8> {
        let mut out = Vec::from(MAGIC);
        out.extend(self.header.version.to_le_bytes());
        out.extend((HEADER_BYTES as u16).to_le_bytes());
        out.extend([0; 8]);
        out.extend((self.sections.len() as u32).to_le_bytes());
        out.extend(self.file_length.to_le_bytes());
        self.header.encode(&mut out);
        out.resize(HEADER_BYTES - 4, 0);
        let mut table = Vec::new();
        for section in &self.sections {
            section.encode(&mut table);
        }
        let mut crc = crc32fast::Hasher::new();
        crc.update(&out);
        crc.update(&table);
        out.extend(crc.finalize().to_le_bytes());
        out.extend(table);
        out
    }

    /// Decodes the start of a file: its first [`OPENING_BYTES`], or all of it if it is shorter.
    /// `file_length` is its real length.
    pub fn decode(start: &[u8], file_length: u64) -> Result<Self> {
        let truncated =
            |expected: String| Error::format("file", expected, format!("{file_length}: truncated"));
        let magic = &start[..start.len().min(MAGIC.len())];
        if !MAGIC.starts_with(magic) {
            return Err(Error::format("first bytes", "those of an .rlv file", format!("{magic:02X?}")));
        }
        let Some((head, rest)) = start.split_at_checked(HEADER_BYTES) else {
            return Err(truncated(format!("at least {HEADER_BYTES} bytes")));
        };
        let mut bytes = Bytes::new(head, "header");
        bytes.take(MAGIC.len())?;
        let version = bytes.u16()?;
        if !(1..=VERSION).contains(&version) {
            return Err(newer(format!("container version {version} (this one reads 1 to {VERSION})")));
        }
        let length = bytes.u16()?;
        demand(usize::from(length) == HEADER_BYTES, "header length", &HEADER_BYTES.to_string(), length)?;
        let required = bytes.u32()?;
        bytes.u32()?;
        let count = bytes.u32()?;
        demand((1..=sections::MAX_SECTIONS).contains(&count), "section count", "1 to 64", count)?;
        let stated = bytes.u64()?;
        let table_bytes = count as usize * SectionEntry::BYTES;
        let table = rest.get(..table_bytes).ok_or_else(|| truncated(format!("{stated} bytes")))?;
        check_crc(head, table)?;
        if file_length < stated {
            return Err(truncated(format!("{stated} bytes")));
        }
        let excess = file_length - stated;
        demand(
            excess == 0,
            "file length",
            &stated.to_string(),
            format!("{file_length}: {excess} trailing bytes"),
        )?;
        if required != 0 {
            return Err(newer(format!("required feature bit {}", required.trailing_zeros())));
        }
        let header = Header::decode(version, &mut bytes)?;
        let reserved = bytes.take(HEADER_BYTES - 4 - 160)?;
        demand(reserved.iter().all(|&byte| byte == 0), "reserved bytes", "zeros", "others")?;
        let mut bytes = Bytes::new(table, "section table");
        let sections = (0..count).map(|_| SectionEntry::decode(&mut bytes)).collect::<Result<Vec<_>>>()?;
        let first_offset = Self::bytes(sections.len());
        sections::check(&sections, first_offset..file_length, OPENING_BYTES)?;
        Ok(Self { header, sections, file_length })
    }
}

fn check_crc(head: &[u8], table: &[u8]) -> Result<()> {
    let (covered, stored) = head.split_at(HEADER_BYTES - 4);
    let stored = Bytes::new(stored, "header").u32()?;
    let mut crc = crc32fast::Hasher::new();
    crc.update(covered);
    crc.update(table);
    let got = crc.finalize();
    if got == stored {
        return Ok(());
    }
    Err(Error::format("header and section table", format!("CRC {stored:08X}"), format!("{got:08X}")))
}
