//! The tiles and images on the GPU: their slots, and their rows and tables for selection.

use std::sync::Arc;

use relevo_core::container::Header;
use relevo_core::select::imagery::{Draw, Images};
use relevo_core::select::tile::{Node, TileData};
use relevo_core::select::traverse::Tiles;
use relevo_core::select::{Selection, TileTable};
use relevo_core::texel::Texels;
use relevo_core::{Result, TileId};

use crate::known::{KnownImages, KnownTiles};
use crate::loader::{Delivery, Item, LoadedImage, LoadedTile};
use crate::pool::{Placed, Pool};

/// The target of uploads: the renderer, or a stand-in in tests.
pub trait Store {
    /// Puts the heights of a tile into a slot.
    fn put_tile(&mut self, slot: u32, data: &TileData) -> Result<()>;
    /// Puts the texels of an image into a slot.
    fn put_image(&mut self, slot: u32, texels: &Texels) -> Result<()>;
}

/// The outcome of a delivery.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Taken {
    /// The tile is resident: the bytes that were uploaded, and the tile that had its slot before.
    Yes(u64, Option<Item>),
    /// The tile is of no use any more.
    Useless(Item),
    /// No slot can be freed for the tile, which the current view wants.
    Full(Item),
    /// No slot can be freed for the tile, which only the predicted view wants.
    Later(Item),
}

/// Heights and images in their slots.
#[derive(Debug)]
pub struct Residency {
    tiles: Pool,
    images: Pool,
    known_tiles: KnownTiles,
    known_images: Option<KnownImages>,
}

impl Residency {
    /// Returns empty slots; `root` and `image_root` are the rows of the root tiles.
    pub fn new((tiles, images): (u32, u32), header: Header, root: Node, image_root: Option<u8>) -> Self {
        Self {
            tiles: Pool::new(tiles),
            images: Pool::new(images),
            known_tiles: KnownTiles::new(header, root),
            known_images: image_root.map(KnownImages::new),
        }
    }

    /// Returns the numbers of slots that tiles and images have taken.
    pub fn taken(&self) -> (usize, usize) {
        (self.tiles.len(), self.images.len())
    }

    /// Returns the number of slots for tiles.
    pub fn tile_slots(&self) -> u32 {
        self.tiles.capacity()
    }

    /// Returns the rows of the imagery for selection, if there is imagery.
    pub fn images(&self) -> Option<&dyn Images> {
        self.known_images.as_ref().map(|images| images as &dyn Images)
    }

    /// Returns the slot of a tile, if it is resident.
    pub fn tile_slot(&self, id: TileId) -> Option<u32> {
        self.tiles.slot(id)
    }

    /// Returns the slot of an image, if it is resident.
    pub fn image_slot(&self, id: TileId) -> Option<u32> {
        self.images.slot(id)
    }

    /// Marks the tiles and images of a selection as drawn in frame `now`: none of them leaves in
    /// this frame.
    pub fn touch(&mut self, selection: &Selection, draws: &[Draw], now: u64) {
        for tile in &selection.tiles {
            self.tiles.touch(tile.id, now);
        }
        for image in draws.iter().filter_map(|draw| draw.image) {
            self.images.touch(image, now);
        }
    }

    /// Puts a delivered tile into a slot, in frame `now`; returns `None` if the delivery is not a
    /// tile.
    pub fn take(&mut self, delivery: &Delivery, now: u64, store: &mut dyn Store) -> Result<Option<Taken>> {
        match delivery {
            Delivery::Tile(tile) => self.take_tile(tile, now, store).map(Some),
            Delivery::Image(image) => self.take_image(image, now, store).map(Some),
            Delivery::Bad(item, _) => {
                self.mark_unreadable(*item);
                Ok(None)
            }
            Delivery::Settled(_) | Delivery::Ground(_) => Ok(None),
        }
    }

    fn take_tile(&mut self, tile: &LoadedTile, now: u64, store: &mut dyn Store) -> Result<Taken> {
        let id = tile.table.id;
        Ok(match self.tiles.place(id, now, tile.ahead) {
            Placed::Useless => Taken::Useless(Item::Tile(id)),
            Placed::Full if tile.ahead => Taken::Later(Item::Tile(id)),
            Placed::Full => Taken::Full(Item::Tile(id)),
            Placed::At { slot, gone } => {
                if let Some(gone) = gone {
                    self.known_tiles.remove(gone);
                }
                store.put_tile(slot, &tile.data)?;
                self.known_tiles.add(Arc::clone(&tile.table), &tile.children);
                let bytes = 4 * tile.data.heights.len() + tile.data.valid.len();
                Taken::Yes(bytes as u64, gone.map(Item::Tile))
            }
        })
    }

    fn take_image(&mut self, image: &LoadedImage, now: u64, store: &mut dyn Store) -> Result<Taken> {
        let id = image.id;
        let Some(known) = &mut self.known_images else {
            return Ok(Taken::Useless(Item::Image(id)));
        };
        Ok(match self.images.place(id, now, image.ahead) {
            Placed::Useless => Taken::Useless(Item::Image(id)),
            Placed::Full if image.ahead => Taken::Later(Item::Image(id)),
            Placed::Full => Taken::Full(Item::Image(id)),
            Placed::At { slot, gone } => {
                if let Some(gone) = gone {
                    known.remove(gone);
                }
                store.put_image(slot, &image.texels)?;
                known.add(id, &image.children);
                Taken::Yes(4 * (image.texels.side * image.texels.side) as u64, gone.map(Item::Image))
            }
        })
    }

    fn mark_unreadable(&mut self, item: Item) {
        match (item, &mut self.known_images) {
            (Item::Tile(id), _) => self.known_tiles.mark_unreadable(id),
            (Item::Image(id), Some(images)) => images.mark_unreadable(id),
            (Item::Image(_), None) => {}
        }
    }

    /// Frees the slots of tiles and images that no frame has used for long, and returns them.
    pub fn expire(&mut self, now: u64) -> Vec<Item> {
        let tiles = self.tiles.expire(now);
        for &id in &tiles {
            self.known_tiles.remove(id);
        }
        let images = self.images.expire(now);
        if let Some(known) = &mut self.known_images {
            for &id in &images {
                known.remove(id);
            }
        }
        tiles.into_iter().map(Item::Tile).chain(images.into_iter().map(Item::Image)).collect()
    }
}

impl Tiles for Residency {
    fn header(&self) -> &Header {
        self.known_tiles.header()
    }

    fn node(&self, id: TileId) -> Option<Node> {
        self.known_tiles.node(id)
    }

    fn table(&self, id: TileId) -> Option<Arc<TileTable>> {
        self.known_tiles.table(id)
    }
}
