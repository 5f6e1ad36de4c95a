//! Colours under transparent texels, so that neither a bilinear filter nor a lossy codec draws a dark rim around a picture.
//!
//! Pull and push: means of 2 x 2 texels that have a colour, until every square has one; then each texel without a colour takes that of
//! the smallest square around it that has. What is seen does not change.

/// One level of means.
struct Means {
    side: usize,
    colour: Vec<u8>,
    known: Vec<bool>,
}

/// Gives wholly transparent texels of a square the colours of near ones; nothing to be done where there is no other texel.
pub(super) fn fill(colour: &mut [u8], alpha: &[u8], side: usize, channels: usize) {
    let known: Vec<bool> = alpha.iter().map(|&alpha| alpha > 0).collect();
    if known.iter().all(|&known| known) || !known.contains(&true) {
        return;
    }
    let mut levels = vec![halve(colour, &known, side, channels)];
    while let Some(last) = levels.last().filter(|last| last.known.contains(&false)) {
        levels.push(halve(&last.colour, &last.known, last.side, channels));
    }
    for index in (1..levels.len()).rev() {
        let (finer, coarser) = levels.split_at_mut(index);
        let (finer, coarser) = (&mut finer[index - 1], &coarser[0]);
        push(&mut finer.colour, &finer.known, finer.side, coarser, channels);
    }
    push(colour, &known, side, &levels[0], channels);
}

fn halve(colour: &[u8], known: &[bool], side: usize, channels: usize) -> Means {
    let half = side.div_ceil(2);
    let mut means =
        Means { side: half, colour: vec![0; half * half * channels], known: vec![false; half * half] };
    let mut sums = vec![0_u32; channels];
    for (index, mean) in means.colour.chunks_exact_mut(channels).enumerate() {
        let (x, y) = (index % half * 2, index / half * 2);
        sums.fill(0);
        let mut count = 0;
        for row in y..(y + 2).min(side) {
            for at in (row * side + x..row * side + (x + 2).min(side)).filter(|&at| known[at]) {
                count += 1;
                let texel = &colour[at * channels..];
                sums.iter_mut().zip(texel).for_each(|(sum, &value)| *sum += u32::from(value));
            }
        }
        if count > 0 {
            means.known[index] = true;
            mean.iter_mut().zip(&sums).for_each(|(mean, sum)| *mean = ((sum + count / 2) / count) as u8);
        }
    }
    means
}

fn push(colour: &mut [u8], known: &[bool], side: usize, coarser: &Means, channels: usize) {
    for (index, texel) in colour.chunks_exact_mut(channels).enumerate().filter(|(index, _)| !known[*index]) {
        let from = index / side / 2 * coarser.side + index % side / 2;
        texel.copy_from_slice(&coarser.colour[from * channels..][..channels]);
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
        fill(&mut colour, &alpha, 5, 1);
        assert_eq!((colour[0], colour[1], colour[6], colour[24]), (40, 40, 40, 200));
        assert_eq!((colour[12], colour[4]), (40, 200));
        assert!(colour.iter().all(|&c| c >= 40));
    }

    #[test]
    fn what_has_nothing_or_all_stays() {
        let mut colour = vec![1, 2, 3, 4];
        fill(&mut colour, &[0; 4], 2, 1);
        fill(&mut colour, &[9; 4], 2, 1);
        assert_eq!(colour, [1, 2, 3, 4]);
    }
}
