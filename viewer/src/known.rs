//! The part of the index and the tables that a thread holds for selection: the drawing thread those
//! of what is resident, the loader those of what it has delivered.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use relevo_core::TileId;
use relevo_core::container::Header;
use relevo_core::select::imagery::Images;
use relevo_core::select::tile::{Node, TileTable};
use relevo_core::select::traverse::Tiles;

/// Rows of the index, and tables of tiles.
#[derive(Debug)]
pub struct KnownTiles {
    header: Header,
    nodes: HashMap<TileId, Node>,
    tables: HashMap<TileId, Arc<TileTable>>,
}

impl KnownTiles {
    /// Returns one that knows only the row of the root.
    pub fn new(header: Header, root: Node) -> Self {
        Self { header, nodes: HashMap::from([(TileId::ROOT, root)]), tables: HashMap::new() }
    }

    /// Adds a tile, with the rows of its children by quadrant.
    pub fn add(&mut self, table: Arc<TileTable>, children: &[Option<Node>; 4]) {
        let id = table.id;
        self.tables.insert(id, table);
        for (quadrant, node) in (0..).zip(children) {
            if let Some(node) = node {
                self.nodes.insert(id.child(quadrant), *node);
            }
        }
    }

    /// Removes a tile and the rows of its children.
    pub fn remove(&mut self, id: TileId) {
        self.tables.remove(&id);
        for quadrant in 0..4 {
            self.nodes.remove(&id.child(quadrant));
        }
    }

    /// Marks a tile as unreadable: its parent is drawn as if it were a leaf.
    pub fn mark_unreadable(&mut self, id: TileId) {
        if let Some(parent) = id.parent().and_then(|parent| self.nodes.get_mut(&parent)) {
            parent.children = 0;
        }
    }
}

impl Tiles for KnownTiles {
    fn header(&self) -> &Header {
        &self.header
    }

    fn node(&self, id: TileId) -> Option<Node> {
        self.nodes.get(&id).copied()
    }

    fn table(&self, id: TileId) -> Option<Arc<TileTable>> {
        self.tables.get(&id).cloned()
    }
}

/// Rows of the imagery's index, and which images are there.
#[derive(Debug, Default)]
pub struct KnownImages {
    children: HashMap<TileId, u8>,
    ready: HashSet<TileId>,
}

impl KnownImages {
    /// Returns one that knows only the row of the root.
    pub fn new(root: u8) -> Self {
        Self { children: HashMap::from([(TileId::ROOT, root)]), ready: HashSet::new() }
    }

    /// Adds an image, with the bits of the children of each of its children.
    pub fn add(&mut self, id: TileId, children: &[Option<u8>; 4]) {
        self.ready.insert(id);
        for (quadrant, bits) in (0..).zip(children) {
            if let Some(bits) = bits {
                self.children.insert(id.child(quadrant), *bits);
            }
        }
    }

    /// Removes an image and the rows of its children.
    pub fn remove(&mut self, id: TileId) {
        self.ready.remove(&id);
        for quadrant in 0..4 {
            self.children.remove(&id.child(quadrant));
        }
    }

    /// Marks an image as unreadable: its parent is drawn in its place.
    pub fn mark_unreadable(&mut self, id: TileId) {
        self.children.remove(&id);
        if let Some(parent) = id.parent().and_then(|parent| self.children.get_mut(&parent)) {
            *parent &= !(1 << id.quadrant());
        }
    }
}

impl Images for KnownImages {
    fn children(&self, id: TileId) -> Option<u8> {
        self.children.get(&id).copied()
    }

    fn ready(&self, id: TileId) -> bool {
        self.ready.contains(&id)
    }
}
