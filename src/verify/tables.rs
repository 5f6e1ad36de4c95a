//! Checks error tables: against the index, within themselves, and against those of the parents.

use super::report::{Check, Place};
use crate::codec::table::ErrorTable;
use crate::container::directory::TileEntry;
use crate::container::layout::Header;
use crate::error_code::{MAX_CODE, code_from_metres, metres_from_code};
use crate::sample::{Lattice, VALID};
use crate::tile::TileId;

/// The parent's patch that contains patch `patch` of a tile of `side x side` patches.
pub(super) fn above(id: TileId, patch: usize, side: usize) -> usize {
    let place = |index: usize, bit: u32| ((bit & 1) as usize * side + index) / 2;
    place(patch / side, id.y) * side + place(patch % side, id.x)
}

/// Checks the bits of drawable patches.
pub(super) fn check_drawable(
    header: &Header,
    entry: &TileEntry,
    lattice: &Lattice,
    table: &ErrorTable,
    check: &mut Check,
) {
    let (patch, side) = (header.patch() as usize, header.patches() as usize);
    for (index, &stored) in table.drawable.iter().enumerate() {
        let (x, y) = (index % side * patch, index / side * patch);
        let mut samples =
            (y..=y + patch).flat_map(|row| (x..=x + patch).map(move |column| lattice.at(column, row)));
        let drawable = samples.any(|at| lattice.state[at] == VALID);
        let place = || {
            let patch = Some([(index % side) as u32, (index / side) as u32]);
            Place { tile: Some(entry.id), patch, part: "drawable".into(), ..Place::default() }
        };
        check.demand(drawable == stored, place, drawable, stored);
    }
}

/// Checks the errors in the index row: they are the largest of the patches at step 0.
pub(super) fn check_index(entry: &TileEntry, table: &ErrorTable, check: &mut Check) {
    let patches = table.patches * table.patches;
    for (name, plane, stored) in [
        ("vertical error", &table.vertical, entry.vertical),
        ("horizontal error", &table.horizontal, entry.horizontal),
    ] {
        let largest = plane.iter().take(patches).max().copied().unwrap_or(0);
        let place = || Place::tile(entry.id).part(format!("{name} in the index"));
        check.demand(largest == stored, place, format_args!("code {largest}"), format_args!("code {stored}"));
    }
}

/// Checks that errors never shrink with the step, and those of a leaf at step 0.
pub(super) fn check_table(entry: &TileEntry, table: &ErrorTable, header: &Header, check: &mut Check) {
    let patches = table.patches * table.patches;
    // At step 0 a leaf draws its own samples: only quantisation errors remain.
    let quantisation = header.quantisation_error * header.band_scale.abs() * header.unit_metres;
    let rounded = |slack: f64| code_from_metres(quantisation * (1.0 + slack));
    for (name, plane, least, most) in [
        ("vertical", &table.vertical, rounded(-1e-12), rounded(1e-12)),
        ("horizontal", &table.horizontal, 0, 0),
    ] {
        check.looked_at += plane.len() as u64;
        for (at, &code) in plane.iter().enumerate() {
            let (step, patch) = (at / patches, at % patches);
            let place = || Place::tile(entry.id).patch(patch, table.patches, step).part(name);
            let finer = if step == 0 { 0 } else { plane[at - patches] };
            let good = (finer..=MAX_CODE).contains(&code);
            check.demand(good, place, format_args!("a code from {finer} to {MAX_CODE}"), code);
            if step == 0 && entry.is_leaf() {
                let expected = if table.drawable[patch] { least..=most } else { 0..=most };
                let metres = metres_from_code(code);
                check.demand(expected.contains(&code), place, format_args!("{quantisation} m"), metres);
            }
        }
    }
}

/// Checks that a parent's errors at step k are not below its children's at step k + 1.
pub(super) fn check_parent(
    parent: TileId,
    over: &ErrorTable,
    entry: &TileEntry,
    table: &ErrorTable,
    check: &mut Check,
) {
    let (side, patches) = (table.patches, table.patches * table.patches);
    let planes =
        [("vertical", &over.vertical, &table.vertical), ("horizontal", &over.horizontal, &table.horizontal)];
    for (name, coarse, fine) in planes {
        for (at, &code) in fine.iter().enumerate().skip(patches) {
            let (step, patch) = (at / patches - 1, at % patches);
            let stored = coarse[step * patches + above(entry.id, patch, side)];
            let place = || Place::tile(parent).patch(above(entry.id, patch, side), side, step).part(name);
            let expected = format_args!("{} m or more, as tile {} has", metres_from_code(code), entry.id);
            check.demand(stored >= code, place, expected, format_args!("{} m", metres_from_code(stored)));
        }
    }
}
