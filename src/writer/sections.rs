//! Where the sections of a file stand, and the limits that readers hold chunks to.

use crate::container::assemble::Tree;
use crate::container::directory::ChunkKind;
use crate::container::layout::Header;
use crate::container::opening::{OPENING_BYTES, Opening};
use crate::container::sections::{self, SectionEntry};
use crate::error::{Error, Result};

/// Fails if a chunk is longer than any terrain of this tile size needs: readers would refuse it.
pub(super) fn check_sizes(tree: &Tree, header: &Header) -> Result<()> {
    let most = header.max_chunk_bytes();
    for entry in (0..=header.levels).flat_map(|level| tree.level(level)) {
        for kind in ChunkKind::ALL {
            let length = u64::from(entry.chunks.chunk(kind).1);
            if length > most {
                return Err(Error::limit(
                    format!("{} chunk of tile {}", kind.name(), entry.id),
                    length,
                    most,
                ));
            }
        }
    }
    Ok(())
}

/// Header and section table of a file: the small sections first, then the large ones.
pub(super) fn opening(header: Header, small: &[(u32, Vec<u8>)], large: &[(u32, u64)]) -> Result<Opening> {
    let mut end = Opening::bytes(small.len() + large.len());
    let mut sections = Vec::with_capacity(small.len() + large.len());
    for (kind, bytes) in small {
        let section = SectionEntry::of(*kind, end, bytes.len() as u64, crc32fast::hash(bytes));
        end = section.end();
        if *kind == sections::METADATA && end > OPENING_BYTES {
            return Err(Error::limit("end of header, root page and metadata", end, OPENING_BYTES));
        }
        sections.push(section);
    }
    for &(kind, length) in large {
        let section = SectionEntry::of(kind, end, length, 0);
        end = section.end();
        sections.push(section);
    }
    Ok(Opening { header, sections, file_length: end })
}
