//! The units and ellipsoids of EPSG codes, for files that give only the code.

pub mod table;

use std::f64::consts::PI;

use crate::geo::{Ellipsoid, WGS84};

/// Metres of a foot.
pub const FOOT: f64 = 0.3048;
/// Metres of a US survey foot.
pub const US_SURVEY_FOOT: f64 = 1200.0 / 3937.0;
/// Radians of a degree.
pub const DEGREE: f64 = PI / 180.0;
/// Radians of a grad.
const GRAD: f64 = PI / 200.0;

/// An ellipsoid that no EPSG code of the Earth exceeds in any radius of curvature at any latitude
/// (their largest is 1.000087 times that of WGS 84; the five spheres are in the table): 0.01 % too
/// long rather than too short.
const LARGEST: Ellipsoid = Ellipsoid { a: WGS84.a * 1.0001, ..WGS84 };

/// EPSG codes of the units of length.
#[rustfmt::skip]
const LENGTHS: &[u32] = &[
    9001, 9002, 9003, 9005, 9014, 9030, 9031, 9033, 9034, 9035, 9036, 9037, 9038, 9039, 9040, 9041, 9042, 9062, 9084,
    9093, 9094, 9095, 9096, 9097, 9098, 9301, 1025, 1033,
];

/// Metres of an EPSG unit of length, and its name.
pub fn length_unit(code: u32) -> Option<(f64, &'static str)> {
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
pub fn angular_unit(code: u32) -> Option<f64> {
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

/// Name of a unit of length by its metres.
pub fn length_name(metres: f64) -> Option<&'static str> {
    LENGTHS.iter().filter_map(|&code| length_unit(code)).find(|unit| unit.0 == metres).map(|unit| unit.1)
}

/// Ellipsoid of a geographic CRS: its own, or one on which distances are 0.01 % too long.
pub fn geographic_ellipsoid(code: Option<u32>) -> Ellipsoid {
    code.and_then(table::geographic).map_or(LARGEST, |row| row.datum.ellipsoid.shape)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_of_known_codes() {
        let projected = |code| length_unit(table::projected(code).expect("row").unit).expect("unit").0;
        assert_eq!(projected(32611), 1.0);
        assert_eq!(projected(2263), US_SURVEY_FOOT); // NAD83 / New York Long Island (ftUS)
        assert_eq!(projected(2256), FOOT); // NAD83 / Montana (ft)
        assert_eq!(projected(2222), FOOT); // NAD83 / Arizona East (ft)
        assert_eq!(projected(6434), US_SURVEY_FOOT); // NAD83(2011) / Colorado North (ftUS)
        assert_eq!(projected(27700), 1.0);
        assert_eq!(projected(22300), 1000.0);
        assert_eq!(angular_unit(table::geographic(4807).expect("row").unit), Some(GRAD));
        let vertical = |code| table::vertical(code).expect("row");
        assert_eq!((vertical(6360).unit, vertical(5703).unit), (9003, 9001));
        assert!(vertical(5715).down && vertical(6359).down && !vertical(5714).down && !vertical(6360).down);
    }

    #[test]
    fn every_unit_of_the_table_is_known() {
        for code in table::projected_codes() {
            assert!(length_unit(table::projected(code).expect("row").unit).is_some(), "EPSG:{code}");
        }
        for code in table::geographic_codes() {
            assert!(angular_unit(table::geographic(code).expect("row").unit).is_some(), "EPSG:{code}");
        }
    }

    #[test]
    fn unknown_ellipsoid_is_longer_than_every_known_one() {
        for code in (7001..7060).chain(1024..1030) {
            let own = table::ellipsoid(code).map(|found| found.shape);
            let Some(own) = own.filter(|own| own.inverse_flattening != 0.0) else { continue };
            for degree in 0..=90 {
                let latitude = f64::from(degree) * DEGREE;
                let (x, y) = own.metres_of_radian(latitude);
                let (far_x, far_y) = LARGEST.metres_of_radian(latitude);
                assert!(x <= far_x && y <= far_y, "{code} at {degree}");
            }
        }
    }
}
