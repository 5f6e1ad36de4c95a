//! Vertices of the 4-8 mesh of a square lattice: where they stand says what they split.
//!
//! The lattice has `N = 2^K` intervals on a side. A vertex at column `x`, row `y` has the *scale*
//! `s`, the largest power of two that divides both. It is the midpoint of the longest side of the
//! two triangles that it splits (one at the border of the lattice):
//! - a *centre* (`x` and `y` odd multiples of `s`) of the diagonal of a cell of `2 s`;
//! - an *edge vertex* (one of them an even multiple) of a side of length `2 s`.
//!
//! Its *parents* are the vertices at the right angles of those triangles: they must be in the mesh
//! before it can be. (Papers 002, section 3, and 004, section 3, which name other centres; the
//! meshes are the same.)

/// Column and row of a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Vertex {
    /// Column, from the west.
    pub x: u32,
    /// Row, from the north.
    pub y: u32,
}

impl Vertex {
    /// The vertex of this column and row.
    pub fn new(x: u32, y: u32) -> Self {
        Self { x, y }
    }

    /// Its scale; 2^31 for the north-western corner, which every power of two divides.
    pub fn scale(self) -> u32 {
        let both = self.x | self.y;
        if both == 0 { 1 << 31 } else { both & both.wrapping_neg() }
    }

    /// The vertices at the right angles of the triangles that it splits, in a lattice of `side`
    /// intervals; none for the corners of the lattice.
    pub fn parents(self, side: u32) -> impl Iterator<Item = Self> {
        let (Self { x, y }, s) = (self, self.scale());
        let is_corner = s >= side;
        let pairs = if x & s != 0 && y & s != 0 {
            let step = s.trailing_zeros() + 1;
            let is_falling = (x >> step).wrapping_add(y >> step) & 1 == 0;
            let (up, down) = (y.wrapping_sub(s), y.wrapping_add(s));
            let (west, east) = (x.wrapping_sub(s), x.wrapping_add(s));
            if is_falling { [(east, up), (west, down)] } else { [(west, up), (east, down)] }
        } else if x & s != 0 {
            [(x, y.wrapping_sub(s)), (x, y.wrapping_add(s))]
        } else {
            [(x.wrapping_sub(s), y), (x.wrapping_add(s), y)]
        };
        let within = move |&(x, y): &(u32, u32)| !is_corner && x <= side && y <= side;
        pairs.into_iter().filter(within).map(|(x, y)| Self { x, y })
    }

    /// The point halfway to another vertex, with which it shares a side of a triangle that can be
    /// split.
    pub fn middle(self, other: Self) -> Self {
        let half = |a: u32, b: u32| ((u64::from(a) + u64::from(b)) / 2) as u32;
        Self { x: half(self.x, other.x), y: half(self.y, other.y) }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use super::*;

    /// Splits triangles from the two of the whole square on, and notes for each midpoint the
    /// vertices at the right angles.
    #[test]
    fn parents_are_the_right_angles_of_the_triangles_that_a_vertex_splits() {
        let side = 16;
        let at = Vertex::new;
        let mut stack =
            vec![[at(0, 0), at(side, 0), at(side, side)], [at(side, side), at(0, side), at(0, 0)]];
        let mut expected: BTreeMap<Vertex, BTreeSet<Vertex>> = BTreeMap::new();
        while let Some([a, apex, b]) = stack.pop() {
            let far = a.x.abs_diff(b.x).max(a.y.abs_diff(b.y));
            if far < 2 {
                continue;
            }
            let middle = a.middle(b);
            expected.entry(middle).or_default().insert(apex);
            stack.push([apex, middle, a]);
            stack.push([b, middle, apex]);
        }
        assert_eq!(expected.len(), 17 * 17 - 4, "every vertex but the corners splits something");
        for (vertex, parents) in expected {
            assert_eq!(vertex.parents(side).collect::<BTreeSet<_>>(), parents, "{vertex:?}");
        }
        assert_eq!(at(0, side).parents(side).count(), 0);
        assert_eq!(at(0, 0).parents(side).count(), 0);
    }
}
