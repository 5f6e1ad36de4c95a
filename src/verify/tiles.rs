//! Tile by tile, as the index is walked: chunks, flags, error tables, shared borders, and what parents owe their children.
//!
//! Memory is what a batch of tiles and the borders in waiting take, whatever the size of the file; only with `deep` the error
//! tables are kept.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::borders::{Border, Borders};
use super::report::{Check, Place};
use super::statistics::Recount;
use super::{VerifyOptions, Watch, tell};
use crate::codec::table::ErrorTable;
use crate::container::directory::{ChunkKind, TileEntry};
use crate::container::layout::Header;
use crate::container::reader::Reader;
use crate::error::{Error, Result};
use crate::error_code::{MAX_CODE, code_from_metres, metres_from_code};
use crate::sample::{Lattice, VALID};
use crate::tile::TileId;

/// Tiles decoded at a time.
const BATCH: usize = 64;

/// Index rows and error tables of the tiles, for what comes after.
#[derive(Default)]
pub(super) struct Tables {
    /// By tile; empty unless they were asked for.
    pub by_tile: BTreeMap<TileId, (TileEntry, ErrorTable)>,
    /// True if every tile could be read.
    pub whole: bool,
}

/// What is found in one tile, by any thread.
struct Inspected {
    entry: TileEntry,
    table: Option<ErrorTable>,
    border: Option<Border>,
    /// Valid samples that no other tile counts, and the range of all of them in metres.
    valid: u64,
    range_m: Option<(f64, f64)>,
    chunks: Check,
    structure: Check,
}

/// A tile on the way from the root to the one being looked at.
struct Node {
    entry: TileEntry,
    table: Option<ErrorTable>,
    /// Patches with a valid sample in or below them.
    occupied: Vec<bool>,
}

/// Walks the file. Gives the checks in the order of the report.
pub(super) fn check(
    reader: &Reader,
    options: &VerifyOptions,
    progress: Watch,
) -> Result<(Tables, Vec<Check>)> {
    let mut walk = Walk::new(reader, options);
    let total = reader.header().tile_count;
    let walked = reader.walk(&mut |entry| {
        walk.batch.push(*entry);
        if walk.batch.len() == BATCH {
            walk.work_off()?;
            tell(progress, "tiles", walk.done, total)?;
        }
        Ok(())
    });
    walk.work_off()?;
    tell(progress, "tiles", walk.done, total)?;
    let counted = walk.index.take(walked, Place::of("index"))?.is_some();
    walk.finish(counted)
}

struct Walk<'a> {
    reader: &'a Reader,
    keep_tables: bool,
    batch: Vec<TileEntry>,
    done: u64,
    tables: Tables,
    /// Nodes from the root to the tile looked at last.
    path: Vec<Node>,
    borders: Borders<'a>,
    recount: Recount,
    /// First and end of the chunks of each level, from the start of the tiles section.
    runs: Vec<Option<(u64, u64)>>,
    index: Check,
    chunks: Check,
    structure: Check,
    monotone: Check,
    keep: usize,
}

impl<'a> Walk<'a> {
    fn new(reader: &'a Reader, options: &VerifyOptions) -> Self {
        let keep = options.keep;
        Self {
            reader,
            keep_tables: options.deep,
            batch: Vec::new(),
            done: 0,
            tables: Tables { whole: true, ..Tables::default() },
            path: Vec::new(),
            borders: Borders::new(reader, keep),
            recount: Recount::new(reader.header()),
            runs: vec![None; usize::from(reader.header().levels) + 1],
            index: Check::new("index", "tiles", keep),
            chunks: Check::new("chunks", "bytes", keep),
            structure: Check::new("tiles", "tiles", keep),
            monotone: Check::new("monotone errors", "errors", keep),
            keep,
        }
    }

    /// Looks at the tiles of the batch: in parallel as far as each is on its own, then in their order.
    fn work_off(&mut self) -> Result<()> {
        let batch = std::mem::take(&mut self.batch);
        let (reader, keep) = (self.reader, self.keep);
        let inspected: Vec<Result<Inspected>> =
            batch.into_par_iter().map(|entry| inspect(reader, entry, keep)).collect();
        for tile in inspected {
            self.add(tile?)?;
        }
        Ok(())
    }

    fn add(&mut self, tile: Inspected) -> Result<()> {
        let entry = tile.entry;
        self.done += 1;
        self.index.looked_at += 1;
        self.chunks.join(tile.chunks);
        self.structure.join(tile.structure);
        self.check_order(&entry);
        self.tables.whole &= tile.border.is_some() && tile.table.is_some();
        self.borders.add(entry.id, tile.border)?;
        while self.path.len() > usize::from(entry.id.level) {
            self.leave();
        }
        self.recount.add(self.reader, &entry, tile.valid, tile.range_m);
        if let Some(table) = &tile.table {
            self.recount.add_drawable(&entry, table);
            check_table(&entry, table, self.reader.header(), &mut self.monotone);
            if let Some(parent) = self.path.last() {
                check_parent(parent, &entry, table, &mut self.monotone);
            }
            if self.keep_tables {
                self.tables.by_tile.insert(entry.id, (entry, table.clone()));
            }
        }
        if let Some(parent) = self.path.last() {
            let (outer, inner) = ((parent.entry.min_m, parent.entry.max_m), (entry.min_m, entry.max_m));
            let holds = outer.0 <= inner.0 && outer.1 >= inner.1;
            let place = || Place::tile(parent.entry.id).part("height range");
            self.structure.demand(holds, place, format_args!("one that holds {inner:?}"), format_args!("{outer:?}"));
        }
        let drawable = |table: &ErrorTable| table.drawable.clone();
        let occupied = if entry.is_leaf() { tile.table.as_ref().map(drawable) } else { None };
        let patches = self.reader.header().patches().pow(2) as usize;
        let occupied = occupied.unwrap_or_else(|| vec![false; patches]);
        self.path.push(Node { entry, table: tile.table, occupied });
        Ok(())
    }

    /// All below the last tile of the path was seen.
    fn leave(&mut self) {
        let Some(node) = self.path.pop() else { return };
        if let Some(table) = &node.table {
            self.recount.add_errors(&node.entry, table, &node.occupied);
        }
        let Some(parent) = self.path.last_mut() else { return };
        let side = self.reader.header().patches() as usize;
        for (patch, _) in node.occupied.iter().enumerate().filter(|(_, occupied)| **occupied) {
            parent.occupied[above(node.entry.id, patch, side)] = true;
        }
    }

    /// Chunks stand level by level, within a level in the order of the walk.
    fn check_order(&mut self, entry: &TileEntry) {
        let (start, length) = (entry.chunks.offset, entry.chunks.bytes());
        let run = &mut self.runs[usize::from(entry.id.level)];
        let (first, end) = run.unwrap_or((start, start));
        let place = || Place::tile(entry.id).part("chunk offset");
        self.chunks.demand(start == end, place, format_args!("{end}, where the tile before ends"), start);
        *run = Some((first, start.saturating_add(length)));
    }

    fn finish(mut self, counted: bool) -> Result<(Tables, Vec<Check>)> {
        while !self.path.is_empty() {
            self.leave();
        }
        if counted {
            let mut expected = 0;
            for (level, run) in self.runs.iter().enumerate() {
                let Some((first, end)) = *run else { continue };
                let place = || Place::of(format!("chunks of level {level}"));
                self.chunks.demand(first == expected, place, format_args!("offset {expected}"), first);
                expected = end;
            }
        } else {
            self.index.note = "the index cannot be read to its end; tiles below the damage were not looked at".into();
        }
        self.tables.whole &= counted;
        let statistics = self.recount.check(self.reader, self.tables.whole, self.keep)?;
        let (existence, borders) = (self.borders.existence, self.borders.check);
        let checks =
            vec![self.index, self.chunks, self.structure, existence, borders, self.monotone, statistics];
        Ok((self.tables, checks))
    }
}

/// The parent's patch that holds patch `patch` of a tile of `side x side`.
fn above(id: TileId, patch: usize, side: usize) -> usize {
    let place = |index: usize, bit: u32| ((bit & 1) as usize * side + index) / 2;
    place(patch / side, id.y) * side + place(patch % side, id.x)
}

/// Reads and decodes a tile, and checks what needs no other.
fn inspect(reader: &Reader, entry: TileEntry, keep: usize) -> Result<Inspected> {
    let mut chunks = Check::new("chunks", "bytes", keep);
    let mut structure = Check::new("tiles", "tiles", keep);
    structure.looked_at = 1;
    let place = Place::tile(entry.id);
    let mut sound = true;
    for kind in ChunkKind::ALL {
        chunks.looked_at += u64::from(entry.chunks.chunk(kind).1);
        sound &= chunks.take(reader.raw_chunk(entry.id, kind), place.clone().part(kind.name()))?.is_some();
    }
    let (mut table, mut lattice) = (None, None);
    if sound {
        table = chunks.take(reader.read_errors(entry.id), place.clone())?;
        lattice = match reader.read_tile(entry.id) {
            // A damaged ancestor is reported where it stands.
            Err(Error::Format { place, .. }) if !place.starts_with(&format!("tile {}, ", entry.id)) => None,
            read => chunks.take(read, place)?,
        };
    }
    let header = reader.header();
    let (mut valid, mut range_m) = (0, None);
    if let Some(lattice) = &lattice {
        (valid, range_m) = census(header, entry.id, lattice);
        check_lattice(header, &entry, lattice, range_m, &mut structure);
        if let Some(table) = &table {
            check_drawable(header, &entry, lattice, table, &mut structure);
        }
    }
    if let Some(table) = &table {
        check_index(&entry, table, &mut structure);
    }
    let border = lattice.map(|lattice| Border::of(&lattice));
    Ok(Inspected { entry, table, border, valid, range_m, chunks, structure })
}

/// Valid samples that belong to this tile alone (shared ones belong to the tile that begins with them), and the range of all.
fn census(header: &Header, id: TileId, lattice: &Lattice) -> (u64, Option<(f64, f64)>) {
    let last = (1_u32 << id.level) - 1;
    let (columns, rows) = (lattice.n + usize::from(id.x == last), lattice.n + usize::from(id.y == last));
    let (mut valid, mut range) = (0, None);
    for (at, _) in lattice.state.iter().enumerate().filter(|(_, state)| **state == VALID) {
        let (x, y) = (at % (lattice.n + 1), at / (lattice.n + 1));
        valid += u64::from(x < columns && y < rows);
        let metres = header.metres_of(lattice.code[at], lattice.low_at(at));
        let (low, high) = range.unwrap_or((metres, metres));
        range = Some((metres.min(low), metres.max(high)));
    }
    (valid, range)
}

/// Existence, flags and the height range of a tile against its samples.
fn check_lattice(
    header: &Header,
    entry: &TileEntry,
    lattice: &Lattice,
    range_m: Option<(f64, f64)>,
    check: &mut Check,
) {
    let place = || Place::tile(entry.id);
    let flags = (lattice.state.contains(&VALID), lattice.state.iter().any(|&state| state != VALID));
    let stored = (entry.has_valid, entry.has_void);
    let flag_place = || place().part("flags (valid, void)");
    check.demand(flags == stored, flag_place, format_args!("{flags:?}"), format_args!("{stored:?}"));
    let exists = !entry.is_leaf() || flags.0;
    check.demand(exists, place, "a valid sample in a tile without children", "none");
    let spacing = u64::from(header.spacing(entry.id.level));
    let (left, top) = header.origin(entry.id);
    let half = lattice.n / 2;
    let mut demanded = [false; 4];
    for (at, _) in lattice.state.iter().enumerate().filter(|(_, state)| **state == VALID) {
        let (x, y) = (at % (lattice.n + 1), at / (lattice.n + 1));
        let (column, row) = (left + x as u64 * spacing, top + y as u64 * spacing);
        let inside = column < u64::from(header.width) && row < u64::from(header.height);
        check.demand(inside, || place().sample(column, row), "void outside the raster", "valid");
        for (quadrant, demanded) in demanded.iter_mut().enumerate() {
            let beside = |v: usize, far: bool| if far { v >= half } else { v <= half };
            *demanded |= beside(x, quadrant & 1 != 0) && beside(y, quadrant & 2 != 0);
        }
    }
    for quadrant in (0..4).filter(|&quadrant| !entry.is_leaf() && demanded[usize::from(quadrant)]) {
        let child = || Place::tile(entry.id.child(quadrant));
        check.demand(entry.has_child(quadrant), child, "a tile, for its parent has a valid sample there", "none");
    }
    if let Some((low, high)) = range_m {
        let finite = low.is_finite() && high.is_finite();
        check.demand(finite, || place().part("heights"), "finite ones", format_args!("{low} to {high}"));
        let holds = f64::from(entry.min_m) <= low && f64::from(entry.max_m) >= high;
        let got = format_args!("{} to {}", entry.min_m, entry.max_m);
        check.demand(holds, || place().part("height range"), format_args!("one that holds {low} to {high}"), got);
    }
}

/// The bits that say which patches can be drawn.
fn check_drawable(header: &Header, entry: &TileEntry, lattice: &Lattice, table: &ErrorTable, check: &mut Check) {
    let (patch, side) = (header.patch() as usize, header.patches() as usize);
    for (index, &stored) in table.drawable.iter().enumerate() {
        let (x, y) = (index % side * patch, index / side * patch);
        let mut samples = (y..=y + patch).flat_map(|row| (x..=x + patch).map(move |column| lattice.at(column, row)));
        let drawable = samples.any(|at| lattice.state[at] == VALID);
        let place = || {
            let patch = Some([(index % side) as u32, (index / side) as u32]);
            Place { tile: Some(entry.id), patch, part: "drawable".into(), ..Place::default() }
        };
        check.demand(drawable == stored, place, drawable, stored);
    }
}

/// The index row's errors: the largest of the patches at step 0.
fn check_index(entry: &TileEntry, table: &ErrorTable, check: &mut Check) {
    let patches = table.patches * table.patches;
    for (name, plane, stored) in
        [("vertical error", &table.vertical, entry.vertical), ("horizontal error", &table.horizontal, entry.horizontal)]
    {
        let largest = plane.iter().take(patches).max().copied().unwrap_or(0);
        let place = || Place::tile(entry.id).part(format!("{name} in the index"));
        check.demand(largest == stored, place, format_args!("code {largest}"), format_args!("code {stored}"));
    }
}

/// Errors that never shrink with the step; those of a leaf's step 0.
fn check_table(entry: &TileEntry, table: &ErrorTable, header: &Header, check: &mut Check) {
    let patches = table.patches * table.patches;
    // At step 0 a leaf is its own surface: only quantisation is left.
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

/// A parent's errors at step k are not below its children's at step k + 1.
fn check_parent(parent: &Node, entry: &TileEntry, table: &ErrorTable, check: &mut Check) {
    let Some(over) = &parent.table else { return };
    let (side, patches) = (table.patches, table.patches * table.patches);
    let planes = [("vertical", &over.vertical, &table.vertical), ("horizontal", &over.horizontal, &table.horizontal)];
    for (name, coarse, fine) in planes {
        for (at, &code) in fine.iter().enumerate().skip(patches) {
            let (step, patch) = (at / patches - 1, at % patches);
            let stored = coarse[step * patches + above(entry.id, patch, side)];
            let place =
                || Place::tile(parent.entry.id).patch(above(entry.id, patch, side), side, step).part(name);
            let expected = format_args!("{} m or more, as tile {} has", metres_from_code(code), entry.id);
            check.demand(stored >= code, place, expected, format_args!("{} m", metres_from_code(stored)));
        }
    }
}
