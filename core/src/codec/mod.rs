//! Bytes of a tile's chunks <-> its samples (`format-spec.md`, sections 7 to 10).
//!
//! A tile stores the samples that its parent does not have: their residuals against an
//! interpolation of their neighbours, their voids, and the error table of its patches. Nothing here
//! knows a file or a tile's place.
//!
//! Decoders are total: any bytes give an error or samples. They never allocate more than the tile's
//! size calls for.

pub mod frame;
pub mod height;
pub mod imagery;
pub mod mask;
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
mod word;

/// Scratch memory of one thread, kept from tile to tile.
#[derive(Default)]
pub struct Scratch {
    /// Bytes of one byte plane, mask or plane of lows.
    bytes: Vec<u8>,
    /// Raw low bits, with zero bytes after them.
    raw: Vec<u8>,
    /// Residuals (zigzag), in newborn order.
    residuals: Vec<u32>,
    /// Codes of one row.
    row: Vec<i32>,
    /// States of one row.
    states: Vec<u8>,
    /// For each sample of one row: 1 if a sample beside it is valid.
    near: Vec<u8>,
    /// Decimals that replace the codes of the lattice.
    decimals: Vec<i32>,
    /// Histogram of residuals.
    histogram: Vec<u32>,
    /// Prediction of heights.
    walk: walk::Walk,
    /// Prediction of validity.
    validity: mask::Validity,
}
