//! [`StatisticsBuilder`]: counts finished tiles for the statistics of the file.
//!
//! Every stored error is counted by its code, so that percentiles are exact and the order of tiles
//! does not matter.

use std::collections::BTreeMap;

use wincode::adapter::FromInto;
use wincode::{SchemaRead, SchemaWrite};

use crate::container::layout::Header;
use crate::container::metadata::{ErrorStatistics, LevelStatistics, Statistics, StepStatistics};
use crate::error_code::metres_from_code;
use crate::patch::TileGeometry;
use crate::pipeline::counts::Counts;
use crate::pipeline::plan::Plan;
use crate::pipeline::tile_work::Finished;
use crate::pipeline::value_range::ValueRange;

/// The counts of all levels.
#[derive(Clone, Debug, Default, PartialEq, SchemaRead, SchemaWrite)]
pub struct StatisticsBuilder {
    levels: Vec<LevelBuilder>,
    /// Range of the values of all leaves, and of those that do not look like void; `None`
    /// while there are none.
    values: [Option<(f64, f64)>; 2],
}

#[derive(Clone, Debug, Default, PartialEq, SchemaRead, SchemaWrite)]
struct LevelBuilder {
    tiles: u64,
    patches: u64,
    valid: u64,
    range_m: Option<(f64, f64)>,
    bytes: [u64; 3],
    steps: Vec<StepBuilder>,
}

#[derive(Clone, Debug, Default, PartialEq, SchemaRead, SchemaWrite)]
struct StepBuilder {
    spacing_m: [f64; 2],
    #[wincode(with = "FromInto<BTreeMap<u16, u64>, _>")]
    vertical: Counts,
    #[wincode(with = "FromInto<BTreeMap<u16, u64>, _>")]
    horizontal: Counts,
}

impl StatisticsBuilder {
    /// Nothing counted yet.
    pub fn new(plan: &Plan) -> Self {
        let steps = plan.patch.trailing_zeros() as usize + 1;
        let level = || LevelBuilder { steps: vec![StepBuilder::default(); steps], ..LevelBuilder::default() };
        Self { levels: (0..=plan.pyramid.levels).map(|_| level()).collect(), values: [None; 2] }
    }

    /// Counts a finished tile.
    pub fn add(&mut self, tile: &Finished, geometry: &TileGeometry) {
        let level = &mut self.levels[usize::from(tile.record.id.level)];
        level.tiles += 1;
        level.patches += tile.table.drawable.iter().filter(|&&d| d).count() as u64;
        level.valid += tile.census.valid;
        if let Some((low, high)) = tile.census.range_m {
            let (a, b) = level.range_m.unwrap_or((low, high));
            level.range_m = Some((a.min(low), b.max(high)));
        }
        if let Some(values) = tile.census.values {
            join_ranges(&mut self.values, values.map(|range| Some((range.low, range.high))));
        }
        let chunks = &tile.chunks;
        for (sum, chunk) in level.bytes.iter_mut().zip([&chunks.heights, &chunks.mask, &chunks.errors]) {
            *sum += chunk.len() as u64;
        }
        let patches = tile.occupied.len();
        for (k, step) in level.steps.iter_mut().enumerate() {
            let spacing = geometry.spacing;
            step.spacing_m[0] = step.spacing_m[0].max(spacing.dx * f64::from(1 << k));
            step.spacing_m[1] = step.spacing_m[1].max(spacing.dy * f64::from(1 << k));
            for (patch, _) in tile.occupied.iter().enumerate().filter(|(_, o)| **o) {
                step.vertical.add(tile.table.vertical[k * patches + patch], 1);
                step.horizontal.add(tile.table.horizontal[k * patches + patch], 1);
            }
        }
    }

    /// Adds what another build has counted, of tiles of its own. False, and nothing done, if it is
    /// of other levels or steps.
    #[must_use]
    pub fn join(&mut self, other: &Self) -> bool {
        let alike = self.levels.len() == other.levels.len()
            && self.levels.iter().zip(&other.levels).all(|(a, b)| a.steps.len() == b.steps.len());
        if alike {
            self.levels.iter_mut().zip(&other.levels).for_each(|(level, other)| level.join(other));
            join_ranges(&mut self.values, other.values);
        }
        alike
    }

    /// Range of the values of all leaves, and of those that do not look like void.
    pub fn values(&self) -> [ValueRange; 2] {
        self.values.map(|range| range.map_or(ValueRange::EMPTY, |(low, high)| ValueRange { low, high }))
    }

    /// The statistics section.
    pub fn statistics(&self, header: &Header) -> Statistics {
        let levels = self.levels.iter().zip(0..).map(|(level, number)| {
            let (columns, rows) = header.level_size(number);
            LevelStatistics {
                level: number,
                tiles: level.tiles,
                patches: level.patches,
                columns: columns.into(),
                rows: rows.into(),
                valid: level.valid,
                min_m: level.range_m.map(|r| r.0),
                max_m: level.range_m.map(|r| r.1),
                heights_bytes: level.bytes[0],
                masks_bytes: level.bytes[1],
                errors_bytes: level.bytes[2],
                steps: level.steps.iter().map(StepBuilder::statistics).collect(),
            }
        });
        Statistics { levels: levels.collect() }
    }
}

/// Makes ranges hold others; one of no values is not kept, for JSON has no infinity.
fn join_ranges(ranges: &mut [Option<(f64, f64)>; 2], others: [Option<(f64, f64)>; 2]) {
    for (range, other) in ranges.iter_mut().zip(others) {
        let Some((low, high)) = other.filter(|(low, high)| low <= high) else { continue };
        let (a, b) = range.unwrap_or((low, high));
        *range = Some((a.min(low), b.max(high)));
    }
}

impl LevelBuilder {
    fn join(&mut self, other: &Self) {
        self.tiles += other.tiles;
        self.patches += other.patches;
        self.valid += other.valid;
        if let Some((low, high)) = other.range_m {
            let (a, b) = self.range_m.unwrap_or((low, high));
            self.range_m = Some((a.min(low), b.max(high)));
        }
        for (sum, bytes) in self.bytes.iter_mut().zip(other.bytes) {
            *sum += bytes;
        }
        for (step, other) in self.steps.iter_mut().zip(&other.steps) {
            for (largest, spacing) in step.spacing_m.iter_mut().zip(other.spacing_m) {
                *largest = largest.max(spacing);
            }
            for (counts, others) in
                [(&mut step.vertical, &other.vertical), (&mut step.horizontal, &other.horizontal)]
            {
                others.iter().for_each(|(code, count)| counts.add(code, count));
            }
        }
    }
}

impl StepBuilder {
    fn statistics(&self) -> StepStatistics {
        StepStatistics {
            spacing_m: self.spacing_m,
            vertical: distribution(&self.vertical),
            horizontal: distribution(&self.horizontal),
        }
    }
}

/// Distribution of stored errors in metres; percentiles by nearest rank.
pub fn distribution(counts: &Counts) -> ErrorStatistics {
    let count: u64 = counts.iter().map(|(_, n)| n).sum();
    let metres = |code: u16| f64::from(metres_from_code(code));
    let percentile = |percent: u64| {
        let rank = (count * percent).div_ceil(100).max(1);
        let mut seen = 0;
        counts
            .iter()
            .find(|(_, n)| {
                seen += n;
                seen >= rank
            })
            .map_or(0.0, |(code, _)| metres(code))
    };
    let mut histogram: Vec<(u16, u64)> = Vec::new();
    for (code, n) in counts.iter() {
        match histogram.last_mut() {
            Some((bin, sum)) if *bin == code >> 6 => *sum += n,
            _ => histogram.push((code >> 6, n)),
        }
    }
    let sum: f64 = counts.iter().map(|(code, n)| metres(code) * n as f64).sum();
    ErrorStatistics {
        count,
        min: counts.iter().next().map_or(0.0, |(code, _)| metres(code)),
        mean: if count == 0 { 0.0 } else { sum / count as f64 },
        max: counts.iter().last().map_or(0.0, |(code, _)| metres(code)),
        p50: percentile(50),
        p90: percentile(90),
        p99: percentile(99),
        histogram,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::encoding;

    #[test]
    fn every_number_comes_back_from_a_state() {
        let odd = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -0.0, 5e-324, f64::MAX];
        for (low, high) in odd.into_iter().flat_map(|low| odd.map(|high| (low, high))) {
            let mut step = StepBuilder { spacing_m: [low, high], ..StepBuilder::default() };
            step.vertical.add(u16::MAX, u64::MAX);
            step.horizontal.add(0, 1);
            let level = LevelBuilder {
                tiles: u64::MAX,
                range_m: Some((low, high)),
                bytes: [0, 1 << 53, u64::MAX],
                steps: vec![step],
                ..LevelBuilder::default()
            };
            let statistics = StatisticsBuilder { levels: vec![level], values: [Some((low, high)), None] };
            let bytes = encoding::encode(&statistics).expect("bytes");
            let back: StatisticsBuilder = encoding::decode(&bytes, "statistics").expect("statistics");
            assert_eq!(format!("{back:?}"), format!("{statistics:?}"));
        }
    }
}
