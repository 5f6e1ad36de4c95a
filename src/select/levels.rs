//! The step of every patch and of every edge of a selection.
//!
//! Steps are counted as *exponents*: spacing `2^e` samples of the lattice, so `e = L - level + k` for step `k` of a tile. Exponents of
//! different tiles compare.
//!
//! [`EdgeRule::Shared`]: the base exponent of a patch is the greatest whose projected error is within the tolerance (of
//! a patch that is not in the picture, the greatest there is). Then, in order,
//! 1. no patch may be finer than a vertex of an edge allows: `least(patch) = max over its edges of max(limit(edge), greatest least of the edge's patches - 1)`,
//!    to the fixed point, and `inner = max(base, least)`. It changes nothing once all tiles that selection wants are loaded;
//! 2. patches of an edge differ by one at most: `inner(patch) = min(inner, 1 + least inner of the edge's patches)`, to the fixed point;
//! 3. an edge has the least `inner` of its patches.
//!
//! Each fixed point is reached after at most [`super::Selection::rounds`] rounds over all patches and edges: exponents of one selection
//! differ by no more, and one round carries a bound one patch further.
//!
//! [`EdgeRule::Paper`]: `inner` is the base; an edge between patches of a tile has the least of the two, an edge at a side has
//! the side's `limit`.

use super::pattern::EdgeRule;
use super::traverse::Selection;
use super::view::{Frame, View};

/// Steps of all patches and edges, as exponents.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Levels {
    /// `[tile * m^2 + patch]`.
    pub inner: Vec<u8>,
    /// By edge number; see [`super::neighbours`]. 255 where no patch uses the number.
    pub edges: Vec<u8>,
}

impl Levels {
    /// Levels of a selection.
    pub fn of(_selection: &Selection, _frame: &Frame, _view: &View, _tolerance: f64, _rule: EdgeRule) -> Self {
        Self::default()
    }
}
