//! Reads the counts of what was drawn back from the device.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use super::Drawn;
use super::meshes::ARGUMENTS;

const IDLE: u8 = 0;
const ASKED: u8 = 1;
const READY: u8 = 2;
const FAILED: u8 = 3;

/// The state of a copy of counts, and the last counts that came.
#[derive(Debug, Default)]
pub(crate) struct Pending {
    state: Arc<AtomicU8>,
    latest: Drawn,
}

impl Pending {
    /// Returns true if the staging buffer is free.
    pub fn idle(&self) -> bool {
        self.state.load(Ordering::Acquire) == IDLE
    }

    /// Maps the staging buffer, into which the last submission copied the counts.
    pub fn ask(&self, staging: &wgpu::Buffer) {
        self.state.store(ASKED, Ordering::Release);
        let state = Arc::clone(&self.state);
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            state.store(if result.is_ok() { READY } else { FAILED }, Ordering::Release);
        });
    }

    /// Returns the latest counts; frees the staging buffer if new ones have come.
    pub fn take(&mut self, staging: &wgpu::Buffer, counted: impl Fn(&[u8]) -> Drawn) -> Drawn {
        match self.state.load(Ordering::Acquire) {
            READY => {
                if let Ok(bytes) = staging.get_mapped_range(..) {
                    self.latest = counted(&bytes);
                }
                staging.unmap();
                self.state.store(IDLE, Ordering::Release);
            }
            FAILED => self.state.store(IDLE, Ordering::Release),
            _ => {}
        }
        self.latest
    }
}

/// Returns the counts from the arguments of the indirect draws; `triangles` are those of each
/// bucket.
pub(crate) fn counted(arguments: &[u8], triangles: &[u32], patch_log2: u8) -> Drawn {
    let mut drawn = Drawn::default();
    // Whole patches and middles: every patch has one of them.
    let middles = 2 * usize::from(patch_log2) + 3;
    for ((bucket, one), &of) in arguments.chunks_exact(ARGUMENTS as usize).enumerate().zip(triangles) {
        let instances = u32::from_le_bytes([one[4], one[5], one[6], one[7]]);
        drawn.triangles += u64::from(instances) * u64::from(of);
        if bucket < middles {
            drawn.patches += instances;
        }
    }
    drawn
}
