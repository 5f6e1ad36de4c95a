//! Checks the parts of a file: the checksum of every section and index page, and that they follow
//! one another without gaps.
//!
//! Pages are read from the file itself, so that bytes of the pages section outside all pages are
//! found too.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

use super::VerifyOptions;
use super::report::{Check, Place};
use crate::codec::frame;
use crate::container::directory::{IndexPage, Page, PageRef, Quadtree, Row};
use crate::container::reader::{ImageryLayer, Reader};
use crate::container::sections::{COVERED, IMAGERY_PAGES, PAGES, ROOT_PAGE, SectionEntry};
use crate::error::{Error, Result};
use crate::tile::TileId;

/// Checks sections with a checksum of their own. (Header and section table were checked when the
/// file was opened.)
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

/// Checks the index pages: checksums, structure, and that together they fill their section.
pub(super) fn pages(reader: &Reader, options: &VerifyOptions) -> Result<Check> {
    let mut check = Check::new("index pages", "pages", options.keep);
    let section = |kind| reader.sections().iter().find(|section| section.kind == kind).copied();
    let (Some(root), Some(pages)) = (section(ROOT_PAGE), section(PAGES)) else { return Ok(check) };
    let length = u32::try_from(root.length).unwrap_or(u32::MAX);
    let first = PageRef { offset: 0, length, crc: root.crc };
    let mut checker = PageChecker::new(reader, pages)?;
    check.looked_at += 1;
    let page = checker.read(reader.header(), TileId::ROOT, root.offset, first);
    if let Some(page) = check.take::<Page>(page, Place::tile(TileId::ROOT).part("index page"))? {
        checker.below(reader.header(), &page, &mut check)?;
    }
    checker.check_cover("pages section", &mut check);
    Ok(check)
}

/// Checks the index pages of the imagery. (The root page is part of the header and was checked when
/// the file was opened.)
pub(super) fn imagery_pages(reader: &Reader, layer: &ImageryLayer, options: &VerifyOptions) -> Result<Check> {
    let mut check = Check::new("imagery pages", "pages", options.keep);
    let pages = reader.sections().iter().find(|section| section.kind == IMAGERY_PAGES);
    let Some(&pages) = pages else { return Ok(check) };
    let mut checker = PageChecker::new(reader, pages)?;
    check.looked_at += 1;
    checker.below(layer.header(), layer.root_page(), &mut check)?;
    checker.check_cover("imagery pages section", &mut check);
    Ok(check)
}

struct PageChecker<'a> {
    reader: &'a Reader,
    file: File,
    pages: SectionEntry,
    /// Offset, length and root tile of every page but the first.
    places: Vec<(u64, u64, TileId)>,
}

impl<'a> PageChecker<'a> {
    fn new(reader: &'a Reader, pages: SectionEntry) -> Result<Self> {
        let file = File::open(reader.path()).map_err(|source| Error::io(reader.path(), "open", source))?;
        Ok(Self { reader, file, pages, places: Vec::new() })
    }

    /// Reads and checks all pages below a page.
    fn below<R: Row>(&mut self, tree: &impl Quadtree, page: &IndexPage<R>, check: &mut Check) -> Result<()> {
        let mut todo = self.refers(page);
        while let Some((id, place)) = todo.pop() {
            check.looked_at += 1;
            let start = self.pages.offset.saturating_add(place.offset);
            let page = self.read::<R>(tree, id, start, place);
            let Some(page) = check.take(page, Place::tile(id).part("index page"))? else { continue };
            todo.extend(self.refers(&page));
        }
        Ok(())
    }

    /// The pages that a page refers to, whose places are recorded.
    fn refers<R: Row>(&mut self, page: &IndexPage<R>) -> Vec<(TileId, PageRef)> {
        let last = page.root().level + page.depth - 1;
        let rows = page.tiles.iter().filter(|row| row.id().level == last);
        let children = rows.flat_map(|row| {
            (0..4).filter(|q| row.children() >> q & 1 != 0).map(|q| row.id().child(q)).collect::<Vec<_>>()
        });
        let refers: Vec<_> = children.zip(page.pages.iter().copied()).collect();
        self.places.extend(refers.iter().map(|(id, place)| (place.offset, place.length.into(), *id)));
        refers
    }

    fn read<R: Row>(
        &mut self,
        tree: &impl Quadtree,
        id: TileId,
        start: u64,
        place: PageRef,
    ) -> Result<IndexPage<R>> {
        let most = 2 * IndexPage::<R>::MAX_BYTES;
        let inside = place.offset.saturating_add(place.length.into()) <= self.pages.length;
        if (id != TileId::ROOT && !inside) || u64::from(place.length) > most {
            let expected = format!("at most {most} bytes within its section");
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
        frame::decompress(&packed, 1..=IndexPage::<R>::MAX_BYTES as usize, "frame", &mut bytes)?;
        IndexPage::decode(&bytes, id, tree)
    }

    /// Checks that the pages follow one another from the start of their section to its end.
    fn check_cover(&mut self, section: &str, check: &mut Check) {
        self.places.sort_unstable();
        let mut end = 0;
        for &(offset, bytes, id) in &self.places {
            let place = || Place::tile(id).part("index page");
            check.demand(offset == end, place, format_args!("offset {end}"), offset);
            end = offset.saturating_add(bytes);
        }
        let length = self.pages.length;
        check.demand(end == length, || Place::of(section), format_args!("pages up to {length}"), end);
    }
}
