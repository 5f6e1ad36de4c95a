//! For tests: a reader in the words of `format-spec.md`. Exact numbers, one sample at a time,
//! nothing shared with the codec.

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
        if self.m == 1 { self.c[0][0] } else { beyond(a, b, self.m, &|a, b| self.c[b as usize][a as usize]) }
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
    let lows = if b > 0 { zstd::stream::decode_all(&chunk[chunk.len() - b..]).unwrap() } else { Vec::new() };
    (residuals, chunk[2], lows)
}

/// Columns and rows, row by row.
fn grid(columns: usize, rows: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..rows).flat_map(move |b| (0..columns).map(move |a| (a, b)))
}

/// What section 9 decodes, stage by stage.
struct Stages<'a> {
    n: usize,
    state: &'a [u8],
    q: Vec<i128>,
    residuals: std::vec::IntoIter<i64>,
    weights: (i128, i128),
}

impl Stages<'_> {
    fn at(&self, x: usize, y: usize) -> usize {
        y * (self.n + 1) + x
    }

    fn valid(&self, x: usize, y: usize) -> bool {
        self.state[self.at(x, y)] == VALID
    }

    fn corners(&mut self) {
        let mut before = 0;
        for (x, y) in [(0, 0), (self.n, 0), (0, self.n), (self.n, self.n)] {
            before = i128::from((before + i128::from(self.residuals.next().unwrap())) as i32);
            let at = self.at(x, y);
            self.q[at] = before;
        }
    }

    /// Section 9.2. A void sample is its prediction until the valid samples of its stage are known.
    fn refine(&mut self, m: usize) {
        let h = self.n / m / 2;
        let parents = |b: usize| (0..=m).map(move |a| (2 * a * h, 2 * b * h));
        let mut p: Vec<Vec<i128>> =
            (0..=m).map(|b| parents(b).map(|(x, y)| self.q[self.at(x, y)]).collect()).collect();
        let valid: Vec<Vec<bool>> =
            (0..=m).map(|b| parents(b).map(|(x, y)| self.valid(x, y)).collect()).collect();
        replace(&mut p, &valid);
        let (sharpness, skew) = self.weights;
        let mut planes = Planes { m: m as i64, sharpness, skew, p, c: vec![vec![0; m]; m] };
        let mut void = Vec::new();
        let mut put = |x: usize, y: usize, prediction: i128| {
            let (x, y, residual) = (x * h, y * h, i128::from(self.residuals.next().unwrap()));
            let code = if self.valid(x, y) { prediction + residual } else { prediction };
            let at = self.at(x, y);
            self.q[at] = i128::from(code as i32);
            if !self.valid(x, y) {
                void.push((x, y, residual));
            }
            self.q[at]
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
        for (x, y, residual) in void {
            let around = grid(3, 3).map(|(i, j)| (x + i * h, y + j * h));
            let inside = around.filter(|(x, y)| (h..=self.n + h).contains(x) && (h..=self.n + h).contains(y));
            let near = inside.map(|(x, y)| (x - h, y - h)).filter(|(x, y)| self.valid(*x, *y));
            let mut near: Vec<i128> = near.map(|(x, y)| self.q[self.at(x, y)]).collect();
            near.sort_unstable();
            let at = self.at(x, y);
            let median = if near.is_empty() { self.q[at] } else { near[(near.len() - 1) / 2] };
            self.q[at] = i128::from((median + residual) as i32);
        }
    }
}

/// Section 9.
pub fn heights(chunk: &[u8], lattice: &mut Lattice, coding: Coding, root: bool) {
    let n = lattice.n;
    let order = newborn(n, root);
    let (residuals, transform, lows) = residuals(chunk, order.len());
    let scales = [1., 2., 4., 8., 16., 32., 64., 128., 256., 10., 100., 1000.];
    let scale = (transform > 0).then(|| scales[usize::from(transform) - 1]);
    let up = |code: i32, s: f64| (f64::from(f32_from_code(code)) * s + 0.5).floor() as i32;
    let q = lattice.code.iter().map(|&code| i128::from(scale.map_or(code, |s| up(code, s)))).collect();
    let weights = i128::from(chunk.get(3).copied().unwrap_or(0x85));
    let weights = (weights % 16, weights / 16 - 8);
    let mut stages = Stages { n, state: &lattice.state, q, residuals: residuals.into_iter(), weights };
    let mut m = n / 2;
    if root {
        stages.corners();
        m = 1;
    }
    while 2 * m <= n {
        stages.refine(m);
        m *= 2;
    }
    let q = stages.q;
    for (i, &(x, y)) in order.iter().enumerate() {
        let at = lattice.at(x, y);
        let code = q[at] as i32;
        lattice.code[at] = scale.map_or(code, |s| code_from_f32((f64::from(code) / s) as f32));
        if coding.has_low() {
            let byte = |j: usize| u32::from(lows[j * order.len() + i]);
            lattice.low[at] = byte(0) | byte(1) << 8 | byte(2) << 16 | byte(3) << 24;
        }
    }
}
