//! Decoded blocks of all pictures of a build, the least recently used of them forgotten first.
//!
//! A block that several threads want at once is decoded by one of them, the others wait. That is
//! safe because decoding never waits for a thread pool.

use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use super::Pixels;
use crate::error::Result;

/// Picture and block.
type Key = (u32, usize);

/// A block, once it is decoded.
type Slot = Arc<Mutex<Option<Arc<Pixels>>>>;

/// Decoded blocks, up to so many bytes.
pub(super) struct Cache {
    most: AtomicUsize,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    pictures: u32,
    slots: HashMap<Key, Entry>,
    /// Keys by the time of their last use.
    uses: BTreeMap<u64, Key>,
    time: u64,
    bytes: usize,
}

struct Entry {
    slot: Slot,
    used: u64,
    bytes: usize,
}

impl Cache {
    pub(super) fn new(bytes: usize) -> Self {
        Self { most: AtomicUsize::new(bytes), state: Mutex::default() }
    }

    /// Bytes that it may take from now on: those of what comes next, if it has more.
    pub(super) fn limit(&self, bytes: usize) {
        self.most.store(bytes, Ordering::Relaxed);
    }

    /// Bytes that it may take.
    pub(super) fn most(&self) -> usize {
        self.most.load(Ordering::Relaxed)
    }

    /// A number for a picture.
    pub(super) fn register(&self) -> u32 {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.pictures += 1;
        state.pictures
    }

    /// A block, decoded by `decode` unless it is here.
    pub(super) fn get(&self, key: Key, decode: impl FnOnce() -> Result<Pixels>) -> Result<Arc<Pixels>> {
        let slot = self.slot(key);
        let mut block = slot.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(block) = &*block {
            return Ok(Arc::clone(block));
        }
        let decoded = Arc::new(decode()?);
        *block = Some(Arc::clone(&decoded));
        drop(block);
        self.count(key, decoded.colour.len() + decoded.alpha.as_ref().map_or(0, Vec::len));
        Ok(decoded)
    }

    /// The slot of a block, which is now the most recently used.
    fn slot(&self, key: Key) -> Slot {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.time += 1;
        let time = state.time;
        let new = || Entry { slot: Slot::default(), used: 0, bytes: 0 };
        let entry = state.slots.entry(key).or_insert_with(new);
        let (slot, before) = (Arc::clone(&entry.slot), std::mem::replace(&mut entry.used, time));
        state.uses.remove(&before);
        state.uses.insert(time, key);
        slot
    }

    /// Notes how large a block is, and forgets old ones until all fit.
    fn count(&self, key: Key, bytes: usize) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(entry) = state.slots.get_mut(&key) else { return };
        let before = std::mem::replace(&mut entry.bytes, bytes);
        state.bytes = state.bytes - before + bytes;
        while state.bytes > self.most() && state.uses.len() > 1 {
            let Some((_, old)) = state.uses.pop_first() else { break };
            state.bytes -= state.slots.remove(&old).map_or(0, |entry| entry.bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;

    fn block(value: u8) -> Pixels {
        Pixels { colour: vec![value; 10], alpha: None }
    }

    #[test]
    fn the_least_recently_used_goes_first() {
        let cache = Cache::new(35);
        for n in 0..3 {
            cache.get((0, n), || Ok(block(n as u8))).expect("new");
        }
        let there = |n| cache.get((0, n), || Err(Error::usage("gone"))).is_ok();
        assert!(there(0));
        cache.get((1, 0), || Ok(block(9))).expect("new");
        assert!(there(0) && there(2) && !there(1));
    }

    #[test]
    fn a_lower_limit_is_kept_from_the_next_block_on() {
        let cache = Cache::new(100);
        (0..5).for_each(|n| assert!(cache.get((0, n), || Ok(block(n as u8))).is_ok()));
        cache.limit(20);
        cache.get((1, 0), || Ok(block(9))).expect("new");
        let there = |n| cache.get((0, n), || Err(Error::usage("gone"))).is_ok();
        assert!(there(4) && !there(3));
    }

    #[test]
    fn an_error_is_not_kept() {
        let cache = Cache::new(100);
        assert!(cache.get((0, 0), || Err(Error::usage("bad luck"))).is_err());
        assert_eq!(cache.get((0, 0), || Ok(block(3))).expect("now").colour, [3; 10]);
    }
}
