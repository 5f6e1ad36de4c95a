//! Four children to their parent: every second sample, untouched.

use crate::sample::{Coding, Lattice, VOID};

/// The even samples of a tile: what its parent takes over.
pub fn halve(child: &Lattice, coding: Coding) -> Lattice {
    let mut half = Lattice::new(child.n / 2, coding);
    for j in 0..=half.n {
        for i in 0..=half.n {
            let (from, to) = (child.at(2 * i, 2 * j), half.at(i, j));
            half.state[to] = child.state[from];
            half.code[to] = child.code[from];
            if let Some(low) = half.low.get_mut(to) {
                *low = child.low_at(from);
            }
        }
    }
    half
}

/// Puts the halved child of quadrant `quadrant` into its parent's lattice.
///
/// Children share a row and a column of the parent. A sample there is void in both or valid in both; a fill that only one of
/// them knows is kept.
pub fn place(half: &Lattice, quadrant: u8, parent: &mut Lattice) {
    let (x0, y0) = (usize::from(quadrant & 1) * half.n, usize::from(quadrant >> 1) * half.n);
    for j in 0..=half.n {
        for i in 0..=half.n {
            let (from, to) = (half.at(i, j), parent.at(x0 + i, y0 + j));
            if half.state[from] != VOID {
                parent.state[to] = half.state[from];
                parent.code[to] = half.code[from];
                if let Some(low) = parent.low.get_mut(to) {
                    *low = half.low_at(from);
                }
            }
        }
    }
}
