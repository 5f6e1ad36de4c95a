//! Points of a tile's half lattice as bits, and the nearest of them to any point.
//!
//! Point (X, Y) of the *half lattice*, `0 <= X, Y <= 2n`, lies X / 2 columns and Y / 2 rows from the north-west, so (even,
//! even) is a sample and (odd, odd) the centre of a cell. Void outlines are short beside a tile: marking costs a few
//! operations per 64 samples, and a query looks at the rows around its point, from near to far, until they are farther
//! than what it has found.

use crate::simd::{self, Kernel};

/// A point of the half lattice: column, row.
pub(super) type HalfPoint = [i16; 2];

/// Bits of a word.
const WORD: usize = u64::BITS as usize;

/// Half rows that are looked at together from far away.
const GROUP: usize = 8;

/// Samples of a tile that are valid, as bits: row by row, each in whole words.
#[derive(Debug, Default)]
pub(super) struct ValidBits {
    /// Samples on a side.
    side: usize,
    words: Vec<u64>,
}

impl ValidBits {
    /// Takes over `side x side` samples of which `is_valid` holds 1 for the valid ones, 0 for the others.
    pub(super) fn fill(&mut self, is_valid: &[u8], side: usize) {
        self.side = side;
        self.words.clear();
        for row in is_valid.chunks_exact(side) {
            self.words.extend(row.chunks(WORD).map(pack));
        }
    }

    /// Row `y`.
    fn row(&self, y: usize) -> &[u64] {
        let words = self.side.div_ceil(WORD);
        &self.words[y * words..(y + 1) * words]
    }
}

/// Up to 64 bytes, each 0 or 1, as bits.
#[inline]
fn pack(bytes: &[u8]) -> u64 {
    // The product gathers the lowest bits of eight bytes in its highest byte.
    let eight = |bytes: [u8; 8]| u64::from_le_bytes(bytes).wrapping_mul(0x0102_0408_1020_4080) >> 56;
    let (chunks, rest) = bytes.as_chunks::<8>();
    let mut last = [0; 8];
    last[..rest.len()].copy_from_slice(rest);
    let mut word = if rest.is_empty() { 0 } else { eight(last) << (8 * chunks.len()) };
    for (i, &bytes) in chunks.iter().enumerate() {
        word |= eight(bytes) << (8 * i);
    }
    word
}

/// Marked points of the half lattice of a tile.
#[derive(Debug, Default)]
pub(super) struct Marks {
    /// Words of a half row, with an empty one before the first mark and one after the last.
    words: usize,
    /// Half rows, one after the other, and an empty one.
    bits: Vec<u64>,
    /// True for each half row with a mark.
    any: Vec<bool>,
    /// The same words for each [`GROUP`] of half rows: what any of them has.
    groups: Vec<u64>,
}

impl Marks {
    /// Forgets all marks, for a tile of `n` intervals, at most 2 048.
    fn start(&mut self, n: usize) {
        debug_assert!(n <= 2048, "half rows must fit HalfPoint");
        self.words = (2 * n + 1).div_ceil(WORD) + 2;
        self.bits.clear();
        self.bits.resize((2 * n + 2) * self.words, 0);
        self.any.clear();
        self.any.resize(2 * n + 1, false);
        self.groups.clear();
        self.groups.resize((2 * n + 1).div_ceil(GROUP) * self.words, 0);
    }

    /// Marks points of half row `row`: bit `i` of word `w` of `even` is half column `2 (64 w + i)`, of `odd` the one after it.
    #[inline]
    fn set(&mut self, row: usize, w: usize, even: u64, odd: u64) {
        if even | odd == 0 {
            return;
        }
        self.any[row] = true;
        let words = [spread(even) | spread(odd) << 1, spread(even >> 32) | spread(odd >> 32) << 1];
        // The last word may have the tile's last half column only.
        let (from, count) = (2 * w + 1, 2.min(self.words - 2 - 2 * w));
        for (i, word) in words.into_iter().enumerate().take(count) {
            self.bits[row * self.words + from + i] = word;
            self.groups[row / GROUP * self.words + from + i] |= word;
        }
    }

    /// Marks the vertices of the outline: midpoints of the sides and diagonals that join a valid and a void sample.
    pub(super) fn outline(&mut self, valid: &ValidBits, n: usize) {
        self.start(n);
        for y in 0..=n {
            let row = valid.row(y);
            for w in 0..row.len() {
                let across = (row[w] ^ next(row, w)) & within(n, w);
                self.set(2 * y, w, 0, across);
            }
        }
        for y in 0..n {
            let (north, south) = (valid.row(y), valid.row(y + 1));
            // Cells whose column and row are both even or both odd have the diagonal from north-west to south-east.
            let falls = if y % 2 == 0 { 0x5555_5555_5555_5555 } else { 0xAAAA_AAAA_AAAA_AAAA };
            for w in 0..north.len() {
                let down = north[w] ^ south[w];
                let (falling, rising) = (north[w] ^ next(south, w), next(north, w) ^ south[w]);
                let diagonal = (falling & falls | rising & !falls) & within(n, w);
                self.set(2 * y + 1, w, down, diagonal);
            }
        }
    }

    /// Marks the samples of one kind, and the centres of the blocks that hold some of that kind inside only. `is_mixed`
    /// says 1 of each of the `n x n` blocks that holds both kinds.
    pub(super) fn places(&mut self, valid: &ValidBits, is_mixed: &[u8], n: usize, kind: bool) {
        self.start(n);
        let flip = if kind { 0 } else { u64::MAX };
        for y in 0..=n {
            let row = valid.row(y);
            for (w, word) in row.iter().enumerate() {
                self.set(2 * y, w, (word ^ flip) & within(n + 1, w), 0);
            }
        }
        for (y, blocks) in is_mixed.chunks_exact(n).enumerate() {
            let (north, south) = (valid.row(y), valid.row(y + 1));
            for (w, blocks) in blocks.chunks(WORD).enumerate() {
                let at_corner = |row: &[u64]| row[w] ^ flip | next(row, w) ^ flip;
                let inside = pack(blocks) & !(at_corner(north) | at_corner(south)) & within(n, w);
                self.set(2 * y + 1, w, 0, inside);
            }
        }
    }

    /// The mark nearest to a point of the half lattice, where half an interval is `half` (across, down) long; `None` if there
    /// are no marks. Of marks as far any one.
    pub(super) fn nearest(&self, from: [usize; 2], half: (f64, f64)) -> Option<HalfPoint> {
        // In units of half an interval across.
        let ratio = (half.1 / half.0) * (half.1 / half.0);
        let near = simd::run(Near { marks: self, from, ratio });
        if near.is_some() { near } else { self.far(from, ratio) }
    }

    /// The nearest mark wherever it is.
    #[cold]
    fn far(&self, [x, y]: [usize; 2], ratio: f64) -> Option<HalfPoint> {
        let (mut found, mut least) = (None, f64::INFINITY);
        let squared = |column: usize, down: usize| {
            let across = column.abs_diff(x);
            (across * across) as f64 + (down * down) as f64 * ratio
        };
        let (own, groups) = (y / GROUP, self.any.len().div_ceil(GROUP));
        for away in 0..groups {
            // Rows between the point and the nearer one of two groups.
            let between = (away * GROUP).saturating_sub(GROUP - 1);
            if squared(x, between) >= least {
                break;
            }
            let south = if away > 0 { own + away } else { groups };
            for group in [own.wrapping_sub(away), south].into_iter().filter(|&group| group < groups) {
                let first = group * GROUP;
                let rows = first..(first + GROUP).min(self.any.len());
                let nearest_row = y.clamp(first, rows.end - 1);
                let Some(column) = self.nearest_in_row(&self.groups, group, x) else { continue };
                if squared(column, nearest_row.abs_diff(y)) >= least {
                    continue;
                }
                for row in rows.filter(|&row| self.any[row]) {
                    let Some(column) = self.nearest_in_row(&self.bits, row, x) else { continue };
                    let away = squared(column, row.abs_diff(y));
                    if away < least {
                        (found, least) = (Some([column as i16, row as i16]), away);
                    }
                }
            }
        }
        found
    }

    /// Half column of the mark of row `row` of `bits` that is nearest to half column `x`.
    fn nearest_in_row(&self, bits: &[u64], row: usize, x: usize) -> Option<usize> {
        let words = &bits[row * self.words + 1..(row + 1) * self.words - 1];
        let (w, bit) = (x / WORD, x % WORD);
        // What of the point's own word lies on either side, the point included, at the end that is next to it.
        let (own_west, own_east) = (words[w] << (WORD - 1 - bit), words[w] >> bit);
        let west = if own_west != 0 {
            Some(x - own_west.leading_zeros() as usize)
        } else {
            let w = words[..w].iter().rposition(|&word| word != 0);
            w.map(|w| w * WORD + WORD - 1 - words[w].leading_zeros() as usize)
        };
        let east = if own_east != 0 {
            Some(x + own_east.trailing_zeros() as usize)
        } else {
            let w = (w + 1..words.len()).find(|&w| words[w] != 0);
            w.map(|w| w * WORD + words[w].trailing_zeros() as usize)
        };
        match (west, east) {
            (Some(west), Some(east)) => Some(if x - west <= east - x { west } else { east }),
            (west, east) => west.or(east),
        }
    }
}

/// The nearest mark that is less than half a word of half columns away; as [`Marks::nearest`].
///
/// Most are. There is nothing to be predicted in the loop but its end.
struct Near<'a> {
    marks: &'a Marks,
    from: [usize; 2],
    ratio: f64,
}

impl Kernel for Near<'_> {
    type Output = Option<HalfPoint>;

    #[inline(always)]
    fn run(self) -> Option<HalfPoint> {
        const REACH: usize = WORD / 2;
        let Self { marks: Marks { words, bits, any, .. }, from: [x, y], ratio } = self;
        let empty = any.len();
        // The word from REACH half columns west of the point on; the first word of a row is before its first mark.
        let (w, shift) = ((x + REACH) / WORD, (x + REACH) % WORD);
        let mut least = (REACH * REACH) as f64;
        let mut found = [-1_i16; 2];
        for away in 0..empty {
            let down = (away * away) as f64 * ratio;
            if down >= least {
                break;
            }
            for row in [y.wrapping_sub(away), y + away] {
                let row = if row < empty { row } else { empty };
                let pair = &bits[row * words + w..][..2];
                let around = pair[0] >> shift | (pair[1] << 1) << (WORD - 1 - shift);
                // Bit REACH is the point's own.
                let east = (around >> REACH).trailing_zeros() as i32;
                let west = (around << (REACH - 1)).leading_zeros() as i32;
                let away = if east < west { east } else { west };
                let squared = f64::from(away * away) + down;
                let column = x as i32 + if east < west { east } else { -west };
                let nearer = squared < least;
                found = if nearer { [column as i16, row as i16] } else { found };
                least = if nearer { squared } else { least };
            }
        }
        (found[0] >= 0).then_some(found)
    }
}

/// Word `w` of a row moved by one: bit `i` is the row's bit `i + 1`.
#[inline]
fn next(row: &[u64], w: usize) -> u64 {
    row[w] >> 1 | row.get(w + 1).map_or(0, |word| word << (WORD - 1))
}

/// Ones at the bits of word `w` that are below `count` in their row.
#[inline]
fn within(count: usize, w: usize) -> u64 {
    match count.saturating_sub(w * WORD) {
        more @ 0..WORD => (1 << more) - 1,
        _ => u64::MAX,
    }
}

/// The lower 32 bits at the even places.
#[inline]
fn spread(bits: u64) -> u64 {
    let mut x = bits & 0xFFFF_FFFF;
    x = (x | x << 16) & 0x0000_FFFF_0000_FFFF;
    x = (x | x << 8) & 0x00FF_00FF_00FF_00FF;
    x = (x | x << 4) & 0x0F0F_0F0F_0F0F_0F0F;
    x = (x | x << 2) & 0x3333_3333_3333_3333;
    (x | x << 1) & 0x5555_5555_5555_5555
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// All marks, one by one.
    fn all(marks: &Marks, n: usize) -> Vec<HalfPoint> {
        let side = 2 * n + 1;
        let is_marked = |x: usize, y: usize| {
            let (word, bit) = (y * marks.words + 1 + x / WORD, x % WORD);
            marks.bits[word] >> bit & 1 == 1
        };
        let points = (0..side * side).map(|i| (i % side, i / side));
        points.filter(|&(x, y)| is_marked(x, y)).map(|(x, y)| [x as i16, y as i16]).collect()
    }

    /// Samples of `side x side`, of which about one in `rarity` is unlike the others.
    fn samples(side: usize, rarity: u64, seed: u64) -> Vec<u8> {
        let mut state = seed | 1;
        let mut next = || {
            state = state.wrapping_mul(0x5851_F42D_4C95_7F2D).wrapping_add(0x1405_7B7E_F767_814F);
            state >> 33
        };
        let usual = (next() % 2) as u8;
        (0..side * side).map(|_| if next() % rarity == 0 { usual ^ 1 } else { usual }).collect()
    }

    fn nearest_is_nearest(marks: &Marks, n: usize, half: (f64, f64)) {
        let marked = all(marks, n);
        let squared = |[x, y]: HalfPoint, at: [usize; 2]| {
            let across = f64::from(x) - at[0] as f64;
            let down = f64::from(y) - at[1] as f64;
            (across * half.0).powi(2) + (down * half.1).powi(2)
        };
        for i in (0..(2 * n + 1) * (2 * n + 1)).step_by(if n > 16 { 37 } else { 1 }) {
            let at = [i % (2 * n + 1), i / (2 * n + 1)];
            match marks.nearest(at, half) {
                None => assert!(marked.is_empty()),
                Some(found) => {
                    let least = marked.iter().map(|&mark| squared(mark, at)).fold(f64::INFINITY, f64::min);
                    assert!(marked.contains(&found), "{found:?} is no mark");
                    assert!(squared(found, at) <= least * (1.0 + 1e-9), "{at:?}: {found:?}, {half:?}");
                }
            }
        }
    }

    proptest! {
        #[test]
        fn marks_are_where_the_definitions_say_and_the_nearest_is_found(
            log_n in 2_u32..8,
            rarity in prop::sample::select(vec![2_u64, 7, 100, 5_000]),
            seed: u64,
            half in (0.1_f64..10.0, 0.1_f64..10.0),
        ) {
            let n = 1 << log_n;
            let side = n + 1;
            let valid = samples(side, rarity, seed);
            let at = |x: usize, y: usize| valid[y * side + x];
            let mut bits = ValidBits::default();
            bits.fill(&valid, side);

            let mut marks = Marks::default();
            marks.outline(&bits, n);
            let mut expected = Vec::new();
            for y in 0..=2 * n {
                for x in 0..=2 * n {
                    let ((i, j), odd) = ((x / 2, y / 2), (x / 2 + y / 2) % 2 == 1);
                    let crossed = match (x % 2, y % 2) {
                        (0, 0) => false,
                        (1, 0) => at(i, j) != at(i + 1, j),
                        (0, _) => at(i, j) != at(i, j + 1),
                        (_, _) if odd => at(i + 1, j) != at(i, j + 1),
                        (_, _) => at(i, j) != at(i + 1, j + 1),
                    };
                    if crossed {
                        expected.push([x as i16, y as i16]);
                    }
                }
            }
            prop_assert_eq!(all(&marks, n), expected);
            nearest_is_nearest(&marks, n, half);

            // Blocks: some of them mixed though their corners are alike.
            let mixed = samples(n, rarity, !seed);
            for kind in [false, true] {
                marks.places(&bits, &mixed, n, kind);
                let is_kind = |x: usize, y: usize| (at(x, y) == 1) == kind;
                let mut expected = Vec::new();
                for y in 0..=2 * n {
                    for x in 0..=2 * n {
                        let (i, j) = (x / 2, y / 2);
                        let marked = match (x % 2, y % 2) {
                            (0, 0) => is_kind(i, j),
                            (1, 1) => {
                                let corners = [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)];
                                mixed[j * n + i] == 1 && !corners.iter().any(|&(i, j)| is_kind(i, j))
                            }
                            _ => false,
                        };
                        if marked {
                            expected.push([x as i16, y as i16]);
                        }
                    }
                }
                prop_assert_eq!(all(&marks, n), expected);
                nearest_is_nearest(&marks, n, half);
            }
        }
    }
}
