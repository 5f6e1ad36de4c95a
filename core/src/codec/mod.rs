//! Bytes of a tile's chunks <-> its samples (`format-spec.md`, sections 7 to 10).
//!
//! A tile stores the samples that are not in its parent already: their residuals against an interpolation of their
//! neighbours, where it is void, and the error table of its patches. Nothing here knows a file or a tile's place.
//!
//! Decoders are total: whatever the bytes, the answer is an error or some samples. They never allocate more than the
//! tile's size calls for.

pub mod frame;
pub mod height;
pub mod mask;
pub mod picture;
pub mod table;

mod bits;
mod decimal;
mod neighbours;
#[cfg(test)]
mod oracle;
mod order;
mod predict;
mod probe;
#[cfg(test)]
mod tests;
mod void;
mod walk;

/// Buffers of one thread, kept from tile to tile.
#[derive(Default)]
pub struct Scratch {
    /// One decoded byte plane, mask or plane of lows.
    bytes: Vec<u8>,
    /// Raw low bits, with room for whole words behind.
    raw: Vec<u8>,
    /// Residuals (zigzag while they are coded), newborn order.
    residuals: Vec<u32>,
    /// Codes of one row.
    row: Vec<i32>,
    /// States of one row.
    states: Vec<u8>,
    /// Which samples of one row have valid ones beside them.
    near: Vec<u8>,
    /// Decimals that take the place of the lattice's codes.
    decimals: Vec<i32>,
    /// Histogram of residuals.
    histogram: Vec<u32>,
    /// Prediction of heights.
    walk: walk::Walk,
    /// Prediction of validity.
    validity: mask::Validity,
}
