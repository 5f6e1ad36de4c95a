//! The imagery layer: pictures become tiles (`crate::imagery`), tiles chunks (`codec::imagery`),
//! chunks the sections of a container.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde_json::json;

use super::threads::threads;
use super::{memory, outcome};
use crate::codec;
use crate::codec::imagery::Codec;
use crate::container::imagery::ImageryHeader;
use crate::container::metadata::{ImageryNote, PictureSourceNote};
use crate::container::reader::Reader;
use crate::error::{Error, Result};
use crate::geo::Crs;
use crate::imagery::{self, GUTTER, Ground, PlacedPicture, PyramidReport, Resolution, TileSink};
use crate::output;
use crate::progress::Progress;
use crate::source::picture::{KEPT, Memory, Picture};
use crate::texel::{Colour, Texels};
use crate::tile::TileId;
use crate::work_folder::{Earlier, WorkFolder};
use crate::writer::amend;
use crate::writer::{ImagerySections, ImageryWriter};

/// Bytes of metadata that the list of pictures may take: it shares the first 64 KiB of a file with
/// much else.
const NOTE_BYTES: usize = 8 << 10;

/// How a layer is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LayerOptions {
    /// Codec of the tiles.
    pub codec: Codec,
    /// Quality of JPEGs, 1..=100; other codecs have none.
    pub quality: u8,
    /// Texels along the side of a tile, gutters not counted: a multiple of 4 in 64..=4096.
    pub tile: u32,
    /// Which level a picture belongs to.
    pub resolution: Resolution,
}

impl Default for LayerOptions {
    fn default() -> Self {
        Self { codec: Codec::Jpeg, quality: 85, tile: 512, resolution: Resolution::default() }
    }
}

/// A finished layer that is not in a file yet: `sections` are for
/// [`crate::writer::ContainerWriter::attach`], `note` is for the metadata.
#[derive(Debug)]
pub struct Layer {
    /// The sections, with their files in the folder that was given.
    pub sections: ImagerySections,
    /// What the metadata say of it.
    pub note: ImageryNote,
    /// What the pyramid is.
    pub pyramid: PyramidReport,
}

/// Pictures to be laid over the heights, the last on top.
#[derive(Clone, Copy)]
pub struct Imagery<'a> {
    /// The pictures, in the coordinate system of the heights.
    pub pictures: &'a [Box<dyn Picture>],
    /// How the layer is stored.
    pub options: LayerOptions,
}

impl Imagery<'_> {
    /// Fails if the pictures cannot be laid over the heights.
    pub fn check(&self, ground: &Ground<'_>) -> Result<()> {
        imagery::place(self.pictures, ground.geo, &ground.grid(self.options.tile), self.options.resolution)
            .map(|_| ())
    }

    /// Bytes of memory that making the layer takes on so many threads, from the least that is
    /// enough to the most that it can use.
    pub fn memory(&self, ground: &Ground<'_>, threads: usize) -> Result<RangeInclusive<u64>> {
        let grid = ground.grid(self.options.tile);
        let Memory { reading, kept, .. } =
            imagery::memory(self.pictures, ground.geo, &grid, self.options.resolution, threads)?;
        let least = memory::beside_heights(ground.tiles, threads).saturating_add(reading);
        Ok(least..=least.saturating_add(kept))
    }

    /// Lets the pictures keep the memory that `limit` leaves them, but no more than without a
    /// limit.
    ///
    /// # Errors
    /// [`Error::Usage`] if that is not enough.
    pub fn keep_within(&self, ground: &Ground<'_>, threads: usize, limit: Option<u64>) -> Result<()> {
        let Some(limit) = limit else { return Ok(()) };
        let least = *self.memory(ground, threads)?.start();
        let Some(rest) = limit.checked_sub(least) else {
            return Err(Error::usage(format!(
                "`memory`: an imagery layer of tiles of {} texels takes about {} MiB on {threads} threads; allow more, or use a smaller \
                 `imagery_tile` or fewer threads",
                self.options.tile,
                least.div_ceil(1 << 20),
            )));
        };
        self.pictures.iter().for_each(|picture| picture.keep(rest.min(KEPT)));
        Ok(())
    }
}

/// Sizes of a finished layer.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerReport {
    /// What the layer says about itself.
    pub header: ImageryHeader,
    /// Tiles and bytes of each level, the root first.
    pub levels: Vec<(u64, u64)>,
    /// Bytes of the layer.
    pub bytes: u64,
    /// What the pyramid is.
    pub pyramid: PyramidReport,
}

impl Layer {
    /// Its sizes.
    pub fn report(&self) -> LayerReport {
        LayerReport {
            header: self.sections.header.clone(),
            levels: self.sections.levels.clone(),
            bytes: self.sections.bytes(),
            pyramid: self.pyramid.clone(),
        }
    }
}

/// What [`add`] has done.
#[derive(Clone, Debug, PartialEq)]
pub struct AddReport {
    /// The layer.
    pub layer: LayerReport,
    /// Bytes of the file.
    pub file_bytes: u64,
    /// Wall time.
    pub elapsed: Duration,
}

/// Encodes tiles on the threads that made them.
struct Sink<'a> {
    writer: &'a ImageryWriter,
    /// Texels are shown or not, nothing between.
    cut_out: bool,
}

impl TileSink for Sink<'_> {
    fn tile(&self, id: TileId, children: u8, mut texels: Texels) -> Result<()> {
        if self.cut_out {
            texels.alpha = texels.alpha.and_then(cut_out);
        }
        let chunks = codec::imagery::encode(&self.writer.form(), &texels)?;
        self.writer.append(id, children, &chunks)
    }
}

/// Alpha with what is at least half opaque wholly so, and the rest transparent; `None` if all is
/// opaque.
fn cut_out(mut alpha: Vec<u8>) -> Option<Vec<u8>> {
    for alpha in &mut alpha {
        *alpha = if *alpha >= 128 { 255 } else { 0 };
    }
    alpha.contains(&0).then_some(alpha)
}

/// Makes a layer over heights. Its files go to `folder`, which must be there. Runs on the current
/// thread pool.
pub fn layer(
    Imagery { pictures, options }: &Imagery<'_>,
    ground: &Ground<'_>,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<Layer> {
    let is_rgb = pictures.iter().any(|picture| picture.info().kind == Colour::Rgb);
    let header = ImageryHeader {
        tile: options.tile,
        gutter: GUTTER as u8,
        codec: options.codec,
        quality: if options.codec == Codec::Jpeg { options.quality } else { 0 },
        colour: if is_rgb { Colour::Rgb } else { Colour::Grey },
        alpha: false,
        leaf: 0,
        tiles: 0,
    };
    let writer = ImageryWriter::create(folder, header)?;
    // Where pixels are transparent or not, degrees come from resampling only: not worth their bytes
    // beside a lossy colour.
    let lossy = matches!(options.codec, Codec::Jpeg | Codec::Bc1);
    let cut_out = lossy && !pictures.iter().any(|picture| picture.info().has_alpha);
    let grid = ground.grid(options.tile);
    let pyramid = imagery::build(
        pictures,
        ground.geo,
        &grid,
        options.resolution,
        &Sink { writer: &writer, cut_out },
        progress,
    )?;
    let sections = writer.finish(progress)?;
    let note = note(&sections.header, options.resolution, &pyramid);
    Ok(Layer { sections, note, pyramid })
}

fn note(header: &ImageryHeader, resolution: Resolution, pyramid: &PyramidReport) -> ImageryNote {
    let mut room = NOTE_BYTES;
    let fits = |note: &PictureSourceNote| {
        let bytes = serde_json::to_vec(note).map_or(0, |json| json.len() + 1);
        room = room.saturating_sub(bytes);
        room > 0
    };
    ImageryNote {
        tool: concat!("relevo ", env!("CARGO_PKG_VERSION")).to_owned(),
        pictures: pyramid.pictures.len() as u64,
        sources: pyramid.pictures.iter().map(source_note).take_while(fits).collect(),
        options: json!({
            "codec": header.codec.as_str(), "quality": header.quality, "tile": header.tile,
            "resolution": format!("{resolution:?}").to_lowercase(),
        }),
    }
}

fn source_note(placed: &PlacedPicture) -> PictureSourceNote {
    let note = placed.note.clone();
    PictureSourceNote {
        name: note.name,
        description: note.description,
        bands: note.bands,
        stretch: note.stretch,
        level: placed.level,
    }
}

/// Opens pictures that lie in a coordinate system.
pub type Open<'a> = &'a (dyn Fn(&Crs) -> Result<Vec<Box<dyn Picture>>> + Sync);

/// Puts an imagery layer of some pictures, the last on top, into a file that is there, or another
/// in its place. The heights are copied, not decoded. Until all is done the old file stays; on any
/// error it is left as it was.
///
/// `jobs` is the number of threads (`None`: one for each core), `memory` the bytes that are to be
/// enough (`None`: no limit).
pub fn add(
    file: &Path,
    open: Open<'_>,
    options: &LayerOptions,
    jobs: Option<usize>,
    memory: Option<u64>,
    progress: &dyn Progress,
) -> Result<AddReport> {
    let start = Instant::now();
    if !file.is_file() {
        let error = std::io::ErrorKind::NotFound.into();
        return Err(Error::io(file, "add imagery to this file", error));
    }
    let mut work = WorkFolder::take(file, true, Earlier::Refuse)?;
    threads(jobs)?.install(|| {
        let reader = Reader::open(work.output())?;
        let opened = open(&reader.geo().crs)?;
        let pictures: Vec<PathBuf> = opened.iter().flat_map(|picture| picture.files()).collect();
        output::check_apart(work.output(), &pictures)?;
        let header = reader.header();
        let intervals = u64::from(header.tile()) << header.levels;
        let imagery = Imagery { pictures: &opened, options: *options };
        let samples = (header.width, header.height);
        let ground = Ground { geo: reader.geo(), intervals, samples, tiles: header.tile_count };
        imagery.keep_within(&ground, rayon::current_num_threads(), memory)?;
        let layer = layer(&imagery, &ground, work.folder(), progress)?;
        // An open file cannot be replaced on Windows.
        drop(reader);
        let file_bytes =
            amend::put_imagery(&mut work, &layer.sections, &layer.note, &outcome::inspect, progress)?;
        Ok(AddReport { layer: layer.report(), file_bytes, elapsed: start.elapsed() })
    })
}
