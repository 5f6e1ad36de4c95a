//! Lies for files: takes a container apart as `format-spec.md` says, lets a test change any of it,
//! and puts it together with all checksums right.
//!
//! Shares no code with the library. Files of one index page only.

use std::path::Path;

use serde_json::Value;

/// Columns of an index page behind `children`: bytes of an element.
const WIDTHS: [usize; 12] = [1, 2, 2, 4, 4, 8, 4, 4, 4, 4, 4, 4];

pub const METADATA: u32 = 1;
const ROOT_PAGE: u32 = 2;
pub const STATISTICS: u32 = 3;
const TILES: u32 = 5;

/// A file in parts.
pub struct Parts {
    /// The 256 bytes at its start.
    pub header: Vec<u8>,
    /// Kind, flags, content (as stored).
    pub sections: Vec<(u32, u32, Vec<u8>)>,
    pub rows: Vec<Row>,
}

/// A row of the index, with the tile's chunks as stored.
#[derive(Clone)]
pub struct Row {
    pub level: u8,
    pub x: u32,
    pub y: u32,
    pub children: u8,
    pub flags: u8,
    pub vertical: u16,
    pub horizontal: u16,
    pub min_m: f32,
    pub max_m: f32,
    /// Heights, mask, errors.
    pub chunks: [Vec<u8>; 3],
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

pub fn unpack(frame: &[u8]) -> Vec<u8> {
    zstd::decode_all(frame).unwrap()
}

/// A frame that states its size.
pub fn pack(content: &[u8]) -> Vec<u8> {
    zstd::bulk::compress(content, 3).unwrap()
}

impl Parts {
    pub fn read(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let count = u32_at(&bytes, 20) as usize;
        let mut sections = Vec::new();
        for at in (0..count).map(|i| 256 + 32 * i) {
            let (offset, length) = (u64_at(&bytes, at + 8) as usize, u64_at(&bytes, at + 16) as usize);
            sections.push((
                u32_at(&bytes, at),
                u32_at(&bytes, at + 4),
                bytes[offset..offset + length].to_vec(),
            ));
        }
        let mut parts = Self { header: bytes[..256].to_vec(), sections, rows: Vec::new() };
        parts.rows = parts.read_rows();
        parts
    }

    fn section(&mut self, kind: u32) -> &mut Vec<u8> {
        &mut self.sections.iter_mut().find(|section| section.0 == kind).unwrap().2
    }

    fn read_rows(&mut self) -> Vec<Row> {
        let page = unpack(self.section(ROOT_PAGE));
        let tiles = self.section(TILES).clone();
        let n = u32_at(&page, 12) as usize;
        let starts: Vec<usize> = WIDTHS
            .iter()
            .scan(16 + n, |at, width| {
                let start = *at;
                *at += n * width;
                Some(start)
            })
            .collect();
        let mut ids = vec![(0_u8, 0_u32, 0_u32)];
        let rows: Vec<Row> = (0..n)
            .map(|i| {
                let field = |column: usize| &page[starts[column] + i * WIDTHS[column]..][..WIDTHS[column]];
                let short = |column: usize| u16::from_le_bytes(field(column).try_into().unwrap());
                let word = |column: usize| u32::from_le_bytes(field(column).try_into().unwrap());
                let (level, x, y) = ids[i];
                let children = page[16 + i];
                for q in (0..4).filter(|q| children >> q & 1 != 0) {
                    ids.push((level + 1, 2 * x + (q & 1), 2 * y + (q >> 1)));
                }
                let mut at = u64_at(&page, starts[5] + 8 * i) as usize;
                let chunks = [6, 7, 8].map(|column| {
                    let start = at;
                    at += word(column) as usize;
                    tiles[start..at].to_vec()
                });
                let (min_m, max_m) = (f32::from_bits(word(3)), f32::from_bits(word(4)));
                Row {
                    level,
                    x,
                    y,
                    children,
                    flags: field(0)[0],
                    vertical: short(1),
                    horizontal: short(2),
                    min_m,
                    max_m,
                    chunks,
                }
            })
            .collect();
        assert!(rows.iter().all(|row| row.level < 5), "files of one page only");
        rows
    }

    /// The row of a tile.
    pub fn row(&mut self, level: u8, x: u32, y: u32) -> &mut Row {
        self.rows.iter_mut().find(|row| (row.level, row.x, row.y) == (level, x, y)).unwrap()
    }

    /// Takes a leaf out of the index.
    pub fn leave_out(&mut self, level: u8, x: u32, y: u32) {
        self.rows.retain(|row| (row.level, row.x, row.y) != (level, x, y));
        self.row(level - 1, x / 2, y / 2).children &= !(1 << (x % 2 + 2 * (y % 2)));
        let count = self.rows.len() as u64;
        self.header[152..160].copy_from_slice(&count.to_le_bytes());
    }

    /// Changes a JSON section.
    pub fn json(&mut self, kind: u32, edit: impl FnOnce(&mut Value)) {
        let packed = kind == STATISTICS;
        let section = self.section(kind);
        let text = if packed { unpack(section) } else { section.clone() };
        let mut value: Value = serde_json::from_slice(&text).unwrap();
        edit(&mut value);
        let text = serde_json::to_vec(&value).unwrap();
        *section = if packed { pack(&text) } else { text };
    }

    /// Sets a field of the header.
    pub fn set(&mut self, at: usize, bytes: &[u8]) {
        self.header[at..at + bytes.len()].copy_from_slice(bytes);
    }

    /// Changes an f64 of the header.
    pub fn double(&mut self, at: usize, edit: impl FnOnce(f64) -> f64) {
        let old = f64::from_le_bytes(self.header[at..at + 8].try_into().unwrap());
        self.set(at, &edit(old).to_le_bytes());
    }

    /// Writes the file with all checksums, lengths and places right.
    pub fn write(mut self, path: &Path) {
        self.write_rows();
        let table_end = 256 + 32 * self.sections.len();
        let (mut table, mut body) = (Vec::new(), Vec::new());
        for (kind, flags, content) in &self.sections {
            let crc = if flags & 2 != 0 { crc32fast::hash(content) } else { 0 };
            table.extend(kind.to_le_bytes());
            table.extend(flags.to_le_bytes());
            table.extend(((table_end + body.len()) as u64).to_le_bytes());
            table.extend((content.len() as u64).to_le_bytes());
            table.extend(crc.to_le_bytes());
            table.extend([0; 4]);
            body.extend(content);
        }
        let length = (table_end + body.len()) as u64;
        self.set(24, &length.to_le_bytes());
        let crc = crc32fast::hash(&[&self.header[..252], &table].concat());
        self.set(252, &crc.to_le_bytes());
        std::fs::write(path, [self.header, table, body].concat()).unwrap();
    }

    fn write_rows(&mut self) {
        // Chunks stand level by level, within a level in the order of the curve.
        let rows = std::mem::take(&mut self.rows);
        let mut order: Vec<usize> = (0..rows.len()).collect();
        order.sort_by_key(|&i| (rows[i].level, hilbert(rows[i].level, rows[i].x, rows[i].y)));
        let (mut tiles, mut offsets) = (Vec::new(), vec![0_u64; rows.len()]);
        for i in order {
            offsets[i] = tiles.len() as u64;
            rows[i].chunks.iter().for_each(|chunk| tiles.extend(chunk));
        }
        let old = unpack(self.section(ROOT_PAGE));
        let mut page = old[..12].to_vec();
        page.extend((rows.len() as u32).to_le_bytes());
        page.extend(rows.iter().map(|row| row.children));
        page.extend(rows.iter().map(|row| row.flags));
        page.extend(rows.iter().flat_map(|row| row.vertical.to_le_bytes()));
        page.extend(rows.iter().flat_map(|row| row.horizontal.to_le_bytes()));
        page.extend(rows.iter().flat_map(|row| row.min_m.to_le_bytes()));
        page.extend(rows.iter().flat_map(|row| row.max_m.to_le_bytes()));
        page.extend(offsets.iter().flat_map(|offset| offset.to_le_bytes()));
        for kind in 0..3 {
            page.extend(rows.iter().flat_map(|row| (row.chunks[kind].len() as u32).to_le_bytes()));
        }
        for kind in 0..3 {
            page.extend(rows.iter().flat_map(|row| crc32fast::hash(&row.chunks[kind]).to_le_bytes()));
        }
        *self.section(ROOT_PAGE) = pack(&page);
        *self.section(TILES) = tiles;
    }
}

/// Section 7 of the specification.
fn hilbert(level: u8, mut x: u32, mut y: u32) -> u64 {
    let mut d = 0;
    for bit in (0..level).rev() {
        let side = 1_u32 << bit;
        let (rx, ry) = (x >> bit & 1, y >> bit & 1);
        d += u64::from(side) * u64::from(side) * u64::from((3 * rx) ^ ry);
        (x, y) = (x % side, y % side);
        if ry == 0 {
            if rx == 1 {
                (x, y) = (side - 1 - x, side - 1 - y);
            }
            (x, y) = (y, x);
        }
    }
    d
}
