//! Every number of a state comes back bit for bit: all floats there are, and all whole numbers.

use proptest::prelude::*;

use super::*;
use crate::container::layout::Metric;
use crate::geo::{Ellipsoid, GeoKeys};
use crate::limits::Limits;
use crate::source::{FileStamp, Overlap, Part, open};

/// Any bits, and often those that a text would lose.
fn float() -> impl Strategy<Value = f64> {
    let odd = [
        f64::NAN,
        -f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        -0.0,
        0.0,
        f64::MIN_POSITIVE,
        5e-324,
        -5e-324,
        f64::MAX,
        f64::MIN,
        f64::from(f32::MIN),
        f64::EPSILON,
    ];
    prop_oneof![any::<u64>().prop_map(f64::from_bits), prop::sample::select(odd.to_vec())]
}

fn whole() -> impl Strategy<Value = u64> {
    prop_oneof![
        any::<u64>(),
        prop::sample::select(vec![0, 1, 23, 24, u64::from(u32::MAX), 1 << 53, u64::MAX])
    ]
}

fn range() -> impl Strategy<Value = std::ops::Range<u32>> {
    (any::<u32>(), any::<u32>()).prop_map(|(a, b)| a..b)
}

fn extent() -> impl Strategy<Value = Rect> {
    (range(), range()).prop_map(|(columns, rows)| Rect { columns, rows })
}

/// What a raster says of itself, all numbers of which are odd.
fn info() -> impl Strategy<Value = SourceInfo> {
    let fixture = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem/rmnp_dem_uint16.tif");
    let plain = open(&fixture, &Limits::default()).expect("fixture").info().clone();
    let numbers = prop::collection::vec(float(), 16);
    (numbers, any::<u32>(), any::<bool>(), prop::collection::vec((range(), range()), 0..3), ".*").prop_map(
        move |(f, word, some, rects, text)| {
            let mut info = plain.clone();
            (info.width, info.height, info.block_rows) = (word, !word, word.rotate_left(7));
            info.nodata = some.then_some(f[0]);
            (info.band_scale, info.band_offset) = (f[1], f[2]);
            info.vertical_unit = (f[3], text.clone());
            info.geo.transform = Some([f[4], f[5], f[6], f[7], f[8], f[9]]);
            let crs = &mut info.geo.crs;
            crs.ellipsoid = Ellipsoid { a: f[10], inverse_flattening: f[11] };
            (crs.unit, crs.epsg, crs.vertical_down) = (f[12], some.then_some(word), some);
            crs.keys = Some(GeoKeys {
                directory: vec![word as u16],
                doubles: f[13..].to_vec(),
                ascii: text.clone(),
            });
            info.parts = vec![Part { name: text.clone(), description: text }];
            info.footprint = some
                .then(|| rects.iter().map(|(c, r)| Rect { columns: c.clone(), rows: r.clone() }).collect());
            info.overlap = some.then_some(Overlap::Mean);
            info
        },
    )
}

fn state() -> impl Strategy<Value = State> {
    let stamps = prop::collection::vec((".*", whole(), whole()), 0..3);
    let options = (any::<u32>(), any::<u32>(), prop::option::of(float()), prop::option::of(float()));
    let mark = (prop::collection::vec(whole(), 0..4), whole());
    (
        info(),
        stamps,
        options,
        (extent(), prop::collection::vec(extent(), 0..3)),
        (float(), any::<u32>()),
        mark,
    )
        .prop_map(|(info, stamps, options, (window, passes), (largest, next), (levels, tiles))| State {
            tool: "relevo".to_owned(),
            fingerprint: Fingerprint {
                files: stamps
                    .into_iter()
                    .map(|(name, bytes, modified_ns)| FileStamp { name, bytes, modified_ns })
                    .collect(),
            },
            info,
            options: BuildOptions {
                tile: options.0,
                patch: options.1,
                metric: Metric::Paper,
                precision_m: options.2,
                nodata: options.3,
                ..BuildOptions::default()
            },
            window,
            passes,
            largest,
            next,
            carry: ("seam-0".to_owned(), tiles),
            mark: Mark { levels, tiles },
            statistics: StatisticsBuilder::default(),
        })
}

proptest! {
    #[test]
    fn all_of_a_state_comes_back(state in state()) {
        let bytes = state.encode().expect("bytes");
        let (back, end) = State::decode(&bytes).expect("state");
        prop_assert_eq!(end, bytes.len());
        // The text of a float says all but the bits within a NaN, and those follow.
        prop_assert_eq!(format!("{back:?}"), format!("{state:?}"));
        prop_assert_eq!(back.largest.to_bits(), state.largest.to_bits());
        prop_assert_eq!(back.info.nodata.map(f64::to_bits), state.info.nodata.map(f64::to_bits));
        prop_assert_eq!(back.info.band_scale.to_bits(), state.info.band_scale.to_bits());
        let folder = Path::new("x.work");
        prop_assert!(back.check_same(&state, folder).is_ok() && state.check_same(&back, folder).is_ok());
    }

    #[test]
    fn another_float_is_another_build(state in state(), other in float()) {
        let mut now = state.clone();
        now.info.nodata = Some(other);
        let same = state.info.nodata.map(f64::to_bits) == Some(other.to_bits());
        prop_assert_eq!(state.check_same(&now, Path::new("x.work")).is_ok(), same);
    }

    #[test]
    fn damage_is_found(state in state(), place in any::<prop::sample::Index>(), bit in 0..8_u8) {
        let mut bytes = state.encode().expect("bytes");
        let place = place.index(bytes.len());
        bytes[place] ^= 1 << bit;
        prop_assert!(State::decode(&bytes).is_err());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    #[test]
    fn truncated_and_older_states_are_refused(state in state(), version in 0..VERSION) {
        let bytes = state.encode().expect("bytes");
        for end in 0..bytes.len() {
            prop_assert!(State::decode(&bytes[..end]).is_err(), "{} of {}", end, bytes.len());
        }
        let mut older = bytes;
        older[8..12].copy_from_slice(&version.to_le_bytes());
        let refused = State::decode(&older).expect_err("an older state").to_string();
        prop_assert!(refused.contains("version of the state") && refused.contains("begin anew"), "{}", refused);
    }
}

#[test]
fn a_body_that_lies_under_a_checksum_that_fits_is_refused() {
    // The first list of a state is that of the mark: its length comes first.
    for count in [1_u64 << 20, 1 << 40, u64::MAX] {
        let mut body = count.to_le_bytes().to_vec();
        body.extend([0; 100]);
        let mut bytes = MAGIC.to_vec();
        for word in [VERSION, body.len() as u32, crc32fast::hash(&body)] {
            bytes.extend(word.to_le_bytes());
        }
        bytes.extend(body);
        assert!(State::decode(&bytes).is_err(), "{count}");
    }
}
