//! Values by key within a number of bytes; the least recently used are dropped first.

use std::collections::{BTreeMap, HashMap};
use std::hash::Hash;

struct Entry<V> {
    value: V,
    bytes: u64,
    used: u64,
}

/// A cache with a budget in bytes.
pub struct Lru<K, V> {
    budget: u64,
    bytes: u64,
    clock: u64,
    entries: HashMap<K, Entry<V>>,
    /// Keys by the time of their last use.
    uses: BTreeMap<u64, K>,
}

impl<K: Copy + Eq + Hash, V> Lru<K, V> {
    /// An empty cache with a budget of `budget` bytes.
    pub fn new(budget: u64) -> Self {
        Self { budget, bytes: 0, clock: 0, entries: HashMap::new(), uses: BTreeMap::new() }
    }

    /// The budget in bytes.
    pub fn budget(&self) -> u64 {
        self.budget
    }

    /// Changes the budget; a lower one takes effect with the next value that grows or is inserted.
    pub fn set_budget(&mut self, bytes: u64) {
        self.budget = bytes;
    }

    /// Sum of the sizes of all values, in bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The value of a key, which becomes the most recently used.
    pub fn get(&mut self, key: K) -> Option<&V> {
        self.touch(key)?;
        self.peek(key)
    }

    /// The value of a key; the order of uses does not change.
    pub fn peek(&self, key: K) -> Option<&V> {
        self.entries.get(&key).map(|entry| &entry.value)
    }

    /// Inserts a value of `bytes` bytes as the most recently used, in place of the key's old one. A
    /// value larger than the budget is not kept.
    pub fn insert(&mut self, key: K, value: V, bytes: u64) {
        self.remove(key);
        if bytes <= self.budget {
            self.add(key, value);
            self.resize(key, bytes);
        }
    }

    /// The value of a key, or a new one of 0 bytes, as the most recently used. Drops nothing:
    /// [`Lru::resize`] does, once the size is known.
    pub fn get_or_insert_with(&mut self, key: K, new: impl FnOnce() -> V) -> &V {
        if self.touch(key).is_none() {
            self.add(key, new());
        }
        &self.entries[&key].value
    }

    /// Sets the size of a value and drops the least recently used ones until the rest fits, or one
    /// is left. A key that is not there changes nothing.
    pub fn resize(&mut self, key: K, bytes: u64) {
        let Some(entry) = self.entries.get_mut(&key) else { return };
        self.bytes = self.bytes - std::mem::replace(&mut entry.bytes, bytes) + bytes;
        while self.bytes > self.budget && self.uses.len() > 1 {
            let Some((_, oldest)) = self.uses.first_key_value() else { break };
            self.remove(*oldest);
        }
    }

    fn add(&mut self, key: K, value: V) {
        self.clock += 1;
        self.uses.insert(self.clock, key);
        self.entries.insert(key, Entry { value, bytes: 0, used: self.clock });
    }

    /// Makes a key the most recently used; `None` if it is not there.
    fn touch(&mut self, key: K) -> Option<()> {
        let entry = self.entries.get_mut(&key)?;
        self.clock += 1;
        self.uses.remove(&entry.used);
        entry.used = self.clock;
        self.uses.insert(self.clock, key);
        Some(())
    }

    fn remove(&mut self, key: K) {
        if let Some(entry) = self.entries.remove(&key) {
            self.bytes -= entry.bytes;
            self.uses.remove(&entry.used);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_budget_holds_and_the_oldest_goes() {
        let mut cache = Lru::new(100);
        for key in 0..10 {
            cache.insert(key, key, 30);
            assert!(cache.bytes() <= 100);
            assert_eq!(cache.get(0), Some(&0), "used every time, so it stays");
        }
        assert_eq!((cache.peek(9), cache.peek(8), cache.peek(7)), (Some(&9), Some(&8), None));
        cache.insert(50, 50, 101);
        assert_eq!(cache.get(50), None);
        cache.insert(9, 90, 10);
        assert_eq!((cache.get(9).copied(), cache.bytes()), (Some(90), 70));
    }

    #[test]
    fn a_look_does_not_keep_a_value() {
        let mut cache = Lru::new(2);
        cache.insert('a', (), 1);
        cache.insert('b', (), 1);
        assert!(cache.peek('a').is_some());
        cache.insert('c', (), 1);
        assert!(cache.peek('a').is_none() && cache.peek('b').is_some());
    }

    #[test]
    fn a_value_whose_size_is_known_later_pushes_out_others_then() {
        let mut cache = Lru::new(10);
        cache.insert(1, "one", 6);
        assert_eq!(cache.get_or_insert_with(2, || "two"), &"two");
        assert_eq!(cache.get_or_insert_with(2, || "other"), &"two");
        assert_eq!((cache.bytes(), cache.peek(1)), (6, Some(&"one")));
        cache.resize(2, 5);
        assert_eq!((cache.bytes(), cache.peek(1)), (5, None));
        // Too large for the budget, but nothing else can make room.
        cache.resize(2, 50);
        assert_eq!((cache.bytes(), cache.peek(2)), (50, Some(&"two")));
        cache.resize(3, 7);
        assert_eq!((cache.bytes(), cache.peek(3)), (50, None));
    }

    #[test]
    fn a_lower_budget_takes_effect_with_the_next_value() {
        let mut cache = Lru::new(100);
        (0..5).for_each(|key| cache.insert(key, key, 10));
        cache.set_budget(20);
        assert_eq!(cache.bytes(), 50);
        cache.insert(5, 5, 10);
        assert_eq!((cache.bytes(), cache.peek(3), cache.peek(4)), (20, None, Some(&4)));
    }
}
