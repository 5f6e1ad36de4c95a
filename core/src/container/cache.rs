//! Caches of decoded tiles and pages, limited in bytes: the least recently used entries are evicted
//! first.
//!
//! [`Store`] is the plain cache: a look-up takes a lock that readers share. [`Lattices`] decodes
//! tiles through a store. To decode a tile it needs the parent, so [`Lattices::get`] and
//! [`Lattices::decode`] call each other up to the root or a cached ancestor; the ancestors stay in
//! the cache. No lock is held while a tile is decoded, two threads never decode the same tile at
//! the same time, and the memory of evicted tiles is used again.

use std::collections::{HashMap, HashSet};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError, RwLock};

use crate::error::Result;
use crate::sample::Lattice;
use crate::tile::TileId;

/// Most lattices that are pooled for the next tiles.
pub(super) const POOLED: usize = 16;

/// A cache of entries by tile; the least recently used are evicted first.
pub(super) struct Store<V> {
    held: RwLock<Held<V>>,
    /// The number of uses so far: the time of the next use.
    clock: AtomicU64,
    budget: u64,
}

struct Held<V> {
    entries: HashMap<TileId, Slot<V>>,
    bytes: u64,
}

struct Slot<V> {
    value: Arc<V>,
    bytes: u64,
    /// Time of the last use.
    used: AtomicU64,
}

impl<V> Store<V> {
    /// An empty store of at most `budget` bytes.
    pub fn new(budget: u64) -> Self {
        let held = RwLock::new(Held { entries: HashMap::new(), bytes: 0 });
        Self { held, clock: AtomicU64::new(0), budget }
    }

    /// An entry, which becomes the most recently used.
    pub fn get(&self, id: TileId) -> Option<Arc<V>> {
        let held = self.held.read().unwrap_or_else(PoisonError::into_inner);
        let slot = held.entries.get(&id)?;
        slot.used.store(self.now(), Ordering::Relaxed);
        Some(Arc::clone(&slot.value))
    }

    /// Makes the entries of some tiles the most recently used. Returns how many of them are in the
    /// store.
    fn touch(&self, ids: impl Iterator<Item = TileId>) -> usize {
        let held = self.held.read().unwrap_or_else(PoisonError::into_inner);
        let slots = ids.filter_map(|id| held.entries.get(&id));
        slots.map(|slot| slot.used.store(self.now(), Ordering::Relaxed)).count()
    }

    /// Adds an entry as the most recently used. If that exceeds the budget, the oldest entries are
    /// evicted down to seven eighths of it, so that it happens rarely; the `keep` most recently
    /// used stay in any case. Returns the evicted values.
    pub fn insert(&self, id: TileId, value: Arc<V>, bytes: u64, keep: usize) -> Vec<Arc<V>> {
        let mut held = self.held.write().unwrap_or_else(PoisonError::into_inner);
        let slot = Slot { value, bytes, used: AtomicU64::new(self.now()) };
        held.bytes += bytes;
        let mut gone = Vec::new();
        if let Some(old) = held.entries.insert(id, slot) {
            held.bytes -= old.bytes;
            gone.push(old.value);
        }
        if held.bytes <= self.budget || held.entries.len() <= keep {
            return gone;
        }
        let mut oldest: Vec<(u64, TileId)> =
            held.entries.iter_mut().map(|(&id, slot)| (*slot.used.get_mut(), id)).collect();
        oldest.sort_unstable_by_key(|&(used, _)| used);
        for (_, id) in &oldest[..oldest.len() - keep.min(oldest.len())] {
            if held.bytes <= self.budget - self.budget / 8 {
                break;
            }
            if let Some(slot) = held.entries.remove(id) {
                held.bytes -= slot.bytes;
                gone.push(slot.value);
            }
        }
        gone
    }

    fn now(&self) -> u64 {
        self.clock.fetch_add(1, Ordering::Relaxed)
    }
}

/// The cache of decoded tiles.
pub(super) struct Lattices {
    store: Store<Lattice>,
    /// Tiles that a thread is decoding.
    busy: Mutex<HashSet<TileId>>,
    done: Condvar,
    decoded: AtomicU64,
    pool: Mutex<Vec<Lattice>>,
}

/// Decodes a tile from its parent into a lattice of any content.
pub(super) type Decode<'a> = &'a dyn Fn(TileId, Option<&Lattice>, &mut Lattice) -> Result<()>;

/// The right to decode a tile; others wait until it is dropped.
struct Claim<'a> {
    of: &'a Lattices,
    id: TileId,
}

impl Drop for Claim<'_> {
    fn drop(&mut self) {
        self.of.busy.lock().unwrap_or_else(PoisonError::into_inner).remove(&self.id);
        self.of.done.notify_all();
    }
}

impl Lattices {
    /// An empty store of at most `budget` bytes.
    pub fn new(budget: u64) -> Self {
        Self {
            store: Store::new(budget),
            busy: Mutex::default(),
            done: Condvar::new(),
            decoded: AtomicU64::new(0),
            pool: Mutex::default(),
        }
    }

    /// Tiles decoded so far.
    pub fn decoded(&self) -> u64 {
        self.decoded.load(Ordering::Relaxed)
    }

    /// A tile, if it is in the cache. It and its ancestors become the most recently used.
    pub fn find(&self, id: TileId) -> Option<Arc<Lattice>> {
        self.store.touch(ancestors(id));
        self.store.get(id)
    }

    /// A tile from the cache, or decoded from its parent, which is got in the same way.
    pub fn get(&self, id: TileId, decode: Decode<'_>) -> Result<Arc<Lattice>> {
        let claim = match self.find_or_claim(id) {
            Ok(lattice) => return Ok(lattice),
            Err(claim) => claim,
        };
        let mut lattice = self.pooled();
        // The holder of a claim waits only for tiles of levels nearer the root: no two threads wait
        // for each other.
        self.decode(id, decode, &mut lattice)?;
        let bytes = size_of::<Lattice>() + 4 * (lattice.code.len() + lattice.low.len()) + lattice.state.len();
        let lattice = Arc::new(lattice);
        let keep = self.store.touch(ancestors(id)) + 1;
        let gone = self.store.insert(id, Arc::clone(&lattice), bytes as u64, keep);
        drop(claim);
        self.recycle(gone);
        Ok(lattice)
    }

    /// Decodes a tile into `out` without caching it; its ancestors are cached.
    pub fn decode(&self, id: TileId, decode: Decode<'_>, out: &mut Lattice) -> Result<()> {
        let parent = id.parent().map(|parent| self.get(parent, decode)).transpose()?;
        decode(id, parent.as_deref(), out)?;
        self.count(1);
        Ok(())
    }

    /// Counts tiles that have been decoded.
    pub fn count(&self, tiles: u64) {
        self.decoded.fetch_add(tiles, Ordering::Relaxed);
    }

    /// A lattice of any content, in memory that has been used before if there is some.
    pub fn pooled(&self) -> Lattice {
        self.pool.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    /// Pools the memory of a lattice.
    pub fn pool(&self, lattice: Lattice) {
        let mut pool = self.pool.lock().unwrap_or_else(PoisonError::into_inner);
        if pool.len() < POOLED {
            pool.push(lattice);
        }
    }

    fn find_or_claim(&self, id: TileId) -> Result<Arc<Lattice>, Claim<'_>> {
        loop {
            if let Some(lattice) = self.find(id) {
                return Ok(lattice);
            }
            let mut busy = self.busy.lock().unwrap_or_else(PoisonError::into_inner);
            if busy.insert(id) {
                drop(busy);
                let claim = Claim { of: self, id };
                // The holder of the claim before may have cached the tile in the meantime.
                return self.find(id).ok_or(claim);
            }
            drop(self.done.wait(busy).unwrap_or_else(PoisonError::into_inner));
        }
    }

    /// Pools the memory of evicted tiles that no caller holds any more.
    fn recycle(&self, gone: Vec<Arc<Lattice>>) {
        let free = gone.into_iter().filter_map(Arc::into_inner);
        let mut pool = self.pool.lock().unwrap_or_else(PoisonError::into_inner);
        let room = POOLED.saturating_sub(pool.len());
        pool.extend(free.take(room));
    }
}

fn ancestors(id: TileId) -> impl Iterator<Item = TileId> {
    std::iter::successors(id.parent(), |tile| tile.parent())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(x: u32) -> TileId {
        TileId::new(8, x, 0)
    }

    #[test]
    fn the_least_recently_used_goes_first_and_the_newest_stay() {
        let store = Store::new(10);
        let there = || (0..5).filter(|&x| store.held.read().unwrap().entries.contains_key(&tile(x)));
        for x in 0..3 {
            assert!(store.insert(tile(x), Arc::new(x), 3, 1).is_empty());
        }
        assert!(store.get(tile(0)).is_some());
        assert_eq!(store.insert(tile(3), Arc::new(3), 3, 1).len(), 1);
        assert_eq!(there().collect::<Vec<_>>(), [0, 2, 3]);
        assert_eq!(store.insert(tile(4), Arc::new(4), 100, 2).len(), 2);
        assert_eq!(there().collect::<Vec<_>>(), [3, 4]);
        assert_eq!(store.held.read().unwrap().bytes, 103);
        assert_eq!(store.insert(tile(4), Arc::new(4), 1, 1), [Arc::new(4)]);
        assert_eq!(store.held.read().unwrap().bytes, 4);
    }

    #[test]
    fn threads_that_ask_for_one_tile_decode_it_once() {
        let lattices = Lattices::new(1 << 20);
        let decode = |_: TileId, _: Option<&Lattice>, _: &mut Lattice| {
            std::thread::sleep(std::time::Duration::from_millis(20));
            Ok(())
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

    #[test]
    fn the_memory_of_a_tile_that_went_holds_the_next() {
        let lattices = Lattices::new(0);
        let decode = |_: TileId, _: Option<&Lattice>, out: &mut Lattice| {
            out.code.resize(1000, 7);
            Ok(())
        };
        let first = lattices.get(TileId::new(1, 0, 0), &decode).unwrap().code.as_ptr();
        assert_ne!(lattices.get(TileId::new(1, 1, 0), &decode).unwrap().code.as_ptr(), first);
        assert_eq!(lattices.get(TileId::new(1, 1, 1), &decode).unwrap().code.as_ptr(), first);
        let held = lattices.get(TileId::new(1, 1, 0), &decode).unwrap();
        let before = held.code.clone();
        lattices.get(TileId::new(1, 0, 1), &decode).unwrap();
        lattices.get(TileId::new(1, 0, 0), &decode).unwrap();
        assert_eq!(held.code, before, "a tile in use stays as it is");
    }
}
