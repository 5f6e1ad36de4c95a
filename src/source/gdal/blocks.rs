//! Caches shared by the rasters of one warp: finished blocks, and operations that no thread is
//! using.

use std::collections::{HashMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::operation::Operation;
use crate::error::Result;
use crate::source::Samples;

/// Bytes of cached blocks. Bands of rows share a row of blocks, so two rows of blocks are kept for
/// all but the widest rasters.
const KEPT: usize = 64 << 20;
/// Most cached operations, each of which keeps a file open.
const IDLE: usize = 64;

/// Key of a block: number of the raster, column and row.
pub(super) type Id = (usize, u32, u32);

/// The caches, whose size does not depend on the number of rasters.
#[derive(Default)]
pub(super) struct Shared {
    kept: Mutex<BlockLru>,
    idle: Mutex<VecDeque<(usize, Operation)>>,
}

impl Shared {
    /// A block from the cache, or else made by `make`.
    pub(super) fn block(&self, id: Id, make: impl FnOnce() -> Result<Samples>) -> Result<Arc<Samples>> {
        let kept = lock(&self.kept).get(id);
        if let Some(block) = kept {
            return Ok(block);
        }
        let block = Arc::new(make()?);
        lock(&self.kept).put(id, &block);
        Ok(block)
    }

    /// An idle operation of a raster, which no one else gets until it is put back.
    pub(super) fn take(&self, raster: usize) -> Option<Operation> {
        let mut idle = lock(&self.idle);
        let at = idle.iter().rposition(|entry| entry.0 == raster)?;
        idle.remove(at).map(|entry| entry.1)
    }

    /// Returns an operation to the cache; if the cache is full, drops the one idle longest.
    pub(super) fn put_back(&self, raster: usize, operation: Operation) {
        let mut idle = lock(&self.idle);
        idle.push_back((raster, operation));
        let oldest = if idle.len() > IDLE { idle.pop_front() } else { None };
        // Closing a file takes time, during which no other thread should wait.
        drop(idle);
        drop(oldest);
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Cached blocks; the least recently used are dropped first.
#[derive(Default)]
struct BlockLru {
    blocks: HashMap<Id, (u64, Arc<Samples>)>,
    bytes: usize,
    clock: u64,
}

impl BlockLru {
    fn get(&mut self, id: Id) -> Option<Arc<Samples>> {
        self.clock += 1;
        let entry = self.blocks.get_mut(&id)?;
        entry.0 = self.clock;
        Some(Arc::clone(&entry.1))
    }

    fn put(&mut self, id: Id, block: &Arc<Samples>) {
        let size = |block: &Samples| block.len() * block.sample_type().bytes();
        self.clock += 1;
        self.bytes += size(block);
        if let Some((_, old)) = self.blocks.insert(id, (self.clock, Arc::clone(block))) {
            self.bytes -= size(&old);
        }
        while self.bytes > KEPT {
            let oldest = self.blocks.iter().min_by_key(|(_, entry)| entry.0).map(|(&id, _)| id);
            let Some((_, block)) = oldest.and_then(|id| self.blocks.remove(&id)) else { break };
            self.bytes -= size(&block);
        }
    }
}
