//! Checks tile by tile in the order of the index: chunks, flags, error tables, shared borders, and
//! bounds of parents over their children.
//!
//! Memory holds a batch of tiles and the borders that wait for neighbours, whatever the size of the
//! file; `deep` also keeps the error tables.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::borders::{Border, Borders};
use super::range::Hull;
use super::report::{Check, Place};
use super::statistics::Recount;
use super::tables::{above, check_drawable, check_index, check_parent, check_table};
use super::{VerifyOptions, hints, values};
use crate::codec::table::ErrorTable;
use crate::container::directory::{ChunkKind, TileEntry};
use crate::container::layout::Header;
use crate::container::reader::Reader;
use crate::error::{Error, Result};
use crate::progress::{Progress, Stage};
use crate::sample::{Lattice, VALID};
use crate::tile::TileId;

/// Tiles decoded at a time.
const BATCH: usize = 64;

/// Index rows and error tables of the tiles, for later checks.
#[derive(Default)]
pub(super) struct Tables {
    /// Entries by tile; empty unless requested.
    pub by_tile: BTreeMap<TileId, (TileEntry, ErrorTable)>,
    /// True if every tile could be read.
    pub whole: bool,
}

/// The result of inspecting one tile, on any thread.
struct Inspected {
    entry: TileEntry,
    table: Option<ErrorTable>,
    border: Option<Border>,
    /// Number of valid samples that no other tile counts, and the range of all valid samples in
    /// metres.
    valid: u64,
    range_m: Option<(f64, f64)>,
    /// Hull of all samples; `None` if they could not be decoded.
    hull: Option<Hull>,
    chunks: Check,
    structure: Check,
}

/// A tile on the path from the root to the current one.
struct Node {
    entry: TileEntry,
    table: Option<ErrorTable>,
    /// For each patch, whether a valid sample lies on or below it.
    occupied: Vec<bool>,
    /// Hull of its own samples and of its children's ranges in the index.
    hull: Option<Hull>,
}

/// Checks all tiles; returns the checks in report order.
pub(super) fn check(
    reader: &Reader,
    options: &VerifyOptions,
    progress: &dyn Progress,
) -> Result<(Tables, Vec<Check>)> {
    let mut checker = TileChecker::new(reader, options);
    let total = reader.header().tile_count;
    let walked = reader.walk(&mut |entry| {
        checker.batch.push(*entry);
        if checker.batch.len() == BATCH {
            checker.work_off()?;
            progress.step(Stage::Tiles, checker.done, total)?;
        }
        Ok(())
    });
    checker.work_off()?;
    progress.step(Stage::Tiles, checker.done, total)?;
    let counted = checker.index.take(walked, Place::of("index"))?.is_some();
    checker.finish(counted)
}

struct TileChecker<'a> {
    reader: &'a Reader,
    keep_tables: bool,
    batch: Vec<TileEntry>,
    done: u64,
    tables: Tables,
    /// Nodes from the root to the last tile.
    path: Vec<Node>,
    borders: Borders<'a>,
    recount: Recount,
    /// First and end offset of each level's chunks, from the start of the tiles section.
    runs: Vec<Option<(u64, u64)>>,
    index: Check,
    chunks: Check,
    structure: Check,
    monotone: Check,
    keep: usize,
}

impl<'a> TileChecker<'a> {
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

    /// Checks the tiles of the batch: in parallel where tiles are independent, then in order.
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
            self.finish_tile();
        }
        self.recount.add(self.reader, &entry, tile.valid, tile.range_m);
        if let Some(table) = &tile.table {
            self.recount.add_drawable(&entry, table);
            check_table(&entry, table, self.reader.header(), &mut self.monotone);
            if let Some(Node { entry: parent, table: Some(over), .. }) = self.path.last() {
                check_parent(parent.id, over, &entry, table, &mut self.monotone);
            }
            if self.keep_tables {
                self.tables.by_tile.insert(entry.id, (entry, table.clone()));
            }
        }
        if let Some(parent) = self.path.last_mut() {
            parent.hull.iter_mut().for_each(|hull| hull.join_range(&entry));
        }
        if let Some(parent) = self.path.last() {
            let (outer, inner) = ((parent.entry.min_m, parent.entry.max_m), (entry.min_m, entry.max_m));
            let holds = outer.0 <= inner.0 && outer.1 >= inner.1;
            let place = || Place::tile(parent.entry.id).part("height range");
            self.structure.demand(
                holds,
                place,
                format_args!("one that holds {} to {}", inner.0, inner.1),
                format_args!("{} to {}", outer.0, outer.1),
            );
        }
        let drawable = |table: &ErrorTable| table.drawable.clone();
        let occupied = if entry.is_leaf() { tile.table.as_ref().map(drawable) } else { None };
        let patches = self.reader.header().patches().pow(2) as usize;
        let occupied = occupied.unwrap_or_else(|| vec![false; patches]);
        self.path.push(Node { entry, table: tile.table, occupied, hull: tile.hull });
        Ok(())
    }

    /// Finishes the last tile of the path, all of whose descendants were checked.
    fn finish_tile(&mut self) {
        let Some(node) = self.path.pop() else { return };
        if let Some(table) = &node.table {
            self.recount.add_errors(&node.entry, table, &node.occupied);
        }
        if let Some(hull) = node.hull {
            hull.check(&node.entry, &mut self.structure);
        }
        let Some(parent) = self.path.last_mut() else { return };
        let side = self.reader.header().patches() as usize;
        for (patch, _) in node.occupied.iter().enumerate().filter(|(_, occupied)| **occupied) {
            parent.occupied[above(node.entry.id, patch, side)] = true;
        }
    }

    /// Checks that chunks are stored level by level, and within a level in the order of the index.
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
            self.finish_tile();
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
            self.index.note =
                "the index cannot be read to its end; tiles below the damage were not looked at".into();
        }
        self.tables.whole &= counted;
        let statistics = self.recount.check(self.reader, self.tables.whole, self.keep)?;
        let (existence, borders) = (self.borders.existence, self.borders.check);
        let checks =
            vec![self.index, self.chunks, self.structure, existence, borders, self.monotone, statistics];
        Ok((self.tables, checks))
    }
}

/// Reads and decodes a tile, and makes the checks that need no other tile.
fn inspect(reader: &Reader, entry: TileEntry, keep: usize) -> Result<Inspected> {
    let mut chunks = Check::new("chunks", "bytes", keep);
    let mut structure = Check::new("tiles", "tiles", keep);
    structure.looked_at = 1;
    let place = Place::tile(entry.id);
    let (mut sound, mut heights) = (true, Vec::new());
    for kind in ChunkKind::ALL {
        chunks.looked_at += u64::from(entry.chunks.chunk(kind).1);
        let chunk = chunks.take(reader.raw_chunk(entry.id, kind), place.clone().part(kind.name()))?;
        sound &= chunk.is_some();
        if kind == ChunkKind::Heights {
            heights = chunk.unwrap_or_default();
        }
    }
    let (mut table, mut lattice) = (None, None);
    if sound {
        table = chunks.take(reader.read_errors(entry.id), place.clone())?;
        lattice = match reader.read_tile(entry.id) {
            // Damage of an ancestor is reported with the ancestor.
            Err(Error::Format { place, .. }) if !place.starts_with(&format!("tile {}, ", entry.id)) => None,
            read => chunks.take(read, place)?,
        };
    }
    let header = reader.header();
    let (mut valid, mut range_m) = (0, None);
    if let Some(lattice) = &lattice {
        (valid, range_m) = census(header, entry.id, lattice);
        check_lattice(header, &entry, lattice, range_m, &mut structure);
        values::check(header, &entry, lattice, &mut structure);
        hints::check_narrow(header, &entry, &heights, lattice, &mut structure)?;
        if let Some(table) = &table {
            check_drawable(header, &entry, lattice, table, &mut structure);
        }
    }
    if let Some(table) = &table {
        check_index(&entry, table, &mut structure);
    }
    let hull = lattice.as_deref().map(|lattice| Hull::of_all(header, lattice));
    let border = lattice.map(|lattice| Border::of(&lattice));
    Ok(Inspected { entry, table, border, valid, range_m, hull, chunks, structure })
}

/// Number of valid samples that this tile owns (shared ones are owned by the tile they begin), and
/// the range of all its valid samples.
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

/// Checks existence, flags and the height range of a tile against its samples.
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
    let flag_place = || place().part("flags");
    let words = |(valid, void): (bool, bool)| {
        let word = |is: bool| if is { "some" } else { "none" };
        format!("{} valid, {} void", word(valid), word(void))
    };
    check.demand(flags == stored, flag_place, words(flags), words(stored));
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
        check.demand(
            entry.has_child(quadrant),
            child,
            "a tile, for its parent has a valid sample there",
            "none",
        );
    }
    if let Some((low, high)) = range_m {
        let holds = f64::from(entry.min_m) <= low && f64::from(entry.max_m) >= high;
        let got = format_args!("{} to {}", entry.min_m, entry.max_m);
        check.demand(
            holds,
            || place().part("height range"),
            format_args!("one that holds {low} to {high}"),
            got,
        );
    }
}
