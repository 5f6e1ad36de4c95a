//! Fill heights of void samples at an outline (`format-spec.md`, section 2).
//!
//! The fill of a sample is the lower median of its valid neighbours at the finest spacing that has
//! any: a function of the whole lattice, not of a tile, so that tiles agree on shared samples. A
//! leaf tile settles spacings 1 to T; at each coarser level only one spacing is new, T, and only
//! the four corners belong to it. A tile never needs samples beyond its eight neighbours.

use crate::sample::state;
use crate::sample::{FILLED, Lattice, VALID, VOID};
use crate::simd::{self, Kernel};

/// A tile's lattice and its eight neighbours, `[row][column]`, the tile itself at `[1][1]`. All of
/// one size.
pub struct Neighbourhood<'a>(pub [[Option<&'a Lattice>; 3]; 3]);

/// A fill: index in the lattice, code, low.
pub type Fill = (u32, i32, u32);

/// Kernel: finds the void samples of a row that have a valid one around them; most samples of a
/// large void have none.
struct NearValid<'a> {
    row: &'a [u8],
    /// The rows of [`Neighbourhood::rows`].
    around: [[&'a [u8]; 3]; 3],
    /// All `VOID` at first, one for each sample of a row of those three parts.
    best: &'a mut [u8],
    /// Set to 1 for each sample found, else to 0.
    open: &'a mut [u8],
}

impl Kernel for NearValid<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { row, around, best, open } = self;
        let count = row.len();
        let spacing = (best.len() - count) / 2;
        for [west, own, east] in around {
            greatest(&mut best[..spacing], west);
            greatest(&mut best[spacing..spacing + count], own);
            greatest(&mut best[spacing + count..], east);
        }
        let (west, own, east) = (&best[..count], &best[spacing..][..count], &best[2 * spacing..][..count]);
        let open = &mut open[..count];
        for x in 0..count {
            let valid = west[x].max(own[x]).max(east[x]) == VALID;
            open[x] = u8::from((row[x] == VOID) & valid);
        }
    }
}

/// Raises `best` to `states`, if there are any. `VALID` is the greatest state.
#[inline(always)]
fn greatest(best: &mut [u8], states: &[u8]) {
    let count = best.len().min(states.len());
    let (best, states) = (&mut best[..count], &states[..count]);
    for x in 0..count {
        best[x] = best[x].max(states[x]);
    }
}

impl Neighbourhood<'_> {
    /// State, code and low at `(x, y)`, each -n..=2n from the tile's own north-west corner.
    fn sample(&self, n: usize, x: isize, y: isize) -> (u8, i32, u32) {
        let ((tx, i), (ty, j)) = (place(n, x), place(n, y));
        match self.0[ty][tx] {
            Some(lattice) => {
                let at = lattice.at(i, j);
                (lattice.state[at], lattice.code[at], lattice.low_at(at))
            }
            None => (VOID, 0, 0),
        }
    }

    /// The fills of the tile's void samples that spacings `from..=to` give (powers of two, in
    /// samples of this level), and the fills that a neighbour's copy of a border sample has
    /// already.
    pub fn fills(&self, from: usize, to: usize) -> Vec<Fill> {
        let mut fills = Vec::new();
        let Some(tile) = self.0[1][1] else { return fills };
        if !has_void(&tile.state) {
            return fills;
        }
        let mut state = tile.state.clone();
        self.adopt(tile, &mut state, &mut fills);
        let (mut best, mut open) = (Vec::new(), Vec::new());
        let mut spacing = from;
        while spacing <= to {
            // A spacing gives fills only to samples whose column and row are multiples of it.
            for (y, row) in state.chunks_exact_mut(tile.n + 1).enumerate().step_by(spacing) {
                if !has_void(row) {
                    continue;
                }
                best.clear();
                best.resize(tile.n + 1 + 2 * spacing, VOID);
                open.resize(tile.n + 1, 0);
                let around = self.rows(tile.n, y, spacing);
                simd::run(NearValid { row, around, best: &mut best, open: &mut open });
                state::each_place(&open, 1, |x| {
                    // The spacing is a power of two.
                    if x & (spacing - 1) == 0
                        && let Some((code, low)) = self.median(tile, x, y, spacing)
                    {
                        fills.push((tile.at(x, y) as u32, code, low));
                        row[x] = FILLED;
                    }
                });
            }
            spacing *= 2;
        }
        fills.shrink_to_fit();
        fills
    }

    /// The states of row `y` and the rows `spacing` away: in the tile, `spacing` samples to the
    /// west of it and as many to the east; empty where there is no tile.
    fn rows(&self, n: usize, y: usize, spacing: usize) -> [[&[u8]; 3]; 3] {
        [-1, 0, 1].map(|step| {
            let (ty, j) = place(n, y as isize + step * spacing as isize);
            let part = |tx: usize, first: usize, count: usize| {
                self.0[ty][tx].map_or(&[][..], |lattice| &lattice.state[lattice.at(first, j)..][..count])
            };
            [part(0, n - spacing, spacing), part(1, 0, n + 1), part(2, 1, spacing)]
        })
    }

    /// Adds the fills of border samples that a neighbouring tile has from its own children.
    fn adopt(&self, tile: &Lattice, state: &mut [u8], fills: &mut Vec<Fill>) {
        let n = tile.n;
        let border = (0..=n).flat_map(|i| [(i, 0), (i, n), (0, i), (n, i)]);
        for (x, y) in border {
            let index = tile.at(x, y);
            if state[index] != VOID {
                continue;
            }
            for (ty, row) in self.0.iter().enumerate() {
                for (tx, neighbour) in row.iter().enumerate() {
                    let (Some(other), Some(i), Some(j)) = (neighbour, mirror(x, tx, n), mirror(y, ty, n))
                    else {
                        continue;
                    };
                    let at = other.at(i, j);
                    if state[index] == VOID && other.state[at] == FILLED {
                        state[index] = FILLED;
                        fills.push((index as u32, other.code[at], other.low_at(at)));
                    }
                }
            }
        }
    }

    /// The lower median of the valid samples among the eight at distance `spacing`.
    fn median(&self, tile: &Lattice, x: usize, y: usize, spacing: usize) -> Option<(i32, u32)> {
        let inside = |v: usize| v >= spacing && v + spacing <= tile.n;
        if inside(x) && inside(y) {
            return median_inside(tile, x, y, spacing);
        }
        let mut near = Near::default();
        let (s, x, y) = (spacing as isize, x as isize, y as isize);
        let around = [(-s, -s), (0, -s), (s, -s), (-s, 0), (s, 0), (-s, s), (0, s), (s, s)];
        for (place, (dx, dy)) in around.into_iter().enumerate() {
            near.take(place, self.sample(tile.n, x + dx, y + dy));
        }
        near.median()
    }
}

/// [`Neighbourhood::median`] of a sample that has all eight in its own tile.
fn median_inside(tile: &Lattice, x: usize, y: usize, spacing: usize) -> Option<(i32, u32)> {
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
    let mut near = Near::default();
    for (place, at) in around.into_iter().enumerate() {
        near.take(place, (tile.state[at], tile.code[at], tile.low_at(at)));
    }
    near.median()
}

/// The valid ones of up to eight samples.
struct Near {
    /// Code and low of each as one number of the same order, which is quicker to sort; the greatest
    /// number for samples that do not count.
    heights: [i64; 8],
    count: usize,
}

impl Default for Near {
    fn default() -> Self {
        Self { heights: [i64::MAX; 8], count: 0 }
    }
}

impl Near {
    /// Adds a sample (state, code, low) if it is valid.
    #[inline(always)]
    fn take(&mut self, place: usize, (state, code, low): (u8, i32, u32)) {
        // All ones if the sample does not count. Which do is random, so a branch would be predicted
        // badly.
        let out = -i64::from(state != VALID);
        let height = i64::from(code) << 32 | i64::from(low);
        self.heights[place] = (height & !out) | (out & i64::MAX);
        self.count += (out + 1) as usize;
    }

    /// The lower median of the samples added.
    #[inline(always)]
    fn median(self) -> Option<(i32, u32)> {
        let median = state::median_of(self.heights, self.count)?;
        Some(((median >> 32) as i32, median as u32))
    }
}

/// The tile that has column or row `v`, -n..=2n from the own tile's first (0 before, 1 the own, 2
/// after), and the index of the column or row in it. Samples on the own tile's border are taken
/// from the own tile, not from the neighbours' copies.
fn place(n: usize, v: isize) -> (usize, usize) {
    match usize::try_from(v) {
        Ok(v) if v <= n => (1, v),
        Ok(v) => (2, v - n),
        Err(_) => (0, n - v.unsigned_abs()),
    }
}

/// Coordinate of a border sample in the tile at offset `tile` (0 before, 1 same, 2 after); `None`
/// if that tile does not have it.
fn mirror(v: usize, tile: usize, n: usize) -> Option<usize> {
    match (tile, v) {
        (1, v) => Some(v),
        (0, 0) => Some(n),
        (2, v) if v == n => Some(0),
        _ => None,
    }
}

/// Fills the void samples inside a leaf tile that have a valid one beside them, as
/// [`Neighbourhood::fills`] would. Most fills are these, and they need no other tile, so they are
/// best made while the tile is in the processor's cache; fewer are left for
/// [`Neighbourhood::fills`].
pub fn inside(tile: &mut Lattice) {
    if state::all_valid(&tile.state) {
        return;
    }
    let (n, width) = (tile.n, tile.n + 1);
    let (mut best, mut open) = (vec![VOID; width + 2], vec![0; width]);
    for y in 1..n {
        let row = &tile.state[y * width..][..width];
        if !has_void(row) {
            continue;
        }
        best.fill(VOID);
        let around = [y - 1, y, y + 1].map(|y| [&[][..], &tile.state[y * width..][..width], &[]]);
        simd::run(NearValid { row, around, best: &mut best, open: &mut open });
        (open[0], open[n]) = (0, 0);
        state::each_place(&open, 1, |x| {
            if let Some((code, low)) = median_inside(tile, x, y, 1) {
                put(tile, (y * width + x, code, low));
            }
        });
    }
}

/// Writes fills into a tile.
pub fn apply(lattice: &mut Lattice, fills: &[Fill]) {
    for &(index, code, low) in fills {
        put(lattice, (index as usize, code, low));
    }
}

fn put(lattice: &mut Lattice, (index, code, low): (usize, i32, u32)) {
    lattice.code[index] = code;
    lattice.state[index] = FILLED;
    if let Some(to) = lattice.low.get_mut(index) {
        *to = low;
    }
}

/// True if one of some samples is void.
fn has_void(states: &[u8]) -> bool {
    // The least state of all, without an early end, so that the compiler uses vectors.
    states.iter().fold(VALID, |least, &state| state.min(least)) == VOID
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::Coding;

    /// Tiles of `n` intervals cut from one lattice of `3 n`, in which `valid` of 100 samples are
    /// valid.
    fn tiles(n: usize, valid: usize, coding: Coding, seed: &mut u32) -> [[Lattice; 3]; 3] {
        let mut random = |below: usize| {
            *seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (*seed >> 16) as usize % below
        };
        let mut whole = Lattice::new(3 * n, coding);
        for at in 0..whole.code.len() {
            whole.code[at] = random(7) as i32 - 3;
            whole.state[at] = if random(100) < valid { VALID } else { VOID };
        }
        whole.low.iter_mut().for_each(|low| *low = random(3) as u32);
        [0, 1, 2].map(|ty| {
            [0, 1, 2].map(|tx| {
                let mut tile = Lattice::new(n, coding);
                for (at, from) in (0..tile.code.len()).map(|at| (at, (at % (n + 1), at / (n + 1)))) {
                    let from = whole.at(tx * n + from.0, ty * n + from.1);
                    (tile.code[at], tile.state[at]) = (whole.code[from], whole.state[from]);
                    if coding.has_low() {
                        tile.low[at] = whole.low[from];
                    }
                }
                tile
            })
        })
    }

    /// The fill of a sample, sample by sample.
    fn expected(around: &Neighbourhood, n: usize, x: usize, y: usize, to: usize) -> Option<(i32, u32)> {
        let spacings =
            (0..).map(|t| 1 << t).take_while(|s| *s <= to && x.is_multiple_of(*s) && y.is_multiple_of(*s));
        spacings.into_iter().find_map(|s| {
            let mut found = Vec::new();
            for (dx, dy) in (0..9).map(|i| (i % 3 - 1, i / 3 - 1)) {
                let (x, y) = (x as isize + dx * s as isize, y as isize + dy * s as isize);
                let (state, code, low) = around.sample(n, x, y);
                found.extend((state == VALID).then_some((code, low)));
            }
            found.sort_unstable();
            found.get(found.len().checked_sub(1)? / 2).copied()
        })
    }

    #[test]
    fn fills_are_those_found_sample_by_sample() {
        let mut seed = 1;
        for (n, coding) in
            [(2, Coding::Float64), (8, Coding::Float64), (32, Coding::Float32), (64, Coding::Float32)]
        {
            for (valid, missing) in [(0, 0), (1, 0), (3, 0x1A5), (10, 0x0E7), (50, 0), (97, 0x040), (100, 0)]
            {
                let tiles = tiles(n, valid, coding, &mut seed);
                let there = |tx: usize, ty: usize| missing >> (3 * ty + tx) & 1 == 0 || (tx, ty) == (1, 1);
                let around = [0, 1, 2].map(|ty| [0, 1, 2].map(|tx| there(tx, ty).then_some(&tiles[ty][tx])));
                let around = Neighbourhood(around);
                let mut want: Vec<Fill> = (0..(n + 1) * (n + 1))
                    .filter(|&at| tiles[1][1].state[at] == VOID)
                    .filter_map(|at| {
                        let (code, low) = expected(&around, n, at % (n + 1), at / (n + 1), n)?;
                        Some((at as u32, code, low))
                    })
                    .collect();
                let mut got = around.fills(1, n);
                want.sort_unstable();
                got.sort_unstable();
                assert_eq!(got, want, "{n}, {valid} of 100");
                // With those inside found before.
                let mut filled = tiles[1][1].clone();
                inside(&mut filled);
                let mut around = around.0;
                around[1][1] = Some(&filled);
                let rest = Neighbourhood(around).fills(1, n);
                assert!(rest.len() <= want.len());
                apply(&mut filled, &rest);
                let mut at_once = tiles[1][1].clone();
                apply(&mut at_once, &want);
                assert!(filled == at_once, "{n}, {valid} of 100");
            }
        }
    }
}
