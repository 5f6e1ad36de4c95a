//! Validity of all samples and cells of a tile at once: which are valid, void, or both.

use crate::patch::blocks::{HAS_VALID, HAS_VOID};
use crate::sample::VALID;
use crate::simd::Kernel;

/// Kernel: sets `valid` to 1 where a sample is valid, 0 elsewhere.
pub(super) struct Validity<'a> {
    pub(super) state: &'a [u8],
    pub(super) valid: &'a mut Vec<u8>,
}

impl Kernel for Validity<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let state = self.state;
        self.valid.resize(state.len(), 0);
        let valid = &mut self.valid[..state.len()];
        for i in 0..state.len() {
            valid[i] = u8::from(state[i] == VALID);
        }
    }
}

/// Kernel: true if all samples of a tile are valid, or none is.
pub(super) struct AllAlike<'a> {
    pub(super) state: &'a [u8],
}

impl Kernel for AllAlike<'_> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        // The inner loop has no early end, so that the compiler uses vectors.
        const AT_ONCE: usize = 1024;
        let Some(&first) = self.state.first() else { return true };
        let valid = u8::from(first == VALID);
        self.state.chunks(AT_ONCE).all(|some| {
            let unlike = some.iter().fold(0, |unlike, &state| unlike | (u8::from(state == VALID) ^ valid));
            unlike == 0
        })
    }
}

/// Two rows of samples, as the corners of the cells between them: north-west, north-east,
/// south-west, south-east.
#[inline(always)]
fn corners(valid: &[u8], n: usize, row: usize) -> [&[u8]; 4] {
    let rows = &valid[row * (n + 1)..(row + 2) * (n + 1)];
    [&rows[..n], &rows[1..][..n], &rows[n + 1..][..n], &rows[n + 2..][..n]]
}

/// Kernel: sets the bits of each cell to what its closed square holds.
pub(super) struct CellBits<'a> {
    pub(super) valid: &'a [u8],
    pub(super) n: usize,
    pub(super) bits: &'a mut [u8],
}

impl Kernel for CellBits<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let n = self.n;
        for y in 0..n {
            let bits = &mut self.bits[y * n..(y + 1) * n];
            let [nw, ne, sw, se] = corners(self.valid, n, y);
            for x in 0..n {
                let (any, all) = (nw[x] | ne[x] | sw[x] | se[x], nw[x] & ne[x] & sw[x] & se[x]);
                bits[x] = (any * HAS_VALID) | ((all ^ 1) * HAS_VOID);
            }
        }
    }
}
