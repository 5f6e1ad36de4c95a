//! The imagery layer of an open file.
//!
//! A tile is decoded from its own chunks alone, and no decoded tile is cached: a renderer keeps
//! textures.

use std::sync::Arc;

use super::index::{Index, Input};
use super::{check_crc, small_section};
use crate::codec::imagery::{self, ImageryChunks, JpegTables};
use crate::container::directory::{IndexPage, Row};
use crate::container::imagery::{ImageryEntry, ImageryHeader};
use crate::container::opening::Opening;
use crate::container::sections::{self, SectionEntry};
use crate::error::{Error, Result};
use crate::limits::Limits;
#[cfg(feature = "imagery")]
use crate::texel::Texels;
use crate::tile::TileId;

/// The imagery of a file; any number of threads may read it.
pub struct ImageryLayer {
    input: Arc<Input>,
    header: ImageryHeader,
    tables: Option<JpegTables>,
    index: Index<ImageryHeader, ImageryEntry>,
}

impl ImageryLayer {
    /// The layer, if the file has one. `start` is the start of the file; `cache` is how many bytes
    /// of index pages to cache.
    pub(super) fn open(
        input: &Arc<Input>,
        start: &[u8],
        opening: &Opening,
        limits: Limits,
        cache: u64,
    ) -> Result<Option<Self>> {
        let section = |kind| opening.sections.iter().find(|section| section.kind == kind).copied();
        let (Some(header), Some(tiles), Some(pages)) =
            (section(sections::IMAGERY), section(sections::IMAGERY_TILES), section(sections::IMAGERY_PAGES))
        else {
            return Ok(None);
        };
        let bytes = read_header(input, start, &header)?;
        let (header, root, tables) = ImageryHeader::decode(&bytes)?;
        let index = Index::new(root, header.clone(), header.tiles, [tiles, pages], limits, cache)?;
        Ok(Some(Self { input: Arc::clone(input), header, tables, index }))
    }

    /// The header of the layer.
    pub fn header(&self) -> &ImageryHeader {
        &self.header
    }

    /// The root page of the index.
    pub fn root_page(&self) -> &IndexPage<ImageryEntry> {
        self.index.root_page()
    }

    /// The index row of a tile; `None` if the tile does not exist.
    pub fn entry(&self, id: TileId) -> Result<Option<ImageryEntry>> {
        self.index.entry(&self.input, id)
    }

    /// The existing tiles of a level in storage order.
    pub fn tiles(&self, level: u8) -> Result<Vec<TileId>> {
        self.index.tiles_of(&self.input, level)
    }

    /// Visits every tile, parents before children, children along the Hilbert curve: tiles of one
    /// level come in storage order. Fails if the number of tiles is not the one stated, or their
    /// chunks do not fill their section.
    pub fn walk(&self, visit: &mut dyn FnMut(&ImageryEntry) -> Result<()>) -> Result<()> {
        self.index.walk(&self.input, visit)
    }

    /// The texels of a tile, gutters included.
    #[cfg(feature = "imagery")]
    pub fn read_tile(&self, id: TileId) -> Result<Texels> {
        let chunks = self.read_raw(id)?;
        imagery::decode(&self.header.form(), self.tables.as_ref(), &chunks.colour, &chunks.alpha)
            .map_err(|error| in_tile(id, error).at(&self.input.path))
    }

    /// The chunks of a tile as stored, checked against their CRCs.
    pub fn read_raw(&self, id: TileId) -> Result<ImageryChunks> {
        let absent =
            || Error::usage(format!("there is no imagery tile {id} in {}", self.input.path.display()));
        let entry = self.entry(id)?.ok_or_else(absent)?;
        self.chunks(&entry).map_err(|error| error.at(&self.input.path))
    }

    fn chunks(&self, entry: &ImageryEntry) -> Result<ImageryChunks> {
        let start = self.index.tiles.offset + entry.chunks.offset;
        let mut colour = self.input.read(start, entry.chunk_bytes(), "an imagery tile")?;
        let alpha = colour.split_off(entry.chunks.lengths[0] as usize);
        for (index, (name, bytes)) in [("colour", &colour), ("alpha", &alpha)].into_iter().enumerate() {
            let (offset, _, crc) = entry.chunks.at(index);
            let offset = self.index.tiles.offset + offset;
            check_crc(bytes, crc, || format!("imagery tile {}, {name} chunk at offset {offset}", entry.id))?;
        }
        let clear = !alpha.is_empty();
        Ok(ImageryChunks { colour, alpha, clear })
    }

    /// The blocks of a tile of a GPU format, row by row. Fails for other codecs.
    pub fn read_blocks(&self, id: TileId) -> Result<Vec<u8>> {
        let chunks = self.read_raw(id)?;
        imagery::unpack_blocks(&self.header.form(), &chunks.colour)
            .map_err(|error| in_tile(id, error).at(&self.input.path))
    }

    /// A tile as an image file: of a JPEG layer the whole JPEG, else the colour chunk, which is a
    /// file (WebP, PNG).
    pub fn read_file(&self, id: TileId) -> Result<Vec<u8>> {
        let chunks = self.read_raw(id)?;
        Ok(self.tables.as_ref().map_or(chunks.colour.clone(), |tables| tables.file(&chunks.colour)))
    }
}

/// The bytes of the section, from `start` or from the file.
fn read_header(input: &Input, start: &[u8], section: &SectionEntry) -> Result<Vec<u8>> {
    let most = ImageryHeader::max_bytes();
    if section.length > most {
        return Err(Error::limit("length of the imagery section", section.length, most));
    }
    if section.end() <= start.len() as u64 {
        return small_section(start, section).map(<[u8]>::to_vec);
    }
    let bytes = input.read(section.offset, section.length, "the imagery section")?;
    check_crc(&bytes, section.crc, || format!("imagery at offset {}", section.offset))?;
    Ok(bytes)
}

/// Adds the tile to an error of the codec.
fn in_tile(id: TileId, mut error: Error) -> Error {
    if let Error::Format { place, .. } = &mut error {
        *place = format!("imagery tile {id}, {place}");
    }
    error
}
