//! An imagery layer in the making: chunks in one file as they come, from several threads; at the
//! end in their places, with the index, as sections that a container takes over.
//!
//! The same tiles give the same bytes in whatever order they came. Memory is one row per tile.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use crate::codec::imagery::{self, Form, Histograms, ImageryChunks, JpegTables};
use crate::container::assemble::Tree;
use crate::container::directory::ChunkPlace;
use crate::container::imagery::{ImageryEntry, ImageryHeader};
use crate::container::sections;
use crate::error::{Error, Result};
use crate::file::read_exact_at;
use crate::progress::{Progress, Stage};
use crate::tile::TileId;
use crate::work_folder::{BUFFER, open_file, spent};

/// Tiles worked on between two cancellation checks.
const TILES_AT_ONCE: usize = 128;

/// Takes the tiles of a layer.
pub struct ImageryWriter {
    folder: PathBuf,
    header: ImageryHeader,
    /// Tables that JPEGs come with.
    tables: Option<JpegTables>,
    inner: Mutex<Inner>,
}

struct Inner {
    file: BufWriter<File>,
    end: u64,
    tree: Tree<ImageryEntry>,
    histograms: Histograms,
    alpha: bool,
    failed: bool,
}

/// A finished layer: sections that wait for their container. What is large lies in a file of the
/// folder that the writer was given.
#[derive(Debug)]
pub struct ImagerySections {
    /// What the layer says about itself.
    pub header: ImageryHeader,
    /// Tiles and bytes of each level, the root first.
    pub levels: Vec<(u64, u64)>,
    /// The imagery section.
    pub(in crate::writer) opening: Vec<u8>,
    /// The section of all pages but the root.
    pub(in crate::writer) pages: Vec<u8>,
    /// The file of the chunks, and its length.
    pub(in crate::writer) tiles: (PathBuf, u64),
}

impl ImagerySections {
    /// Bytes of all sections.
    pub fn bytes(&self) -> u64 {
        (self.opening.len() + self.pages.len()) as u64 + self.tiles.1
    }

    /// Kinds and lengths of the sections that stand at the end of a file.
    pub(in crate::writer) fn large(&self) -> [(u32, u64); 2] {
        [(sections::IMAGERY_TILES, self.tiles.1), (sections::IMAGERY_PAGES, self.pages.len() as u64)]
    }

    /// Writes these sections.
    pub(in crate::writer) fn copy(&self, out: &mut BufWriter<File>) -> io::Result<()> {
        let mut tiles = File::open(&self.tiles.0)?;
        io::copy(&mut tiles, out)?;
        out.write_all(&self.pages)
    }
}

impl ImageryWriter {
    /// Begins a layer, with its files in `folder`. `header.alpha`, `leaf` and `tiles` are found
    /// out.
    pub fn create(folder: &Path, header: ImageryHeader) -> Result<Self> {
        let header = ImageryHeader { alpha: false, leaf: 0, tiles: 1, ..header };
        header.check()?;
        let tables = imagery::jpeg_tables(&header.form())?;
        let path = folder.join("imagery-chunks");
        let file = open_file(&path, true).map_err(|source| Error::io(path, "begin it", source))?;
        let inner = Inner {
            file: BufWriter::with_capacity(BUFFER, file),
            end: 0,
            tree: Tree::default(),
            histograms: Histograms::default(),
            alpha: false,
            failed: false,
        };
        Ok(Self { folder: folder.to_owned(), header, tables, inner: Mutex::new(inner) })
    }

    /// What [`imagery::encode`] is to make.
    pub fn form(&self) -> Form {
        self.header.form()
    }

    /// Adds a tile that [`imagery::encode`] has made. Tiles may come in any order, each once.
    pub fn append(&self, id: TileId, children: u8, chunks: &ImageryChunks) -> Result<()> {
        let mut counted = Histograms::default();
        if let Some(tables) = &self.tables {
            tables.count(chunks, &mut counted)?;
        }
        let chunks_clear = chunks.clear;
        let parts = [&chunks.colour, &chunks.alpha];
        let lengths = parts.map(|part| part.len() as u32);
        let crcs = parts.map(|part| crc32fast::hash(part));
        let mut inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        inner.tree.check_new(id)?;
        let chunks = ChunkPlace { offset: inner.end, lengths, crcs };
        // A write that fails part of the way leaves bytes that no row counts: the writer is spent.
        inner.failed = true;
        for part in parts {
            inner.file.write_all(part).map_err(|source| self.failed("write a tile", source))?;
        }
        inner.failed = false;
        inner.end += chunks.bytes();
        inner.tree.push(ImageryEntry { id, children, chunks });
        inner.alpha |= chunks_clear;
        inner.histograms.add(&counted);
        Ok(())
    }

    fn failed(&self, action: &str, source: io::Error) -> Error {
        Error::io(self.folder.join("imagery-chunks"), action, source)
    }

    /// Puts the tiles in their places. Fails with [`Error::Interrupted`] if `progress`, which hears
    /// of the tiles that are done, says so.
    pub fn finish(self, progress: &dyn Progress) -> Result<ImagerySections> {
        let Self { folder, mut header, tables, inner } = self;
        let Inner { file, mut tree, histograms, alpha, failed, .. } =
            inner.into_inner().unwrap_or_else(PoisonError::into_inner);
        if failed {
            return Err(spent());
        }
        let io_error = |source| Error::io(folder.join("imagery-chunks"), "put tiles in their places", source);
        let file = file.into_inner().map_err(|error| io_error(error.into_error()))?;
        header.leaf = tree.depth().saturating_sub(1) as u8;
        header.tiles = tree.count();
        header.alpha = alpha;
        tree.check(&header)?;
        tree.sort();
        let form = header.form();
        let fitted = tables.as_ref().map(|tables| tables.fitted(&form, &histograms)).transpose()?;
        let recode = tables.as_ref().zip(fitted.as_ref());
        let path = folder.join("imagery-tiles");
        let mut out = BufWriter::with_capacity(BUFFER, File::create(&path).map_err(io_error)?);
        let (mut end, mut done, mut levels) = (0, 0, Vec::new());
        for level in 0..=header.leaf {
            let start = end;
            for rows in tree.level_mut(level).chunks_mut(TILES_AT_ONCE) {
                let chunks: Vec<Vec<u8>> =
                    rows.par_iter_mut().map(|row| place(&file, row, recode)).collect::<Result<_>>()?;
                for (row, chunk) in rows.iter_mut().zip(chunks) {
                    row.chunks.offset = end;
                    end += chunk.len() as u64;
                    out.write_all(&chunk).map_err(io_error)?;
                }
                done += rows.len() as u64;
                progress.step(Stage::Write, done, header.tiles)?;
            }
            levels.push((tree.level(level).len() as u64, end - start));
        }
        out.flush().map_err(io_error)?;
        let index = tree.pages(header.leaf)?;
        let prefix = fitted.as_ref().map_or(&[][..], JpegTables::prefix);
        let opening = header.encode(&index.root, prefix);
        // What is left of it is not needed while the container is written.
        drop(file);
        let _ = std::fs::remove_file(folder.join("imagery-chunks"));
        Ok(ImagerySections { header, levels, opening, pages: index.pages, tiles: (path, end) })
    }
}

/// The chunks of a tile from the file, coded anew if there are other tables; the row then says so.
fn place(file: &File, row: &mut ImageryEntry, recode: Option<(&JpegTables, &JpegTables)>) -> Result<Vec<u8>> {
    let failed = |source| Error::io("", format!("read imagery tile {} back", row.id), source);
    let mut bytes = vec![0; row.chunks.bytes() as usize];
    read_exact_at(file, &mut bytes, row.chunks.offset).map_err(failed)?;
    let (colour, alpha) = bytes.split_at(row.chunks.lengths[0] as usize);
    if [colour, alpha].map(crc32fast::hash) != row.chunks.crcs {
        return Err(failed(io::Error::other("the disk gave back other bytes than it was given")));
    }
    let Some((from, to)) = recode else { return Ok(bytes) };
    let mut colour = from.recode(to, colour)?;
    row.chunks.lengths[0] = colour.len() as u32;
    row.chunks.crcs[0] = crc32fast::hash(&colour);
    colour.extend(alpha);
    Ok(colour)
}
