//! One frame: what is chosen among what is resident, what has come since, what is to be loaded.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use relevo_core::container::{ImageryLayer, Reader, ReaderOptions};
use relevo_core::select::imagery::{self, Draw, Layer};
use relevo_core::select::traverse::Tiles;
use relevo_core::select::{EdgeRule, Frame, Node, Options, Selection, View, select};
use relevo_core::{Error, Result, TileId};

use crate::camera;
use crate::gpu::Sizes;
use crate::loader::{AHEAD, Ask, Delivery, Item, Loader, Message};
use crate::pool::FRESH_FRAMES;
use crate::residency::{Residency, Store, Taken};

/// Pixels that a texel may cover before a finer image is wanted (papers 000 and 001).
pub const MAGNIFICATION: f64 = 1.5;
/// Bytes uploaded in a frame at most, but always one tile.
const UPLOAD_BYTES: u64 = 8 << 20;
/// Frames between two times that less is asked for: what is on its way then comes first.
const PAUSE: u64 = 10;
/// Frames after such a time until more is asked for.
const PATIENCE: u64 = 60;
/// Questions that a picture may need until all is there; each can go down many levels.
const ROUNDS: usize = 1_000;

/// An open file, and the memory that is kept of it.
pub struct Terrain {
    reader: Arc<Reader>,
    for_tiles: u64,
}

impl Terrain {
    /// Opens a file. `ram_cache` bytes of decoded tiles are kept.
    pub fn open(path: &Path, ram_cache: u64) -> Result<Self> {
        // The reader keeps ancestors of what it decodes; the rest of the budget is for what is decoded.
        let for_reader = ram_cache / 4;
        let options = ReaderOptions { cache_bytes: for_reader, ..ReaderOptions::default() };
        let reader = Arc::new(Reader::open_with(path, options)?);
        Ok(Self { reader, for_tiles: ram_cache - for_reader })
    }

    /// The file.
    pub fn reader(&self) -> &Arc<Reader> {
        &self.reader
    }

    /// What a renderer would need to hold all of the file at once.
    pub fn sizes(&self) -> Sizes {
        let count = |tiles: u64| u32::try_from(tiles).unwrap_or(u32::MAX);
        let header = self.reader.header();
        let layer = self.reader.imagery().map(ImageryLayer::header);
        Sizes {
            tile: header.tile(),
            patch_log2: header.patch_log2,
            tiles: count(header.tile_count),
            images: layer.map_or(0, |layer| count(layer.tiles)),
            image_side: layer.map_or(0, |layer| layer.side() as u32),
            gutter: layer.map_or(0, |layer| layer.gutter.into()),
        }
    }
}

/// What to draw, with where it lies on the GPU.
#[derive(Clone, Debug, Default)]
pub struct Picture {
    /// Tiles.
    pub selection: Selection,
    /// Slot of each.
    pub slots: Vec<u32>,
    /// Virtual tiles.
    pub draws: Vec<Draw>,
    /// Image slot of each.
    pub images: Vec<Option<u32>>,
    /// Tiles and images that are wanted and not resident.
    pub pending: usize,
    /// Milliseconds of selection.
    pub select_ms: f64,
}

/// A terrain, a loader, and what is resident of it.
pub struct Scene {
    reader: Arc<Reader>,
    loader: Loader,
    residency: Residency,
    frame: Frame,
    rule: EdgeRule,
    /// Tiles that a selection may have, so that they and their ancestors have slots.
    most_tiles: usize,
    /// Pixels that a texel may cover: more than [`MAGNIFICATION`] where finer images have no slots.
    magnification: f64,
    now: u64,
    serial: u64,
    /// The last frame in which less was asked for than before.
    lowered: u64,
    /// Frames from then until more is asked for again.
    patience: u64,
    last: Option<(View, Instant)>,
    ground: Option<f64>,
    problems: Vec<String>,
    fatal: Option<String>,
}

impl Scene {
    /// Of a terrain, with as many slots as `sizes` says.
    pub fn new(terrain: Terrain, sizes: Sizes, rule: EdgeRule, exaggeration: f64) -> Result<Self> {
        let Terrain { reader, for_tiles } = terrain;
        let absent = || Error::format("index", "a root tile", "none").at(reader.path());
        let entry = reader.entry(TileId::ROOT)?.ok_or_else(absent)?;
        let root = Node::new(reader.header(), reader.geo(), &Frame::of(&reader), &entry);
        let image_root = match reader.imagery() {
            Some(layer) if sizes.images > 0 => layer.entry(TileId::ROOT)?.map(|row| row.children),
            _ => None,
        };
        let loader = Loader::start(Arc::clone(&reader), for_tiles, root, image_root)?;
        let frame = Frame { exaggeration, ..Frame::of(&reader) };
        let slots = (sizes.tiles, sizes.images);
        Ok(Self {
            most_tiles: most_tiles(slots.0, reader.header().tile_count),
            magnification: MAGNIFICATION,
            residency: Residency::new(slots, reader.header().clone(), root, image_root),
            reader,
            loader,
            frame,
            rule,
            now: PAUSE + 1,
            serial: 0,
            lowered: 0,
            patience: 0,
            last: None,
            ground: None,
            problems: Vec::new(),
            fatal: None,
        })
    }

    /// The file.
    pub fn reader(&self) -> &Reader {
        &self.reader
    }

    /// Where things stand.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Lowest and highest height of the file, metres.
    pub fn heights(&self) -> (f32, f32) {
        self.residency.node(TileId::ROOT).map_or((0.0, 1.0), |root| (root.low, root.high))
    }

    /// Other heights.
    pub fn exaggerate(&mut self, exaggeration: f64) {
        self.frame.exaggeration = exaggeration;
    }

    /// The edge rule.
    pub fn rule(&self) -> EdgeRule {
        self.rule
    }

    /// Resident tiles and images.
    pub fn resident(&self) -> (usize, usize) {
        self.residency.taken()
    }

    /// Height of the ground under the last eye, metres of the frame.
    pub fn ground(&self) -> Option<f64> {
        self.ground.map(|metres| metres * self.frame.exaggeration)
    }

    /// What could not be read since this was asked last.
    pub fn take_problems(&mut self) -> Vec<String> {
        std::mem::take(&mut self.problems)
    }

    fn options(&self, tolerance: f64) -> Options {
        let p = self.reader.header().patch_log2;
        let imbalance = if self.rule == EdgeRule::Shared { 1 } else { p };
        Options { tolerance, rule: self.rule, imbalance, max_tiles: self.most_tiles }
    }

    /// What is to be drawn of what is resident; it stays so in this frame.
    pub fn choose(&mut self, view: &View, tolerance: f64) -> Picture {
        let begun = Instant::now();
        let options = self.options(tolerance);
        let selection = select(&self.residency, &self.frame, view, &options);
        let texels = self.reader.imagery().map_or(0, |layer| layer.header().tile);
        let layer = self.residency.images();
        let layer = layer.map(|images| Layer { images, texels, magnification: self.magnification });
        let (draws, wanted) = imagery::assign(&selection, layer, &self.frame, view);
        self.residency.touch(&selection, &draws, self.now);
        let mut picture = Picture { pending: selection.wanted.len() + wanted.len(), ..Picture::default() };
        picture.slots =
            selection.tiles.iter().map(|tile| self.residency.tile_slot(tile.id).unwrap_or(0)).collect();
        let slot = |draw: &Draw| draw.image.and_then(|id| self.residency.image_slot(id));
        picture.images = draws.iter().map(slot).collect();
        (picture.selection, picture.draws) = (selection, draws);
        picture.select_ms = begun.elapsed().as_secs_f64() * 1e3;
        picture
    }

    /// Says again that a picture is drawn in this frame, so that nothing of it leaves.
    pub fn keep(&mut self, picture: &Picture) {
        self.residency.touch(&picture.selection, &picture.draws, self.now);
    }

    /// The next frame begins.
    pub fn advance(&mut self) {
        self.now += 1;
        let gone = self.residency.expire(self.now);
        if !gone.is_empty() {
            self.loader.send(Message::Gone(gone));
        }
        // What was refused under pressure may have room by and by.
        if self.now > self.lowered + self.patience {
            let more = self.most_tiles.saturating_add(1 + self.most_tiles / 32);
            self.most_tiles =
                more.min(most_tiles(self.residency.tile_slots(), self.reader.header().tile_count));
            self.magnification = (self.magnification / 1.02).max(MAGNIFICATION);
        }
    }

    /// A frame of what is there: never waits. Fails if the root tile cannot be read.
    pub fn stream(&mut self, store: &mut dyn Store, view: &View, tolerance: f64) -> Result<Picture> {
        self.patience = PATIENCE;
        self.advance();
        let picture = self.choose(view, tolerance);
        self.ask(view, tolerance, true);
        let mut uploaded = 0;
        while uploaded < UPLOAD_BYTES {
            let Some(delivery) = self.loader.poll() else { break };
            uploaded += self.receive(&delivery, store)?;
        }
        self.fatal.clone().map_or(Ok(picture), |what| Err(Error::usage(what)))
    }

    /// A frame with everything that it wants loaded, waiting for it.
    pub fn settle(&mut self, store: &mut dyn Store, view: &View, tolerance: f64) -> Result<Picture> {
        // To be refused costs a round here, not a frame.
        self.patience = 0;
        self.advance();
        for _ in 0..ROUNDS {
            let picture = self.choose(view, tolerance);
            if picture.pending == 0 && !picture.selection.tiles.is_empty() {
                return Ok(picture);
            }
            let before = self.lowered;
            let serial = self.ask(view, tolerance, false);
            let mut came = false;
            loop {
                let delivery = self.loader.wait()?;
                if let Delivery::Settled(of) = delivery {
                    if of == serial {
                        break;
                    }
                    continue;
                }
                came |= !matches!(delivery, Delivery::Ground(_));
                self.receive(&delivery, store)?;
            }
            if let Some(what) = &self.fatal {
                return Err(Error::usage(what.clone()));
            }
            if before != self.lowered {
                // There was no room. What the next choice does not need may leave now.
                self.now += FRESH_FRAMES + PAUSE;
            } else if !came {
                // The loader has nothing more: what is pending cannot be had.
                return Ok(self.choose(view, tolerance));
            }
        }
        Ok(self.choose(view, tolerance))
    }

    fn ask(&mut self, view: &View, tolerance: f64, ahead: bool) -> u64 {
        self.serial += 1;
        let mut views = vec![*view];
        let before = self.last.replace((*view, Instant::now()));
        if let Some((before, when)) = before.filter(|_| ahead)
            && camera::moved(&before, view)
        {
            views.push(camera::predict(&before, view, when.elapsed().as_secs_f64(), AHEAD));
        }
        let options = self.options(tolerance);
        self.loader.ask(Ask {
            serial: self.serial,
            views,
            frame: self.frame,
            options,
            magnification: self.magnification,
        });
        self.serial
    }

    /// Takes a delivery; says how many bytes were uploaded.
    fn receive(&mut self, delivery: &Delivery, store: &mut dyn Store) -> Result<u64> {
        match delivery {
            Delivery::Ground(metres) => self.ground = Some(*metres),
            Delivery::Bad(Item::Tile(TileId::ROOT), why) => self.fatal = Some(why.clone()),
            Delivery::Bad(item, why) => {
                let instead = if *item == Item::Image(TileId::ROOT) {
                    "no imagery is shown"
                } else {
                    "its parent is shown"
                };
                self.problems.push(format!("{why}; {instead}"));
            }
            _ => {}
        }
        Ok(match self.residency.take(delivery, self.now, store)? {
            Some(Taken::Yes(bytes, gone)) => {
                if let Some(gone) = gone {
                    self.loader.send(Message::Gone(vec![gone]));
                }
                bytes
            }
            Some(Taken::Useless(item)) => {
                self.loader.send(Message::Gone(vec![item]));
                0
            }
            Some(Taken::Later(item)) => {
                self.loader.send(Message::Refused(item));
                0
            }
            Some(Taken::Full(item)) => {
                self.loader.send(Message::Refused(item));
                if self.now > self.lowered + PAUSE {
                    self.lowered = self.now;
                    match item {
                        Item::Tile(_) => self.most_tiles = (self.most_tiles * 7 / 8).max(1),
                        Item::Image(_) => self.magnification = (self.magnification * 1.2).min(1e6),
                    }
                }
                0
            }
            None => 0,
        })
    }
}

/// Tiles that a selection may have at first: all, if all of the file's have slots; else two thirds of the slots, as a quadtree's
/// inner nodes are a third of its leaves and siblings wait beside them. Where that is too many for the view at hand, a refusal lowers it.
fn most_tiles(slots: u32, of_file: u64) -> usize {
    if u64::from(slots) >= of_file { usize::MAX } else { (slots as usize * 2 / 3).max(1) }
}
