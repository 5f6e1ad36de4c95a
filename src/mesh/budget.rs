//! The most exact mesh of at most so many triangles.

use super::made::{Made, Wish};
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::tile::TileId;

/// Meshes that are tried at most.
const TRIES: u32 = 16;
/// A mesh with this part of the triangles allowed is as good as the best.
const GOOD: f64 = 0.99;

/// The least error in metres that a mesh of at most `most` triangles is found to keep. More
/// triangles than that come of an error that is smaller by 0.2 % at least, or the mesh has at least
/// 99 % of them.
///
/// # Errors
/// [`Error::Usage`] if even the coarsest mesh has more.
pub(super) fn error_for(wish: Wish<'_>, most: u64, progress: &dyn Progress) -> Result<f64> {
    let count = |error: f64| Made::new(wish, error, progress).map(|mesh| mesh.triangle_count());
    let Wish { reader, window, .. } = wish;
    let header = reader.header();
    let rounded = (header.quantisation_error * header.band_scale * header.unit_metres).abs();
    let cells = (window.columns.len() as u64 - 1) * (window.rows.len() as u64 - 1);
    if most >= 2 * cells {
        return Ok(rounded);
    }
    let root = reader.entry(TileId::ROOT)?;
    let range = root.map_or(0.0, |root| f64::from(root.max_m) - f64::from(root.min_m));
    // No triangle between samples is off by more than the range of heights.
    let (mut coarse, mut fine) = ((rounded + range + 1.0, count(rounded + range + 1.0)?), None);
    if coarse.1 > most {
        return Err(Error::usage(format!(
            "even the coarsest mesh of this window has {} triangles (outlines of voids are exact); allow as many, or take another window",
            coarse.1
        )));
    }
    for _ in 0..TRIES {
        if coarse.1 as f64 >= GOOD * most as f64 {
            break;
        }
        // Triangles fall with a power of the error, more or less.
        let guess = match fine {
            None => rounded + (coarse.0 - rounded) * (coarse.1 as f64 / most as f64).clamp(0.01, 0.7),
            Some((error, triangles)) if error > 0.0 => {
                let (low, high) = (f64::ln(error), coarse.0.ln());
                let (more, fewer) = ((triangles as f64).ln(), (coarse.1 as f64).ln());
                let part = (more - (0.995 * most as f64).ln()) / (more - fewer).max(1e-9);
                (low + (high - low) * part.clamp(0.05, 0.95)).exp()
            }
            Some((error, _)) => f64::midpoint(error, coarse.0),
        };
        let least = fine.map_or(rounded, |(error, _): (f64, u64)| error);
        if guess <= least || coarse.0 / guess < 1.002 {
            break;
        }
        let triangles = count(guess)?;
        if triangles <= most {
            coarse = (guess, triangles);
        } else {
            fine = Some((guess, triangles));
        }
    }
    Ok(coarse.0)
}
