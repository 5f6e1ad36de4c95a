//! What EPSG codes say of units and ellipsoids, for files that give the code and nothing else.
//!
//! Tables were made from the EPSG dataset 10.076 (IOGP). They are not a CRS database: a projected code has a unit
//! here, a geographic one its unit and an ellipsoid, a vertical one its unit, and that is all.

use std::f64::consts::PI;

use crate::geo::{Ellipsoid, WGS84};

/// Metres of a foot.
pub(crate) const FOOT: f64 = 0.3048;
/// Metres of a US survey foot.
pub(crate) const US_SURVEY_FOOT: f64 = 1200.0 / 3937.0;
/// Radians of a degree.
pub(crate) const DEGREE: f64 = PI / 180.0;
/// Radians of a grad.
const GRAD: f64 = PI / 200.0;

const GRS80: Ellipsoid = Ellipsoid { a: 6_378_137.0, inverse_flattening: 298.257_222_101 };

/// An ellipsoid that no EPSG code of the Earth exceeds in any radius of curvature at any latitude (their largest is
/// 1.000087 times that of WGS 84; the five spheres are in the table): 0.01 % too long rather than too short.
const LARGEST: Ellipsoid = Ellipsoid { a: WGS84.a * 1.0001, ..WGS84 };

/// EPSG ellipsoids by code.
const ELLIPSOIDS: &[(u32, f64, f64)] = &[
    (7001, 6_377_563.396, 299.324_964_6),
    (7003, 6_378_160.0, 298.25),
    (7004, 6_377_397.155, 299.152_812_8),
    (7008, 6_378_206.4, 294.978_698_213_898),
    (7012, 6_378_249.145, 293.465),
    (7019, 6_378_137.0, 298.257_222_101),
    (7022, 6_378_388.0, 297.0),
    (7024, 6_378_245.0, 298.3),
    (7030, 6_378_137.0, 298.257_223_563),
    (7035, 6_371_000.0, 0.0),
    (7043, 6_378_135.0, 298.26),
    (7048, 6_371_007.0, 0.0),
    (7052, 6_370_997.0, 0.0),
    (7057, 6_371_228.0, 0.0),
    (7059, 6_378_137.0, 0.0),
];

/// Ellipsoids of the geographic codes that DEMs mostly come in, and of all that lie on a sphere.
const GEOGRAPHIC: &[(u32, &[u32])] = &[
    (7030, &[4326, 4979, 4030, 9053, 9054, 9055, 9056, 9057]),
    (
        7019,
        &[
            4019, 4140, 4152, 4167, 4171, 4258, 4269, 4283, 4490, 4612, 4617, 4674, 4759, 4937, 4955, 4957,
            6318, 6319, 6668, 6706, 7843, 7844, 8232,
        ],
    ),
    (7008, &[4008, 4267]),
    (7001, &[4001, 4277]),
    (7022, &[4022, 4225, 4230, 4265, 4272]),
    (7004, &[4004, 4301, 4312, 4313, 4314]),
    (7003, &[4003, 4202, 4203]),
    (7024, &[4024, 4178, 4179, 4284]),
    (7043, &[4322, 4324]),
    (7035, &[4035]),
    (7048, &[4047]),
    (7052, &[4052]),
    (7057, &[4053]),
    (7059, &[4055]),
];

/// Geographic codes in grads; all others are in degrees.
const IN_GRADS: &[u32] = &[4807, 4810, 4811, 4816, 4819, 4821, 4901, 4902];

/// Projected codes in US survey feet: first, last, step.
#[rustfmt::skip]
const IN_US_SURVEY_FEET: &[(u32, u32, u32)] = &[
    (2155, 2155, 1), (2194, 2194, 1), (2204, 2204, 1), (2225, 2250, 1), (2254, 2263, 3), (2255, 2263, 2),
    (2258, 2264, 1), (2267, 2268, 1), (2271, 2277, 3), (2272, 2278, 2), (2275, 2279, 1), (2283, 2289, 1),
    (2870, 2895, 1), (2899, 2911, 3), (2900, 2908, 2), (2903, 2908, 1), (2912, 2918, 3), (2916, 2920, 1),
    (2924, 2930, 1), (2964, 2968, 1), (3089, 3091, 2), (3102, 3102, 1), (3363, 3365, 2), (3404, 3404, 1),
    (3417, 3438, 1), (3441, 3446, 1), (3451, 3459, 1), (3485, 3487, 2), (3490, 3512, 2), (3515, 3553, 2),
    (3560, 3570, 1), (3582, 3586, 2), (3598, 3600, 2), (3608, 3632, 2), (3640, 3642, 2), (3650, 3654, 2),
    (3658, 3664, 2), (3668, 3674, 2), (3677, 3686, 3), (3688, 3692, 2), (3696, 3700, 2), (3728, 3739, 1),
    (3753, 3760, 1), (3991, 3992, 1), (4217, 4217, 1), (4399, 4413, 1), (4418, 4433, 1), (4438, 4439, 1),
    (4455, 4457, 1), (5623, 5625, 1), (5646, 5646, 1), (5654, 5655, 1), (6200, 6202, 1), (6411, 6413, 2),
    (6416, 6438, 2), (6441, 6479, 2), (6484, 6492, 2), (6501, 6507, 2), (6510, 6510, 1), (6517, 6543, 2),
    (6549, 6555, 2), (6563, 6565, 2), (6568, 6568, 1), (6572, 6578, 2), (6582, 6590, 2), (6593, 6609, 2),
    (6612, 6618, 2), (6625, 6627, 1), (6633, 6633, 1), (6880, 6880, 1), (6923, 6925, 2), (6966, 6966, 1),
    (6997, 6997, 1), (7057, 7070, 1), (7128, 7128, 1), (7132, 7132, 1), (7258, 7370, 2), (7587, 7645, 1),
    (8035, 8036, 1), (8091, 8093, 2), (8096, 8172, 2), (8177, 8180, 3), (8182, 8185, 3), (8189, 8189, 1),
    (8193, 8193, 1), (8197, 8200, 3), (8202, 8210, 2), (8213, 8216, 3), (8220, 8220, 1), (8224, 8226, 2),
    (8380, 8384, 2), (8387, 8387, 1), (8518, 8540, 1), (9748, 9749, 1), (26729, 26803, 1),
    (26811, 26813, 1), (26847, 26870, 1), (32001, 32058, 1), (32064, 32067, 1), (32074, 32077, 1),
    (32099, 32099, 1), (32164, 32167, 1), (32664, 32667, 1),
];

/// Projected codes in feet: first, last, step.
#[rustfmt::skip]
const IN_FEET: &[(u32, u32, u32)] = &[
    (2222, 2224, 1), (2251, 2253, 1), (2256, 2256, 1), (2265, 2266, 1), (2269, 2270, 1), (2273, 2273, 1),
    (2280, 2282, 1), (2867, 2869, 1), (2896, 2898, 1), (2901, 2901, 1), (2909, 2910, 1), (2913, 2914, 1),
    (2921, 2923, 1), (2992, 2994, 2), (3080, 3080, 1), (3359, 3361, 2), (3479, 3483, 2), (3588, 3590, 2),
    (3593, 3593, 1), (3605, 3605, 1), (3634, 3636, 2), (3644, 3648, 2), (3656, 3656, 1), (3676, 3682, 3),
    (5588, 5588, 1), (6128, 6129, 1), (6141, 6141, 1), (6391, 6391, 1), (6405, 6409, 2), (6494, 6496, 2),
    (6499, 6499, 1), (6515, 6515, 1), (6545, 6547, 2), (6557, 6561, 2), (6570, 6570, 1), (6785, 6863, 2),
    (6868, 6868, 1), (6885, 6887, 2), (7119, 7127, 1), (8065, 8068, 1), (8312, 8348, 2),
    (20050, 20050, 1),
];

/// Other projected codes that are not in metres, with their unit.
#[rustfmt::skip]
const IN_OTHER_UNITS: &[(u32, u32)] = &[
    (2066, 9039), (2136, 9094), (2159, 9094), (2160, 9094), (2314, 9005), (3139, 9098), (3140, 9098), (3167, 9301),
    (3407, 9005), (5472, 9037), (5589, 9005), (22300, 9036), (24100, 9005), (24370, 9084), (24371, 9084),
    (24372, 9084), (24373, 9084), (24374, 9084), (24382, 9084), (24571, 9062), (27291, 9040), (27292, 9040),
    (29371, 9031), (29373, 9031), (29375, 9031), (29377, 9031), (29379, 9031), (29381, 9031), (29383, 9031),
    (29385, 9031), (29871, 9042), (29872, 9041), (30200, 9039),
];

/// Metres of an EPSG unit of length, and its name.
pub(crate) fn length_unit(code: u32) -> Option<(f64, &'static str)> {
    Some(match code {
        9001 => (1.0, "metre"),
        9002 => (FOOT, "foot"),
        9003 => (US_SURVEY_FOOT, "US survey foot"),
        9005 => (0.304_797_265_4, "Clarke's foot"),
        9014 => (1.8288, "fathom"),
        9030 => (1852.0, "nautical mile"),
        9031 => (1.000_013_596_5, "German legal metre"),
        9033 => (66.0 * US_SURVEY_FOOT, "US survey chain"),
        9034 => (0.66 * US_SURVEY_FOOT, "US survey link"),
        9035 => (5280.0 * US_SURVEY_FOOT, "US survey mile"),
        9036 => (1000.0, "kilometre"),
        9037 => (0.914_391_796_2, "Clarke's yard"),
        9038 => (20.116_619_516_4, "Clarke's chain"),
        9039 => (0.201_166_195_164, "Clarke's link"),
        9040 => (0.914_398_414_616_028_9, "British yard (Sears 1922)"),
        9041 => (0.304_799_471_538_676_2, "British foot (Sears 1922)"),
        9042 => (20.116_765_121_552_632, "British chain (Sears 1922)"),
        9062 => (20.116_782_494_375_872, "British chain (Benoit 1895 B)"),
        9084 => (0.914_398_530_744_440_8, "Indian yard"),
        9093 => (1609.344, "Statute mile"),
        9094 => (0.304_799_710_181_508_8, "Gold Coast foot"),
        9095 => (0.304_800_749_1, "British foot (1936)"),
        9096 => (0.9144, "yard"),
        9097 => (20.1168, "chain"),
        9098 => (0.201_168, "link"),
        9301 => (20.116_756, "British chain (Sears 1922 truncated)"),
        1025 => (0.001, "millimetre"),
        1033 => (0.01, "centimetre"),
        _ => return None,
    })
}

/// Radians of an EPSG unit of angle.
pub(crate) fn angular_unit(code: u32) -> Option<f64> {
    Some(match code {
        9101 => 1.0,
        9102 | 9107 | 9108 | 9110 | 9122 => DEGREE,
        9103 => DEGREE / 60.0,
        9104 => DEGREE / 3600.0,
        9105 | 9106 => GRAD,
        9109 => 1e-6,
        _ => return None,
    })
}

/// Metres of the unit of a projected CRS; metres where nothing else is known.
pub(crate) fn projected_unit(code: u32) -> f64 {
    let within = |table: &[(u32, u32, u32)]| {
        table
            .iter()
            .any(|&(first, last, step)| (first..=last).contains(&code) && (code - first).is_multiple_of(step))
    };
    if within(IN_US_SURVEY_FEET) {
        US_SURVEY_FOOT
    } else if within(IN_FEET) {
        FOOT
    } else {
        let other = IN_OTHER_UNITS.iter().find(|entry| entry.0 == code);
        other.and_then(|entry| length_unit(entry.1)).map_or(1.0, |unit| unit.0)
    }
}

/// Radians of the unit of a geographic CRS.
pub(crate) fn geographic_unit(code: u32) -> f64 {
    if IN_GRADS.contains(&code) { GRAD } else { DEGREE }
}

/// Metres of the unit of a vertical CRS, and its name; metres where nothing else is known.
pub(crate) fn vertical_unit(code: u32) -> (f64, &'static str) {
    let unit = match code {
        5614 | 6130..=6132 | 8050 | 8051 | 8228 | 8897 => 9002,
        5702 | 6358..=6360 | 8052 | 8053 => 9003,
        5754 => 9095,
        _ => 9001,
    };
    length_unit(unit).unwrap_or((1.0, "metre"))
}

/// Vertical codes whose axis points down: depths.
const DEPTHS: &[u32] = &[
    5336, 5612, 5614, 5706, 5715, 5734, 5739, 5789, 5831, 5861, 5862, 5863, 5864, 5865, 5866, 5867, 5873,
    6357, 6358, 6359, 7976, 8051, 8053, 8358, 8378, 8897, 9287, 9288, 9672,
];

/// True if a vertical CRS counts downwards.
pub(crate) fn is_depth(code: u32) -> bool {
    DEPTHS.contains(&code)
}

/// An ellipsoid by its own code.
pub(crate) fn ellipsoid(code: u32) -> Option<Ellipsoid> {
    let found = ELLIPSOIDS.iter().find(|entry| entry.0 == code)?;
    Some(Ellipsoid { a: found.1, inverse_flattening: found.2 })
}

/// Ellipsoid of a geographic CRS: its own, or one on which distances are 0.01 % too long.
pub(crate) fn geographic_ellipsoid(code: Option<u32>) -> Ellipsoid {
    let Some(code) = code else { return LARGEST };
    let found = GEOGRAPHIC.iter().find(|entry| entry.1.contains(&code));
    found.and_then(|entry| ellipsoid(entry.0)).unwrap_or(LARGEST)
}

/// Ellipsoid of the projected families that this program writes WKT for.
pub(crate) fn projected_ellipsoid(code: u32) -> Ellipsoid {
    match code {
        25828..=25838 | 26901..=26923 => GRS80,
        _ => WGS84,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_of_known_codes() {
        assert_eq!(projected_unit(32611), 1.0);
        assert_eq!(projected_unit(2263), US_SURVEY_FOOT); // NAD83 / New York Long Island (ftUS)
        assert_eq!(projected_unit(2256), FOOT); // NAD83 / Montana (ft)
        assert_eq!(projected_unit(2222), FOOT); // NAD83 / Arizona East (ft)
        assert_eq!(projected_unit(6434), US_SURVEY_FOOT); // NAD83(2011) / Colorado North (ftUS)
        assert_eq!(projected_unit(27700), 1.0);
        assert_eq!(projected_unit(22300), 1000.0);
        assert_eq!(geographic_unit(4807), GRAD);
        assert_eq!(vertical_unit(6360).0, US_SURVEY_FOOT);
        assert_eq!(vertical_unit(5703).0, 1.0);
        assert!(is_depth(5715) && is_depth(6359) && !is_depth(5714) && !is_depth(6360));
    }

    #[test]
    fn unknown_ellipsoid_is_longer_than_every_known_one() {
        for &(code, ..) in ELLIPSOIDS {
            let own = ellipsoid(code).expect("listed");
            if own.inverse_flattening == 0.0 {
                continue;
            }
            for degree in 0..=90 {
                let latitude = f64::from(degree) * DEGREE;
                let (x, y) = own.metres_of_radian(latitude);
                let (far_x, far_y) = LARGEST.metres_of_radian(latitude);
                assert!(x <= far_x && y <= far_y, "{code} at {degree}");
            }
        }
    }
}
