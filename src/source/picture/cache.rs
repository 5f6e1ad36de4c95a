//! A cache of decoded blocks for all pictures of a build; the least recently used are dropped
//! first.
//!
//! If several threads want a block, one decodes it and the others wait. That cannot deadlock,
//! because decoding never waits for a thread pool.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::Pixels;
use crate::error::Result;
use crate::lru::Lru;

/// Picture and block.
type Key = (u32, usize);

/// A block, empty until it is decoded.
type Slot = Arc<Mutex<Option<Arc<Pixels>>>>;

/// Decoded blocks, within a limit of bytes.
pub(super) struct Cache(Mutex<State>);

struct State {
    pictures: u32,
    slots: Lru<Key, Slot>,
}

impl Cache {
    pub(super) fn new(bytes: u64) -> Self {
        Self(Mutex::new(State { pictures: 0, slots: Lru::new(bytes) }))
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the bytes that it may take; a lower number is kept from the next block on.
    pub(super) fn limit(&self, bytes: u64) {
        self.state().slots.set_budget(bytes);
    }

    /// A new number for a picture.
    pub(super) fn register(&self) -> u32 {
        let mut state = self.state();
        state.pictures += 1;
        state.pictures
    }

    /// A block from the cache, or else made by `decode`.
    pub(super) fn get(&self, key: Key, decode: impl FnOnce() -> Result<Pixels>) -> Result<Arc<Pixels>> {
        let slot = Arc::clone(self.state().slots.get_or_insert_with(key, Slot::default));
        let mut block = slot.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(block) = &*block {
            return Ok(Arc::clone(block));
        }
        let decoded = Arc::new(decode()?);
        *block = Some(Arc::clone(&decoded));
        drop(block);
        let bytes = decoded.colour.len() + decoded.alpha.as_ref().map_or(0, Vec::len);
        self.state().slots.resize(key, bytes as u64);
        Ok(decoded)
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
