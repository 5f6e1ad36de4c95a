//! A tile at half its resolution, for its parent.

use super::GUTTER;
use super::composite::Canvas;
use super::light::TABLES;
use crate::simd::{self, Kernel};

/// A quarter of a tile of the level above: means of 2 x 2 texels in linear light, weighted by their
/// alpha.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Half {
    side: usize,
    colour: Vec<u8>,
    /// `None` if all texels are opaque.
    alpha: Option<Vec<u8>>,
}

impl Half {
    /// The half of the texels of a tile without its gutter.
    pub(super) fn of(canvas: &Canvas) -> Self {
        if canvas.kind.channels() == 1 {
            simd::run(Halve::<1>(canvas))
        } else {
            simd::run(Halve::<3>(canvas))
        }
    }

    /// Copies it to cell (`x`, `y`) of a tile above. Cells 1 and 2 are the tile's own quadrants; of
    /// cells 0 and 3, its neighbours', only the gutter is copied.
    pub(super) fn paste(&self, canvas: &mut Canvas, x: usize, y: usize) {
        let (channels, side, half) = (canvas.kind.channels(), canvas.side, self.side);
        // The start of the cell on the canvas, and the part of the cell that lies on the canvas.
        let place = |cell: usize| match cell {
            0 => (0, half - GUTTER..half),
            3 => (side - GUTTER, 0..GUTTER),
            own => (GUTTER + (own - 1) * half, 0..half),
        };
        let ((left, columns), (top, rows)) = (place(x), place(y));
        for (to, from) in (top..).zip(rows) {
            let (to, from) = (to * side + left, from * half + columns.start);
            let run = columns.len();
            canvas.colour[to * channels..][..run * channels]
                .copy_from_slice(&self.colour[from * channels..][..run * channels]);
            match &self.alpha {
                Some(alpha) => canvas.alpha[to..][..run].copy_from_slice(&alpha[from..][..run]),
                None => canvas.alpha[to..][..run].fill(255),
            }
        }
    }
}

struct Halve<'a, const C: usize>(&'a Canvas);

impl<const C: usize> Kernel for Halve<'_, C> {
    type Output = Half;

    #[inline(always)]
    fn run(self) -> Half {
        let (side, tables) = (self.0.side, &*TABLES);
        let half = (side - 2 * GUTTER) / 2;
        let mut colour = vec![0; half * half * C];
        let mut alpha = vec![255; half * half];
        let mut opaque = true;
        let out = colour.chunks_exact_mut(half * C).zip(alpha.chunks_exact_mut(half));
        for (row, (colour, alpha)) in out.enumerate() {
            let start = (GUTTER + 2 * row) * side + GUTTER;
            let texels = |start: usize| {
                self.0.colour[start * C..][..2 * half * C].as_chunks::<C>().0.as_chunks::<2>().0
            };
            let opacities = |start: usize| self.0.alpha[start..][..2 * half].as_chunks::<2>().0;
            let (upper, lower) = (texels(start), texels(start + side));
            let (above, below) = (opacities(start), opacities(start + side));
            let out = colour.as_chunks_mut::<C>().0.iter_mut();
            if above.iter().chain(below).all(|pair| *pair == [255; 2]) {
                for ((out, upper), lower) in out.zip(upper).zip(lower) {
                    for (channel, out) in out.iter_mut().enumerate() {
                        let light = |texel: &[u8; C]| u32::from(tables.light16[usize::from(texel[channel])]);
                        let sum = light(&upper[0]) + light(&upper[1]) + light(&lower[0]) + light(&lower[1]);
                        *out = tables.byte16(sum, 4);
                    }
                }
                continue;
            }
            opaque = false;
            for (index, (out, alpha)) in out.zip(alpha).enumerate() {
                let texels = [upper[index][0], upper[index][1], lower[index][0], lower[index][1]];
                let weights = [above[index][0], above[index][1], below[index][0], below[index][1]];
                *alpha = mean::<C>(texels, weights, out);
            }
        }
        Half { side: half, colour, alpha: (!opaque).then_some(alpha) }
    }
}

/// Sets the mean colour, weighted by alpha, and returns the mean alpha. It is 0 only if all four
/// are: the parent of an existing tile exists.
#[inline(always)]
fn mean<const C: usize>(texels: [[u8; C]; 4], weights: [u8; 4], colour: &mut [u8; C]) -> u8 {
    let sum: u32 = weights.iter().map(|&weight| u32::from(weight)).sum();
    if sum == 0 {
        return 0;
    }
    for (channel, colour) in colour.iter_mut().enumerate() {
        let light = texels.iter().zip(weights).map(|(texel, weight)| {
            u32::from(weight) * u32::from(TABLES.light16[usize::from(texel[channel])])
        });
        *colour = TABLES.byte16(light.sum(), sum);
    }
    ((sum + 2) / 4).max(1) as u8
}
