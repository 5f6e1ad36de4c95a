//! Fill heights of void samples that stand at an outline (`format-spec.md`, section 2).
//!
//! The fill of a sample is the lower median of its valid neighbours at the finest spacing that has any: a function of the
//! whole lattice, not of a tile, so that tiles agree on shared samples. A leaf tile settles spacings 1 to T; at each
//! coarser level only one spacing is new, T, and only the four corners are born that coarse. What a
//! tile looks at never reaches farther than its eight neighbours.

use crate::sample::{FILLED, Lattice, VALID, VOID};

/// A tile's lattice amid its eight neighbours, `[row][column]`, the tile itself at `[1][1]`. All of one size.
pub struct Neighbourhood<'a>(pub [[Option<&'a Lattice>; 3]; 3]);

/// A fill to be written: index in the lattice, code, low.
pub type Fill = (usize, i32, u32);

impl Neighbourhood<'_> {
    /// State, code and low at `(x, y)`, each -n..=2n from the tile's own north-west corner.
    fn sample(&self, n: usize, x: isize, y: isize) -> (u8, i32, u32) {
        let size = n as isize;
        // Column 0..=n belongs to the tile itself; its own samples win over the neighbours' copies.
        let place = |v: isize| {
            if v < 0 {
                (0, v + size)
            } else if v <= size {
                (1, v)
            } else {
                (2, v - size)
            }
        };
        let ((tx, i), (ty, j)) = (place(x), place(y));
        match self.0[ty][tx] {
            Some(lattice) => {
                let at = lattice.at(i as usize, j as usize);
                (lattice.state[at], lattice.code[at], lattice.low_at(at))
            }
            None => (VOID, 0, 0),
        }
    }

    /// Fills of the tile's void samples that are settled at spacings `from..=to` (powers of two, in samples of this level), plus
    /// those that a neighbour's copy of a border sample already has.
    pub fn fills(&self, from: usize, to: usize) -> Vec<Fill> {
        let mut fills = Vec::new();
        let Some(tile) = self.0[1][1] else { return fills };
        if !tile.state.contains(&VOID) {
            return fills;
        }
        let mut open: Vec<bool> = tile.state.iter().map(|&state| state == VOID).collect();
        self.adopt(tile, &mut open, &mut fills);
        let mut waiting = waiting(tile, &open, from);
        let mut spacing = from;
        while spacing <= to && !waiting.is_empty() {
            waiting.retain(|&(x, y)| {
                let median = self.median(tile, x, y, spacing);
                fills.extend(median.map(|(code, low)| (tile.at(x, y), code, low)));
                // The next spacing looks at every second column and row.
                median.is_none() && (x | y) & spacing == 0
            });
            spacing *= 2;
        }
        fills
    }

    /// Border samples whose fill a neighbouring tile has from its own children.
    fn adopt(&self, tile: &Lattice, open: &mut [bool], fills: &mut Vec<Fill>) {
        let n = tile.n;
        let border = (0..=n).flat_map(|i| [(i, 0), (i, n), (0, i), (n, i)]);
        for (x, y) in border {
            let index = tile.at(x, y);
            if !open[index] {
                continue;
            }
            for (ty, row) in self.0.iter().enumerate() {
                for (tx, neighbour) in row.iter().enumerate() {
                    let (Some(other), Some(i), Some(j)) = (neighbour, mirror(x, tx, n), mirror(y, ty, n))
                    else {
                        continue;
                    };
                    let at = other.at(i, j);
                    if open[index] && other.state[at] == FILLED {
                        open[index] = false;
                        fills.push((index, other.code[at], other.low_at(at)));
                    }
                }
            }
        }
    }

    /// Lower median of the valid samples among the eight at distance `spacing`.
    fn median(&self, tile: &Lattice, x: usize, y: usize, spacing: usize) -> Option<(i32, u32)> {
        let inside = |v: usize| v >= spacing && v + spacing <= tile.n;
        let mut found = [(0, 0); 8];
        let mut count = 0;
        if inside(x) && inside(y) {
            let (at, down) = (tile.at(x, y), spacing * (tile.n + 1));
            let around = [
                at - down - spacing,
                at - down,
                at - down + spacing,
                at - spacing,
                at + spacing,
                at + down - spacing,
                at + down,
                at + down + spacing,
            ];
            // Most void samples of a large void have none.
            for at in around {
                if tile.state[at] == VALID {
                    found[count] = (tile.code[at], tile.low_at(at));
                    count += 1;
                }
            }
        } else {
            let (s, x, y) = (spacing as isize, x as isize, y as isize);
            for (dx, dy) in [(-s, -s), (0, -s), (s, -s), (-s, 0), (s, 0), (-s, s), (0, s), (s, s)] {
                let (state, code, low) = self.sample(tile.n, x + dx, y + dy);
                if state == VALID {
                    found[count] = (code, low);
                    count += 1;
                }
            }
        }
        let found = &mut found[..count];
        found.sort_unstable();
        found.get(count.checked_sub(1)? / 2).copied()
    }
}

/// Column and row of the open samples in every `spacing`-th column and row, row by row.
fn waiting(tile: &Lattice, open: &[bool], spacing: usize) -> Vec<(usize, usize)> {
    let mut waiting = Vec::new();
    for (y, row) in open.chunks_exact(tile.n + 1).enumerate().step_by(spacing) {
        // Few rows have any, and few parts of them.
        for (first, part) in (0..).step_by(64).zip(row.chunks(64)) {
            if part.contains(&true) {
                let open = (first..).zip(part).filter(|(x, open)| **open && x % spacing == 0);
                waiting.extend(open.map(|(x, _)| (x, y)));
            }
        }
    }
    waiting
}

/// Coordinate of a border sample in the tile at offset `tile` (0 before, 1 same, 2 after); `None` if that tile does not have it.
fn mirror(v: usize, tile: usize, n: usize) -> Option<usize> {
    match (tile, v) {
        (1, v) => Some(v),
        (0, 0) => Some(n),
        (2, v) if v == n => Some(0),
        _ => None,
    }
}

/// Writes fills into their tile.
pub fn apply(lattice: &mut Lattice, fills: &[Fill]) {
    for &(index, code, low) in fills {
        lattice.code[index] = code;
        lattice.state[index] = FILLED;
        if let Some(to) = lattice.low.get_mut(index) {
            *to = low;
        }
    }
}
