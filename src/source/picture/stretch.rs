//! Stretching of wide samples to 8 bits: linear, with the same values in all pictures of a build.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::blocks::BlockPicture;
use super::check_opening;
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::sample::SampleType;

/// Most values sampled for percentiles, and most blocks they are taken from.
const VALUES: usize = 4 << 20;
const BLOCKS: usize = 256;

/// The sample values that become 0 and 255.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stretch {
    /// No stretch: 8-bit samples unchanged, the upper 8 bits of 16-bit ones.
    None,
    /// Minimum and maximum of each band, over all opaque pixels.
    MinMax,
    /// Two percentiles of each band, over opaque pixels spread evenly over the pictures.
    Percent(f64, f64),
    /// Two given values, for every band.
    Range(f64, f64),
}

impl Stretch {
    /// The default for samples wider than 8 bits: two per cent are cut off at either end.
    const WIDE: Self = Self::Percent(2.0, 98.0);

    fn check(self) -> Result<Self> {
        match self {
            Self::Percent(low, high) if !(0.0 <= low && low < high && high <= 100.0) => {
                Err(Error::usage("percentiles of a stretch go from 0 to 100, the lower first"))
            }
            Self::Range(low, high) if !(low < high && low.is_finite() && high.is_finite()) => {
                Err(Error::usage("a stretch goes from a value to a greater one"))
            }
            good => Ok(good),
        }
    }
}

/// Sets the stretch values of every picture.
pub(super) fn settle(pictures: &mut [BlockPicture], wanted: Option<Stretch>, limits: &Limits) -> Result<()> {
    let wanted = wanted.map(Stretch::check).transpose()?;
    let groups: Vec<_> = pictures.iter().map(BlockPicture::stretchable).collect();
    let mut done = Vec::new();
    for group in groups.iter().flatten() {
        if done.contains(group) {
            continue;
        }
        done.push(*group);
        let (kind, bands) = *group;
        let rule = wanted.unwrap_or(if kind == SampleType::Uint8 { Stretch::None } else { Stretch::WIDE });
        let members =
            || groups.iter().enumerate().filter(|(_, other)| **other == Some(*group)).map(|(at, _)| at);
        let ranges = match (rule, kind) {
            (Stretch::None, SampleType::Uint8) => continue,
            (Stretch::None, SampleType::Uint16) => vec![(0.0, 65535.0); bands],
            (Stretch::None, _) => {
                let what = format!("{} samples as they are in a picture", kind.gdal_name());
                return Err(Error::unsupported(what, "say by `stretch` how they become 8 bits"));
            }
            (Stretch::Range(low, high), _) => vec![(low, high); bands],
            (rule, _) => {
                let of: Vec<&BlockPicture> = members().map(|at| &pictures[at]).collect();
                measure(&of, bands, rule, limits)?
            }
        };
        for at in members() {
            pictures[at].set_stretch(&ranges);
        }
    }
    Ok(())
}

/// Measures the values of each band over several pictures.
fn measure(
    pictures: &[&BlockPicture],
    bands: usize,
    rule: Stretch,
    limits: &Limits,
) -> Result<Vec<(f64, f64)>> {
    let all = rule == Stretch::MinMax;
    let share = (VALUES / pictures.len()).max(1);
    let mut work = Vec::new();
    // Bytes of the values of each block, in vectors with up to twice the capacity, and of all
    // values.
    let pixels: u64 = pictures.iter().map(|picture| picture.pixels()).fold(0, u64::saturating_add);
    let values = if all { 0 } else { pixels.min(2 * VALUES as u64) * bands as u64 * 8 };
    for &picture in pictures {
        check_opening(picture, 3 * values, limits)?;
        let blocks = picture.blocks();
        let chosen = if all { blocks } else { blocks.min(BLOCKS) };
        let most = share.div_ceil(chosen);
        work.extend((0..chosen).map(|n| (picture, spread(n, chosen, blocks), most)));
    }
    let read =
        |(picture, block, most): (&BlockPicture, usize, usize)| picture.values(block, (!all).then_some(most));
    let read: Vec<Result<Vec<Vec<f64>>>> = work.into_par_iter().map(read).collect();
    let mut joined = vec![Vec::new(); bands];
    for values in read {
        joined.iter_mut().zip(values?).for_each(|(all, some)| all.extend(some));
    }
    Ok(joined.into_iter().map(|values| range(values, rule)).collect())
}

/// The `n`th of `chosen` blocks, spread over `blocks` so that they do not line up in columns.
pub(super) fn spread(n: usize, chosen: usize, blocks: usize) -> usize {
    if chosen == blocks {
        return n;
    }
    let golden = (n as f64 * 0.618_033_988_75).fract();
    (((n as f64 + golden) * blocks as f64 / chosen as f64) as usize).min(blocks - 1)
}

fn range(mut values: Vec<f64>, rule: Stretch) -> (f64, f64) {
    let (low, high) = if let Stretch::Percent(low, high) = rule { (low, high) } else { (0.0, 100.0) };
    values.sort_unstable_by(f64::total_cmp);
    let at = |percent: f64| {
        let last = values.len().saturating_sub(1) as f64;
        values.get((percent / 100.0 * last).round() as usize).copied()
    };
    let (low, high) = (at(low).unwrap_or(0.0), at(high).unwrap_or(1.0));
    if low < high { (low, high) } else { (low, low + 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_of_known_values() {
        let values: Vec<f64> = (0..=100).rev().map(f64::from).collect();
        assert_eq!(range(values.clone(), Stretch::Percent(2.0, 98.0)), (2.0, 98.0));
        assert_eq!(range(values, Stretch::MinMax), (0.0, 100.0));
        assert_eq!(range(vec![7.0; 9], Stretch::MinMax), (7.0, 8.0));
        assert_eq!(range(Vec::new(), Stretch::Percent(2.0, 98.0)), (0.0, 1.0));
    }

    #[test]
    fn blocks_are_spread_over_columns_and_rows() {
        let blocks: Vec<usize> = (0..256).map(|n| spread(n, 256, 64 * 64)).collect();
        assert!(blocks.is_sorted() && blocks.iter().all(|&b| b < 64 * 64));
        let columns: std::collections::BTreeSet<_> = blocks.iter().map(|b| b % 64).collect();
        assert!(columns.len() > 48, "{}", columns.len());
    }
}
