//! What was decoded and may be needed again: least recently used entries go first, by bytes.
//!
//! [`Lru`] is the plain store. [`Lattices`] decodes tiles through one: a tile needs its parent, and a parent that is being
//! used stays. No lock is held while a tile is decoded, and two threads never decode the same tile at the same time.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use crate::error::Result;
use crate::sample::Lattice;
use crate::tile::TileId;

/// Entries by tile, the least recently used first to go.
pub(super) struct Lru<V> {
    entries: HashMap<TileId, Slot<V>>,
    /// Tiles by the time of their last use.
    order: BTreeMap<u64, TileId>,
    clock: u64,
    bytes: u64,
    budget: u64,
}

struct Slot<V> {
    value: Arc<V>,
    bytes: u64,
    used: u64,
}

impl<V> Lru<V> {
    /// An empty store of so many bytes.
    pub fn new(budget: u64) -> Self {
        Self { entries: HashMap::new(), order: BTreeMap::new(), clock: 0, bytes: 0, budget }
    }

    /// An entry, which becomes the most recently used.
    pub fn get(&mut self, id: TileId) -> Option<Arc<V>> {
        let slot = self.entries.get_mut(&id)?;
        self.clock += 1;
        self.order.remove(&slot.used);
        self.order.insert(self.clock, id);
        slot.used = self.clock;
        Some(Arc::clone(&slot.value))
    }

    /// Adds an entry as the most recently used, and drops the oldest while the budget is exceeded; the `keep` most
    /// recently used stay whatever they take.
    pub fn insert(&mut self, id: TileId, value: Arc<V>, bytes: u64, keep: usize) {
        self.remove(id);
        self.clock += 1;
        self.order.insert(self.clock, id);
        self.entries.insert(id, Slot { value, bytes, used: self.clock });
        self.bytes += bytes;
        while self.bytes > self.budget && self.entries.len() > keep {
            let Some((_, &oldest)) = self.order.first_key_value() else { break };
            self.remove(oldest);
        }
    }

    fn remove(&mut self, id: TileId) {
        if let Some(slot) = self.entries.remove(&id) {
            self.order.remove(&slot.used);
            self.bytes -= slot.bytes;
        }
    }
}

struct State {
    cache: Lru<Lattice>,
    /// Tiles that a thread is decoding.
    busy: HashSet<TileId>,
}

impl State {
    /// Makes the ancestors of a tile the most recently used; how many are there.
    fn touch_ancestors(&mut self, id: TileId) -> usize {
        std::iter::successors(id.parent(), |tile| tile.parent())
            .filter(|&tile| self.cache.get(tile).is_some())
            .count()
    }
}

/// Decoded tiles.
pub(super) struct Lattices {
    state: Mutex<State>,
    done: Condvar,
    decoded: AtomicU64,
}

/// The right to decode a tile; others wait until it is dropped.
struct Claim<'a> {
    of: &'a Lattices,
    id: TileId,
}

impl Drop for Claim<'_> {
    fn drop(&mut self) {
        self.of.lock().busy.remove(&self.id);
        self.of.done.notify_all();
    }
}

impl Lattices {
    /// An empty store of so many bytes.
    pub fn new(budget: u64) -> Self {
        let state = Mutex::new(State { cache: Lru::new(budget), busy: HashSet::new() });
        Self { state, done: Condvar::new(), decoded: AtomicU64::new(0) }
    }

    /// Tiles decoded so far.
    pub fn decoded(&self) -> u64 {
        self.decoded.load(Ordering::Relaxed)
    }

    /// A tile from the store, or decoded from its parent, which is got in the same way.
    pub fn get(
        &self,
        id: TileId,
        decode: &dyn Fn(TileId, Option<&Lattice>) -> Result<Lattice>,
    ) -> Result<Arc<Lattice>> {
        let claim = match self.find_or_claim(id) {
            Ok(lattice) => return Ok(lattice),
            Err(claim) => claim,
        };
        // Whoever holds a claim waits for tiles of lower levels only: no two wait for each other.
        let parent = id.parent().map(|parent| self.get(parent, decode)).transpose()?;
        let lattice = Arc::new(decode(id, parent.as_deref())?);
        self.decoded.fetch_add(1, Ordering::Relaxed);
        let bytes = size_of::<Lattice>() + 4 * (lattice.code.len() + lattice.low.len()) + lattice.state.len();
        let mut state = self.lock();
        let ancestors = state.touch_ancestors(id);
        state.cache.insert(id, Arc::clone(&lattice), bytes as u64, ancestors + 1);
        drop(state);
        drop(claim);
        Ok(lattice)
    }

    fn find_or_claim(&self, id: TileId) -> Result<Arc<Lattice>, Claim<'_>> {
        let mut state = self.lock();
        loop {
            state.touch_ancestors(id);
            if let Some(lattice) = state.cache.get(id) {
                return Ok(lattice);
            }
            if state.busy.insert(id) {
                return Err(Claim { of: self, id });
            }
            state = self.done.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // Nothing panics under the lock; a store left by a panic elsewhere is whole.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(x: u32) -> TileId {
        TileId::new(8, x, 0)
    }

    #[test]
    fn the_least_recently_used_goes_first_and_the_newest_stay() {
        let mut lru = Lru::new(10);
        for x in 0..3 {
            lru.insert(tile(x), Arc::new(x), 3, 1);
        }
        assert!(lru.get(tile(0)).is_some());
        lru.insert(tile(3), Arc::new(3), 3, 1);
        let there: Vec<_> = (0..4).filter(|&x| lru.get(tile(x)).is_some()).collect();
        assert_eq!(there, [0, 2, 3]);
        lru.insert(tile(4), Arc::new(4), 100, 2);
        assert!(lru.get(tile(3)).is_some() && lru.get(tile(4)).is_some() && lru.get(tile(0)).is_none());
        assert_eq!(lru.bytes, 103);
        lru.insert(tile(4), Arc::new(4), 1, 1);
        assert_eq!(lru.bytes, 4);
    }

    #[test]
    fn threads_that_ask_for_one_tile_decode_it_once() {
        let lattices = Lattices::new(1 << 20);
        let decode = |_: TileId, _: Option<&Lattice>| {
            std::thread::sleep(std::time::Duration::from_millis(20));
            Ok(Lattice::default())
        };
        std::thread::scope(|scope| {
            for x in 0..4 {
                let (lattices, decode) = (&lattices, &decode);
                scope.spawn(move || lattices.get(TileId::new(2, x, 0), decode).unwrap());
                scope.spawn(move || lattices.get(TileId::new(2, x, 0), decode).unwrap());
            }
        });
        assert_eq!(lattices.decoded(), 1 + 2 + 4);
    }
}
