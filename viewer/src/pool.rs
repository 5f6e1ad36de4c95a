//! The slots of one atlas, which are fixed in number: which tile has which, and which tile gives
//! its slot to another.
//!
//! A tile stays while a child of its is resident, while the frame uses it, and for a while after it
//! came if no frame has used it yet. Of the others the least recently used goes.

use std::collections::HashMap;

use relevo_core::TileId;

/// Frames after which an unused tile leaves, as in paper 001.
pub const UNUSED_FRAMES: u64 = 1_000;
/// Frames for which a tile that came and was not used yet keeps its slot: its siblings may be on
/// their way.
pub const FRESH_FRAMES: u64 = 20;
/// Frames that a tile must have been unused before one that is loaded ahead takes its slot.
const STALE_FRAMES: u64 = 120;

#[derive(Clone, Copy, Debug)]
struct Held {
    slot: u32,
    used: u64,
    came: u64,
    children: u8,
}

/// The outcome of a request for a slot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Placed {
    /// The tile has a slot, which another tile may have had before.
    At {
        /// Number of the slot.
        slot: u32,
        /// The tile that had it before.
        gone: Option<TileId>,
    },
    /// The tile is resident already, or its parent is not.
    Useless,
    /// All slots are taken by tiles that must stay.
    Full,
}

/// The slots of one atlas.
#[derive(Debug)]
pub struct Pool {
    capacity: u32,
    free: Vec<u32>,
    held: HashMap<TileId, Held>,
}

impl Pool {
    /// Returns a pool of `capacity` empty slots.
    pub fn new(capacity: u32) -> Self {
        Self { capacity, free: (0..capacity).rev().collect(), held: HashMap::new() }
    }

    /// Returns the number of slots.
    pub fn capacity(&self) -> u32 {
        self.capacity
    }

    /// Returns the number of slots that are taken.
    pub fn len(&self) -> usize {
        self.held.len()
    }

    /// Returns true if no slot is taken.
    pub fn is_empty(&self) -> bool {
        self.held.is_empty()
    }

    /// Returns the slot of a tile, if it is resident.
    pub fn slot(&self, id: TileId) -> Option<u32> {
        self.held.get(&id).map(|held| held.slot)
    }

    /// Marks a tile and its ancestors as used in frame `now`.
    pub fn touch(&mut self, id: TileId, now: u64) {
        let mut next = Some(id);
        while let Some(held) = next.and_then(|id| self.held.get_mut(&id)) {
            if held.used == now && held.came < now {
                return;
            }
            held.used = now;
            // Used once: it is no longer fresh.
            held.came = 0;
            next = next.and_then(TileId::parent);
        }
    }

    /// Finds a slot for a tile in frame `now`. A tile that is loaded `ahead` of its use only takes
    /// a slot that was not used for long.
    pub fn place(&mut self, id: TileId, now: u64, ahead: bool) -> Placed {
        let orphan = id.parent().is_some_and(|parent| !self.held.contains_key(&parent));
        if orphan || self.held.contains_key(&id) {
            return Placed::Useless;
        }
        let (slot, gone) = match self.free.pop() {
            Some(slot) => (slot, None),
            None => match self.oldest(id.parent(), now, ahead) {
                Some(gone) => (self.remove(gone), Some(gone)),
                None => return Placed::Full,
            },
        };
        self.held.insert(id, Held { slot, used: now, came: if ahead { 0 } else { now }, children: 0 });
        if let Some(parent) = id.parent().and_then(|parent| self.held.get_mut(&parent)) {
            parent.children += 1;
        }
        Placed::At { slot, gone }
    }

    /// Frees the slots of tiles that no frame has used for [`UNUSED_FRAMES`], and returns the
    /// tiles.
    pub fn expire(&mut self, now: u64) -> Vec<TileId> {
        let mut gone: Vec<TileId> =
            self.held.iter().filter(|(_, held)| held.used + UNUSED_FRAMES < now).map(|(&id, _)| id).collect();
        // Deep ones first: a tile stays if one of its children does.
        gone.sort_by_key(|id| std::cmp::Reverse(*id));
        gone.retain(|id| {
            self.held.get(id).is_some_and(|held| held.children == 0) && id.level > 0 && self.drop_slot(*id)
        });
        gone
    }

    fn drop_slot(&mut self, id: TileId) -> bool {
        let slot = self.remove(id);
        self.free.push(slot);
        true
    }

    /// Returns the tile that gives its slot to a child of `parent`.
    fn oldest(&self, parent: Option<TileId>, now: u64, ahead: bool) -> Option<TileId> {
        let unused = if ahead { STALE_FRAMES } else { 1 };
        let may = |(id, held): &(&TileId, &Held)| {
            let fresh = held.came > 0 && held.came + FRESH_FRAMES > now;
            held.children == 0 && held.used + unused <= now && !fresh && Some(**id) != parent && id.level > 0
        };
        self.held.iter().filter(may).min_by_key(|(id, held)| (held.used, **id)).map(|(&id, _)| id)
    }

    fn remove(&mut self, id: TileId) -> u32 {
        if let Some(parent) = id.parent().and_then(|parent| self.held.get_mut(&parent)) {
            parent.children = parent.children.saturating_sub(1);
        }
        self.held.remove(&id).map_or(0, |held| held.slot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(placed: &Placed) -> u32 {
        match placed {
            Placed::At { slot, .. } => *slot,
            other => panic!("no slot: {other:?}"),
        }
    }

    #[test]
    fn what_is_drawn_and_its_ancestors_stay_and_the_oldest_goes() {
        let mut pool = Pool::new(4);
        let children = [0, 1, 2, 3].map(|q| TileId::ROOT.child(q));
        assert_eq!(pool.place(children[0], 1, false), Placed::Useless, "its parent is not there");
        at(&pool.place(TileId::ROOT, 1, false));
        let slots = [0, 1, 2].map(|q: usize| at(&pool.place(children[q], 1, false)));
        assert_eq!(pool.place(children[3], 1, false), Placed::Full, "all came in this frame");
        for (frame, child) in [(100, 0), (101, 1), (102, 2)] {
            pool.touch(children[child], frame);
        }
        let placed = pool.place(children[3], 103, false);
        assert_eq!(placed, Placed::At { slot: slots[0], gone: Some(children[0]) });
        assert_eq!(pool.len(), 4);
        assert_eq!(pool.place(children[3], 103, false), Placed::Useless, "it is there");
    }

    #[test]
    fn a_tile_that_came_and_waits_for_its_siblings_is_not_pushed_out() {
        let mut pool = Pool::new(2);
        at(&pool.place(TileId::ROOT, 1, false));
        at(&pool.place(TileId::ROOT.child(0), 1, false));
        pool.touch(TileId::ROOT, 2);
        assert_eq!(pool.place(TileId::ROOT.child(1), 2, false), Placed::Full);
        pool.touch(TileId::ROOT, 90);
        assert!(matches!(pool.place(TileId::ROOT.child(1), 90, false), Placed::At { gone: Some(_), .. }));
    }

    #[test]
    fn unused_tiles_leave_but_not_under_their_children() {
        let mut pool = Pool::new(8);
        let child = TileId::ROOT.child(0);
        at(&pool.place(TileId::ROOT, 1, false));
        at(&pool.place(child, 1, false));
        at(&pool.place(child.child(2), 1, false));
        at(&pool.place(TileId::ROOT.child(1), 1, false));
        pool.touch(TileId::ROOT.child(1), 900);
        assert_eq!(pool.expire(1_001), []);
        assert_eq!(pool.expire(1_002), [child.child(2), child]);
        assert_eq!(pool.len(), 2);
    }
}
