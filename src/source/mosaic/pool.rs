//! Members that are open. Kept from one window to the next are those that the rows of the window
//! meet: an open raster has blocks that the next window wants again. A sweep from north to south
//! closes what it has passed.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, PoisonError};

use super::member::{Held, Member};
use crate::error::Result;
use crate::source::Source;

/// Most files kept open by all mosaics together: a process may open 256 on some systems. Where the
/// rows of a window meet more members, those beyond are opened for every window anew, and decode
/// the blocks that windows share again.
const MOST: usize = 200;

/// [`MOST`], or what the process may open if that is less: half of what is left beside the files
/// that are written, as a raster may have a mask beside it.
static MOST_HERE: LazyLock<usize> = LazyLock::new(|| match crate::file::most_open() {
    Some(most) => usize::try_from(most.saturating_sub(OTHERS) / 2).unwrap_or(MOST).clamp(1, MOST),
    None => MOST,
});

/// Files that are open beside those of mosaics.
const OTHERS: u64 = 40;

/// Files kept open now.
static KEPT: AtomicUsize = AtomicUsize::new(0);

/// The right to keep a file open.
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

/// An open raster, and the right to keep it; one that is open all the time needs none.
type Kept = (Arc<dyn Source>, Option<Permit>);

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
        if let Some((source, _)) = self.lock().get(&index) {
            return Ok(Arc::clone(source));
        }
        #[cfg(test)]
        self.opened.fetch_add(1, Ordering::Relaxed);
        let source = member.open()?;
        let stays = matches!(member.held, Held::Open(_));
        let permit = if stays { None } else { Permit::take() };
        if stays || permit.is_some() {
            self.lock().insert(index, (Arc::clone(&source), permit));
        }
        Ok(source)
    }

    /// Closes the members that some rows of the mosaic do not meet; those that cannot be closed let
    /// go of what they can.
    pub(super) fn leave(&self, members: &[Member], rows: &Range<u32>) {
        let meets = |member: &Member| member.rect.rows.start < rows.end && rows.start < member.rect.rows.end;
        self.lock().retain(|&index, (source, _)| {
            let stays = meets(&members[index]);
            if !stays {
                source.release();
            }
            stays
        });
    }

    /// How many members are open.
    #[cfg(test)]
    pub(super) fn kept(&self) -> usize {
        self.lock().len()
    }

    /// Closes all.
    pub(super) fn clear(&self) {
        let all = std::mem::take(&mut *self.lock());
        for (source, _) in all.values() {
            source.release();
        }
    }
}
