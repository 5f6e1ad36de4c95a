//! The scene of a file: chooses what a frame draws of the resident tiles, takes deliveries, and
//! asks the loader for more.

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
use crate::loader::{AHEAD, Delivery, Item, Loader, Message, Request};
use crate::pool::FRESH_FRAMES;
use crate::residency::{Residency, Store, Taken};

/// Pixels that a texel may cover before a finer image is wanted (papers 000 and 001).
pub const MAGNIFICATION: f64 = 1.5;
/// Most bytes uploaded in a frame; one tile is always uploaded.
const UPLOAD_BYTES: u64 = 8 << 20;
/// Frames between two reductions of what is asked for, so that tiles on their way arrive first.
const PAUSE: u64 = 10;
/// Frames from a reduction until more is asked for again.
const PATIENCE: u64 = 60;
/// Most requests for a frame until all is there; each can go down many levels.
const ROUNDS: usize = 1_000;

/// An open file, and the budget for its decoded tiles.
pub struct Terrain {
    reader: Arc<Reader>,
    for_tiles: u64,
}

impl Terrain {
    /// Opens a file. `ram_cache` is the budget for decoded tiles in bytes.
    pub fn open(path: &Path, ram_cache: u64) -> Result<Self> {
        // The reader keeps the ancestors of tiles that it decodes; the rest of the budget is for
        // decoded tiles.
        let for_reader = ram_cache / 4;
        let options = ReaderOptions { cache_bytes: for_reader, ..ReaderOptions::default() };
        let reader = Arc::new(Reader::open_with(path, options)?);
        Ok(Self { reader, for_tiles: ram_cache - for_reader })
    }

    /// Returns the reader of the file.
    pub fn reader(&self) -> &Arc<Reader> {
        &self.reader
    }

    /// Returns the sizes of a renderer that holds all of the file at once.
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

/// What a frame draws, and where it lies on the GPU.
#[derive(Clone, Debug, Default)]
pub struct FramePlan {
    /// The tiles.
    pub selection: Selection,
    /// Slot of each tile.
    pub slots: Vec<u32>,
    /// Virtual tiles: tiles, each once for every image on it.
    pub draws: Vec<Draw>,
    /// Image slot of each virtual tile.
    pub images: Vec<Option<u32>>,
    /// Tiles and images that are wanted and not resident.
    pub pending: usize,
    /// Milliseconds that the selection took.
    pub select_ms: f64,
}

/// A terrain, its loader, and its resident tiles.
pub struct Scene {
    reader: Arc<Reader>,
    loader: Loader,
    residency: Residency,
    frame: Frame,
    rule: EdgeRule,
    /// Most tiles of a selection, so that they and their ancestors have slots.
    most_tiles: usize,
    /// Most pixels that a texel may cover: above [`MAGNIFICATION`] where finer images have no
    /// slots.
    magnification: f64,
    now: u64,
    serial: u64,
    /// The frame of the last reduction of what is asked for.
    lowered: u64,
    /// Frames from then until more is asked for again.
    patience: u64,
    last: Option<(View, Instant)>,
    ground: Option<f64>,
    problems: Vec<String>,
    fatal: Option<String>,
}

impl Scene {
    /// Returns the scene of a terrain, with the slots of `sizes`.
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

    /// Returns the reader of the file.
    pub fn reader(&self) -> &Reader {
        &self.reader
    }

    /// Returns the frame: the spacing of samples and the exaggeration.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Returns the lowest and the highest height of the file, metres.
    pub fn heights(&self) -> (f32, f32) {
        self.residency.node(TileId::ROOT).map_or((0.0, 1.0), |root| (root.low, root.high))
    }

    /// Sets the exaggeration of heights.
    pub fn exaggerate(&mut self, exaggeration: f64) {
        self.frame.exaggeration = exaggeration;
    }

    /// Returns the edge rule.
    pub fn rule(&self) -> EdgeRule {
        self.rule
    }

    /// Returns the numbers of resident tiles and images.
    pub fn resident(&self) -> (usize, usize) {
        self.residency.taken()
    }

    /// Returns the height of the ground under the last eye, metres of the frame.
    pub fn ground(&self) -> Option<f64> {
        self.ground.map(|metres| metres * self.frame.exaggeration)
    }

    /// Returns and forgets the sentences about tiles that could not be read.
    pub fn take_problems(&mut self) -> Vec<String> {
        std::mem::take(&mut self.problems)
    }

    fn options(&self, tolerance: f64) -> Options {
        let p = self.reader.header().patch_log2;
        let imbalance = if self.rule == EdgeRule::Shared { 1 } else { p };
        Options { tolerance, rule: self.rule, imbalance, max_tiles: self.most_tiles }
    }

    /// Chooses what this frame draws of the resident tiles; none of them leaves in this frame.
    pub fn choose(&mut self, view: &View, tolerance: f64) -> FramePlan {
        let begun = Instant::now();
        let options = self.options(tolerance);
        let selection = select(&self.residency, &self.frame, view, &options);
        let texels = self.reader.imagery().map_or(0, |layer| layer.header().tile);
        let layer = self.residency.images();
        let layer = layer.map(|images| Layer { images, texels, magnification: self.magnification });
        let (draws, wanted) = imagery::assign(&selection, layer, &self.frame, view);
        self.residency.touch(&selection, &draws, self.now);
        let mut plan = FramePlan { pending: selection.wanted.len() + wanted.len(), ..FramePlan::default() };
        plan.slots =
            selection.tiles.iter().map(|tile| self.residency.tile_slot(tile.id).unwrap_or(0)).collect();
        let slot = |draw: &Draw| draw.image.and_then(|id| self.residency.image_slot(id));
        plan.images = draws.iter().map(slot).collect();
        (plan.selection, plan.draws) = (selection, draws);
        plan.select_ms = begun.elapsed().as_secs_f64() * 1e3;
        plan
    }

    /// Marks the tiles and images of a plan as drawn in this frame too, so that none of them
    /// leaves.
    pub fn keep(&mut self, plan: &FramePlan) {
        self.residency.touch(&plan.selection, &plan.draws, self.now);
    }

    /// Begins the next frame.
    pub fn advance(&mut self) {
        self.now += 1;
        let gone = self.residency.expire(self.now);
        if !gone.is_empty() {
            self.loader.send(Message::Gone(gone));
        }
        // There may be room by now for what was refused.
        if self.now > self.lowered + self.patience {
            let more = self.most_tiles.saturating_add(1 + self.most_tiles / 32);
            self.most_tiles =
                more.min(most_tiles(self.residency.tile_slots(), self.reader.header().tile_count));
            self.magnification = (self.magnification / 1.02).max(MAGNIFICATION);
        }
    }

    /// Plans a frame of the resident tiles and asks for the missing ones; never waits. Fails if the
    /// root tile cannot be read.
    pub fn stream(&mut self, store: &mut dyn Store, view: &View, tolerance: f64) -> Result<FramePlan> {
        self.patience = PATIENCE;
        self.advance();
        let plan = self.choose(view, tolerance);
        self.request(view, tolerance, true);
        let mut uploaded = 0;
        while uploaded < UPLOAD_BYTES {
            let Some(delivery) = self.loader.poll() else { break };
            uploaded += self.receive(&delivery, store)?;
        }
        self.fatal.clone().map_or(Ok(plan), |what| Err(Error::usage(what)))
    }

    /// Plans a frame after all tiles that it wants are loaded; waits for them.
    pub fn settle(&mut self, store: &mut dyn Store, view: &View, tolerance: f64) -> Result<FramePlan> {
        // A refusal costs a round here, not a frame.
        self.patience = 0;
        self.advance();
        for _ in 0..ROUNDS {
            let plan = self.choose(view, tolerance);
            if plan.pending == 0 && !plan.selection.tiles.is_empty() {
                return Ok(plan);
            }
            let before = self.lowered;
            let serial = self.request(view, tolerance, false);
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

    fn request(&mut self, view: &View, tolerance: f64, ahead: bool) -> u64 {
        self.serial += 1;
        let mut views = vec![*view];
        let before = self.last.replace((*view, Instant::now()));
        if let Some((before, when)) = before.filter(|_| ahead)
            && camera::moved(&before, view)
        {
            views.push(camera::predict(&before, view, when.elapsed().as_secs_f64(), AHEAD));
        }
        let options = self.options(tolerance);
        self.loader.request(Request {
            serial: self.serial,
            views,
            frame: self.frame,
            options,
            magnification: self.magnification,
        });
        self.serial
    }

    /// Takes a delivery; returns the number of bytes uploaded.
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

/// Returns the most tiles of a selection at first: no limit if all tiles of the file have slots;
/// else two thirds of the slots, as a quadtree's inner nodes are a third of its leaves and siblings
/// wait beside them. Where that is too many for a view, a refusal lowers it.
fn most_tiles(slots: u32, of_file: u64) -> usize {
    if u64::from(slots) >= of_file { usize::MAX } else { (slots as usize * 2 / 3).max(1) }
}
