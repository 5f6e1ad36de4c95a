//! The samples of a parent from its four children: every second one, unchanged.

use crate::sample::{Lattice, VOID};

/// Sets `out` to the even samples of a tile, which its parent takes over.
pub fn halve(child: &Lattice, out: &mut Lattice) {
    out.n = child.n / 2;
    even(&child.code, child.n, &mut out.code);
    even(&child.low, child.n, &mut out.low);
    even(&child.state, child.n, &mut out.state);
}

/// Every second sample of every second row of a plane of `n` intervals.
fn even<T: Copy>(plane: &[T], n: usize, out: &mut Vec<T>) {
    out.clear();
    out.reserve_exact(if plane.is_empty() { 0 } else { (n / 2 + 1) * (n / 2 + 1) });
    for row in plane.chunks_exact(n + 1).step_by(2) {
        out.extend(row.chunks_exact(2).map(|pair| pair[0]));
        out.extend(row.last());
    }
}

/// Copies the halved child of quadrant `quadrant` into its parent's lattice.
///
/// Children share a row and a column of the parent. A sample there is void in both or valid in
/// both; a fill that only one of them knows is kept.
pub fn place(half: &Lattice, quadrant: u8, parent: &mut Lattice) {
    let (x0, y0) = (usize::from(quadrant & 1) * half.n, usize::from(quadrant >> 1) * half.n);
    for j in 0..=half.n {
        let (from, to) = (half.at(0, j), parent.at(x0, y0 + j));
        let (from, to) = (from..=from + half.n, to..=to + half.n);
        let state = &half.state[from.clone()];
        if !state.contains(&VOID) {
            parent.state[to.clone()].copy_from_slice(state);
            parent.code[to.clone()].copy_from_slice(&half.code[from.clone()]);
            if !parent.low.is_empty() {
                parent.low[to].copy_from_slice(&half.low[from]);
            }
            continue;
        }
        for (from, to) in from.zip(to) {
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
