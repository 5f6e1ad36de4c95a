//! Members that are open. Kept from one window to the next are those that the rows of the window meet: an open raster
//! has blocks that the next window wants again. A sweep from north to south closes what it has passed.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::member::{Held, Member};
use crate::error::Result;
use crate::source::Source;

/// Most files kept open by all mosaics together: a process may open 256 on some systems. Where the rows of a window
/// meet more members, those beyond are opened for every window anew, and decode the blocks that windows share again.
const MOST: usize = 200;

/// Files kept open now.
static KEPT: AtomicUsize = AtomicUsize::new(0);

/// The right to keep a file open.
struct Permit;

impl Permit {
    fn take() -> Option<Self> {
        let more = |kept| (kept < MOST).then_some(kept + 1);
        KEPT.fetch_update(Ordering::Relaxed, Ordering::Relaxed, more).ok().map(|_| Self)
    }
}

impl Drop for Permit {
    fn drop(&mut self) {
        KEPT.fetch_sub(1, Ordering::Relaxed);
    }
}

/// An open raster, and the right to keep it.
type Kept = (Arc<dyn Source>, Permit);

/// The open members of one mosaic.
#[derive(Default)]
pub(super) struct Pool {
    kept: Mutex<BTreeMap<usize, Kept>>,
    /// How often a member was opened.
    #[cfg(test)]
    pub(super) opened: AtomicUsize,
}

impl Pool {
    fn lock(&self) -> MutexGuard<'_, BTreeMap<usize, Kept>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The source of a member, opened unless it is.
    pub(super) fn source(&self, index: usize, member: &Member) -> Result<Arc<dyn Source>> {
        if matches!(member.held, Held::Open(_)) {
            return member.open();
        }
        if let Some((source, _)) = self.lock().get(&index) {
            return Ok(Arc::clone(source));
        }
        #[cfg(test)]
        self.opened.fetch_add(1, Ordering::Relaxed);
        let source = member.open()?;
        if let Some(permit) = Permit::take() {
            self.lock().insert(index, (Arc::clone(&source), permit));
        }
        Ok(source)
    }

    /// Closes the members that some rows of the mosaic do not meet.
    pub(super) fn leave(&self, members: &[Member], rows: &Range<u32>) {
        let apart =
            |member: &Member| member.rect.rows.end <= rows.start || rows.end <= member.rect.rows.start;
        self.lock().retain(|&index, _| !apart(&members[index]));
    }

    /// Closes all.
    pub(super) fn clear(&self) {
        self.lock().clear();
    }
}
