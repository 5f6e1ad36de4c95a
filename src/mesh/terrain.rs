//! The terrain of a file as meshes are made of it: heights by tile, within a window.
//!
//! Heights are *numbers*: codes of integer files, values of float files. Planes through codes are
//! computed without rounding. Outside the window a height is that of the nearest sample in it, so
//! that triangles that reach over its sides have corners; they are cut there later.

use std::ops::Range;

use super::square::{HAS_VALID, HAS_VOID, MIXED, Square, Verdict};
use super::triangle::Triangle;
use super::vertex::Vertex;
use crate::container::layout::{Header, Metric};
use crate::container::{Reader, TileEntry};
use crate::error::{Error, Result};
use crate::rect::Rect;
use crate::sample::{Coding, Lattice, VALID, VOID};
use crate::surface::leaf_at;
use crate::tile::TileId;

/// A window of the lattice by its first and last column, and its first and last row: unlike a
/// [`Rect`] it says where its sides are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Extent {
    /// First and last column.
    pub columns: (u32, u32),
    /// First and last row.
    pub rows: (u32, u32),
}

impl Extent {
    /// A window of a file's raster; `None` is all of it.
    ///
    /// # Errors
    /// [`Error::Usage`] for a window without area, or beyond the raster.
    pub fn of(header: &Header, window: Option<&Rect>) -> Result<Self> {
        let whole = Rect { columns: 0..header.width, rows: 0..header.height };
        let Rect { columns, rows } = window.unwrap_or(&whole);
        let fits = |range: &Range<u32>, size: u32| range.len() >= 2 && range.end <= size;
        if fits(columns, header.width) && fits(rows, header.height) {
            return Ok(Self { columns: (columns.start, columns.end - 1), rows: (rows.start, rows.end - 1) });
        }
        Err(Error::usage(format!(
            "{} x {} samples from column {}, row {} are no area of a raster of {} x {}; a mesh needs 2 x 2",
            columns.len(),
            rows.len(),
            columns.start,
            rows.start,
            header.width,
            header.height
        )))
    }

    /// The same window.
    pub fn rect(&self) -> Rect {
        let range = |(first, last): (u32, u32)| first..last + 1;
        Rect { columns: range(self.columns), rows: range(self.rows) }
    }

    /// True if a vertex lies in it.
    pub fn contains(&self, vertex: Vertex) -> bool {
        let within = |value: u32, (first, last): (u32, u32)| first <= value && value <= last;
        within(vertex.x, self.columns) && within(vertex.y, self.rows)
    }

    /// The vertex of it that is nearest to another.
    pub fn nearest(&self, vertex: Vertex) -> Vertex {
        let limited = |value: u32, (first, last): (u32, u32)| value.clamp(first, last);
        Vertex::new(limited(vertex.x, self.columns), limited(vertex.y, self.rows))
    }

    /// True if it has an area in common with a square.
    pub fn overlaps(&self, (left, top): (i64, i64), side: i64) -> bool {
        let meet = |start: i64, (first, last): (u32, u32)| start < last.into() && start + side > first.into();
        meet(left, self.columns) && meet(top, self.rows)
    }

    /// True if it has an area in common with a triangle.
    pub fn meets(&self, triangle: &Triangle) -> bool {
        let wide = |(first, last): (u32, u32)| (i64::from(first), i64::from(last));
        triangle.overlaps(wide(self.columns), wide(self.rows))
    }

    /// True if all of a square lies in it.
    pub fn covers(&self, (left, top): (i64, i64), side: i64) -> bool {
        let hold =
            |start: i64, (first, last): (u32, u32)| start >= first.into() && start + side <= last.into();
        hold(left, self.columns) && hold(top, self.rows)
    }
}

/// Samples along one side of the window.
struct Line {
    /// Numbers, from the window's first row or column on.
    numbers: Vec<f64>,
    kinds: Vec<u8>,
}

/// The terrain of a file within a window.
pub(super) struct Terrain<'a> {
    /// The file.
    pub reader: &'a Reader,
    /// The window.
    pub extent: Extent,
    /// What triangles may be off by, in numbers.
    pub limit: f64,
    /// Metres of one number.
    pub metres: f64,
    /// The largest number that a height can be, its sign left out.
    pub highest: f64,
    /// What triangles are off by at most, in metres, with what the file's heights were rounded by
    /// and what arithmetic rounds.
    pub promised_m: f64,
    /// West, east, north and south side of the window; `None` where no vertex lies beyond.
    sides: [Option<Line>; 4],
}

impl<'a> Terrain<'a> {
    /// The terrain of a window; triangles may be off by `error_m` metres from the source's samples.
    pub fn new(reader: &'a Reader, extent: Extent, error_m: f64) -> Result<Self> {
        let header = reader.header();
        let metres = metres_of_number(header);
        let kept_of_file =
            error_m - (header.quantisation_error * header.band_scale * header.unit_metres).abs();
        // Planes through floats are rounded; so is the product above.
        let root = reader.entry(TileId::ROOT)?;
        let highest = root.map_or(0.0, |root| f64::from(root.min_m.abs().max(root.max_m.abs())));
        let rounding = if matches!(header.coding, Coding::Integer { .. }) { 0.0 } else { 1e-14 * highest };
        if kept_of_file.is_nan() || kept_of_file < 0.0 {
            return Err(Error::usage(format!(
                "{}: its heights are rounded to within {} m, so no mesh of it has an error of {error_m} m; ask for a larger error",
                reader.path().display(),
                error_m - kept_of_file
            )));
        }
        let kept = (kept_of_file - rounding).max(0.0);
        // Errors of whole numbers are often equal to the limit, which must not be rounded up.
        let limit = kept / metres;
        let limit = if metres.mul_add(limit, -kept) > 0.0 { limit.next_down() } else { limit };
        let promised_m = error_m.max(error_m - kept_of_file + rounding);
        let highest = highest / metres;
        let mut terrain =
            Self { reader, extent, limit, metres, highest, promised_m, sides: [const { None }; 4] };
        let side = terrain.side();
        let Extent { columns, rows } = extent;
        let needs = [columns.0 > 0, columns.1 < side, rows.0 > 0, rows.1 < side];
        for (number, needed) in needs.into_iter().enumerate() {
            if needed {
                terrain.sides[number] = Some(terrain.read_side(number)?);
            }
        }
        Ok(terrain)
    }

    /// Intervals on a side of the lattice.
    pub fn side(&self) -> u32 {
        self.reader.header().tile() << self.reader.header().levels
    }

    /// Corner and side of the square of a tile.
    pub fn square(&self, id: TileId) -> ((i64, i64), i64) {
        let header = self.reader.header();
        let (left, top) = header.origin(id);
        ((left as i64, top as i64), i64::from(header.tile()) * i64::from(header.spacing(id.level)))
    }

    /// What the terrain between the samples of a tile is off by at most, in numbers: 0 in a leaf,
    /// infinite if the index does not tell.
    pub fn between(&self, entry: &TileEntry) -> Result<f64> {
        let header = self.reader.header();
        if entry.is_leaf() {
            if entry.id.level == header.levels {
                return Ok(0.0);
            }
            let what = format!("a mesh of a file with leaves above level {} ({})", header.levels, entry.id);
            return Err(Error::unsupported(what, "build the file again").at(self.reader.path()));
        }
        let (corner, side) = self.square(entry.id);
        let is_known = header.metric == Metric::Bound
            && !entry.has_void
            && entry.horizontal == 0
            && self.extent.covers(corner, side);
        let vertical = f64::from(entry.vertical_m()) / self.metres * (1.0 + 1e-14);
        Ok(if is_known && vertical.is_finite() { vertical } else { f64::INFINITY })
    }

    /// Puts the heights of a tile into `square`.
    pub fn fill(&self, entry: &TileEntry, square: &mut Square) -> Result<()> {
        let header = self.reader.header();
        let (coding, n) = (header.coding, header.tile() as usize);
        let lattice = self.reader.read_tile(entry.id)?;
        square.begin(n);
        square.limit = self.limit;
        square.is_falling = (entry.id.x + entry.id.y).is_multiple_of(2);
        square.between = self.between(entry)?;
        match coding {
            Coding::Integer { .. } => {
                let pairs = square.heights.iter_mut().zip(&lattice.code);
                pairs.for_each(|(height, &code)| *height = f64::from(code));
            }
            _ => {
                for (at, height) in square.heights.iter_mut().enumerate() {
                    *height = lattice.value(at, coding);
                }
            }
        }
        if entry.has_void {
            square.states.clone_from(&lattice.state);
        }
        let ((left, top), side) = self.square(entry.id);
        let spacing = side / n as i64;
        let inside = |start: i64, (first, last): (u32, u32)| {
            let first = (i64::from(first) - start + spacing - 1).div_euclid(spacing).max(0);
            (first, (i64::from(last) - start).div_euclid(spacing).min(n as i64))
        };
        square.place = ((left, top), spacing);
        square.extent = self.extent;
        square.inside = [inside(left, self.extent.columns), inside(top, self.extent.rows)];
        if !self.extent.covers((left, top), side) {
            self.fill_outside(square, (left, top), spacing);
        }
        Ok(())
    }

    /// Puts the nearest heights of the window where a square lies outside it.
    fn fill_outside(&self, square: &mut Square, (left, top): (i64, i64), spacing: i64) {
        let n = square.n as i64;
        let (columns, rows) = (square.inside[0], square.inside[1]);
        for y in 0..=n {
            for x in 0..=n {
                if (columns.0..=columns.1).contains(&x) && (rows.0..=rows.1).contains(&y) {
                    continue;
                }
                let vertex = Vertex::new((left + x * spacing) as u32, (top + y * spacing) as u32);
                let (number, kind) = self.outside(vertex);
                let at = (y * (n + 1) + x) as usize;
                square.heights[at] = number;
                if !square.states.is_empty() {
                    square.states[at] = if kind == HAS_VALID { VALID } else { VOID };
                }
            }
        }
    }

    /// Number and kind of the sample of the window that is nearest to a vertex outside it.
    pub fn outside(&self, vertex: Vertex) -> (f64, u8) {
        let near = self.extent.nearest(vertex);
        let Extent { columns, rows } = self.extent;
        let (side, place) = if vertex.x < columns.0 {
            (0, near.y - rows.0)
        } else if vertex.x > columns.1 {
            (1, near.y - rows.0)
        } else if vertex.y < rows.0 {
            (2, near.x - columns.0)
        } else {
            (3, near.x - columns.0)
        };
        let line = self.sides[side].as_ref();
        line.map_or((0.0, HAS_VOID), |line| (line.numbers[place as usize], line.kinds[place as usize]))
    }

    /// Reads the samples along one side of the window.
    fn read_side(&self, which: usize) -> Result<Line> {
        let Extent { columns, rows } = self.extent;
        let header = self.reader.header();
        let (fixed, (first, last)) = match which {
            0 => (columns.0, rows),
            1 => (columns.1, rows),
            2 => (rows.0, columns),
            _ => (rows.1, columns),
        };
        let place = |along: u32| if which < 2 { (fixed, along) } else { (along, fixed) };
        let mut line = Line { numbers: Vec::new(), kinds: Vec::new() };
        let mut along = first;
        while along <= last {
            // The samples up to the next border of leaf tiles.
            let end = (along / header.tile() + 1).saturating_mul(header.tile()).min(last + 1);
            let (x, y) = place(along);
            let tile = match leaf_at(self.reader, x.into(), y.into())? {
                Some(leaf) => Some((self.square(leaf.id).0, self.reader.read_tile(leaf.id)?)),
                None => None,
            };
            for along in along..end {
                let (x, y) = place(along);
                let (number, kind) = tile.as_ref().map_or((0.0, HAS_VOID), |((left, top), lattice)| {
                    let at = lattice.at((i64::from(x) - left) as usize, (i64::from(y) - top) as usize);
                    (number(lattice, at, header.coding), kind(lattice, at))
                });
                line.numbers.push(number);
                line.kinds.push(kind);
            }
            along = end;
        }
        Ok(line)
    }

    /// What a triangle is off by, from the tile `id` downwards, whose square holds it. `kinds` are
    /// those of its corners.
    pub fn judge(&self, id: TileId, triangle: &Triangle, kinds: &mut u8) -> Result<Verdict> {
        let Some(entry) = self.reader.entry(id)? else {
            *kinds |= HAS_VOID;
            return Ok(if *kinds == MIXED { Verdict::Beyond } else { Verdict::Within(0.0) });
        };
        let between = self.between(&entry)?;
        let lattice = self.reader.read_tile(id)?;
        let most = self.scan(&entry, &lattice, triangle, kinds);
        if most > self.limit || *kinds == MIXED {
            return Ok(Verdict::Beyond);
        }
        if most + between <= self.limit {
            return Ok(Verdict::Within(most + between));
        }
        let mut total = most;
        for child in (0..4).map(|quadrant| id.child(quadrant)) {
            let (corner, side) = self.square(child);
            let (left, top) = corner;
            let is_beside = !triangle.overlaps((left, left + side), (top, top + side));
            if is_beside || !self.extent.overlaps(corner, side) {
                continue;
            }
            match self.judge(child, triangle, kinds)? {
                Verdict::Within(most) => total = total.max(most),
                verdict => return Ok(verdict),
            }
        }
        Ok(Verdict::Within(total))
    }

    /// The largest distance of a triangle from the valid samples of one tile that are in it.
    fn scan(&self, entry: &TileEntry, lattice: &Lattice, triangle: &Triangle, kinds: &mut u8) -> f64 {
        let coding = self.reader.header().coding;
        let ((left, top), side) = self.square(entry.id);
        let spacing = side / lattice.n as i64;
        let common = |start: i64, (first, last): (u32, u32)| {
            (start.max(first.into()), (start + side).min(last.into()))
        };
        let (columns, rows) = (common(left, self.extent.columns), common(top, self.extent.rows));
        let up = |value: i64, start: i64| (value - start + spacing - 1).div_euclid(spacing);
        let down = |value: i64, start: i64| (value - start).div_euclid(spacing);
        let plane = triangle.plane();
        let mut most = 0.0_f64;
        for part in triangle.parts() {
            for row in up(rows.0.max(part.rows.0), top)..=down(rows.1.min(part.rows.1), top) {
                let y = top + row * spacing;
                let step = y - part.rows.0;
                let first = up((part.left.0 + part.left.1 * step).max(columns.0), left);
                let last = down((part.right.0 + part.right.1 * step).min(columns.1), left);
                for column in first..=last {
                    let at = lattice.at(column as usize, row as usize);
                    if entry.has_void && lattice.state[at] != VALID {
                        *kinds |= HAS_VOID;
                        continue;
                    }
                    *kinds |= HAS_VALID;
                    let off = number(lattice, at, coding) - plane.height(left + column * spacing, y);
                    most = most.max(off.abs());
                }
            }
            if most > self.limit {
                break;
            }
        }
        most
    }
}

/// Metres of one number of a file.
pub(super) fn metres_of_number(header: &Header) -> f64 {
    let scale = match header.coding {
        Coding::Integer { scale, .. } => scale,
        Coding::Float32 | Coding::Float64 => 1.0,
    };
    (scale * header.band_scale * header.unit_metres).abs()
}

/// Height in metres of a number.
pub(super) fn height_of_number(header: &Header, number: f64) -> f64 {
    header.metres(match header.coding {
        Coding::Integer { scale, offset } => offset + scale * number,
        Coding::Float32 | Coding::Float64 => number,
    })
}

/// The number of a sample.
#[inline]
pub(super) fn number(lattice: &Lattice, at: usize, coding: Coding) -> f64 {
    match coding {
        Coding::Integer { .. } => f64::from(lattice.code[at]),
        Coding::Float32 | Coding::Float64 => lattice.value(at, coding),
    }
}

/// The kind of a sample.
pub(super) fn kind(lattice: &Lattice, at: usize) -> u8 {
    if lattice.state[at] == VALID { HAS_VALID } else { HAS_VOID }
}
