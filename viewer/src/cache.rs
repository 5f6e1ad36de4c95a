//! Decoded tiles in main memory, so that one that has left the GPU comes back without being decoded.

use std::collections::{BTreeMap, HashMap};
use std::hash::Hash;

struct Kept<V> {
    value: V,
    bytes: u64,
    used: u64,
}

/// Values by key under a budget of bytes; the least recently used goes first.
pub struct Cache<K, V> {
    budget: u64,
    bytes: u64,
    clock: u64,
    kept: HashMap<K, Kept<V>>,
    order: BTreeMap<u64, K>,
}

impl<K: Copy + Eq + Hash, V: Clone> Cache<K, V> {
    /// An empty cache of so many bytes.
    pub fn new(budget: u64) -> Self {
        Self { budget, bytes: 0, clock: 0, kept: HashMap::new(), order: BTreeMap::new() }
    }

    /// Bytes kept.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// A value, which becomes the most recently used.
    pub fn get(&mut self, key: K) -> Option<V> {
        self.clock += 1;
        let kept = self.kept.get_mut(&key)?;
        self.order.remove(&kept.used);
        kept.used = self.clock;
        self.order.insert(self.clock, key);
        Some(kept.value.clone())
    }

    /// A value; when it was used does not change.
    pub fn peek(&self, key: K) -> Option<&V> {
        self.kept.get(&key).map(|kept| &kept.value)
    }

    /// Keeps a value of so many bytes, unless it is larger than the budget.
    pub fn insert(&mut self, key: K, value: V, bytes: u64) {
        self.remove(key);
        if bytes > self.budget {
            return;
        }
        while self.bytes + bytes > self.budget {
            let Some((_, oldest)) = self.order.pop_first() else { break };
            self.remove(oldest);
        }
        self.clock += 1;
        self.order.insert(self.clock, key);
        self.kept.insert(key, Kept { value, bytes, used: self.clock });
        self.bytes += bytes;
    }

    fn remove(&mut self, key: K) {
        if let Some(kept) = self.kept.remove(&key) {
            self.bytes -= kept.bytes;
            self.order.remove(&kept.used);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_budget_holds_and_the_oldest_goes() {
        let mut cache = Cache::new(100);
        for key in 0..10 {
            cache.insert(key, key, 30);
            assert!(cache.bytes() <= 100);
            assert_eq!(cache.get(0), Some(0), "used every time, so it stays");
        }
        assert_eq!((cache.get(9), cache.get(8), cache.get(7)), (Some(9), Some(8), None));
        cache.insert(50, 50, 101);
        assert_eq!(cache.get(50), None);
        cache.insert(9, 90, 10);
        assert_eq!((cache.get(9), cache.bytes()), (Some(90), 70));
    }
}
