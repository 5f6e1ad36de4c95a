//! A sparse raster and its pyramid, straight from the words of section 2: slow, and an oracle for
//! that.

use std::collections::{BTreeSet, HashMap};
use std::path::Path;

use relevo::TileId;
use relevo::codec::{self, Scratch, table::ErrorTable};
use relevo::container::layout::{Header, Metric, leaf_level};
use relevo::container::metadata::{LevelStatistics, Metadata, Statistics};
use relevo::sample::{Coding, FILLED, Lattice, SampleType, VALID, VOID};
use relevo::writer::{ContainerWriter, FileSummary, TileChunks, TileRecord};

/// A random number generator of a few lines: the same numbers everywhere.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    pub fn below(&mut self, end: u64) -> u64 {
        (self.next() >> 11) % end
    }

    pub fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

pub const INTEGER: Coding = Coding::Integer { scale: 0.5, offset: 100.0 };

/// Valid samples (code and low) by column and row.
pub struct Raster {
    pub header: Header,
    pub valid: HashMap<(u64, u64), (i32, u32)>,
}

impl Raster {
    pub fn new(width: u32, height: u32, coding: Coding) -> Self {
        let header = Header {
            width,
            height,
            tile_log2: 4,
            patch_log2: 2,
            levels: leaf_level(width, height, 16),
            metric: Metric::Bound,
            coding,
            source_type: match coding {
                Coding::Integer { .. } => SampleType::Int16,
                Coding::Float32 => SampleType::Float32,
                Coding::Float64 => SampleType::Float64,
            },
            band_scale: 2.0,
            band_offset: 1.0,
            unit_metres: 0.5,
            quantisation_error: 0.0,
            nodata: Some(-9999.0),
            transform: Some([1000.0, 3.0, 1.0, 2000.0, 0.5, -2.0]),
            version: 2,
            tile_count: 1,
        };
        Self { header, valid: HashMap::new() }
    }

    /// A bumpy raster with holes.
    pub fn bumpy(width: u32, height: u32, coding: Coding, seed: u64) -> Self {
        let mut raster = Self::new(width, height, coding);
        let mut random = Random(seed);
        for row in 0..u64::from(height) {
            for column in 0..u64::from(width) {
                let (x, y) = (column as f64, row as f64);
                let hole = (x * 0.21).sin() + (y * 0.17).cos() > 1.1 || random.below(30) == 0;
                let value = 200.0 * (x * 0.1).sin() * (y * 0.13).cos() + random.unit();
                if !hole {
                    raster.valid.insert((column, row), code_of(value, coding));
                }
            }
        }
        raster
    }

    /// A few samples in a large void: long thin branches of the tree.
    pub fn sparse(side: u32, count: u64, seed: u64) -> Self {
        let mut raster = Self::new(side, side, INTEGER);
        let mut random = Random(seed);
        for index in 0..count {
            let place = (random.below(side.into()), random.below(side.into()));
            raster.valid.insert(place, (index as i32 * 7 - 30, 0));
        }
        raster
    }

    /// Code, low and state of a sample of the root square.
    pub fn sample(&self, column: u64, row: u64) -> (i32, u32, u8) {
        if let Some(&(code, low)) = self.valid.get(&(column, row)) {
            return (code, low, VALID);
        }
        let side = u64::from(self.header.tile()) << self.header.levels;
        let mut spacing = 1;
        while spacing <= side && column.is_multiple_of(spacing) && row.is_multiple_of(spacing) {
            let mut around = Vec::new();
            for (dx, dy) in [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)] {
                let x = column.checked_add_signed(dx * spacing as i64);
                let y = row.checked_add_signed(dy * spacing as i64);
                around.extend(x.zip(y).and_then(|place| self.valid.get(&place)));
            }
            around.sort_unstable();
            if !around.is_empty() {
                let (code, low) = around[(around.len() - 1) / 2];
                return (code, low, FILLED);
            }
            spacing *= 2;
        }
        (0, 0, VOID)
    }

    pub fn lattice(&self, id: TileId) -> Lattice {
        let mut lattice = Lattice::new(self.header.tile() as usize, self.header.coding);
        let (left, top) = self.header.origin(id);
        let spacing = u64::from(self.header.spacing(id.level));
        for y in 0..=lattice.n {
            for x in 0..=lattice.n {
                let at = lattice.at(x, y);
                let (code, low, state) = self.sample(left + x as u64 * spacing, top + y as u64 * spacing);
                (lattice.code[at], lattice.state[at]) = (code, state);
                if self.header.coding.has_low() {
                    lattice.low[at] = low;
                }
            }
        }
        lattice
    }

    /// The tiles that exist: those whose closed square holds a valid sample.
    pub fn existing(&self) -> Vec<TileId> {
        let mut ids = BTreeSet::new();
        for &(column, row) in self.valid.keys() {
            for level in 0..=self.header.levels {
                let side = u64::from(self.header.tile()) * u64::from(self.header.spacing(level));
                let of = |place: u64| {
                    let before = place.is_multiple_of(side) && place > 0;
                    let last = (1_u64 << level) - 1;
                    [Some(place / side), before.then(|| place / side - 1)]
                        .into_iter()
                        .flatten()
                        .filter(move |&tile| tile <= last)
                };
                for x in of(column) {
                    for y in of(row) {
                        ids.insert(TileId::new(level, x as u32, y as u32));
                    }
                }
            }
        }
        ids.into_iter().filter(|&id| self.header.holds(id)).collect()
    }

    /// Records and chunks of all tiles.
    pub fn tiles(&self) -> Vec<(TileRecord, TileChunks)> {
        let ids = self.existing();
        let there: std::collections::HashSet<_> = ids.iter().copied().collect();
        let mut scratch = Scratch::default();
        let mut tile = |&id: &TileId| {
            let lattice = self.lattice(id);
            let root = id.level == 0;
            let mut chunks = TileChunks::default();
            let occupancy = codec::mask::encode(&lattice, root, &mut scratch, &mut chunks.mask).unwrap();
            codec::height::encode(
                (&lattice, codec::height::Fills::Any),
                self.header.coding,
                root,
                &mut scratch,
                &mut chunks.heights,
            )
            .unwrap();
            codec::table::encode(&self.errors(id), &mut chunks.errors).unwrap();
            let children = (0..4).filter(|&q| there.contains(&id.child(q))).fold(0, |bits, q| bits | 1 << q);
            let record = TileRecord {
                id,
                children,
                has_valid: occupancy.has_valid,
                has_void: occupancy.has_void,
                vertical: 300 - u16::from(id.level),
                horizontal: u16::from(id.level),
                min_m: -1e6 + (id.x % 1000) as f32,
                max_m: 1e6 - (id.y % 1000) as f32,
            };
            (record, chunks)
        };
        ids.iter().map(&mut tile).collect()
    }

    /// Some error table, other for every tile.
    pub fn errors(&self, id: TileId) -> ErrorTable {
        let (patches, steps) = (self.header.patches() as usize, self.header.steps() as usize);
        let count = patches * patches;
        let code = |index: usize| (index as u16 * 3).wrapping_add(id.x as u16 % 1000);
        ErrorTable {
            patches,
            steps,
            drawable: (0..count).map(|patch| patch % 3 != id.y as usize % 3).collect(),
            vertical: (0..count * steps).map(code).collect(),
            horizontal: (0..count * steps).map(|index| code(index) / 2).collect(),
        }
    }

    pub fn metadata() -> Metadata {
        Metadata { tool: "test".into(), vertical_unit: "ell".into(), ..Metadata::default() }
    }

    pub fn statistics(&self) -> Statistics {
        let level = |level| LevelStatistics { level, tiles: 7, ..LevelStatistics::default() };
        Statistics { levels: (0..=self.header.levels).map(level).collect() }
    }

    pub fn write(&self, path: &Path) -> FileSummary {
        self.write_in_order(path, |_| {})
    }

    pub fn write_in_order(
        &self,
        path: &Path,
        order: impl FnOnce(&mut Vec<(TileRecord, TileChunks)>),
    ) -> FileSummary {
        let mut tiles = self.tiles();
        order(&mut tiles);
        let mut writer = ContainerWriter::create(path, false).unwrap();
        for (record, chunks) in &tiles {
            writer.append(record, chunks).unwrap();
        }
        writer.finish(&self.header, &Self::metadata(), &self.statistics()).unwrap()
    }
}

fn code_of(value: f64, coding: Coding) -> (i32, u32) {
    match coding {
        Coding::Integer { .. } => (value as i32, 0),
        Coding::Float32 => (relevo::sample::code_from_f32(value as f32), 0),
        Coding::Float64 => relevo::sample::code_from_f64(value),
    }
}

/// A lattice as a reader sees it: states are valid or void, codes without a meaning are left out.
pub fn seen(lattice: &Lattice, oracle: &Lattice) -> Vec<Option<(bool, i32, u32)>> {
    let sample = |at: usize| {
        let valid = lattice.state[at] == VALID;
        (oracle.state[at] != VOID || valid).then(|| (valid, lattice.code[at], lattice.low_at(at)))
    };
    (0..lattice.code.len()).map(sample).collect()
}
