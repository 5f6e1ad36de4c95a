//! The loop of the loader thread.

use std::collections::HashSet;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError};

use relevo_core::container::{ImageryLayer, Reader, TileEntry};
use relevo_core::lru::Lru;
use relevo_core::select::imagery::{self, Images, Layer};
use relevo_core::select::tile::{Node, TileData, TileTable};
use relevo_core::select::traverse::Tiles;
use relevo_core::select::{Frame, View, select};
use relevo_core::texel::Texels;
use relevo_core::{Result, TileId};

use super::{Delivery, Item, LoadedImage, LoadedTile, Message, Request};
use crate::known::{KnownImages, KnownTiles};

/// Tiles that are loaded before the thread looks for a new request.
const BATCH: usize = 4;

/// A decoded tile of either kind, as the cache holds it.
#[derive(Clone)]
enum Decoded {
    Tile(Arc<TileTable>, Arc<TileData>),
    Image(Arc<Texels>),
}

/// The receiver is gone, so the thread ends.
struct Closed;

pub(super) struct Worker {
    reader: Arc<Reader>,
    frame: Frame,
    tiles: KnownTiles,
    images: Option<KnownImages>,
    /// So that a tile that has left the GPU comes back without being decoded.
    cache: Lru<Item, Decoded>,
    bad: HashSet<Item>,
    refused: HashSet<Item>,
    request: Option<Request>,
    /// True if the request has not been looked at yet.
    new: bool,
    /// The kind of request that [`Worker::refused`] holds for.
    kind: (usize, u64, u64),
    out: SyncSender<Delivery>,
}

impl Worker {
    pub fn new(
        reader: Arc<Reader>,
        ram_cache: u64,
        root: Node,
        images: Option<u8>,
        out: SyncSender<Delivery>,
    ) -> Self {
        Self {
            frame: Frame::of(&reader),
            tiles: KnownTiles::new(reader.header().clone(), root),
            reader,
            images: images.map(KnownImages::new),
            cache: Lru::new(ram_cache),
            bad: HashSet::new(),
            refused: HashSet::new(),
            request: None,
            new: false,
            kind: (0, 0, 0),
            out,
        }
    }

    /// Runs until the drawing thread closes its channels.
    pub fn run(mut self, messages: &Receiver<Message>) {
        let mut idle = true;
        loop {
            if idle {
                let Ok(message) = messages.recv() else { return };
                self.handle(message);
            }
            loop {
                match messages.try_recv() {
                    Ok(message) => self.handle(message),
                    Err(TryRecvError::Empty) => break,
                    Err(TryRecvError::Disconnected) => return,
                }
            }
            match self.work() {
                Ok(more) => idle = !more,
                Err(Closed) => return,
            }
        }
    }

    fn handle(&mut self, message: Message) {
        match message {
            Message::Request(request) => {
                // For another request there may be room for what was refused.
                let kind = (request.options.max_tiles, request.magnification.to_bits(), request.serial / 32);
                if self.kind != kind {
                    self.refused.clear();
                }
                self.kind = kind;
                self.request = Some(*request);
                self.new = true;
            }
            Message::Gone(items) => items.into_iter().for_each(|item| self.forget(item)),
            Message::Refused(item) => {
                self.forget(item);
                self.refused.insert(item);
            }
        }
    }

    fn forget(&mut self, item: Item) {
        match (item, &mut self.images) {
            (Item::Tile(id), _) => self.tiles.remove(id),
            (Item::Image(id), Some(images)) => images.remove(id),
            (Item::Image(_), None) => {}
        }
    }

    /// Loads a few of the most urgent tiles; returns false if there is nothing to do.
    fn work(&mut self) -> Result<bool, Closed> {
        let Some(request) = self.request.take() else { return Ok(false) };
        if std::mem::take(&mut self.new)
            && let Some(height) = request.views.first().and_then(|view| self.ground(&request.frame, view))
        {
            self.send(Delivery::Ground(height))?;
        }
        for (index, view) in request.views.iter().enumerate() {
            let wanted = self.wanted(&request, view);
            if wanted.is_empty() {
                if index == 0 {
                    self.send(Delivery::Settled(request.serial))?;
                }
                continue;
            }
            for item in wanted.into_iter().take(BATCH) {
                self.deliver(item, index > 0)?;
            }
            self.request = Some(request);
            return Ok(true);
        }
        // All delivered; the next request comes with the next frame.
        Ok(false)
    }

    fn send(&self, delivery: Delivery) -> Result<(), Closed> {
        self.out.send(delivery).map_err(|_| Closed)
    }

    /// Returns the tiles that a view wants and can have, the most urgent first.
    fn wanted(&self, request: &Request, view: &View) -> Vec<Item> {
        let mut list: Vec<(f64, Item)> = Vec::new();
        let selection = select(&self.tiles, &request.frame, view, &request.options);
        let scale = request.options.tolerance.max(1e-9);
        list.extend(selection.wanted.iter().map(|wanted| (wanted.priority / scale, Item::Tile(wanted.id))));
        if self.tiles.table(TileId::ROOT).is_none() {
            list.push((f64::INFINITY, Item::Tile(TileId::ROOT)));
        }
        if let (Some(images), Some(layer)) = (&self.images, self.reader.imagery()) {
            let (texels, magnification) = (layer.header().tile, request.magnification);
            let on = Layer { images, texels, magnification };
            let (_, wanted) = imagery::assign(&selection, Some(on), &request.frame, view);
            let scale = request.magnification.max(1e-9);
            list.extend(wanted.iter().map(|wanted| (wanted.priority / scale, Item::Image(wanted.id))));
            if !images.ready(TileId::ROOT) {
                list.push((f64::INFINITY, Item::Image(TileId::ROOT)));
            }
        }
        list.retain(|(_, item)| !self.bad.contains(item) && !self.refused.contains(item));
        list.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut seen = HashSet::new();
        list.into_iter().map(|(_, item)| item).filter(|item| seen.insert(*item)).collect()
    }

    fn deliver(&mut self, item: Item, ahead: bool) -> Result<(), Closed> {
        let decoded = match self.cache.get(item).cloned() {
            Some(decoded) => Ok(decoded),
            None => self.decode(item),
        };
        match (item, decoded) {
            (Item::Tile(id), Ok(Decoded::Tile(table, data))) => {
                let (children, problems) = self.rows(id);
                self.tiles.add(Arc::clone(&table), &children);
                self.send(Delivery::Tile(LoadedTile { table, data, children, ahead }))?;
                problems.into_iter().try_for_each(|(item, why)| self.mark_unreadable(item, why))
            }
            (Item::Image(id), Ok(Decoded::Image(texels))) => {
                let (children, problems) = self.image_rows(id);
                if let Some(images) = &mut self.images {
                    images.add(id, &children);
                }
                self.send(Delivery::Image(LoadedImage { id, texels, children, ahead }))?;
                problems.into_iter().try_for_each(|(item, why)| self.mark_unreadable(item, why))
            }
            (_, Err(error)) => self.mark_unreadable(item, error.to_string()),
            // A cache that answers with another kind has no such key.
            _ => self.mark_unreadable(item, "it is of another kind".into()),
        }
    }

    fn mark_unreadable(&mut self, item: Item, why: String) -> Result<(), Closed> {
        self.bad.insert(item);
        match (item, &mut self.images) {
            (Item::Tile(id), _) => self.tiles.mark_unreadable(id),
            (Item::Image(id), Some(images)) => images.mark_unreadable(id),
            (Item::Image(_), None) => {}
        }
        self.send(Delivery::Bad(item, why))
    }

    fn decode(&mut self, item: Item) -> Result<Decoded> {
        let (decoded, bytes) = match item {
            Item::Tile(id) => self.decode_tile(id)?,
            Item::Image(id) => self.decode_image(id)?,
        };
        self.cache.insert(item, decoded.clone(), bytes as u64);
        Ok(decoded)
    }

    fn decode_tile(&self, id: TileId) -> Result<(Decoded, usize)> {
        let reader = &self.reader;
        let absent = || {
            relevo_core::Error::format(format!("index row of tile {id}"), "a row", "none").at(reader.path())
        };
        let entry = reader.entry(id)?.ok_or_else(absent)?;
        let lattice = reader.read_tile(id)?;
        let errors = reader.read_errors(id)?;
        let data = TileData::new(reader.header(), reader.geo(), &self.frame, &entry, &lattice, &errors)
            .map_err(|error| error.at(reader.path()))?;
        let table = &data.table;
        let numbers = table.vertical.len() + table.horizontal.len() + table.low.len() + table.high.len();
        // The table is there twice: once for the GPU, once for selection.
        let bytes = 4 * data.heights.len() + data.valid.len() + 2 * (4 * numbers + table.drawable.len());
        Ok((Decoded::Tile(Arc::new(table.clone()), Arc::new(data)), bytes))
    }

    fn decode_image(&self, id: TileId) -> Result<(Decoded, usize)> {
        let none = || relevo_core::Error::usage("the file has no imagery");
        let texels = self.reader.imagery().ok_or_else(none)?.read_tile(id)?;
        let bytes = texels.colour.len() + texels.alpha.as_ref().map_or(0, Vec::len);
        Ok((Decoded::Image(Arc::new(texels)), bytes))
    }

    /// Returns the rows of the children of a tile, and the reasons for those that cannot be read.
    fn rows(&self, id: TileId) -> ([Option<Node>; 4], Vec<(Item, String)>) {
        let mut problems = Vec::new();
        let Ok(Some(entry)) = self.reader.entry(id) else { return ([None; 4], problems) };
        let rows = [0, 1, 2, 3].map(|quadrant| {
            let child = id.child(quadrant);
            if !entry.has_child(quadrant) || self.bad.contains(&Item::Tile(child)) {
                return None;
            }
            let why = match self.reader.entry(child) {
                Ok(Some(entry)) => return Some(self.node(&entry)),
                Ok(None) => format!(
                    "{}: index row of tile {child}: expected a row, got none",
                    self.reader.path().display()
                ),
                Err(error) => error.to_string(),
            };
            problems.push((Item::Tile(child), why));
            None
        });
        (rows, problems)
    }

    /// Returns a row for selection: without children if one of them cannot be read.
    fn node(&self, entry: &TileEntry) -> Node {
        let mut node = Node::new(self.reader.header(), self.reader.geo(), &self.frame, entry);
        if entry.child_ids().any(|child| self.bad.contains(&Item::Tile(child))) {
            node.children = 0;
        }
        node
    }

    fn image_rows(&self, id: TileId) -> ([Option<u8>; 4], Vec<(Item, String)>) {
        let mut problems = Vec::new();
        let bits = |layer: &ImageryLayer, id| layer.entry(id).map(|row| row.map(|row| row.children));
        let layer = self.reader.imagery();
        let Some((layer, children)) = layer.and_then(|layer| Some((layer, bits(layer, id).ok().flatten()?)))
        else {
            return ([None; 4], problems);
        };
        let rows = [0, 1, 2, 3].map(|quadrant| {
            let child = id.child(quadrant);
            if children >> quadrant & 1 == 0 || self.bad.contains(&Item::Image(child)) {
                return None;
            }
            match bits(layer, child) {
                Ok(row) => row.map(|bits| self.without_bad(child, bits)),
                Err(error) => {
                    problems.push((Item::Image(child), error.to_string()));
                    None
                }
            }
        });
        (rows, problems)
    }

    fn without_bad(&self, id: TileId, bits: u8) -> u8 {
        let bad = (0..4).filter(|&quadrant| self.bad.contains(&Item::Image(id.child(quadrant))));
        bad.fold(bits, |bits, quadrant| bits & !(1 << quadrant))
    }

    /// Returns the height of the ground under the eye, from the finest decoded tile there.
    fn ground(&self, frame: &Frame, view: &View) -> Option<f64> {
        let [column, row, _] = frame.lattice(view.eye);
        let header = self.reader.header();
        if !(0.0..f64::from(header.width)).contains(&column)
            || !(0.0..f64::from(header.height)).contains(&row)
        {
            return None;
        }
        let side = |level: u8| f64::from(header.tile()) * f64::from(header.spacing(level));
        let tile = (0..=header.levels).rev().find_map(|level| {
            let id = TileId::new(level, (column / side(level)) as u32, (row / side(level)) as u32);
            match self.cache.peek(Item::Tile(id)) {
                Some(Decoded::Tile(_, data)) => Some((id, Arc::clone(data))),
                _ => None,
            }
        });
        let (id, data) = tile?;
        let spacing = f64::from(header.spacing(id.level));
        let (left, top) = header.origin(id);
        let at = |place: f64, origin: u64| {
            (((place - origin as f64) / spacing).round() as usize).min(data.n as usize)
        };
        let index = at(row, top) * (data.n as usize + 1) + at(column, left);
        data.heights.get(index).map(|&height| f64::from(height))
    }
}
