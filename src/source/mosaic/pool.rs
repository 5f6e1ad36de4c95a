//! The open members of mosaics. Members that meet the rows of a window stay open for the next
//! window, which needs the same blocks again. A sweep from north to south closes those that it has
//! passed.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

use super::member::{Member, MemberSource};
use crate::error::Result;
use crate::source::Source;

/// Most files kept open by all mosaics together: some systems allow a process 256. If the rows of a
/// window meet more members, the others are reopened for every window, and decode the blocks that
/// windows share again.
const MOST: usize = 200;

/// [`MOST`], or half of what the process may still open if that is less: a raster may have a mask
/// file beside it.
static MOST_HERE: LazyLock<usize> = LazyLock::new(|| match crate::file::most_open() {
    Some(most) => usize::try_from(most.saturating_sub(OTHERS) / 2).unwrap_or(MOST).clamp(1, MOST),
    None => MOST,
});

/// Open files other than those of mosaics.
const OTHERS: u64 = 40;

/// Number of files kept open now.
static KEPT: AtomicUsize = AtomicUsize::new(0);

/// A permit to keep a file open.
struct Permit;

impl Permit {
    fn take() -> Option<Self> {
        let most = *MOST_HERE;
        let more = |kept| (kept < most).then_some(kept + 1);
        KEPT.fetch_update(Ordering::Relaxed, Ordering::Relaxed, more).ok().map(|_| Self)
    }
}

impl Drop for Permit {
    fn drop(&mut self) {
        KEPT.fetch_sub(1, Ordering::Relaxed);
    }
}

/// An open source with its permit; a source that is always open has none.
type OpenMember = (Arc<dyn Source>, Option<Permit>);

/// The open members of one mosaic.
#[derive(Default)]
pub(super) struct Pool {
    kept: Mutex<BTreeMap<usize, OpenMember>>,
    /// How often members were opened.
    #[cfg(test)]
    pub(super) opened: AtomicUsize,
}

impl Pool {
    fn lock(&self) -> MutexGuard<'_, BTreeMap<usize, OpenMember>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The source of a member, opened if necessary.
    pub(super) fn source(&self, index: usize, member: &Member) -> Result<Arc<dyn Source>> {
        if let Some((source, _)) = self.lock().get(&index) {
            return Ok(Arc::clone(source));
        }
        #[cfg(test)]
        self.opened.fetch_add(1, Ordering::Relaxed);
        let source = member.open()?;
        let stays = matches!(member.held, MemberSource::Open(_));
        let permit = if stays { None } else { Permit::take() };
        if stays || permit.is_some() {
            self.lock().insert(index, (Arc::clone(&source), permit));
        }
        Ok(source)
    }

    /// Closes the members that do not meet these rows of the mosaic; those that stay open release
    /// their caches.
    pub(super) fn close_passed(&self, members: &[Member], rows: &Range<u32>) {
        let meets = |member: &Member| member.rect.rows.start < rows.end && rows.start < member.rect.rows.end;
        self.lock().retain(|&index, (source, _)| {
            let stays = meets(&members[index]);
            if !stays {
                source.release();
            }
            stays
        });
    }

    /// Number of open members.
    #[cfg(test)]
    pub(super) fn kept(&self) -> usize {
        self.lock().len()
    }

    /// Closes all members.
    pub(super) fn clear(&self) {
        let all = std::mem::take(&mut *self.lock());
        for (source, _) in all.values() {
            source.release();
        }
    }
}
