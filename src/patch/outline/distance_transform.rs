//! A distance transform: the feature points of a tile's half lattice, and the nearest of them to
//! any point.
//!
//! Point (X, Y) of the *half lattice*, `0 <= X, Y <= 2n`, lies X / 2 columns and Y / 2 rows from
//! the north-west, so (even, even) is a sample and (odd, odd) the centre of a cell. The transform
//! stores, for each point, the distance to the nearest feature in its own half column. This first
//! pass works on whole half rows, in vectors. A query then searches along one half row, from near
//! to far, until the half columns are farther than the feature found. (These are the two passes of
//! the distance transform of Felzenszwalb & Huttenlocher 2012, the second only for the points that
//! are asked for.)

use crate::geo::Plane;
use crate::simd::{self, Kernel};

/// A point of the half lattice: column, row.
pub(super) type HalfPoint = [i16; 2];

/// Half columns of one kind, even or odd, that are searched together.
const LANES: usize = 8;
/// Half columns of both kinds.
const BLOCK: usize = 2 * LANES;
/// The bytes of a half row of one kind are a multiple of this: whole vectors.
const VECTOR: usize = 32;
/// Stored distance, in half rows, that means this far or farther.
const FAR: u8 = u8::MAX;
/// Largest cosine of the angle between columns and rows with which distances are taken as if it
/// were a right angle: within a tenth.
const SHEARED: f64 = 0.09;

/// The distances from the points of a half lattice to the nearest features of their half columns.
#[derive(Debug, Default)]
pub(super) struct DistanceTransform {
    n: usize,
    /// Bytes of the even, or the odd, half columns of a half row: whole vectors, so more than the
    /// tile has.
    stride: usize,
    /// Half rows to the nearest feature of the same half column, [`FAR`] at most: half row by half
    /// row, first of the even half columns, then of the odd ones.
    down: Vec<u8>,
    /// The least of them for each block of a half row.
    low: Vec<u8>,
}

/// Intervals of a tile at most: half rows must fit [`HalfPoint`].
const MOST_INTERVALS: usize = 2048;
/// 1 and 0 in turn.
static ALTERNATING: [u8; MOST_INTERVALS + 1] = {
    let mut bytes = [1; MOST_INTERVALS + 1];
    let mut i = 1;
    while i < bytes.len() {
        bytes[i] = 0;
        i += 2;
    }
    bytes
};

/// The distances before the first half row.
static ALL_FAR: [u8; 2 * (MOST_INTERVALS + 1).next_multiple_of(VECTOR)] =
    [FAR; 2 * (MOST_INTERVALS + 1).next_multiple_of(VECTOR)];

/// A definition of features: which points of a half row are features.
trait FeatureRow {
    /// Sets `even` and `odd`, the even and odd half columns of a half row, to 1 at features and 0
    /// elsewhere.
    fn set(&self, row: usize, even: &mut [u8], odd: &mut [u8]);
}

/// The vertices of the outline: midpoints of the sides and diagonals that join a valid and a void
/// sample.
struct Outline<'a> {
    valid: &'a [u8],
    n: usize,
}

impl FeatureRow for Outline<'_> {
    #[inline(always)]
    /// Sets `even` and `odd`, the even and odd half columns of a half row, to 1 at features and 0
    /// elsewhere.
    fn set(&self, row: usize, even: &mut [u8], odd: &mut [u8]) {
        let (n, y) = (self.n, row / 2);
        let north = &self.valid[y * (n + 1)..(y + 1) * (n + 1)];
        if row.is_multiple_of(2) {
            for ((feature, west), east) in odd.iter_mut().zip(north).zip(&north[1..]) {
                *feature = west ^ east;
            }
            even.fill(0);
            return;
        }
        let south = &self.valid[(y + 1) * (n + 1)..(y + 2) * (n + 1)];
        for ((feature, north), south) in even.iter_mut().zip(north).zip(south) {
            *feature = north ^ south;
        }
        // Cells whose column and row are both even or both odd have the diagonal from north-west to
        // south-east.
        let falls = &ALTERNATING[y % 2..];
        let corners = north.iter().zip(&north[1..]).zip(south.iter().zip(&south[1..]));
        for ((feature, falls), ((nw, ne), (sw, se))) in odd.iter_mut().zip(falls).zip(corners) {
            let (falling, rising) = (nw ^ se, ne ^ sw);
            *feature = rising ^ ((falling ^ rising) & falls);
        }
    }
}

/// The samples of one kind, and the centres of the blocks that hold that kind only inside.
struct OfKind<'a> {
    valid: &'a [u8],
    /// 1 for each of the `n x n` blocks that holds both kinds.
    is_mixed: &'a [u8],
    n: usize,
    /// 1 or 0.
    kind: u8,
}

impl FeatureRow for OfKind<'_> {
    #[inline(always)]
    /// Sets `even` and `odd`, the even and odd half columns of a half row, to 1 at features and 0
    /// elsewhere.
    fn set(&self, row: usize, even: &mut [u8], odd: &mut [u8]) {
        let (n, y, flip) = (self.n, row / 2, self.kind ^ 1);
        let north = &self.valid[y * (n + 1)..(y + 1) * (n + 1)];
        if row.is_multiple_of(2) {
            for (feature, valid) in even.iter_mut().zip(north) {
                *feature = valid ^ flip;
            }
            odd.fill(0);
            return;
        }
        even.fill(0);
        let south = &self.valid[(y + 1) * (n + 1)..(y + 2) * (n + 1)];
        let is_mixed = &self.is_mixed[y * n..(y + 1) * n];
        let corners = north.iter().zip(&north[1..]).zip(south.iter().zip(&south[1..]));
        for ((feature, mixed), ((nw, ne), (sw, se))) in odd.iter_mut().zip(is_mixed).zip(corners) {
            let at_corner = (nw ^ flip) | (ne ^ flip) | (sw ^ flip) | (se ^ flip);
            *feature = mixed & (at_corner ^ 1);
        }
    }
}

/// Kernel: the first pass, which sets the distances.
struct Transform<'a, M> {
    transform: &'a mut DistanceTransform,
    of: M,
}

impl<M: FeatureRow> Kernel for Transform<'_, M> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        const MOST: usize = (MOST_INTERVALS + 1).next_multiple_of(VECTOR);
        let Self { transform: DistanceTransform { n, stride, down, low }, of } = self;
        let (n, stride, row) = (*n, *stride, 2 * *stride);
        let mut features = [0_u8; 2 * MOST];
        for y in 0..=2 * n {
            let (even, odd) = features[..row].split_at_mut(stride);
            of.set(y, &mut even[..=n], &mut odd[..n]);
            let (before, here) = down.split_at_mut(y * row);
            let north = before.len().checked_sub(row).map_or(&ALL_FAR[..row], |from| &before[from..]);
            for ((here, north), feature) in here[..row].iter_mut().zip(north).zip(&features) {
                // 0 at a feature.
                *here = north.saturating_add(1) & feature.wrapping_sub(1);
            }
        }
        let (mut one, mut two, mut four) = ([0; MOST], [0; MOST / 2], [0; MOST / 4]);
        for y in (0..=2 * n).rev() {
            let (here, south) = down[y * row..].split_at_mut(row);
            // The last one has no row to the south.
            for (here, south) in here.iter_mut().zip(&*south) {
                *here = (*here).min(south.saturating_add(1));
            }
            let (even, odd) = here.split_at(stride);
            for ((one, even), odd) in one.iter_mut().zip(even).zip(odd) {
                *one = *even.min(odd);
            }
            lower_of_two(&one[..stride], &mut two);
            lower_of_two(&two[..stride / 2], &mut four);
            lower_of_two(&four[..stride / 4], &mut low[y * stride / LANES..][..stride / LANES]);
        }
    }
}

/// Sets `lower` to the lower one of every two bytes.
#[inline(always)]
fn lower_of_two(bytes: &[u8], lower: &mut [u8]) {
    for (lower, pair) in lower.iter_mut().zip(bytes.as_chunks::<2>().0) {
        *lower = pair[0].min(pair[1]);
    }
}

impl DistanceTransform {
    /// Becomes the transform of the vertices of the outline of a tile of `n` intervals; `valid` is
    /// 1 or 0 for each of its samples.
    pub(super) fn of_outline(&mut self, valid: &[u8], n: usize) {
        self.fill(n, Outline { valid, n });
    }

    /// Becomes the transform of the samples of one kind, and of the centres of the blocks that hold
    /// that kind only inside. `is_mixed` is 1 for each of the `n x n` blocks that holds both kinds.
    pub(super) fn of_kind(&mut self, valid: &[u8], is_mixed: &[u8], n: usize, kind: bool) {
        self.fill(n, OfKind { valid, is_mixed, n, kind: u8::from(kind) });
    }

    fn fill(&mut self, n: usize, of: impl FeatureRow) {
        debug_assert!(n <= MOST_INTERVALS, "half rows must fit HalfPoint");
        self.n = n;
        self.stride = (n + 1).next_multiple_of(VECTOR);
        self.down.resize((2 * n + 1) * 2 * self.stride, 0);
        self.low.resize((2 * n + 1) * self.stride / LANES, 0);
        simd::run(Transform { transform: self, of });
    }

    /// Half rows from point `(x, y)` to the nearest feature of its half column; [`FAR`] if none is
    /// nearer than that.
    #[inline]
    fn down(&self, x: usize, y: usize) -> u8 {
        self.down[(2 * y + x % 2) * self.stride + x / 2]
    }

    /// The feature nearest to a point of the half lattice in a plane; `None` if there are no
    /// features. Of features whose distances differ by no more than the rounding of f32 (by a tenth
    /// if the plane is sheared) it may be any.
    pub(super) fn nearest(&self, [x, y]: [usize; 2], plane: Plane) -> Option<HalfPoint> {
        // In units of half an interval across.
        let row = plane.row() / plane.dx;
        let ratio = row * row;
        if plane.skew.abs() > SHEARED * plane.row() {
            return self.far([x, y], plane.dy / plane.row(), plane.skew / plane.dx / ratio, ratio);
        }
        let (column, squared) = simd::run(Nearest { transform: self, from: [x, y], ratio: ratio as f32 });
        // A feature of a nearer column, but farther than a byte can say, may be nearer.
        if f64::from(squared) >= f64::from(FAR) * f64::from(FAR) * ratio * (1.0 - 1e-6) {
            return self.far([x, y], 1.0, 0.0, ratio);
        }
        let down = usize::from(self.down(column, y));
        let row = if y >= down && self.down(column, y - down) == 0 { y - down } else { y + down };
        Some([column as i16, row as i16])
    }

    /// The nearest feature at any distance; that of one `i` half columns and `j` half rows away is
    /// `ratio (j + lean i)^2 + (apart i)^2`.
    #[cold]
    fn far(&self, [x, y]: [usize; 2], apart: f64, lean: f64, ratio: f64) -> Option<HalfPoint> {
        let (mut found, mut least, last) = (None, f64::INFINITY, 2 * self.n);
        for across in 0..=last {
            if (across as f64 * apart).powi(2) >= least {
                break;
            }
            for (column, away) in [(x.wrapping_sub(across), -(across as f64)), (x + across, across as f64)] {
                if column > last {
                    continue;
                }
                // The nearest point of the half column, between two half rows.
                let middle = (y as f64 - lean * away).clamp(0.0, last as f64);
                for asked in [middle.floor() as usize, middle.ceil() as usize] {
                    let Some(row) = self.nearest_in_column(column, asked) else { break };
                    let down = row as f64 - y as f64 + lean * away;
                    let squared = (away * apart).powi(2) + down * down * ratio;
                    if squared < least {
                        (found, least) = (Some([column as i16, row as i16]), squared);
                    }
                }
            }
        }
        found
    }

    /// Half row of the feature of half column `x` that is nearest to half row `y`.
    fn nearest_in_column(&self, x: usize, y: usize) -> Option<usize> {
        let last = 2 * self.n;
        let within = |row: usize| (row <= last).then_some(row);
        // If no feature is nearer than FAR, the next place to look up is that far away.
        (0..=last).step_by(usize::from(FAR)).find_map(|away| {
            let asked = [y.checked_sub(away), within(y + away)].into_iter().flatten();
            let transform = asked.flat_map(|row| {
                let down = usize::from(self.down(x, row));
                [row.checked_sub(down), within(row + down)]
            });
            transform.flatten().filter(|&row| self.down(x, row) == 0).min_by_key(|row| row.abs_diff(y))
        })
    }
}

/// Kernel: half column and squared distance (in units of half an interval across) of the nearest
/// feature, if that is less than [`FAR`] half rows away.
struct Nearest<'a> {
    transform: &'a DistanceTransform,
    from: [usize; 2],
    ratio: f32,
}

/// A half row that a query searches, by blocks.
struct Row<'a> {
    even: &'a [[u8; LANES]],
    odd: &'a [[u8; LANES]],
    low: &'a [u8],
    /// Half column of the point of the query.
    x: usize,
    ratio: f32,
}

/// The block with the nearest feature so far, and its squared distance.
#[derive(Clone, Copy)]
struct Best {
    block: usize,
    squared: f32,
}

impl Row<'_> {
    /// Squared distances to the nearest features of the half columns of a block.
    #[inline(always)]
    fn squared(&self, block: usize) -> [[f32; LANES]; 2] {
        let first = (block * BLOCK) as f32 - self.x as f32;
        [squared(&self.even[block], first, self.ratio), squared(&self.odd[block], first + 1.0, self.ratio)]
    }

    /// Searches a block whose half columns are at least `across` away.
    #[inline(always)]
    fn search(&self, block: usize, across: f32, best: &mut Best) {
        let down = f32::from(self.low[block]);
        if across * across + down * down * self.ratio < best.squared {
            let squared = least(&self.squared(block));
            if squared < best.squared {
                *best = Best { block, squared };
            }
        }
    }
}

/// Squared distances from the parts `down` along half columns, the first of which is `first` half
/// columns away.
// One operation at a time on all lanes, so that the compiler uses vectors.
#[inline(always)]
fn squared(down: &[u8; LANES], first: f32, ratio: f32) -> [f32; LANES] {
    const COLUMNS: [f32; LANES] = [0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0];
    let (mut whole, mut squared, mut across) = ([0_i32; LANES], [0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        whole[i] = i32::from(down[i]);
    }
    for i in 0..LANES {
        squared[i] = (whole[i] * whole[i]) as f32 * ratio;
    }
    for i in 0..LANES {
        across[i] = COLUMNS[i] + first;
    }
    for i in 0..LANES {
        squared[i] += across[i] * across[i];
    }
    squared
}

/// The least of some squared distances. Floats that are not negative have the order of their bits,
/// and the least of integers may be found in any order, hence in vectors.
#[inline(always)]
fn least(squared: &[[f32; LANES]; 2]) -> f32 {
    let mut least = u32::MAX >> 1;
    for lanes in squared {
        for squared in lanes {
            least = least.min(squared.to_bits());
        }
    }
    f32::from_bits(least)
}

impl Kernel for Nearest<'_> {
    type Output = (usize, f32);

    #[inline(always)]
    fn run(self) -> (usize, f32) {
        let Self { transform: DistanceTransform { stride, down, low, .. }, from: [x, y], ratio } = self;
        let (even, odd) = down[2 * y * stride..][..2 * stride].split_at(*stride);
        let count = stride / LANES;
        let (even, odd) = (even.as_chunks().0, odd.as_chunks().0);
        let row = Row { even, odd, low: &low[y * count..][..count], x, ratio };
        let own = x / BLOCK;
        let mut best = Best { block: own, squared: least(&row.squared(own)) };
        // From the point to the blocks on either side.
        let (mut to_west, mut to_east) = ((x % BLOCK + 1) as f32, (BLOCK - x % BLOCK) as f32);
        for away in 1..count {
            let (west, east) = (to_west * to_west < best.squared, to_east * to_east < best.squared);
            if !west && !east {
                break;
            }
            if west && away <= own {
                row.search(own - away, to_west, &mut best);
            }
            if east && own + away < count {
                row.search(own + away, to_east, &mut best);
            }
            to_west += BLOCK as f32;
            to_east += BLOCK as f32;
        }
        let mut is_best = 0_u32;
        for (odd, lanes) in row.squared(best.block).iter().enumerate() {
            for (lane, squared) in lanes.iter().enumerate() {
                is_best |= u32::from(*squared == best.squared) << (odd * LANES + lane);
            }
        }
        let place = is_best.trailing_zeros() as usize % BLOCK;
        (best.block * BLOCK + 2 * (place % LANES) + place / LANES, best.squared)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// All features, one by one.
    fn all(transform: &DistanceTransform, n: usize) -> Vec<HalfPoint> {
        let side = 2 * n + 1;
        let is_feature = |x: usize, y: usize| transform.down(x, y) == 0;
        let points = (0..side * side).map(|i| (i % side, i / side));
        points.filter(|&(x, y)| is_feature(x, y)).map(|(x, y)| [x as i16, y as i16]).collect()
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

    fn nearest_is_nearest(transform: &DistanceTransform, n: usize, half: (f64, f64)) {
        let plane = Plane { dx: half.0, skew: 0.0, dy: half.1 };
        nearest_in_plane(transform, n, plane);
    }

    fn nearest_in_plane(transform: &DistanceTransform, n: usize, plane: Plane) {
        let features = all(transform, n);
        let squared = |[x, y]: HalfPoint, at: [usize; 2]| {
            let (across, down) = (f64::from(x) - at[0] as f64, f64::from(y) - at[1] as f64);
            (across * plane.dx + down * plane.skew).powi(2) + (down * plane.dy).powi(2)
        };
        let step = if n > 256 {
            1499
        } else if n > 16 {
            37
        } else {
            1
        };
        for i in (0..(2 * n + 1) * (2 * n + 1)).step_by(step) {
            let at = [i % (2 * n + 1), i / (2 * n + 1)];
            match transform.nearest(at, plane) {
                None => assert!(features.is_empty()),
                Some(found) => {
                    let least =
                        features.iter().map(|&feature| squared(feature, at)).fold(f64::INFINITY, f64::min);
                    assert!(features.contains(&found), "{found:?} is no feature");
                    assert!(squared(found, at) <= least * (1.0 + 1e-6), "{at:?}: {found:?}, {plane:?}");
                }
            }
        }
    }

    #[test]
    fn features_are_found_from_farther_than_a_byte_can_say() {
        let n = 512;
        for (x, y) in [(0, 0), (n, 3), (200, n), (n / 2, n / 2)] {
            let mut valid = vec![1; (n + 1) * (n + 1)];
            valid[y * (n + 1) + x] = 0;
            for half in [(1.0, 1.0), (1.0, 0.1), (0.1, 1.0), (3.0, 4.0)] {
                let mut transform = DistanceTransform::default();
                transform.of_outline(&valid, n);
                nearest_is_nearest(&transform, n, half);
                transform.of_kind(&valid, &vec![0; n * n], n, false);
                nearest_is_nearest(&transform, n, half);
            }
        }
        let mut transform = DistanceTransform::default();
        transform.of_outline(&vec![1; (n + 1) * (n + 1)], n);
        assert_eq!(transform.nearest([7, 9], Plane { dx: 1.0, skew: 0.0, dy: 1.0 }), None);
    }

    #[test]
    fn features_of_a_sheared_lattice_are_found() {
        for (n, seed) in [(16, 5), (16, 9), (128, 7)] {
            let mut transform = DistanceTransform::default();
            for rarity in [7, 60] {
                transform.of_outline(&samples(n + 1, rarity, seed), n);
                for (dx, skew, dy) in [(1.0, 0.5, 1.0), (1.0, -5.0, 2.0), (9.0, 3.0, 1.0), (2.0, -10.0, 40.0)]
                {
                    let plane = Plane { dx, skew, dy };
                    nearest_in_plane(&transform, n, plane);
                }
            }
        }
    }

    proptest! {
        #[test]
        fn features_are_where_the_definitions_say_and_the_nearest_is_found(
            log_n in 2_u32..8,
            rarity in prop::sample::select(vec![2_u64, 7, 100, 5_000]),
            seed: u64,
            half in (0.1_f64..10.0, 0.1_f64..10.0),
        ) {
            let n = 1 << log_n;
            let side = n + 1;
            let valid = samples(side, rarity, seed);
            let at = |x: usize, y: usize| valid[y * side + x];
            let mut transform = DistanceTransform::default();
            transform.of_outline(&valid, n);
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
            prop_assert_eq!(all(&transform, n), expected);
            nearest_is_nearest(&transform, n, half);

            // Blocks: some of them mixed though their corners are alike.
            let mixed = samples(n, rarity, !seed);
            for kind in [false, true] {
                transform.of_kind(&valid, &mixed, n, kind);
                let is_kind = |x: usize, y: usize| (at(x, y) == 1) == kind;
                let mut expected = Vec::new();
                for y in 0..=2 * n {
                    for x in 0..=2 * n {
                        let (i, j) = (x / 2, y / 2);
                        let features = match (x % 2, y % 2) {
                            (0, 0) => is_kind(i, j),
                            (1, 1) => {
                                let corners = [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)];
                                mixed[j * n + i] == 1 && !corners.iter().any(|&(i, j)| is_kind(i, j))
                            }
                            _ => false,
                        };
                        if features {
                            expected.push([x as i16, y as i16]);
                        }
                    }
                }
                prop_assert_eq!(all(&transform, n), expected);
                nearest_is_nearest(&transform, n, half);
            }
        }
    }
}
