//! The parts of a file: every section and every index page under its checksum, one after the other without gaps.
//!
//! Pages are read here from the file itself, so that bytes of the pages section that no page claims are found too.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

use super::VerifyOptions;
use super::report::{Check, Place};
use crate::codec::frame;
use crate::container::directory::{Page, PageRef, TileEntry};
use crate::container::reader::Reader;
use crate::container::sections::{COVERED, PAGES, ROOT_PAGE, SectionEntry};
use crate::error::{Error, Result};
use crate::tile::TileId;

/// Sections with a checksum of their own. (Header and section table were checked when the file was opened.)
pub(super) fn sections(reader: &Reader, options: &VerifyOptions) -> Result<Check> {
    let mut check = Check::new("sections", "bytes", options.keep);
    for section in reader.sections() {
        if section.flags & COVERED != 0 {
            check.looked_at += section.length;
            check.take(reader.check_section(section), Place::default())?;
        }
    }
    Ok(check)
}

/// Index pages: checksums, structure, and that together they fill their section.
pub(super) fn pages(reader: &Reader, options: &VerifyOptions) -> Result<Check> {
    let mut check = Check::new("index pages", "pages", options.keep);
    let section = |kind| reader.sections().iter().find(|section| section.kind == kind).copied();
    let (Some(root), Some(pages)) = (section(ROOT_PAGE), section(PAGES)) else { return Ok(check) };
    let file = File::open(reader.path()).map_err(|source| Error::io(reader.path(), "open", source))?;
    let mut walk = Walk { reader, file, pages, places: Vec::new() };
    let length = u32::try_from(root.length).unwrap_or(u32::MAX);
    let first = PageRef { offset: 0, length, crc: root.crc };
    let mut todo = vec![(TileId::ROOT, root.offset, first)];
    while let Some((id, start, place)) = todo.pop() {
        check.looked_at += 1;
        let page = walk.read(id, start, place);
        let Some(page) = check.take(page, Place::tile(id).part("index page"))? else { continue };
        let last = id.level + page.depth - 1;
        let below = page.tiles.iter().filter(|entry| entry.id.level == last).flat_map(TileEntry::child_ids);
        for (child, place) in below.zip(&page.pages) {
            walk.places.push((place.offset, place.length.into(), child));
            todo.push((child, pages.offset.saturating_add(place.offset), *place));
        }
    }
    check_cover(&mut walk.places, pages.length, &mut check);
    Ok(check)
}

struct Walk<'a> {
    reader: &'a Reader,
    file: File,
    pages: SectionEntry,
    /// Offset, length and root tile of every page but the first.
    places: Vec<(u64, u64, TileId)>,
}

impl Walk<'_> {
    fn read(&mut self, id: TileId, start: u64, place: PageRef) -> Result<Page> {
        let inside = place.offset.saturating_add(place.length.into()) <= self.pages.length;
        if (id != TileId::ROOT && !inside) || u64::from(place.length) > 2 * Page::MAX_BYTES {
            let expected = format!("at most {} bytes within its section", 2 * Page::MAX_BYTES);
            return Err(Error::format("place", expected, format!("{} at {}", place.length, place.offset)));
        }
        let mut packed = vec![0; place.length as usize];
        self.file
            .seek(SeekFrom::Start(start))
            .and_then(|_| self.file.read_exact(&mut packed))
            .map_err(|source| Error::io(self.reader.path(), "read an index page", source))?;
        let crc = crc32fast::hash(&packed);
        if crc != place.crc {
            return Err(Error::format("checksum", format!("{:08X}", place.crc), format!("{crc:08X}")));
        }
        let mut bytes = Vec::new();
        frame::decompress(&packed, 1..=Page::MAX_BYTES as usize, "frame", &mut bytes)?;
        Page::decode(&bytes, id, self.reader.header())
    }
}

/// Fails unless the pages follow one another from the start of their section to its end.
fn check_cover(places: &mut [(u64, u64, TileId)], length: u64, check: &mut Check) {
    places.sort_unstable();
    let mut end = 0;
    for &(offset, bytes, id) in &*places {
        let place = || Place::tile(id).part("index page");
        check.demand(offset == end, place, format_args!("offset {end}"), offset);
        end = offset.saturating_add(bytes);
    }
    check.demand(end == length, || Place::of("pages section"), format_args!("pages up to {length}"), end);
}
