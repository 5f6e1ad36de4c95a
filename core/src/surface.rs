//! The surface that a file defines (section 2 of the specification), point by point at full
//! resolution.
//!
//! This is the surface of the leaves: two triangles to a cell, its diagonal by the parity of the
//! cell, shown where at least half of it is valid. On the border of two leaves of one level both
//! give the same answer, bit for bit.

use crate::container::{Header, Reader, TileEntry};
use crate::error::{Error, Result};
use crate::sample::{Lattice, VALID};
use crate::tile::TileId;

/// Height in metres at a place in world coordinates; `None` where the surface is not shown.
pub fn height_at(reader: &Reader, x: f64, y: f64) -> Result<Option<f64>> {
    let (column, row) = reader.geo().sample_from_world(x, y).ok_or_else(|| {
        let path = reader.path().display();
        Error::usage(format!("{path} has a geotransform that cannot be inverted; ask for samples instead"))
    })?;
    height_at_sample(reader, column, row)
}

/// Height in metres at a place of the lattice, fractions allowed; `None` where the surface is not
/// shown.
///
/// ```
/// # use relevo_core::{Reader, TileId};
/// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
/// # let reader = Reader::open(path)?;
/// use relevo_core::surface;
///
/// let height = surface::height_at_sample(&reader, 20.0, 20.0)?.unwrap();
/// assert!((61.0..=739.0).contains(&height));
/// # Ok::<(), relevo_core::Error>(())
/// ```
pub fn height_at_sample(reader: &Reader, column: f64, row: f64) -> Result<Option<f64>> {
    let header = reader.header();
    let Some(leaf) = leaf_at(reader, column, row)? else { return Ok(None) };
    let lattice = reader.read_tile(leaf.id)?;
    Ok(height_in_tile(header, leaf.id, &lattice, column, row))
}

/// The leaf at a place of the lattice; one of them if it lies on a border. `None` if no tile is
/// there.
///
/// ```
/// # use relevo_core::{Reader, TileId};
/// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
/// # let reader = Reader::open(path)?;
/// use relevo_core::surface;
///
/// assert_eq!(surface::leaf_at(&reader, 20.0, 40.0)?.unwrap().id, TileId::new(3, 1, 2));
/// # Ok::<(), relevo_core::Error>(())
/// ```
pub fn leaf_at(reader: &Reader, column: f64, row: f64) -> Result<Option<TileEntry>> {
    let header = reader.header();
    let side = f64::from(header.tile()) * f64::from(header.spacing(0));
    if !(0.0..=side).contains(&column) || !(0.0..=side).contains(&row) {
        return Ok(None);
    }
    let mut found = reader.entry(TileId::ROOT)?;
    while let Some(entry) = found.filter(|entry| !entry.is_leaf()) {
        let half = f64::from(header.tile()) * f64::from(header.spacing(entry.id.level + 1));
        let (left, top) = header.origin(entry.id);
        let east = column - left as f64 >= half;
        let south = row - top as f64 >= half;
        found = reader.entry(entry.id.child(u8::from(east) | u8::from(south) << 1))?;
    }
    Ok(found)
}

/// Height in metres of the surface of one tile at its step 0; `None` outside the tile and where it
/// is not shown.
pub fn height_in_tile(header: &Header, id: TileId, lattice: &Lattice, column: f64, row: f64) -> Option<f64> {
    let spacing = f64::from(header.spacing(id.level));
    let (left, top) = header.origin(id);
    // Exact: the divisor is a power of two, and the subtrahend has no more bits than the
    // difference.
    let (u, v) = (column / spacing - left as f64 / spacing, row / spacing - top as f64 / spacing);
    let side = lattice.n as f64;
    if !(0.0..=side).contains(&u) || !(0.0..=side).contains(&v) {
        return None;
    }
    let (i, j) = ((u as usize).min(lattice.n - 1), (v as usize).min(lattice.n - 1));
    let parity = (id.x as usize + id.y as usize) * lattice.n + i + j;
    let weights = weights(u - i as f64, v - j as f64, parity.is_multiple_of(2));
    let corners = [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)];
    let (mut validity, mut height) = (0.0, 0.0);
    for ((x, y), weight) in corners.into_iter().zip(weights) {
        // A corner without weight may be one whose code means nothing.
        if weight == 0.0 {
            continue;
        }
        let at = lattice.at(x, y);
        if lattice.state[at] == VALID {
            validity += weight;
        }
        height += weight * header.metres_of(lattice.code[at], lattice.low_at(at));
    }
    (validity >= 0.5).then_some(height)
}

/// Weights of the corners of a cell (north-west, north-east, south-west, south-east) at a point of
/// it, one of them 0. On an edge they are exactly `1 - t` and `t` at its ends, from whichever cell.
fn weights(x: f64, y: f64, falling: bool) -> [f64; 4] {
    if falling {
        if x >= y { [1.0 - x, x - y, 0.0, y] } else { [1.0 - y, 0.0, y - x, x] }
    } else if x + y <= 1.0 && x < 1.0 && y < 1.0 {
        // (The far edges belong to the other triangle even where the sum rounds to 1.)
        let rest = if x <= y { (1.0 - y) - x } else { (1.0 - x) - y };
        [rest, x, y, 0.0]
    } else {
        let rest = if x >= y { y - (1.0 - x) } else { x - (1.0 - y) };
        [0.0, 1.0 - y, 1.0 - x, rest]
    }
}
