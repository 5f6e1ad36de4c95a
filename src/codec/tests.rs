//! The codec against a slow reader that follows the specification word by word, and against damaged chunks.

use super::{Scratch, decimal, height, mask, table};
use crate::sample::{Coding, FILLED, Lattice, VALID, VOID, code_from_f32, code_from_f64};
use proptest::prelude::*;

/// A reader in the words of `format-spec.md`: exact numbers, one sample at a time, nothing shared with the codec.
mod oracle {
    use crate::sample::{Coding, Lattice, VALID, VOID, code_from_f32, f32_from_code};

    /// Newborn samples as (column, row), in the order of section 7.
    pub fn newborn(n: usize, root: bool) -> Vec<(usize, usize)> {
        let mut order = if root { vec![(0, 0), (n, 0), (0, n), (n, n)] } else { Vec::new() };
        let mut m = if root { 1 } else { n / 2 };
        while 2 * m <= n {
            let s = n / (2 * m);
            for (x, y, columns, rows) in [(1, 1, m, m), (1, 0, m, m + 1), (0, 1, m + 1, m)] {
                for b in 0..rows {
                    order.extend((0..columns).map(|a| ((2 * a + x) * s, (2 * b + y) * s)));
                }
            }
            m *= 2;
        }
        order
    }

    /// Section 8.
    pub fn mask(frame: &[u8], lattice: &mut Lattice, root: bool) {
        let n = lattice.n;
        let bytes = zstd::stream::decode_all(frame).unwrap();
        for (i, (x, y)) in newborn(n, root).into_iter().enumerate() {
            let bit = bytes[i / 8] >> (i % 8) & 1 == 1;
            // Spacing of the sample's stage, halved: its neighbours are at this distance.
            let s = (x | y | n).trailing_zeros();
            let s = 1_usize << s;
            let corner = s == n;
            let (odd_x, odd_y) = (x / s % 2 == 1, y / s % 2 == 1);
            let near: &[(isize, isize)] = match (odd_x, odd_y) {
                (true, true) => &[(-1, -1), (1, -1), (-1, 1), (1, 1)],
                _ => &[(-1, 0), (1, 0), (0, -1), (0, 1)],
            };
            let known: Vec<bool> = near
                .iter()
                .map(|(dx, dy)| (x as isize + dx * s as isize, y as isize + dy * s as isize))
                .filter(|(x, y)| (0..=n as isize).contains(x) && (0..=n as isize).contains(y))
                .map(|(x, y)| lattice.state[lattice.at(x as usize, y as usize)] == VALID)
                .collect();
            let valid = known.iter().filter(|valid| **valid).count();
            let predicted = corner || 2 * valid >= known.len();
            let at = lattice.at(x, y);
            lattice.state[at] = if bit ^ predicted { VALID } else { VOID };
        }
    }

    struct Planes {
        m: i64,
        sharpness: i128,
        skew: i128,
        p: Vec<Vec<i128>>,
        c: Vec<Vec<i128>>,
    }

    impl Planes {
        fn p(&self, a: i64, b: i64) -> i128 {
            beyond(a, b, self.m + 1, &|a, b| self.p[b as usize][a as usize])
        }
        fn c(&self, a: i64, b: i64) -> i128 {
            if self.m == 1 {
                self.c[0][0]
            } else {
                beyond(a, b, self.m, &|a, b| self.c[b as usize][a as usize])
            }
        }
        fn centre(&self, a: i64, b: i64) -> i128 {
            let p = |a, b| self.p(a, b);
            let s4 = p(a, b) + p(a + 1, b) + p(a, b + 1) + p(a + 1, b + 1);
            let s8 = p(a - 1, b) + p(a - 1, b + 1) + p(a + 2, b) + p(a + 2, b + 1);
            let s8 = s8 + p(a, b - 1) + p(a + 1, b - 1) + p(a, b + 2) + p(a + 1, b + 2);
            let i = self.sharpness;
            ((32 + 2 * i) * s4 - i * s8 + 64) >> 7
        }
        fn horizontal(&self, a: i64, b: i64) -> i128 {
            let (p, c) = (|a, b| self.p(a, b), |a, b| self.c(a, b));
            if b == 0 || b == self.m {
                return (9 * (p(a, b) + p(a + 1, b)) - p(a - 1, b) - p(a + 2, b) + 8) >> 4;
            }
            let (e, n) = (p(a, b) + p(a + 1, b), c(a, b - 1) + c(a, b));
            let e4 = c(a - 1, b - 1) + c(a - 1, b) + c(a + 1, b - 1) + c(a + 1, b);
            let n4 = p(a, b - 1) + p(a + 1, b - 1) + p(a, b + 1) + p(a + 1, b + 1);
            self.edge(e, n, e4, n4)
        }
        fn vertical(&self, a: i64, b: i64) -> i128 {
            let (p, c) = (|a, b| self.p(a, b), |a, b| self.c(a, b));
            if a == 0 || a == self.m {
                return (9 * (p(a, b) + p(a, b + 1)) - p(a, b - 1) - p(a, b + 2) + 8) >> 4;
            }
            let (e, n) = (c(a - 1, b) + c(a, b), p(a, b) + p(a, b + 1));
            let e4 = p(a - 1, b) + p(a - 1, b + 1) + p(a + 1, b) + p(a + 1, b + 1);
            let n4 = c(a - 1, b - 1) + c(a, b - 1) + c(a - 1, b + 1) + c(a, b + 1);
            self.edge(e, n, e4, n4)
        }
        fn edge(&self, e: i128, n: i128, e4: i128, n4: i128) -> i128 {
            let (i, j) = (self.sharpness, self.skew);
            ((32 + 2 * i + 4 * j) * e + (32 + 2 * i - 4 * j) * n - (i + j) * e4 - (i - j) * n4 + 64) >> 7
        }
    }

    fn beyond(a: i64, b: i64, size: i64, at: &dyn Fn(i64, i64) -> i128) -> i128 {
        if a < 0 {
            2 * at(0, b) - at(1, b)
        } else if a >= size {
            2 * at(size - 1, b) - at(size - 2, b)
        } else if b < 0 {
            2 * at(a, 0) - at(a, 1)
        } else if b >= size {
            2 * at(a, size - 1) - at(a, size - 2)
        } else {
            at(a, b)
        }
    }

    fn replace(p: &mut [Vec<i128>], valid: &[Vec<bool>]) {
        let rows = p.len();
        for (row, valid) in p.iter_mut().zip(valid) {
            let good: Vec<usize> = (0..rows).filter(|a| valid[*a]).collect();
            for a in (0..rows).filter(|a| !valid[*a]) {
                let before = good.iter().rev().find(|g| **g < a);
                let after = good.iter().find(|g| **g > a);
                row[a] = match (before, after) {
                    (Some(&a0), Some(&a1)) => {
                        row[a0] + ((row[a1] - row[a0]) * (a - a0) as i128).div_euclid((a1 - a0) as i128)
                    }
                    (Some(&g), None) | (None, Some(&g)) => row[g],
                    (None, None) => 0,
                };
            }
        }
        let good: Vec<usize> = (0..rows).filter(|b| valid[*b].contains(&true)).collect();
        for b in 0..rows {
            let source = good.iter().rev().find(|g| **g <= b).or(good.first());
            p[b] = source.map_or(vec![0; rows], |source| p[*source].clone());
        }
    }

    fn residuals(chunk: &[u8], count: usize) -> (Vec<i64>, u8, Vec<u8>) {
        if chunk.is_empty() {
            return (vec![0; count], 0, vec![0; 4 * count]);
        }
        let word = |at: usize| u32::from_le_bytes(chunk[at..at + 4].try_into().unwrap()) as usize;
        let (k, a, b) = (usize::from(chunk[1]), word(4), word(8));
        let plane = zstd::stream::decode_all(&chunk[12..12 + a]).unwrap();
        let raw = &chunk[12 + a..chunk.len() - b];
        assert_eq!(raw.len(), (count * k).div_ceil(8));
        let mut escapes = plane[count..].iter();
        let residuals = (0..count).map(|i| {
            let mut u = u64::from(plane[i]);
            if u == 255 {
                for shift in (0..).step_by(7) {
                    let byte = *escapes.next().unwrap();
                    u += u64::from(byte & 127) << shift;
                    if byte < 128 {
                        break;
                    }
                }
            }
            let w = (0..k).fold(0, |w, j| w | u64::from(raw[(i * k + j) / 8] >> ((i * k + j) % 8) & 1) << j);
            let g = (u << k | w) as i64;
            (g >> 1) ^ -(g & 1)
        });
        let residuals = residuals.collect();
        let lows =
            if b > 0 { zstd::stream::decode_all(&chunk[chunk.len() - b..]).unwrap() } else { Vec::new() };
        (residuals, chunk[2], lows)
    }

    /// Columns and rows, row by row.
    fn grid(columns: usize, rows: usize) -> impl Iterator<Item = (usize, usize)> {
        (0..rows).flat_map(move |b| (0..columns).map(move |a| (a, b)))
    }

    /// Section 9.
    pub fn heights(chunk: &[u8], lattice: &mut Lattice, coding: Coding, root: bool) {
        let n = lattice.n;
        let order = newborn(n, root);
        let (residuals, transform, lows) = residuals(chunk, order.len());
        let mut residuals = residuals.into_iter();
        let scales = [1., 2., 4., 8., 16., 32., 64., 128., 256., 10., 100., 1000.];
        let scale = (transform > 0).then(|| scales[usize::from(transform) - 1]);
        let mut q: Vec<i128> = lattice.code.iter().map(|&code| i128::from(code)).collect();
        if let Some(s) = scale {
            let up = |&code: &i32| (f64::from(f32_from_code(code)) * s + 0.5).floor() as i32;
            q = lattice.code.iter().map(|code| i128::from(up(code))).collect();
        }
        let at = |x: usize, y: usize| y * (n + 1) + x;
        let state = lattice.state.clone();
        let valid_at = |x: usize, y: usize| state[at(x, y)] == VALID;
        // A void sample is its prediction until the valid samples of its stage are known.
        let mut take = |prediction: i128, valid: bool| {
            let residual = i128::from(residuals.next().unwrap());
            let code = |residual| i128::from((prediction + residual) as i32);
            if valid { (code(residual), 0) } else { (code(0), residual) }
        };
        let mut m = n / 2;
        if root {
            let mut before = 0;
            for (x, y) in [(0, 0), (n, 0), (0, n), (n, n)] {
                before = take(before, true).0;
                q[at(x, y)] = before;
            }
            m = 1;
        }
        while 2 * m <= n {
            let h = n / m / 2;
            let mut p: Vec<Vec<i128>> =
                (0..=m).map(|b| (0..=m).map(|a| q[at(2 * a * h, 2 * b * h)]).collect()).collect();
            let valid: Vec<Vec<bool>> =
                (0..=m).map(|b| (0..=m).map(|a| valid_at(2 * a * h, 2 * b * h)).collect()).collect();
            replace(&mut p, &valid);
            let weights = i128::from(chunk.get(3).copied().unwrap_or(0x85));
            let (sharpness, skew) = (weights % 16, weights / 16 - 8);
            let mut planes = Planes { m: m as i64, sharpness, skew, p, c: vec![vec![0; m]; m] };
            let mut void = Vec::new();
            let mut put = |x: usize, y: usize, prediction: i128| {
                let (code, residual) = take(prediction, valid_at(x * h, y * h));
                q[at(x * h, y * h)] = code;
                void.push((x * h, y * h, residual));
                code
            };
            for (a, b) in grid(m, m) {
                planes.c[b][a] = put(2 * a + 1, 2 * b + 1, planes.centre(a as i64, b as i64));
            }
            for (a, b) in grid(m, m + 1) {
                put(2 * a + 1, 2 * b, planes.horizontal(a as i64, b as i64));
            }
            for (a, b) in grid(m + 1, m) {
                put(2 * a, 2 * b + 1, planes.vertical(a as i64, b as i64));
            }
            for (x, y, residual) in void.into_iter().filter(|(x, y, _)| !valid_at(*x, *y)) {
                let around = grid(3, 3).map(|(i, j)| (x + i * h, y + j * h));
                let inside = around.filter(|(x, y)| (h..=n + h).contains(x) && (h..=n + h).contains(y));
                let near = inside.map(|(x, y)| (x - h, y - h)).filter(|(x, y)| valid_at(*x, *y));
                let mut near: Vec<i128> = near.map(|(x, y)| q[at(x, y)]).collect();
                near.sort_unstable();
                let median = if near.is_empty() { q[at(x, y)] } else { near[(near.len() - 1) / 2] };
                q[at(x, y)] = i128::from((median + residual) as i32);
            }
            m *= 2;
        }
        for (i, &(x, y)) in order.iter().enumerate() {
            let code = q[at(x, y)] as i32;
            lattice.code[at(x, y)] = scale.map_or(code, |s| code_from_f32((f64::from(code) / s) as f32));
            if coding.has_low() {
                let byte = |j: usize| u32::from(lows[j * order.len() + i]);
                lattice.low[at(x, y)] = byte(0) | byte(1) << 8 | byte(2) << 16 | byte(3) << 24;
            }
        }
    }
}

/// A tile as its parent leaves it: even samples known, the rest blank.
fn blank(lattice: &Lattice, coding: Coding, root: bool) -> Lattice {
    let mut blank = Lattice::new(lattice.n, coding);
    // Nothing may depend on what was there.
    blank.code.fill(0x5A5A_5A5A);
    blank.low.fill(7);
    blank.state.fill(FILLED);
    for (x, y) in (0..=lattice.n).flat_map(|y| (0..=lattice.n).map(move |x| (x, y))) {
        if !root && x % 2 == 0 && y % 2 == 0 {
            let at = lattice.at(x, y);
            blank.code[at] = lattice.code[at];
            blank.state[at] = if lattice.state[at] == VALID { VALID } else { VOID };
            if coding.has_low() {
                blank.low[at] = lattice.low[at];
            }
        }
    }
    blank
}

/// Encodes a tile and checks what both readers make of it. Gives the chunks.
fn check(lattice: &Lattice, coding: Coding, root: bool, scratch: &mut Scratch) -> (Vec<u8>, Vec<u8>) {
    let (mut heights, mut bits) = (vec![1, 2, 3], vec![4]);
    height::encode(lattice, coding, root, scratch, &mut heights).unwrap();
    let occupancy = mask::encode(lattice, root, scratch, &mut bits).unwrap();
    let (heights, bits) = (heights.split_off(3), bits.split_off(1));

    let mut decoded = blank(lattice, coding, root);
    let mut expected = decoded.clone();
    mask::decode(&bits, occupancy, &mut decoded, root, scratch).unwrap();
    if occupancy.has_valid && occupancy.has_void {
        oracle::mask(&bits, &mut expected, root);
    } else {
        assert!(bits.is_empty());
        expected.state.fill(if occupancy.has_valid { VALID } else { VOID });
    }
    assert!(decoded.state == expected.state, "mask and oracle differ");
    height::decode(&heights, &mut decoded, coding, root, scratch).unwrap();
    oracle::heights(&heights, &mut expected, coding, root);
    assert!(decoded.code == expected.code, "heights and oracle differ");
    assert!(decoded.low == expected.low, "lows and oracle differ");
    for (at, &state) in lattice.state.iter().enumerate() {
        assert_eq!(decoded.state[at] == VALID, state == VALID, "sample {at}");
        if state != VOID {
            assert_eq!(decoded.code[at], lattice.code[at], "sample {at}");
            assert_eq!(decoded.low_at(at), lattice.low_at(at), "sample {at}");
        }
    }
    (heights, bits)
}

/// Numbers that look random, the same every time.
fn hash(seed: u64, x: usize, y: usize) -> u64 {
    let mut z = seed
        ^ (x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Hills of several sizes, in metres.
fn hills(seed: u64, x: usize, y: usize) -> f64 {
    let (x, y, phase) = (x as f64, y as f64, (seed % 100) as f64);
    300.0 * (x / 40.0 + phase).sin() * (y / 31.0).cos()
        + 60.0 * ((x + y) / 9.0).sin()
        + 9.0 * (x / 2.3 - y / 3.1).sin()
}

const KINDS: usize = 14;
const PATTERNS: usize = 8;

/// A tile whose heights are of one of [`KINDS`] and whose voids follow one of [`PATTERNS`].
fn tile(n: usize, kind: usize, pattern: usize, seed: u64) -> (Lattice, Coding) {
    let coding = match kind {
        0..=6 => Coding::Integer { scale: 1.0, offset: 0.0 },
        7..=11 => Coding::Float32,
        _ => Coding::Float64,
    };
    let mut lattice = Lattice::new(n, coding);
    for (x, y) in (0..=n).flat_map(|y| (0..=n).map(move |x| (x, y))) {
        let (at, random, h) = (lattice.at(x, y), hash(seed, x, y), hills(seed, x, y));
        let float = match kind {
            7 => h as f32,
            8 => ((f64::from((h * 100.0) as i32)) / 100.0) as f32,
            9 => ((h * 4.0).floor() / 4.0) as f32,
            10 => [-0.0, 0.0, 1e-42, -1e-42, f32::MAX, f32::MIN, f32::MIN_POSITIVE, 1.5][random as usize % 8],
            _ => f32::from_bits(random as u32 & 0xFF7F_FFFF),
        };
        let double = if kind == 12 { h } else { f64::from_bits(random & 0xFFEF_FFFF_FFFF_FFFF) };
        lattice.code[at] = match kind {
            0 => h as i32,
            1 => 123,
            2 => 7 * x as i32 - 3 * y as i32,
            3 => (random % 500) as i32,
            4 => random as i32,
            5 => [i32::MIN, i32::MAX, 0, -1][random as usize % 4],
            6 => (h * 1e6) as i32,
            7..=11 => code_from_f32(float),
            _ => code_from_f64(double).0,
        };
        if coding.has_low() {
            lattice.low[at] = code_from_f64(double).1;
        }
        let void = match pattern {
            0 => false,
            1 => true,
            2 => random >> 40 & 1 == 0,
            3 => random >> 40 & 63 == 0,
            4 => hills(seed / 7, x, y) > 100.0,
            5 => (y / 3) % 2 == 0,
            6 => (x + y) % 2 == 0,
            _ => x != n || y != n / 3,
        };
        let filled = if random >> 50 & 1 == 0 { FILLED } else { VOID };
        lattice.state[at] = if void { filled } else { VALID };
    }
    (lattice, coding)
}

#[test]
fn every_kind_and_pattern_comes_back() {
    let mut scratch = Scratch::default();
    for kind in 0..KINDS {
        for pattern in 0..PATTERNS {
            for root in [false, true] {
                let (lattice, coding) = tile(32, kind, pattern, 77);
                check(&lattice, coding, root, &mut scratch);
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(192))]
    #[test]
    fn tiles_come_back(
        size in 1_u32..=8, kind in 0..KINDS, pattern in 0..PATTERNS, seed: u64, root: bool
    ) {
        let (lattice, coding) = tile(1 << size, kind, pattern, seed);
        check(&lattice, coding, root, &mut Scratch::default());
    }

    #[test]
    fn any_numbers_come_back(
        samples in prop::collection::vec((any::<i32>(), any::<u32>(), 0..=VALID), 81), coding in 0..3, root: bool
    ) {
        let coding = [Coding::Integer { scale: 1.0, offset: 0.0 }, Coding::Float32, Coding::Float64][coding as usize];
        let mut lattice = Lattice::new(8, coding);
        lattice.code = samples.iter().map(|sample| sample.0).collect();
        if coding.has_low() {
            lattice.low = samples.iter().map(|sample| sample.1).collect();
        }
        lattice.state = samples.iter().map(|sample| sample.2).collect();
        check(&lattice, coding, root, &mut Scratch::default());
    }
}

#[test]
fn the_largest_tile_comes_back() {
    let (lattice, coding) = tile(1024, 0, 4, 5);
    check(&lattice, coding, false, &mut Scratch::default());
}

#[test]
fn ends_of_the_narrow_range_come_back() {
    let coding = Coding::Integer { scale: 1.0, offset: 0.0 };
    let mut scratch = Scratch::default();
    for base in [0, -5, i32::MIN, i32::MAX - (1 << 24)] {
        for range in [(1_u64 << 23) - 1, 1 << 23, (1 << 23) + 1, (1 << 24) - 1] {
            for root in [false, true] {
                let (mut lattice, _) = tile(16, 0, 2, 3);
                for at in 0..lattice.code.len() {
                    let h = if hash(9, at, 0) % 2 == 0 {
                        hash(8, at, 0) % (range + 1)
                    } else {
                        hash(7, at, 1) % 2 * range
                    };
                    lattice.code[at] = base + h as i32;
                }
                check(&lattice, coding, root, &mut scratch);
            }
        }
    }
}

#[test]
fn a_smooth_tile_without_news_takes_no_bytes() {
    let mut scratch = Scratch::default();
    let (ramp, coding) = tile(64, 2, 0, 1);
    let mut even = ramp.clone();
    even.code.iter_mut().for_each(|code| *code *= 2);
    assert!(check(&even, coding, false, &mut scratch).0.is_empty());
    let (void, coding) = tile(64, 12, 0, 1);
    let void = Lattice { state: vec![VOID; void.state.len()], ..void };
    assert!(check(&void, coding, true, &mut scratch).0.is_empty());
}

#[test]
fn decimals_are_found_and_minus_zero_is_kept() {
    let mut scratch = Scratch::default();
    let (mut cents, coding) = tile(64, 8, 0, 3);
    let (chunk, _) = check(&cents, coding, false, &mut scratch);
    assert_eq!(chunk[2], 11);
    // One newborn sample of -0 is not f32(q / s) for any q.
    cents.code[1] = code_from_f32(-0.0);
    let (chunk, _) = check(&cents, coding, false, &mut scratch);
    assert_eq!(chunk[2], 0);
    let (quarters, coding) = tile(64, 9, 0, 3);
    let (chunk, _) = check(&quarters, coding, true, &mut scratch);
    assert_eq!(chunk[2], 3);
    let odd = [f32::MAX, f32::MIN, f32::NAN, f32::INFINITY, -0.0, 1e-40];
    for code in odd.map(code_from_f32).into_iter().chain([i32::MIN, i32::MAX]) {
        for scale in [1.0, 1000.0] {
            let _ = decimal::code_from_q(decimal::q_from_code(code, scale), scale);
        }
    }
}

/// Whatever the bytes, a decoder answers.
fn decode_all(
    heights: &[u8],
    bits: &[u8],
    lattice: &Lattice,
    coding: Coding,
    root: bool,
    scratch: &mut Scratch,
) -> [bool; 2] {
    let mut decoded = blank(lattice, coding, root);
    let occupancy = mask::Occupancy { has_valid: true, has_void: true };
    let mask = mask::decode(bits, occupancy, &mut decoded, root, scratch).is_ok();
    [height::decode(heights, &mut decoded, coding, root, scratch).is_ok(), mask]
}

#[test]
fn every_cut_chunk_is_refused() {
    let mut scratch = Scratch::default();
    for (kind, root) in [(0, false), (3, true), (8, false), (11, false), (12, true)] {
        let (lattice, coding) = tile(16, kind, 2, 4);
        let (heights, bits) = check(&lattice, coding, root, &mut scratch);
        for end in 1..heights.len() {
            assert!(!decode_all(&heights[..end], &bits, &lattice, coding, root, &mut scratch)[0], "{end}");
        }
        for end in 0..bits.len() {
            assert!(!decode_all(&heights, &bits[..end], &lattice, coding, root, &mut scratch)[1], "{end}");
        }
        for more in [&[0][..], &[0; 9]] {
            let (heights, bits) = ([&heights, more].concat(), [&bits, more].concat());
            assert_eq!(decode_all(&heights, &bits, &lattice, coding, root, &mut scratch), [false; 2]);
        }
    }
}

#[test]
fn changed_chunks_never_panic() {
    let mut scratch = Scratch::default();
    for (kind, root) in [(0, false), (3, true), (5, false), (8, true), (11, false), (12, false)] {
        let (lattice, coding) = tile(16, kind, 2, 4);
        let (heights, bits) = check(&lattice, coding, root, &mut scratch);
        for round in 0..2000 {
            let (mut heights, mut bits) = (heights.clone(), bits.clone());
            for change in 0..=round % 3 {
                let at = |length: usize| hash(round as u64, change, 1) as usize % length;
                let early = if round % 2 == 0 { heights.len() } else { 40.min(heights.len()) };
                let (in_heights, in_bits) = (at(early), at(bits.len()));
                heights[in_heights] ^= hash(round as u64, change, 2) as u8;
                bits[in_bits] ^= hash(round as u64, change, 3) as u8;
            }
            decode_all(&heights, &bits, &lattice, coding, root, &mut scratch);
        }
    }
}

#[test]
fn sound_frames_of_unsound_content_never_panic() {
    let mut scratch = Scratch::default();
    let (lattice, coding) = tile(16, 0, 2, 4);
    for round in 0..2000_u64 {
        let k = [0, 1, 7, 24][round as usize % 4];
        let count = 17 * 17 - 81;
        let mut plane: Vec<u8> = (0..count + round as usize % 600).map(|i| hash(round, i, 0) as u8).collect();
        if round % 3 == 0 {
            plane[..count].fill(1);
        }
        plane
            .iter_mut()
            .skip(round as usize % count)
            .for_each(|byte| *byte |= if round % 5 == 0 { 0xFF } else { 0x80 });
        let mut frame = Vec::new();
        super::frame::compress(&plane, &mut frame).unwrap();
        let mut chunk = vec![round as u8 % 2, k, 0, 0];
        chunk.extend_from_slice(&(frame.len() as u32).to_le_bytes());
        chunk.extend_from_slice(&[0; 4]);
        chunk.extend_from_slice(&frame);
        chunk.resize(chunk.len() + (count * usize::from(k)).div_ceil(8), 0xFF);
        decode_all(&chunk, &[], &lattice, coding, false, &mut scratch);
    }
}

#[test]
fn unknown_heads_are_refused() {
    let mut scratch = Scratch::default();
    let (lattice, coding) = tile(16, 0, 0, 4);
    let (heights, _) = check(&lattice, coding, false, &mut scratch);
    for (at, value) in
        [(0, 2), (0, 0x80), (1, 25), (2, 1), (2, 13), (3, 0x88), (3, 0x0F), (8, 1), (4, heights[4] + 1)]
    {
        let mut changed = heights.clone();
        changed[at] = value;
        assert!(!decode_all(&changed, &[], &lattice, coding, false, &mut scratch)[0], "byte {at} = {value}");
    }
}

#[test]
fn one_kind_of_samples_needs_no_mask() {
    let mut scratch = Scratch::default();
    let (lattice, coding) = tile(16, 0, 0, 4);
    let mut decoded = blank(&lattice, coding, true);
    let mut decode = |has_valid, has_void, chunk: &[u8]| {
        mask::decode(chunk, mask::Occupancy { has_valid, has_void }, &mut decoded, true, &mut scratch)
    };
    assert!(decode(true, false, &[]).is_ok());
    assert!(decode(false, true, &[]).is_ok());
    assert!(decode(false, false, &[]).is_err());
    assert!(decode(true, true, &[]).is_err());
    assert!(decode(true, false, &[0]).is_err());
}

/// The bytes of version 1: a 5 x 5 root whose every part can be checked by hand.
#[test]
fn golden_bytes() {
    let coding = Coding::Integer { scale: 1.0, offset: 0.0 };
    let mut lattice = Lattice::new(4, coding);
    lattice.state.fill(VALID);
    lattice.code = (0..25).map(|at| at * at).collect();
    lattice.state[6] = VOID;
    lattice.state[7] = FILLED;
    let (heights, bits) = check(&lattice, coding, true, &mut Scratch::default());
    println!("{heights:02X?}\n{bits:02X?}");
}

#[test]
fn tables_come_back_and_damaged_ones_do_not() {
    for (patches, steps) in [(1, 1), (4, 6), (16, 5), (64, 3)] {
        let count: usize = patches * patches;
        let mut original = table::ErrorTable { patches, steps, ..Default::default() };
        original.drawable = (0..count).map(|at| hash(1, at, 0) % 3 > 0).collect();
        for at in 0..count * steps {
            let before = |plane: &[u16]| if at < count { 0 } else { plane[at - count] };
            let more = |seed| (hash(seed, at, 1) % 9000) as u16;
            original.vertical.push(before(&original.vertical) + more(1));
            original.horizontal.push(before(&original.horizontal) + more(2));
        }
        let mut chunk = Vec::new();
        table::encode(&original, &mut chunk).unwrap();
        assert_eq!(table::decode(&chunk, patches, steps).unwrap(), original);
        assert!(table::decode(&chunk, patches, steps + 1).is_err());
        assert!(table::decode(&chunk, 2 * patches, steps).is_err());
        for end in 0..chunk.len().min(500) {
            assert!(table::decode(&chunk[..end], patches, steps).is_err());
        }
        for round in 0..1000 {
            let mut changed = chunk.clone();
            let at = hash(3, round, 0) as usize % chunk.len();
            changed[at] ^= hash(4, round, 0) as u8;
            let _ = table::decode(&changed, patches, steps);
        }
    }
}

#[test]
fn tables_must_be_monotone_and_whole() {
    let table = |vertical: Vec<u16>| table::ErrorTable {
        patches: 1,
        steps: 2,
        drawable: vec![true],
        vertical,
        horizontal: vec![0, 0xFF00],
    };
    let encode = |vertical| table::encode(&table(vertical), &mut Vec::new());
    assert!(encode(vec![5, 6]).is_ok());
    assert!(encode(vec![6, 5]).is_err());
    assert!(encode(vec![6]).is_err());
    assert!(encode(vec![0, 0xFF01]).is_err());
    let mut chunk = Vec::new();
    super::frame::compress(&[1, 0, 2, 0, 0xFF, 0, 0, 0, 0], &mut chunk).unwrap();
    assert!(table::decode(&chunk, 1, 2).is_err(), "0xFF02 is more than infinity");
    chunk.clear();
    super::frame::compress(&[2, 0, 0, 0, 0, 0, 0, 0, 0], &mut chunk).unwrap();
    assert!(table::decode(&chunk, 1, 2).is_err(), "an unused bit is set");
}
