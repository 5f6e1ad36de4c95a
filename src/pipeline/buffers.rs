//! [`Buffers`]: memory that is used again for one tile after the other.
//!
//! The planes of lattices and blocks are made by one thread and dropped by another. An allocator
//! that keeps memory apart for every thread would keep for each of them the most that it ever had.
//! So memory that is done with waits here for the next tile.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::codec::Scratch;
use crate::patch::blocks::Blocks;
use crate::sample::Lattice;
use crate::writer::TileChunks;

/// Memory that is not in use at the moment.
#[derive(Default)]
pub struct Buffers {
    threads: Mutex<Vec<(Scratch, TileChunks)>>,
    /// Lattices, by their intervals on a side.
    pub lattices: Spares<Lattice>,
    /// Blocks, by their number on a side.
    pub blocks: Spares<Blocks>,
}

/// Buffers of a thread while it works on some tiles. Dropping it gives them back.
pub struct Lent<'a> {
    /// Working memory of the codec.
    pub scratch: Scratch,
    /// Chunks while they are encoded: they have more room than the finished chunks take.
    pub chunks: TileChunks,
    /// The owner, which gets them back.
    pub owner: &'a Buffers,
}

impl Buffers {
    /// Lends buffers, if possible some that have been used before.
    pub fn lend(&self) -> Lent<'_> {
        let (scratch, chunks) = lock(&self.threads).pop().unwrap_or_default();
        Lent { scratch, chunks, owner: self }
    }
}

impl Drop for Lent<'_> {
    fn drop(&mut self) {
        let buffers = (std::mem::take(&mut self.scratch), std::mem::take(&mut self.chunks));
        lock(&self.owner.threads).push(buffers);
    }
}

/// Planes of one kind that are not in use, by their size.
#[derive(Default)]
pub struct Spares<T>(Mutex<BTreeMap<usize, Shelf<T>>>);

#[derive(Default)]
struct Shelf<T> {
    spare: Vec<T>,
    lent: usize,
}

impl<T: Default> Spares<T> {
    /// Takes one of this size, with any content, or an empty one if there is none.
    pub fn take(&self, size: usize) -> T {
        let mut shelves = lock(&self.0);
        let shelf = shelves.entry(size).or_default();
        shelf.lent += 1;
        shelf.spare.pop().unwrap_or_default()
    }

    /// Takes one back. One that was made elsewhere may come too. It is kept only while fewer have
    /// come back than were taken, so that there are never more than were in use at a time.
    pub fn give(&self, size: usize, thing: T) {
        let mut shelves = lock(&self.0);
        let shelf = shelves.entry(size).or_default();
        if shelf.lent > 0 {
            shelf.lent -= 1;
            shelf.spare.push(thing);
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_more_are_kept_than_were_in_use() {
        let spares = Spares::<Vec<u8>>::default();
        assert!(spares.take(3).is_empty() && spares.take(3).is_empty());
        for i in 0..4 {
            spares.give(3, vec![i]);
        }
        assert_eq!([3, 4, 3, 3].map(|size| spares.take(size)), [vec![1], vec![], vec![0], vec![]]);
    }
}
