//! The parts of a tile that selection and a renderer keep: its row of the index, its error table in
//! metres of the frame, its heights.

use super::half_steps::{self, BorderCells, Covered, MAX_MISDRAW, STEPS};
use super::view::Frame;
use crate::codec::table::ErrorTable;
use crate::container::{Header, TileEntry};
use crate::error::{Error, Result};
use crate::error_code::metres_from_code;
use crate::geo::{CrsKind, Geo};
use crate::sample::{Coding, Lattice, SampleType, VALID};
use crate::tile::TileId;

/// A tile's row of the index, in metres of the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// Bit `q` is set if child `q` exists.
    pub children: u8,
    /// Vertical error at full resolution of the tile, metres, not exaggerated.
    pub vertical: f32,
    /// Horizontal error at full resolution, in metres of the frame.
    pub horizontal: f32,
    /// Lowest height, metres.
    pub low: f32,
    /// Greatest height, metres.
    pub high: f32,
}

impl Node {
    /// The node of a row of the index. Its errors are no smaller than those of any patch of the
    /// tile's [`TileTable`] at step 0.
    pub fn new(header: &Header, geo: &Geo, frame: &Frame, entry: &TileEntry) -> Self {
        let horizontal = f64::from(entry.horizontal_m());
        // Half of the last bit of a height as f32.
        let rounding = f64::from(entry.min_m.abs().max(entry.max_m.abs())) * f64::from(f32::EPSILON) / 2.0;
        let vertical = f64::from(entry.vertical_m()) + if is_exact(header) { 0.0 } else { rounding };
        let scaled =
            if horizontal > 0.0 { horizontal * frame_scale(header, geo, frame, entry.id) } else { 0.0 };
        Self {
            children: entry.children,
            vertical: round_up(vertical),
            horizontal: round_up(scaled),
            low: entry.min_m,
            high: entry.max_m,
        }
    }
}

/// True if all heights in metres are exact as f32.
fn is_exact(header: &Header) -> bool {
    let metres = header.band_scale == 1.0 && header.band_offset == 0.0 && header.unit_metres == 1.0;
    let small = match header.source_type {
        SampleType::Int32 | SampleType::Uint32 => false,
        _ => header.coding == Coding::Integer { scale: 1.0, offset: 0.0 },
    };
    metres && (small || header.coding == Coding::Float32)
}

/// Error tables of a loaded tile, covering every mesh that [`super::pattern`] draws with
/// [`super::EdgeRule::Shared`].
///
/// They are the errors of the file, enlarged by the errors of half-step triangles (from step 1 on),
/// by the rounding of heights to f32, and where the metres of the frame are longer than those of
/// the tile. Around voids of a tile that is not a leaf they are larger than necessary: at some
/// border cells only the range of all heights below, `low` to `high`, bounds the part that a
/// half-step triangle hides.
#[derive(Clone, Debug, PartialEq)]
pub struct TileTable {
    /// The tile.
    pub id: TileId,
    /// Patches on a side.
    pub patches: u32,
    /// Steps, `p + 1`.
    pub steps: u32,
    /// Vertical errors in metres, by step, patch row, patch column; not exaggerated.
    pub vertical: Vec<f32>,
    /// Horizontal errors in metres of the frame, in the same order.
    pub horizontal: Vec<f32>,
    /// Lowest height, in metres, in or below each patch.
    pub low: Vec<f32>,
    /// Greatest height, in metres, in or below each patch.
    pub high: Vec<f32>,
    /// True for each patch with a valid sample; the others are not drawn.
    pub drawable: Vec<bool>,
}

/// A tile, ready to be uploaded.
#[derive(Clone, Debug, PartialEq)]
pub struct TileData {
    /// The table for selection.
    pub table: TileTable,
    /// Intervals on a side, T.
    pub n: u32,
    /// Heights in metres, `(T + 1)^2`, row by row from the north-west; void samples have their
    /// fill.
    pub heights: Vec<f32>,
    /// 1 where a sample is valid, 0 where it is void.
    pub valid: Vec<u8>,
}

impl TileData {
    /// The data of a decoded tile and its error table. Fails if the table or the lattice has not
    /// the size of this file.
    pub fn new(
        header: &Header,
        geo: &Geo,
        frame: &Frame,
        entry: &TileEntry,
        lattice: &Lattice,
        table: &ErrorTable,
    ) -> Result<Self> {
        check(header, entry.id, lattice, table)?;
        let heights = Heights::new(header, entry, lattice);
        let table = heights.table(header, geo, frame, entry, table);
        Ok(Self { table, n: header.tile(), heights: heights.metres, valid: heights.valid })
    }
}

/// Fails unless all planes have the sizes that the header calls for.
fn check(header: &Header, id: TileId, lattice: &Lattice, table: &ErrorTable) -> Result<()> {
    let demand = |what: &str, expected: usize, got: usize| {
        if expected == got { Ok(()) } else { Err(Error::format(format!("tile {id}, {what}"), expected, got)) }
    };
    let n = header.tile() as usize;
    let samples = (n + 1).pow(2);
    demand("intervals on a side", n, lattice.n)?;
    demand("heights", samples, lattice.code.len())?;
    demand("states", samples, lattice.state.len())?;
    demand("low halves", if header.coding.has_low() { samples } else { 0 }, lattice.low.len())?;
    let (patches, steps) = (header.patches() as usize, header.steps() as usize);
    demand("patches on a side of the error table", patches, table.patches)?;
    demand("steps of the error table", steps, table.steps)?;
    demand("flags of patches", patches.pow(2), table.drawable.len())?;
    demand("vertical errors", steps * patches.pow(2), table.vertical.len())?;
    demand("horizontal errors", steps * patches.pow(2), table.horizontal.len())
}

/// Heights of a tile as they are drawn.
pub(crate) struct Heights {
    /// In metres.
    pub metres: Vec<f32>,
    /// 1 where a sample is valid.
    pub valid: Vec<u8>,
    /// How far each height was moved to fit an f32; empty if none was moved.
    moved: Vec<f32>,
}

impl Heights {
    /// The heights of a decoded tile.
    pub fn new(header: &Header, entry: &TileEntry, lattice: &Lattice) -> Self {
        let (low, high) = (finite(entry.min_m), finite(entry.max_m).max(finite(entry.min_m)));
        let valid: Vec<u8> = lattice.state.iter().map(|&state| u8::from(state == VALID)).collect();
        let exact = |at: usize| header.metres_of(lattice.code[at], lattice.low_at(at));
        let mut differs = false;
        let metres: Vec<f32> = valid
            .iter()
            .enumerate()
            .map(|(at, &valid)| {
                let exact = exact(at);
                let height = match exact as f32 {
                    height if valid != 0 => finite(height),
                    height if height.is_nan() => low,
                    // Fills that are drawn lie in this range; the height of any other void sample
                    // means nothing.
                    height => height.clamp(low, high),
                };
                differs |= exact != f64::from(height);
                height
            })
            .collect();
        let mut moved = Vec::new();
        if differs {
            let inside = |exact: f64| f64::from(entry.min_m) <= exact && exact <= f64::from(entry.max_m);
            let off = |(at, &metres): (usize, &f32)| {
                let exact = exact(at);
                let counts = valid[at] != 0 || inside(exact);
                if counts { round_up((exact - f64::from(metres)).abs()) } else { 0.0 }
            };
            moved = metres.iter().enumerate().map(off).collect();
        }
        Self { metres, valid, moved }
    }

    fn table(
        &self,
        header: &Header,
        geo: &Geo,
        frame: &Frame,
        entry: &TileEntry,
        file: &ErrorTable,
    ) -> TileTable {
        let (n, m, steps) = (header.tile() as usize, file.patches, file.steps);
        let holed = self.valid.contains(&0);
        let leaf = entry.is_leaf();
        let quantised = header.metres(header.quantisation_error) - header.metres(0.0);
        let range = (f64::from(entry.min_m) - quantised.abs(), f64::from(entry.max_m) + quantised.abs());
        let near = if leaf && holed { half_steps::near(&self.valid, n) } else { Vec::new() };
        let odd = (entry.id.x ^ entry.id.y) & 1 != 0;
        let border = BorderCells { n, heights: &self.metres, valid: &self.valid, leaf, odd, range, near };
        let scale = frame_scale(header, geo, frame, entry.id);
        let misdraw = MAX_MISDRAW * f64::from(header.spacing(entry.id.level)) * frame.dx.max(frame.dy);
        let count = m * m;
        let mut table = TileTable {
            id: entry.id,
            patches: m as u32,
            steps: steps as u32,
            vertical: vec![0.0; steps * count],
            horizontal: vec![0.0; steps * count],
            low: vec![0.0; count],
            high: vec![0.0; count],
            drawable: file.drawable.clone(),
        };
        for patch in 0..count {
            let side = n / m;
            let start = patch / m * side * (n + 1) + patch % m * side;
            let rows = || (0..=side).map(|y| start + y * (n + 1)).map(|at| at..=at + side);
            let mixed = holed && rows().any(|row| self.valid[row].contains(&0));
            let moved = if self.moved.is_empty() {
                0.0
            } else {
                rows().flat_map(|row| &self.moved[row]).fold(0.0, |most: f32, &moved| most.max(moved))
            };
            let own: [f64; STEPS] =
                std::array::from_fn(|k| metres(file.vertical[k.min(steps - 1) * count + patch]));
            let (mut vertical, mut horizontal) = (0.0, 0.0_f64);
            for k in 0..steps {
                let mut covered = Covered { vertical: own[k].max(vertical), outline: false };
                if k > 0 {
                    let patch = half_steps::Patch { start, side, mixed, errors: &own };
                    covered = border.step(&patch, k, covered.vertical);
                }
                vertical = covered.vertical;
                let misdrawn = metres(file.horizontal[k * count + patch]);
                horizontal = horizontal.max(if misdrawn > 0.0 { misdrawn * scale } else { 0.0 });
                if covered.outline {
                    horizontal = horizontal.max(misdraw * f64::from(1_u32 << k));
                }
                table.vertical[k * count + patch] = round_up(vertical + f64::from(moved));
                table.horizontal[k * count + patch] = round_up(horizontal);
            }
            (table.low[patch], table.high[patch]) =
                self.range(rows(), mixed && !leaf, entry, own[0] + f64::from(moved));
        }
        table
    }

    /// Range of the full resolution over a patch. If `unknown`, the full resolution may be shown
    /// where the tile is void, and only the range of all heights below the tile is known.
    fn range<'a>(
        &'a self,
        rows: impl Iterator<Item = std::ops::RangeInclusive<usize>> + 'a,
        unknown: bool,
        entry: &TileEntry,
        error: f64,
    ) -> (f32, f32) {
        let (least, most) = (finite(entry.min_m), finite(entry.max_m));
        if unknown || !error.is_finite() {
            return (least, most);
        }
        let heights = rows.flat_map(|row| &self.metres[row]);
        let (low, high) =
            heights.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &z| (low.min(z), high.max(z)));
        let down = -round_up(error - f64::from(low));
        (down.clamp(least, most.max(least)), round_up(f64::from(high) + error).clamp(least, most.max(least)))
    }
}

/// Metres of an error code; infinite for an invalid code, which bounds nothing.
fn metres(code: u16) -> f64 {
    let metres = f64::from(metres_from_code(code));
    if metres.is_nan() { f64::INFINITY } else { metres }
}

fn finite(height: f32) -> f32 {
    if height.is_nan() { 0.0 } else { height.clamp(f32::MIN, f32::MAX) }
}

/// The least f32 that is no smaller.
fn round_up(value: f64) -> f32 {
    let nearest = value as f32;
    if f64::from(nearest) < value { nearest.next_up() } else { nearest }
}

/// Greatest ratio of metres of the frame to metres that the file measured in a tile or below it.
///
/// The file measures a displacement of i columns and j rows as `hypot(i dx, j dy)` or more, for the
/// spacing of some of its rows.
fn frame_scale(header: &Header, geo: &Geo, frame: &Frame, id: TileId) -> f64 {
    let side = u64::from(header.tile()) * u64::from(header.spacing(id.level));
    let (left, top) = header.origin(id);
    let span = |first: u64, samples: u32| {
        let last = u64::from(samples - 1);
        (first.min(last) as u32, (first + side).min(last) as u32)
    };
    let (dx, dy) = least_spacing(geo, span(left, header.width), span(top, header.height));
    // The factor covers the rounding of both quotients.
    (frame.dx / dx).max(frame.dy / dy) * (1.0 + 1e-9)
}

/// Metres of a column and of a row where they are smallest; [`Geo::spacing`] has the largest.
fn least_spacing(geo: &Geo, columns: (u32, u32), rows: (u32, u32)) -> (f64, f64) {
    let [_, a, b, _, d, e] = geo.transform_or_identity();
    let (mut mx, mut my) = (geo.crs.unit, geo.crs.unit);
    if geo.crs.kind == CrsKind::Geographic {
        let quarter = std::f64::consts::FRAC_PI_2;
        let corners = [(columns.0, rows.0), (columns.1, rows.0), (columns.0, rows.1), (columns.1, rows.1)];
        let latitudes = corners.map(|(c, r)| {
            (geo.world_from_sample(f64::from(c), f64::from(r)).1 * geo.crs.unit).clamp(-quarter, quarter)
        });
        let (south, north) =
            latitudes.iter().fold((quarter, -quarter), |(s, n), &lat| (lat.min(s), lat.max(n)));
        let nearest = if south <= 0.0 && north >= 0.0 { 0.0 } else { south.abs().min(north.abs()) };
        // A parallel is shortest nearest a pole; a meridian's arc is shortest nearest the equator.
        mx *= geo.crs.ellipsoid.metres_of_radian(south.abs().max(north.abs())).0;
        my *= geo.crs.ellipsoid.metres_of_radian(nearest).1;
    }
    ((a * mx).hypot(d * my), (b * mx).hypot(e * my))
}
