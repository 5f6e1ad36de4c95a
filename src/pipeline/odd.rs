//! Warnings about heights that look wrong, from the lowest and the highest value of a build.

use crate::container::layout::Header;
use crate::geo::CrsKind;
use crate::pipeline::plan::Plan;
use crate::pipeline::value_range::ValueRange;
use crate::sample::{Coding, Lattice, VALID};
use crate::source::{SourceInfo, advice};

/// Heights of the Earth reach from -10 935 to 8849 m.
const HIGHEST_M: f64 = 12_000.0;
/// Semi-major axes of the ellipsoids of the Earth, metres.
const EARTH: std::ops::RangeInclusive<f64> = 6_370_000.0..=6_385_000.0;
/// Values that programs write to mean void.
const SENTINELS: [f64; 18] = [
    0.0,
    -99.0,
    -999.0,
    -9999.0,
    -99_999.0,
    -999_999.0,
    9999.0,
    99_999.0,
    -32_766.0,
    -32_767.0,
    -32_768.0,
    32_767.0,
    65_534.0,
    65_535.0,
    -2_147_483_648.0,
    -2_147_483_647.0,
    2_147_483_647.0,
    4_294_967_295.0,
];
/// No height is as large: 1e20, 9.96921e36 and -3.4e38 mean void.
const NO_HEIGHT: f64 = 1e20;

/// True if a value looks like one that means void.
fn is_sentinel(value: f64, error: f64) -> bool {
    value.abs() >= NO_HEIGHT || SENTINELS.iter().any(|sentinel| (value - sentinel).abs() <= error)
}

/// How far a decoded value may be from the source's.
fn error(plan: &Plan) -> f64 {
    match plan.recipe.coding {
        Coding::Integer { scale, .. } if plan.quantised() => scale / 2.0,
        _ => 0.0,
    }
}

/// The range of the valid samples of a leaf, without its lowest and highest value where these look
/// like void.
pub fn rest(lattice: &Lattice, range: ValueRange, plan: &Plan) -> ValueRange {
    let error = error(plan);
    let odd = |value: f64| (value == range.low || value == range.high) && is_sentinel(value, error);
    if !odd(range.low) && !odd(range.high) {
        return range;
    }
    let coding = plan.recipe.coding;
    let valid = (0..lattice.state.len()).filter(|&index| lattice.state[index] == VALID);
    let values = valid.map(|index| lattice.value(index, coding)).filter(|&value| !odd(value));
    values.fold(ValueRange::EMPTY, |range, value| range.join(ValueRange { low: value, high: value }))
}

/// The warnings. `all` is the range of the valid samples, `rest` the one that [`rest`] returns.
pub fn warnings(
    all: ValueRange,
    rest: ValueRange,
    plan: &Plan,
    info: &SourceInfo,
    header: &Header,
) -> Vec<String> {
    let name = name(info);
    let (mut found, mut seen) = (Vec::new(), all);
    if rest.low <= rest.high {
        let spread = rest.high - rest.low;
        for (value, gap) in [(all.low, rest.low - all.low), (all.high, all.high - rest.high)] {
            // 0 is a height like others on a coast, where the next one is near.
            let most = if value == 0.0 { spread } else { spread / 4.0 };
            if gap <= most || !is_sentinel(value, error(plan)) {
                continue;
            }
            let value = printed(value, header.quantisation_error > 0.0);
            found.push(format!(
                "{name}: samples of {value} stand far from all others, {} to {}, and are taken as heights; if they mean void, {} {value}",
                short(rest.low), short(rest.high), advice::NODATA
            ));
            seen = rest;
        }
    }
    let crs = &info.geo.crs;
    let earth = crs.kind != CrsKind::Engineering && EARTH.contains(&crs.ellipsoid.a);
    let (low, high) = seen.metres(plan);
    if earth && low <= high && (low < -HIGHEST_M || high > HIGHEST_M) {
        found.push(format!(
            "{name}: heights from {} to {} m, which are not of this Earth; {}, or {} if some mean void",
            short(low),
            short(high),
            advice::UNIT,
            advice::NODATA
        ));
    }
    found
}

/// The file, or the first of several.
fn name(info: &SourceInfo) -> String {
    let first = info.parts.first().map_or("the raster", |part| &part.name);
    match info.parts.len() {
        0 | 1 => first.to_owned(),
        count => format!("{first} and {} more", count - 1),
    }
}

/// A value as it is typed after `--nodata`.
fn printed(value: f64, quantised: bool) -> String {
    if quantised || value.abs() < 1e15 { format!("{}", value.round()) } else { format!("{value:e}") }
}

/// A number for people.
fn short(value: f64) -> String {
    if value.abs() < 1e9 { format!("{}", (value * 100.0).round() / 100.0) } else { format!("{value:.4e}") }
}
