//! Prediction of newborn samples from their parents and from the centres (`format-spec.md`, section 9.2).
//!
//! Samples stand in planes with one sample of padding around them, so that every row is predicted by the same
//! branch-free loop. The arithmetic is generic: 64 bits always suffice, 32 bits do for a *narrow* tile.

/// Integers that predictions are computed in. All operations wrap.
pub trait Word: Copy + Default {
    /// A code, relative to `base`.
    fn from_code(code: i32, base: i32) -> Self;
    /// The code of a number relative to `base`, modulo 2^32.
    fn code(self, base: i32) -> i32;
    /// `self + other`.
    fn plus(self, other: Self) -> Self;
    /// `self - other`.
    fn minus(self, other: Self) -> Self;
    /// `self * 2^bits`.
    fn up(self, bits: u32) -> Self;
    /// `floor((self + 2^(bits - 1)) / 2^bits)`.
    fn rounded_down(self, bits: u32) -> Self;
}

impl Word for i32 {
    #[inline(always)]
    fn from_code(code: i32, base: i32) -> Self {
        code.wrapping_sub(base)
    }
    #[inline(always)]
    fn code(self, base: i32) -> i32 {
        self.wrapping_add(base)
    }
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.wrapping_add(other)
    }
    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }
    #[inline(always)]
    fn up(self, bits: u32) -> Self {
        self << bits
    }
    #[inline(always)]
    fn rounded_down(self, bits: u32) -> Self {
        self.wrapping_add(1 << (bits - 1)) >> bits
    }
}

impl Word for i64 {
    #[inline(always)]
    fn from_code(code: i32, base: i32) -> Self {
        Self::from(code) - Self::from(base)
    }
    #[inline(always)]
    fn code(self, base: i32) -> i32 {
        (self as i32).wrapping_add(base)
    }
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.wrapping_add(other)
    }
    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.wrapping_sub(other)
    }
    #[inline(always)]
    fn up(self, bits: u32) -> Self {
        self << bits
    }
    #[inline(always)]
    fn rounded_down(self, bits: u32) -> Self {
        self.wrapping_add(1 << (bits - 1)) >> bits
    }
}

/// A plane of samples with one sample of padding on every side.
#[derive(Default)]
pub struct Plane<W> {
    width: usize,
    height: usize,
    data: Vec<W>,
}

impl<W: Word> Plane<W> {
    /// Makes room for `width x height` samples; what they are is not defined.
    fn resize(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        self.data.resize((width + 2) * (height + 2), W::default());
    }

    /// Row `row - 1` with its padding: sample `a` stands at `a + 1`.
    #[inline]
    fn padded(&self, row: usize) -> &[W] {
        &self.data[row * (self.width + 2)..][..self.width + 2]
    }

    /// Row `row`, without padding.
    #[inline]
    fn row_mut(&mut self, row: usize) -> &mut [W] {
        &mut self.data[(row + 1) * (self.width + 2) + 1..][..self.width]
    }

    /// Sets row `row` to `codes` relative to `base`.
    pub fn set_row(&mut self, row: usize, codes: &[i32], base: i32) {
        for (sample, &code) in self.row_mut(row).iter_mut().zip(codes) {
            *sample = W::from_code(code, base);
        }
    }

    /// Continues rows and columns by one sample in a straight line; a single sample by itself.
    fn pad(&mut self) {
        let (width, height, stride) = (self.width, self.height, self.width + 2);
        for row in self.data.chunks_exact_mut(stride).skip(1).take(height) {
            row[0] = beyond(row[1], row[2.min(width)]);
            row[width + 1] = beyond(row[width], row[(width - 1).max(1)]);
        }
        for column in 1..=width {
            let at = |row: usize| row * stride + column;
            let (first, second) = (self.data[at(1)], self.data[at(2.min(height))]);
            let (last, before) = (self.data[at(height)], self.data[at((height - 1).max(1))]);
            self.data[at(0)] = beyond(first, second);
            self.data[at(height + 1)] = beyond(last, before);
        }
    }
}

/// The next sample of a line after `last`, whose neighbour is `before`.
#[inline]
fn beyond<W: Word>(last: W, before: W) -> W {
    last.up(1).minus(before)
}

/// The planes that one stage predicts from.
#[derive(Default)]
pub struct Planes<W> {
    /// `P`, `(m + 1)^2`.
    parents: Plane<W>,
    /// `C`, `m^2`, padded.
    centres: Plane<W>,
    /// Subtracted from all codes before they become words.
    base: i32,
}

impl<W: Word> Planes<W> {
    /// Starts a stage of `(m + 1)^2` parents, given row by row with their void samples replaced.
    pub fn start(&mut self, m: usize, parents: &[i32], base: i32) {
        self.base = base;
        self.parents.resize(m + 1, m + 1);
        self.centres.resize(m, m);
        for (row, codes) in parents.chunks_exact(m + 1).enumerate() {
            self.parents.set_row(row, codes, base);
        }
        self.parents.pad();
    }

    /// Takes the codes of row `row` of the centres.
    pub fn set_centres(&mut self, row: usize, codes: &[i32]) {
        self.centres.set_row(row, codes, self.base);
    }

    /// To be called when all centres are set, before H and V are predicted.
    pub fn finish_centres(&mut self) {
        self.centres.pad();
    }

    /// Predicts row `b` of the centres.
    pub fn predict_centres(&self, b: usize, out: &mut [i32]) {
        let m = out.len();
        let (above, upper) = (self.parents.padded(b), self.parents.padded(b + 1));
        let (lower, below) = (self.parents.padded(b + 2), self.parents.padded(b + 3));
        let (above_w, above_e) = (&above[1..=m], &above[2..m + 2]);
        let (below_w, below_e) = (&below[1..=m], &below[2..m + 2]);
        let (upper_ww, upper_w, upper_e, upper_ee) = quartet(upper, m);
        let (lower_ww, lower_w, lower_e, lower_ee) = quartet(lower, m);
        for a in 0..m {
            let near = upper_w[a].plus(upper_e[a]).plus(lower_w[a]).plus(lower_e[a]);
            let far = upper_ww[a].plus(upper_ee[a]).plus(lower_ww[a]).plus(lower_ee[a]);
            let far = far.plus(above_w[a]).plus(above_e[a]).plus(below_w[a]).plus(below_e[a]);
            out[a] = twelve_taps(near, far).code(self.base);
        }
    }

    /// Predicts row `b` of H.
    pub fn predict_horizontals(&self, b: usize, out: &mut [i32]) {
        let m = out.len();
        let row = self.parents.padded(b + 1);
        let (ww, w, e, ee) = quartet(row, m);
        if b == 0 || b == m {
            for a in 0..m {
                out[a] = four_taps(w[a].plus(e[a]), ww[a].plus(ee[a])).code(self.base);
            }
            return;
        }
        let (above, below) = (self.parents.padded(b), self.parents.padded(b + 2));
        let (above_w, above_e) = (&above[1..=m], &above[2..m + 2]);
        let (below_w, below_e) = (&below[1..=m], &below[2..m + 2]);
        let (north_w, north, north_e) = triplet(self.centres.padded(b), m);
        let (south_w, south, south_e) = triplet(self.centres.padded(b + 1), m);
        for a in 0..m {
            let near = w[a].plus(e[a]).plus(north[a]).plus(south[a]);
            let far = above_w[a].plus(above_e[a]).plus(below_w[a]).plus(below_e[a]);
            let far = far.plus(north_w[a]).plus(south_w[a]).plus(north_e[a]).plus(south_e[a]);
            out[a] = twelve_taps(near, far).code(self.base);
        }
    }

    /// Predicts row `b` of V, of `m + 1` samples.
    pub fn predict_verticals(&self, b: usize, out: &mut [i32]) {
        let m = out.len() - 1;
        let (above, upper) = (self.parents.padded(b), self.parents.padded(b + 1));
        let (lower, below) = (self.parents.padded(b + 2), self.parents.padded(b + 3));
        for a in [0, m] {
            let (near, far) = (upper[a + 1].plus(lower[a + 1]), above[a + 1].plus(below[a + 1]));
            out[a] = four_taps(near, far).code(self.base);
        }
        // Inner columns a = 1..m; the slices below start at a = 1.
        let inner = &mut out[1..m];
        let count = inner.len();
        let (upper_w, upper, upper_e) = triplet(&upper[1..], count);
        let (lower_w, lower, lower_e) = triplet(&lower[1..], count);
        let (north, middle, south) =
            (self.centres.padded(b), self.centres.padded(b + 1), self.centres.padded(b + 2));
        let (north_w, north_e) = (&north[1..=count], &north[2..count + 2]);
        let (west, east) = (&middle[1..=count], &middle[2..count + 2]);
        let (south_w, south_e) = (&south[1..=count], &south[2..count + 2]);
        for a in 0..count {
            let near = upper[a].plus(lower[a]).plus(west[a]).plus(east[a]);
            let far = upper_w[a].plus(upper_e[a]).plus(lower_w[a]).plus(lower_e[a]);
            let far = far.plus(north_w[a]).plus(north_e[a]).plus(south_w[a]).plus(south_e[a]);
            inner[a] = twelve_taps(near, far).code(self.base);
        }
    }
}

/// `(18 near - far + 32) >> 6`: four neighbours, pulled back by the eight around them.
#[inline(always)]
fn twelve_taps<W: Word>(near: W, far: W) -> W {
    near.up(4).plus(near.up(1)).minus(far).rounded_down(6)
}

/// `(9 near - far + 8) >> 4`: the cubic through four samples of a line.
#[inline(always)]
fn four_taps<W: Word>(near: W, far: W) -> W {
    near.up(3).plus(near).minus(far).rounded_down(4)
}

/// `row` from its first, second and third sample on, `count` each.
#[inline(always)]
fn triplet<W>(row: &[W], count: usize) -> (&[W], &[W], &[W]) {
    (&row[..count], &row[1..=count], &row[2..count + 2])
}

/// `row` from its first, second, third and fourth sample on, `count` each.
#[inline(always)]
fn quartet<W>(row: &[W], count: usize) -> (&[W], &[W], &[W], &[W]) {
    (&row[..count], &row[1..=count], &row[2..count + 2], &row[3..count + 3])
}

/// Replaces the void samples of `(m + 1)^2` parents: straight lines between the valid ones of a row, the nearest valid one
/// at its ends; rows without a valid sample copy the nearest row above that has one, or below.
pub fn replace_void(parents: &mut [i32], valid: &[bool], m: usize) {
    let width = m + 1;
    let mut source = None;
    for (row, valid) in valid.chunks_exact(width).enumerate() {
        let start = row * width;
        if replace_in_row(&mut parents[start..start + width], valid) {
            if source.is_none() {
                for above in 0..row {
                    parents.copy_within(start..start + width, above * width);
                }
            }
            source = Some(start);
        } else if let Some(source) = source {
            parents.copy_within(source..source + width, start);
        }
    }
    if source.is_none() {
        parents.fill(0);
    }
}

/// Replaces the void samples of one row; false if none is valid.
fn replace_in_row(row: &mut [i32], valid: &[bool]) -> bool {
    let mut last = None;
    for a in 0..row.len() {
        if !valid[a] {
            continue;
        }
        match last {
            None => {
                let code = row[a];
                row[..a].fill(code);
            }
            Some(before) if before + 1 < a => interpolate(&mut row[before..=a]),
            Some(_) => {}
        }
        last = Some(a);
    }
    if let Some(last) = last {
        let code = row[last];
        row[last..].fill(code);
    }
    last.is_some()
}

/// Sets all but the ends of `run` to the straight line between them, rounded down.
fn interpolate(run: &mut [i32]) {
    let (steps, first) = ((run.len() - 1) as i64, i64::from(run[0]));
    let rise = i64::from(run[run.len() - 1]) - first;
    for (step, code) in run.iter_mut().enumerate().take(steps as usize).skip(1) {
        *code = (first + (rise * step as i64).div_euclid(steps)) as i32;
    }
}
