//! Fills in colours of transparent texels, so that neither a bilinear filter nor a lossy codec
//! draws a dark border around a picture.
//!
//! It is a pull-push filter: means of 2 x 2 texels that have a colour, until every square has one;
//! then each texel without a colour takes that of the smallest square around it that has one. No
//! visible texel changes.

use crate::texel::Colour;

/// One level of the means.
struct Means<const C: usize> {
    side: usize,
    colour: Vec<[u8; C]>,
    known: Vec<bool>,
}

/// Gives the wholly transparent texels of a square the colours of near texels; does nothing if
/// there are no others.
pub(super) fn fill(colour: &mut [u8], alpha: &[u8], side: usize, kind: Colour) {
    let known: Vec<bool> = alpha.iter().map(|&alpha| alpha > 0).collect();
    if known.iter().all(|&known| known) || !known.contains(&true) {
        return;
    }
    match kind {
        Colour::Grey => pull_and_push::<1>(colour.as_chunks_mut().0, &known, side),
        Colour::Rgb => pull_and_push::<3>(colour.as_chunks_mut().0, &known, side),
    }
}

fn pull_and_push<const C: usize>(colour: &mut [[u8; C]], known: &[bool], side: usize) {
    let mut levels = vec![halve(colour, known, side)];
    while let Some(last) = levels.last().filter(|last| last.known.contains(&false)) {
        levels.push(halve(&last.colour, &last.known, last.side));
    }
    for index in (1..levels.len()).rev() {
        let (finer, coarser) = levels.split_at_mut(index);
        let (finer, coarser) = (&mut finer[index - 1], &coarser[0]);
        push(&mut finer.colour, &finer.known, finer.side, coarser);
    }
    push(colour, known, side, &levels[0]);
}

fn halve<const C: usize>(colour: &[[u8; C]], known: &[bool], side: usize) -> Means<C> {
    let half = side.div_ceil(2);
    let mut means = Means { side: half, colour: vec![[0; C]; half * half], known: vec![false; half * half] };
    let rows = means.colour.chunks_exact_mut(half).zip(means.known.chunks_exact_mut(half));
    for (y, (row, row_known)) in rows.enumerate() {
        // With an odd side the last row and column count twice.
        let (upper, lower) = (2 * y * side, (2 * y + 1).min(side - 1) * side);
        for (x, (mean, mean_known)) in row.iter_mut().zip(row_known).enumerate() {
            let (left, right) = (2 * x, (2 * x + 1).min(side - 1));
            let four = [upper + left, upper + right, lower + left, lower + right];
            let count: u32 = four.iter().map(|&at| u32::from(known[at])).sum();
            if count == 0 {
                continue;
            }
            let mut sums = [count / 2; C];
            for at in four {
                let weight = u32::from(known[at]);
                sums.iter_mut().zip(colour[at]).for_each(|(sum, value)| *sum += weight * u32::from(value));
            }
            *mean = sums.map(|sum| (sum / count) as u8);
            *mean_known = true;
        }
    }
    means
}

fn push<const C: usize>(colour: &mut [[u8; C]], known: &[bool], side: usize, coarser: &Means<C>) {
    let rows = colour.chunks_exact_mut(side).zip(known.chunks_exact(side));
    for (y, (row, known)) in rows.enumerate().filter(|(_, (_, known))| known.contains(&false)) {
        let from = &coarser.colour[y / 2 * coarser.side..][..coarser.side];
        for (x, (texel, known)) in row.iter_mut().zip(known).enumerate() {
            if !known {
                *texel = from[x / 2];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_texel_takes_the_nearest_square() {
        let mut colour = vec![0; 25];
        let mut alpha = vec![0; 25];
        (colour[0], alpha[0]) = (40, 255);
        (colour[24], alpha[24]) = (200, 1);
        fill(&mut colour, &alpha, 5, Colour::Grey);
        assert_eq!((colour[0], colour[1], colour[6], colour[24]), (40, 40, 40, 200));
        // The square of the far corners is the whole: its mean.
        assert_eq!((colour[12], colour[4]), (40, 120));
        assert!(colour.iter().all(|&c| c >= 40));
    }

    #[test]
    fn what_has_nothing_or_all_stays() {
        let mut colour = vec![1, 2, 3, 4];
        fill(&mut colour, &[0; 4], 2, Colour::Grey);
        fill(&mut colour, &[9; 4], 2, Colour::Grey);
        assert_eq!(colour, [1, 2, 3, 4]);
    }
}
