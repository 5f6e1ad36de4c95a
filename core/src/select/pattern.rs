//! The triangles of a patch: index meshes that are built once, and the choice of those that draw a
//! patch of given inner and outer steps.
//!
//! A patch of P = 2^p intervals has (P + 1)^2 vertices, numbered row by row from the north-west:
//! `y * (P + 1) + x`. Step `k` uses every `2^k`-th. A patch whose edges are all at its inner step
//! is one uniform grid. Otherwise it is the grid without its outer ring of cells, and four *strips*
//! of border cells; the corner cells are cut along their diagonals. A strip is stored for the north
//! side; [`turned`] gives the others. Triangles run clockwise on the map (x east, y south), so they
//! face up in a frame with z up.
//!
//! ```text
//! +---+---+---+---+     N  the strip of the north edge; turned, it gives E, S and W
//! |\ N| N | N |N /|     I  the interior: the cells that do not touch the border
//! |W\ |   |   | /E|
//! +---+---+---+---+     A cell of a strip beside a finer edge:
//! | W | I | I | E |
//! +---+---+---+---+     a--n--b
//! | W | I | I | E |     |\ | /|     n  a vertex of the finer edge, in the middle of the side
//! +---+---+---+---+     | \|/ |     m  the centre of the cell
//! |W/ |   |   | \E|     |  m  |
//! |/ S| S | S |S \|     | / \ |
//! +---+---+---+---+     |/   \|
//!                       +-----+
//! ```
//!
//! [`EdgeRule::Shared`]: an outer step is the inner one or the next finer. Along a finer edge every
//! border cell is cut by both diagonals at its centre, and the triangle at the edge once more:
//! bisections of a 4-8 mesh (paper 002, section 3). A strip beside a strip that is cut like that
//! shares the centre of the corner cell. [`EdgeRule::Paper`]: outer steps are free, as those of a
//! hardware tessellator (paper 001, section 4); the ring is triangulated between both borders, like
//! a zip.

/// The rule for the step of an edge that two patches share.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum EdgeRule {
    /// The finer of the steps of both sides, which differ by at most one.
    #[default]
    Shared,
    /// Papers 000 and 001: between patches of a tile the finer of the two; along a tile's edge all
    /// vertices of the coarser tile.
    Paper,
}

/// A run of triangles in [`Meshes::indices`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Mesh {
    /// Its first index.
    pub first: u32,
    /// Indices, three to a triangle.
    pub count: u32,
}

/// All index meshes of one patch size.
#[derive(Clone, Debug)]
pub struct Meshes {
    /// Binary logarithm of the patch size, `p`.
    pub patch_log2: u8,
    /// The meshes by *bucket*; see [`Meshes::full`], [`Meshes::interior`], [`Meshes::strip`],
    /// [`Meshes::zip`]. Some are empty.
    pub buckets: Vec<Mesh>,
    /// Vertex numbers.
    pub indices: Vec<u16>,
}

/// A piece of a patch: a bucket, and its rotation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Piece {
    /// Index into [`Meshes::buckets`].
    pub bucket: u32,
    /// Quarter turns clockwise: 0 north, 1 east, 2 south, 3 west.
    pub turn: u8,
}

/// Vertex (x, y) of a patch of `side` intervals after `turn` quarter turns clockwise.
pub fn turned((x, y): (u32, u32), side: u32, turn: u8) -> (u32, u32) {
    match turn & 3 {
        0 => (x, y),
        1 => (side - y, x),
        2 => (side - x, side - y),
        _ => (y, side - x),
    }
}

type Corner = (u32, u32);

impl Meshes {
    /// All meshes of patches of `2^p` intervals, `p` in 2..=6. Bucket numbers depend on `p` alone;
    /// a shader computes them in the same way.
    pub fn new(p: u8) -> Self {
        let mut meshes = Self { patch_log2: p, buckets: Vec::new(), indices: Vec::new() };
        for k in 0..=p {
            meshes.push(uniform(p, k, 0, false));
        }
        meshes.push(uniform(p, p, 0, true));
        for k in 0..=p {
            meshes.push(if k + 2 <= p { uniform(p, k, 1, false) } else { Vec::new() });
        }
        for k in 0..=p {
            for variant in 0..5 {
                meshes.push(strip(p, k, variant));
            }
        }
        for inner in 0..=p {
            for outer in 0..=p {
                meshes.push(if inner < p { zip(p, inner, outer) } else { Vec::new() });
            }
        }
        meshes
    }

    fn push(&mut self, triangles: Vec<[Corner; 3]>) {
        let row = (1_u32 << self.patch_log2) + 1;
        let first = self.indices.len() as u32;
        self.indices.extend(triangles.iter().flatten().map(|&(x, y)| (y * row + x) as u16));
        self.buckets.push(Mesh { first, count: self.indices.len() as u32 - first });
    }

    /// Bucket of the whole patch at step `k`; `odd` matters for `k = p` only: the parity of patch
    /// column + row over the level.
    pub fn full(p: u8, k: u8, odd: bool) -> u32 {
        u32::from(k) + u32::from(k == p && odd)
    }

    /// Bucket of the cells at step `k` that do not touch the border.
    pub fn interior(p: u8, k: u8) -> u32 {
        u32::from(p) + 2 + u32::from(k)
    }

    /// Bucket of border cells at inner step `k`. Variant 4: the edge is one step finer. Variants
    /// 0..4: it is not; bit 0 says that the strip to the left (north side: the west one) is of
    /// variant 4, bit 1 the one to the right.
    pub fn strip(p: u8, k: u8, variant: u8) -> u32 {
        2 * u32::from(p) + 3 + 5 * u32::from(k) + u32::from(variant)
    }

    /// Bucket of the triangles between the inner cells at step `inner`, below `p`, and the border
    /// at step `outer`.
    pub fn zip(p: u8, inner: u8, outer: u8) -> u32 {
        let p = u32::from(p);
        2 * p + 3 + 5 * (p + 1) + (p + 1) * u32::from(inner) + u32::from(outer)
    }

    /// The pieces that draw a patch at step `inner` with edges at `outer` (north, east, south,
    /// west).
    ///
    /// With [`EdgeRule::Shared`] outer steps are `inner` or `inner - 1`.
    pub fn pieces(
        p: u8,
        inner: u8,
        outer: [u8; 4],
        odd: bool,
        rule: EdgeRule,
    ) -> impl Iterator<Item = Piece> {
        let (inner, outer) = (inner.min(p), outer.map(|k| k.min(p)));
        let whole = outer == [inner; 4];
        // A patch with a zip has at least two cells on a side, as with a hardware tessellator.
        let ring = if rule == EdgeRule::Paper { inner.min(p - 1) } else { inner };
        let finer = outer.map(|k| k < inner);
        let middle = Piece {
            bucket: if whole { Self::full(p, inner, odd) } else { Self::interior(p, ring) },
            turn: 0,
        };
        let side = move |turn: u8| {
            let at = usize::from(turn);
            let bucket = match rule {
                EdgeRule::Paper => Self::zip(p, ring, outer[at]),
                EdgeRule::Shared if finer[at] => Self::strip(p, inner, 4),
                EdgeRule::Shared if inner == p => Self::strip(p, p, 3),
                EdgeRule::Shared => {
                    Self::strip(p, inner, u8::from(finer[(at + 3) & 3]) | u8::from(finer[(at + 1) & 3]) << 1)
                }
            };
            Piece { bucket, turn }
        };
        std::iter::once(middle).chain((0..if whole { 0 } else { 4 }).map(side))
    }

    /// The triangles of a bucket, as corners (x, y) of the patch.
    pub fn triangles(&self, piece: Piece) -> impl Iterator<Item = [(u32, u32); 3]> + '_ {
        let side = 1_u32 << self.patch_log2;
        let mesh = self.buckets.get(piece.bucket as usize).copied().unwrap_or_default();
        let indices = &self.indices[mesh.first as usize..(mesh.first + mesh.count) as usize];
        indices.chunks_exact(3).map(move |three| {
            std::array::from_fn(|i| {
                let index = u32::from(three[i]);
                turned((index % (side + 1), index / (side + 1)), side, piece.turn)
            })
        })
    }
}

/// The two triangles of a cell.
fn cell(out: &mut Vec<[Corner; 3]>, (x, y): Corner, s: u32, falling: bool) {
    let (a, b, c, d) = ((x, y), (x + s, y), (x, y + s), (x + s, y + s));
    out.extend(if falling { [[a, b, d], [a, d, c]] } else { [[a, b, c], [b, d, c]] });
}

/// Cells at step `k`, `margin` cells off the border.
fn uniform(p: u8, k: u8, margin: u32, odd: bool) -> Vec<[Corner; 3]> {
    let (s, cells) = (1 << k, 1_u32 << (p - k));
    let mut out = Vec::new();
    for row in margin..cells.saturating_sub(margin) {
        for column in margin..cells.saturating_sub(margin) {
            cell(&mut out, (column * s, row * s), s, (column + row).is_multiple_of(2) != odd);
        }
    }
    out
}

/// Border cells of the north side at inner step `k`; of the corner cells only the part above the
/// diagonal.
fn strip(p: u8, k: u8, variant: u8) -> Vec<[Corner; 3]> {
    let (s, cells) = (1_u32 << k, 1_u32 << (p - k));
    let half = s / 2;
    let mut out = Vec::new();
    if k == 0 && variant > 0 {
        return out;
    }
    if k == p {
        // One cell: its four triangles meet at the centre.
        let centre = (half, half);
        match variant {
            3 => out.push([(0, 0), (s, 0), centre]),
            4 => out.extend([[(0, 0), (half, 0), centre], [(half, 0), (s, 0), centre]]),
            _ => {}
        }
        return out;
    }
    for column in 0..cells {
        let x = column * s;
        let (first, last) = (column == 0, column + 1 == cells);
        let (a, b, c, d, m) = ((x, 0), (x + s, 0), (x, s), (x + s, s), (x + half, half));
        let split = variant == 4 || first && variant & 1 != 0 || last && variant & 2 != 0;
        if !split && !first && !last {
            cell(&mut out, a, s, column.is_multiple_of(2));
            continue;
        }
        if !split {
            out.push(if first { [a, b, d] } else { [a, b, c] });
            continue;
        }
        if variant == 4 {
            out.extend([[a, (x + half, 0), m], [(x + half, 0), b, m]]);
        } else {
            out.push([a, b, m]);
        }
        if !last {
            out.push([b, d, m]);
        }
        if !first {
            out.push([c, a, m]);
        }
        if !first && !last {
            out.push([d, c, m]);
        }
    }
    out
}

/// Triangles between the northern border at step `outer` and the line one cell of step `inner`
/// inside.
fn zip(p: u8, inner: u8, outer: u8) -> Vec<[Corner; 3]> {
    let side = 1_u32 << p;
    let (s, t) = (1_u32 << inner, 1_u32 << outer);
    let mut out = Vec::new();
    let (mut border, mut ring) = (0, s);
    let end = side - s;
    while border < side || ring < end {
        // The next triangle takes the side whose next vertex is nearer to the west; both middles
        // decide, so that the strip is its own mirror image.
        let along_border = ring >= end || border < side && 2 * border + t <= 2 * ring + s;
        if along_border {
            out.push([(border, 0), (border + t, 0), (ring, s)]);
            border += t;
        } else {
            out.push([(border, 0), (ring + s, s), (ring, s)]);
            ring += s;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// Twice the signed area; positive for triangles that are clockwise on the map.
    fn area(t: &[Corner; 3]) -> i64 {
        let [a, b, c] = t.map(|(x, y)| (i64::from(x), i64::from(y)));
        (b.0 - a.0) * (c.1 - a.1) - (c.0 - a.0) * (b.1 - a.1)
    }

    fn all(meshes: &Meshes, inner: u8, outer: [u8; 4], odd: bool, rule: EdgeRule) -> Vec<[Corner; 3]> {
        Meshes::pieces(meshes.patch_log2, inner, outer, odd, rule)
            .flat_map(|piece| meshes.triangles(piece))
            .collect()
    }

    /// Every edge of a triangle is the edge of exactly one other, the other way round, or lies on
    /// the border.
    fn conforms(triangles: &[[Corner; 3]], p: u8, outer: [u8; 4]) {
        let side = 1_u32 << p;
        let mut edges: BTreeMap<(Corner, Corner), i32> = BTreeMap::new();
        let mut sum = 0;
        for t in triangles {
            assert!(area(t) > 0, "{t:?} is turned over");
            sum += area(t);
            for i in 0..3 {
                *edges.entry((t[i], t[(i + 1) % 3])).or_default() += 1;
            }
        }
        assert_eq!(sum, 2 * i64::from(side).pow(2), "the patch is covered once");
        let mut border = [0_u32; 4];
        for (&(a, b), &count) in &edges {
            assert_eq!(count, 1);
            if edges.contains_key(&(b, a)) {
                continue;
            }
            let at = [
                a.1 == 0 && b.1 == 0,
                a.0 == side && b.0 == side,
                a.1 == side && b.1 == side,
                a.0 == 0 && b.0 == 0,
            ];
            let Some(at) = at.iter().position(|&is| is) else { panic!("{a:?} to {b:?} has one side only") };
            assert_eq!(a.0.abs_diff(b.0) + a.1.abs_diff(b.1), 1 << outer[at]);
            border[at] += 1;
        }
        for at in 0..4 {
            assert_eq!(border[at] << outer[at], side, "side {at}");
        }
    }

    #[test]
    fn every_patch_of_either_rule_is_a_conforming_mesh_with_the_edges_asked_for() {
        for p in 2..=6_u8 {
            let meshes = Meshes::new(p);
            assert!(meshes.indices.iter().all(|&i| u32::from(i) < ((1 << p) + 1_u32).pow(2)));
            for inner in 0..=p {
                for mask in 0..16_u8 {
                    if inner == 0 && mask != 0 {
                        continue;
                    }
                    let outer: [u8; 4] = std::array::from_fn(|i| inner - (mask >> i & 1));
                    for odd in [false, true] {
                        conforms(&all(&meshes, inner, outer, odd, EdgeRule::Shared), p, outer);
                    }
                }
                let n = p + 1;
                for code in 0..u32::from(n).pow(4) {
                    // All four sides, thinned out where there are many.
                    if p > 3 && code % 37 != 0 {
                        continue;
                    }
                    let outer: [u8; 4] =
                        std::array::from_fn(|i| (code / u32::from(n).pow(i as u32) % u32::from(n)) as u8);
                    conforms(&all(&meshes, inner, outer, false, EdgeRule::Paper), p, outer);
                }
            }
        }
    }

    /// Triangles of the shared rule are those of a 4-8 mesh: right and isosceles, of a uniform step
    /// or of half of one.
    #[test]
    fn the_shared_rule_draws_triangles_of_a_4_8_mesh() {
        for p in 2..=5_u8 {
            let meshes = Meshes::new(p);
            for inner in 1..=p {
                let uniform: Vec<Vec<[Corner; 3]>> = [inner, inner - 1]
                    .iter()
                    .map(|&k| all(&meshes, k, [k; 4], false, EdgeRule::Shared))
                    .collect();
                let sorted = |t: &[Corner; 3]| {
                    let mut t = *t;
                    t.sort_unstable();
                    t
                };
                let known: Vec<_> = uniform.iter().flatten().map(sorted).collect();
                let s = 1_u32 << inner;
                for mask in 1..16_u8 {
                    let outer: [u8; 4] = std::array::from_fn(|i| inner - (mask >> i & 1));
                    for t in all(&meshes, inner, outer, false, EdgeRule::Shared) {
                        // Half a step: two corners of a cell that are `s` apart, and its centre.
                        let half = area(&t) == i64::from(s).pow(2) / 2
                            && t.iter().filter(|(x, y)| x % s == 0 && y % s == 0).count() == 2;
                        assert!(half || known.contains(&sorted(&t)), "{t:?} of step {inner}, {outer:?}");
                    }
                }
            }
        }
    }
}
