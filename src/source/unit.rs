//! Vertical units by their names in files and on the command line.

use crate::crs::epsg::{FOOT, US_SURVEY_FOOT};

/// Length in metres of a unit: by GDAL's names, those of PROJ and OGC, and common ones. `0.25 m` is
/// a unit of a quarter of a metre.
pub(crate) fn metres_of(name: &str) -> Option<f64> {
    let name = name.trim().to_lowercase();
    if let Some(number) = name.strip_suffix(" m") {
        return length(number);
    }
    Some(match name.as_str() {
        "m" | "metre" | "metres" | "meter" | "meters" | "1" => 1.0,
        "ft" | "foot" | "feet" | "international foot" | "international feet" | "foot_intl" | "ft_int" => FOOT,
        "us survey foot" | "us survey feet" | "us-ft" | "us_ft" | "ftus" | "ft_us" | "foot_us"
        | "us foot" | "us feet" | "u.s. survey foot" | "us_survey_foot" | "survey foot" | "foot us"
        | "sft" => US_SURVEY_FOOT,
        "km" | "kilometre" | "kilometer" | "kilometres" | "kilometers" => 1000.0,
        "dm" | "decimetre" | "decimeter" | "decimetres" | "decimeters" => 0.1,
        "cm" | "centimetre" | "centimeter" | "centimetres" | "centimeters" => 0.01,
        "mm" | "millimetre" | "millimeter" | "millimetres" | "millimeters" => 0.001,
        "yd" | "yard" | "yards" => 0.9144,
        "fath" | "fathom" | "fathoms" => 1.8288,
        _ => return None,
    })
}

/// A unit stated by the user: `m`, `ft`, `us-ft`, any other known name, or its length in metres.
/// Returns metres, and the name to record, which GDAL and this program read back as the same unit.
pub fn parse(text: &str) -> Option<(f64, String)> {
    let text = text.trim();
    if let Some(metres) = length(text) {
        let name = if metres == 1.0 { "m".to_owned() } else { format!("{metres} m") };
        return Some((metres, name));
    }
    let metres = metres_of(text)?;
    // GDAL's own name, which every reader of a GeoTIFF knows.
    let name = if metres == US_SURVEY_FOOT { "US survey foot" } else { text };
    Some((metres, name.to_owned()))
}

fn length(number: &str) -> Option<f64> {
    number.trim().parse().ok().filter(|&metres: &f64| metres > 0.0 && metres.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_numbers() {
        assert_eq!(parse("m"), Some((1.0, "m".to_owned())));
        assert_eq!(parse("ft"), Some((0.3048, "ft".to_owned())));
        assert_eq!(parse("us-ft"), Some((1200.0 / 3937.0, "US survey foot".to_owned())));
        assert_eq!(parse("0.25"), Some((0.25, "0.25 m".to_owned())));
        assert_eq!(parse(" 1 "), Some((1.0, "m".to_owned())));
        for nonsense in ["", "cubit", "0", "-1", "nan", "inf", "ft2", "-1 m"] {
            assert_eq!(parse(nonsense), None, "{nonsense}");
        }
    }

    #[test]
    fn recorded_names_are_read_back() {
        for text in ["m", "ft", "us-ft", "0.25", "1e-3", "fathom", "3.0480061"] {
            let (metres, name) = parse(text).expect("a unit");
            assert_eq!(metres_of(&name), Some(metres), "{name}");
        }
    }
}
