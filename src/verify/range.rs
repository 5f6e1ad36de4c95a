//! Checks that height ranges of the index (specification, section 6) are no wider than their
//! heights.
//!
//! That a range holds its heights is checked where these are decoded. Here it must not hold more: a
//! renderer that trusts it would draw too much, and a picker would search in the wrong place. A
//! reader cannot tell fills from samples without meaning, so all samples of a tile count unless
//! full resolution is known.

use super::report::{Check, Place};
use crate::container::directory::TileEntry;
use crate::container::layout::Header;
use crate::sample::Lattice;

/// Relative rounding allowed in converting a value to metres.
const SLACK: f64 = 1e-15;

/// Lowest and highest of some heights, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hull {
    low: f64,
    high: f64,
}

impl Hull {
    /// The hull of no heights.
    pub const EMPTY: Self = Self { low: f64::INFINITY, high: f64::NEG_INFINITY };

    /// The hull of all samples of a lattice, with or without meaning.
    pub fn of_all(header: &Header, lattice: &Lattice) -> Self {
        let mut hull = Self::EMPTY;
        if header.coding.has_low() {
            for at in 0..lattice.code.len() {
                hull.take(header.metres_of(lattice.code[at], lattice.low_at(at)));
            }
        } else {
            // Metres grow with the code, or shrink.
            for code in [lattice.code.iter().min(), lattice.code.iter().max()].into_iter().flatten() {
                hull.take(header.metres_of(*code, 0));
            }
        }
        hull
    }

    /// Adds a height; NaN is ignored.
    pub fn take(&mut self, metres: f64) {
        if metres.is_nan() {
            *self = Self { low: f64::NEG_INFINITY, high: f64::INFINITY };
        }
        (self.low, self.high) = (self.low.min(metres), self.high.max(metres));
    }

    /// Adds all heights of another hull.
    pub fn join(&mut self, other: Self) {
        (self.low, self.high) = (self.low.min(other.low), self.high.max(other.high));
    }

    /// Adds the height range of a child.
    pub fn join_range(&mut self, entry: &TileEntry) {
        self.join(Self { low: entry.min_m.into(), high: entry.max_m.into() });
    }

    /// Checks that the height range of a tile is no wider than the hull.
    pub fn check(self, entry: &TileEntry, check: &mut Check) {
        let (low, high) = (self.low - SLACK * self.low.abs(), self.high + SLACK * self.high.abs());
        let (least, most) = (down(low), up(high));
        let is = self.low > self.high || (entry.min_m >= least && entry.max_m <= most);
        let expected = format_args!("{least} to {most}, or narrower: that is how far its heights reach");
        let got = format_args!("{} to {}", entry.min_m, entry.max_m);
        check.demand(is, || Place::tile(entry.id).part("height range"), expected, got);
    }
}

/// The nearest f32 not above a number.
fn down(number: f64) -> f32 {
    let near = number as f32;
    if f64::from(near) > number { near.next_down() } else { near }
}

/// The nearest f32 not below a number.
fn up(number: f64) -> f32 {
    -down(-number)
}
