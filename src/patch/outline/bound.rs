//! The bounds of the branch and bound: of a whole search, and of a square of cells.

use crate::patch::blocks::{HAS_VALID, HAS_VOID};

/// Largest ratio of a squared distance found to the true one, by the number of triangles evaluated
/// so far: half a per cent in the distance at first, more where a pattern repeats itself all over a
/// patch, so that little can be pruned.
const SLACK: [(u32, f64); 3] = [(500, 1.005 * 1.005), (2_000, 1.04 * 1.04), (u32::MAX, 1.15 * 1.15)];

/// Lower and upper bound of the largest squared distance of the points evaluated so far, square
/// metres.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Bound {
    lower: f64,
    upper: f64,
    /// Triangles evaluated.
    effort: u32,
}

impl Bound {
    /// The bound of a search whose result is at least `finer`, square metres.
    pub(super) fn starting_from(finer: f64) -> Self {
        Self { upper: finer, ..Self::default() }
    }

    /// Counts an evaluated triangle that has a misdrawn point at this squared distance.
    #[inline]
    pub(super) fn evaluated(&mut self, squared: f64) {
        self.raise_lower(squared);
        self.effort = self.effort.saturating_add(1);
    }

    /// Raises the lower bound to the squared distance of a misdrawn point.
    #[inline]
    pub(super) fn raise_lower(&mut self, squared: f64) {
        self.lower = self.lower.max(squared);
    }

    /// True if a branch whose points are at most this far can be pruned; then the upper bound
    /// covers them.
    #[inline]
    pub(super) fn prunes(&mut self, squared: f64) -> bool {
        let [(few, close), (more, wide), (_, widest)] = SLACK;
        let slack = if self.effort <= few {
            close
        } else if self.effort <= more {
            wide
        } else {
            widest
        };
        let is_pruned = squared <= self.upper || squared <= self.lower * slack;
        if is_pruned {
            self.raise_upper(squared);
        }
        is_pruned
    }

    /// The upper bound, square metres.
    pub(super) fn upper(self) -> f64 {
        self.upper
    }

    /// Raises the upper bound to a squared distance.
    #[inline]
    pub(super) fn raise_upper(&mut self, squared: f64) {
        self.upper = self.upper.max(squared);
    }

    /// The bound to start a branch with: the upper bound of its points is still 0.
    pub(super) fn branch(self) -> Self {
        Self { upper: 0.0, ..self }
    }

    /// Merges the bound of a branch into this one. Returns the upper bound of the branch.
    pub(super) fn merge(&mut self, branch: Self) -> f64 {
        *self = Self { upper: self.upper.max(branch.upper), ..branch };
        branch.upper
    }
}

/// For each fault an upper bound, in square metres, of the squared distance from the outline of the
/// points of a square at which the fault is possible, however it is drawn. Infinite until it is
/// computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct UpperBounds([f32; 2]);

impl UpperBounds {
    /// Not computed yet.
    pub(super) const UNKNOWN: Self = Self([f32::INFINITY; 2]);

    /// True if they have been computed.
    #[inline]
    pub(super) fn is_known(self) -> bool {
        self.0[0] < f32::INFINITY
    }

    /// The upper bound of a fault.
    #[inline]
    pub(super) fn of(self, fault: usize) -> f64 {
        f64::from(self.0[fault])
    }

    /// Lowers the upper bound of a fault.
    #[inline]
    pub(super) fn lower(&mut self, fault: usize, squared: f64) {
        let rounded = squared as f32;
        let above = if f64::from(rounded) < squared { rounded.next_up() } else { rounded };
        self.0[fault] = self.0[fault].min(above);
    }

    /// Lowers the upper bounds of a square to the largest of its children, which hold `bits`.
    #[inline]
    pub(super) fn lower_to(&mut self, children: &[Self; 4], bits: [u8; 4]) {
        let mut highest = [0.0_f32; 2];
        for (Self([shown, hidden]), bits) in children.iter().zip(bits) {
            highest[0] = larger(highest[0], if bits & HAS_VOID != 0 { *shown } else { 0.0 });
            highest[1] = larger(highest[1], if bits & HAS_VALID != 0 { *hidden } else { 0.0 });
        }
        for (own, highest) in self.0.iter_mut().zip(highest) {
            *own = if highest < *own { highest } else { *own };
        }
    }

    /// The largest upper bound of some faults.
    #[inline]
    pub(super) fn highest(self, faults: [bool; 2]) -> f64 {
        let of = |fault: usize| if faults[fault] { self.0[fault] } else { 0.0 };
        f64::from(larger(of(0), of(1)))
    }
}

/// The larger of two numbers, neither of which is NaN.
#[inline]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
