//! Definitions against what GDAL says of the same systems, and against themselves.

use proptest::prelude::*;
use serde_json::Value;

use crate::crs::geokeys;
use crate::crs::*;
use crate::geo::*;

/// What GDAL 3.6.2 wrote and read back: see fixtures/SOURCES.md.
fn oracle() -> Vec<Value> {
    let path = std::env::var("RELEVO_CRS_ORACLE")
        .unwrap_or_else(|_| concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/crs/gdal.json").to_owned());
    serde_json::from_str(&std::fs::read_to_string(path).expect("file")).expect("JSON")
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * a.abs().max(b.abs())
}

/// What differs between a system and GDAL's account of it.
fn differences(crs: &Crs, gdal: &Value) -> Vec<String> {
    let mut found = Vec::new();
    let mut differ =
        |what: &str, ours: String, theirs: &Value| found.push(format!("{what} {ours}, not {theirs}"));
    let kind = serde_json::to_value(crs.kind).expect("word");
    if kind != gdal["kind"] {
        differ("kind", kind.to_string(), &gdal["kind"]);
    }
    if crs.epsg.map(u64::from) != gdal["epsg"].as_u64() {
        differ("code", format!("{:?}", crs.epsg), &gdal["epsg"]);
    }
    if !close(crs.unit, gdal["unit"].as_f64().expect("unit")) {
        differ("unit", crs.unit.to_string(), &gdal["unit"]);
    }
    if crs.kind != CrsKind::Engineering {
        let (a, rf) = (gdal["a"].as_f64().expect("a"), gdal["rf"].as_f64().expect("rf"));
        let ours = crs.ellipsoid;
        if !close(ours.a, a) || (ours.inverse_flattening - rf).abs() > 1e-8 * rf {
            differ("ellipsoid", format!("{ours:?}"), &gdal["rf"]);
        }
    }
    found
}

#[test]
fn keys_mean_what_they_mean_to_gdal() {
    let mut wrong = Vec::new();
    for row in oracle() {
        let keys: GeoKeys = serde_json::from_value(row["keys"].clone()).expect("keys");
        let found = geokeys::read(keys);
        let differences = differences(&found.crs, &row["gdal"]);
        if !differences.is_empty() {
            wrong.push(format!("{}: {}", row["what"], differences.join("; ")));
        }
        let own = row["wkt1"].as_str().map(read);
        if let Some(Ok(own)) = own
            && !are_same(&own, &found.crs)
        {
            wrong.push(format!("{} keys and text differ\n  {}\n  {}", row["what"], own.wkt, found.crs.wkt));
        }
    }
    assert!(wrong.is_empty(), "{}\n{} wrong", wrong.join("\n"), wrong.len());
}

#[test]
fn texts_of_one_system_are_one() {
    let mut wrong = Vec::new();
    for row in oracle() {
        let what = row["what"].as_str().expect("text");
        let Some(first) = row["wkt1"].as_str().filter(|text| !text.is_empty()) else { continue };
        let first = match read(first) {
            Ok(first) => first,
            Err(error) => {
                wrong.push(format!("{what}: {error}"));
                continue;
            }
        };
        let truth = differences(&first, &row["truth"]);
        if !truth.is_empty() {
            wrong.push(format!("{what} WKT: {}", truth.join("; ")));
        }
        let head = if what.starts_with("ESRI") { "" } else { what };
        // GDAL takes the successors of some withdrawn codes.
        let replaced = row["truth"]["epsg"].as_u64().is_some_and(|code| what != format!("EPSG:{code}"));
        let head =
            if replaced && table::compound(what[5..].parse().unwrap_or(0)).is_none() { "" } else { head };
        for text in ["esri", "proj", "wkt2"]
            .map(|key| row[key].as_str().unwrap_or_default())
            .into_iter()
            .chain([head])
        {
            if text.is_empty() || text.starts_with('+') && !what.starts_with('+') {
                continue;
            }
            match read(text) {
                Ok(other) if !are_same(&first, &other) => wrong.push(format!("{what}: another is {text}")),
                Ok(_) => {}
                Err(error) => wrong.push(format!("{what}: {error}")),
            }
        }
    }
    assert!(wrong.is_empty(), "{}\n{} wrong", wrong.join("\n"), wrong.len());
}

/// Writes and reads every system of the EPSG table; the texts go where the variable says, for other
/// programs to read.
#[test]
fn every_code_goes_through_its_text() {
    let codes = table::projected_codes()
        .map(|code| (CrsKind::Projected, code))
        .chain(table::geographic_codes().map(|code| (CrsKind::Geographic, code)));
    let mut texts = String::new();
    for (kind, code) in codes {
        let definition = Definition::of_kind(kind, code).unwrap_or_else(|| panic!("EPSG:{code}"));
        let crs = definition.crs();
        assert!(!crs.wkt.is_empty() && crs.unit == definition.unit, "EPSG:{code}");
        let again = Definition::read(&crs.wkt).unwrap_or_else(|error| panic!("EPSG:{code}: {error}"));
        assert!(
            again.same(&definition) && again.epsg == Some(code),
            "EPSG:{code}: {again:?}\n{definition:?}"
        );
        assert_eq!(
            (&again.name, &again.axes, again.unit),
            (&definition.name, &definition.axes, definition.unit)
        );
        texts += &[&code.to_string(), "\t", &crs.wkt, "\n"].concat();
    }
    if let Ok(path) = std::env::var("RELEVO_CRS_TEXTS") {
        std::fs::write(path, texts).expect("written");
    }
}

#[test]
fn codes_in_all_spellings() {
    for text in ["EPSG:4326", "epsg:4326", "urn:ogc:def:crs:EPSG::4326", "OGC:CRS84", "+init=epsg:4326"] {
        assert_eq!(read(text).expect(text).epsg, Some(4326), "{text}");
    }
    let both = read("EPSG:32613+5703").expect("codes");
    assert_eq!((both.epsg, both.vertical_epsg), (Some(32613), Some(5703)));
    for text in [
        "",
        "EPSG:",
        "EPSG:1",
        "EPSG:4978",
        "GEOCCS[\"x\"]",
        "+proj=nothing",
        "+proj=utm +zone=61",
        "[",
        "é[é]",
    ] {
        assert!(matches!(read(text), Err(Error::Unsupported { .. })), "{text}");
    }
}

#[test]
fn a_code_that_the_text_contradicts_does_not_count() {
    let text = read("EPSG:32613").expect("code").wkt;
    assert_eq!(read(&text).expect("WKT").epsg, Some(32613));
    let lying = text.replace("-105", "-104");
    let other = read(&lying).expect("WKT");
    assert!(other.epsg.is_none() && !are_same(&other, &read("EPSG:32613").expect("code")));
}

proptest! {
    #[test]
    fn no_text_panics(at in 0_usize..2000, with in "[\\]\\[\",0-9.eE+é -]{0,4}", length in 0_usize..12, code in 0_usize..6) {
        let codes = [2056, 32613, 3031, 2263, 4807, 27700];
        let text = read(&format!("EPSG:{}", codes[code])).expect("code").wkt;
        let at = at % text.len();
        let head: String = text.chars().take(at).collect();
        let tail: String = text.chars().skip(at + length).collect();
        let _ = read(&format!("{head}{with}{tail}"));
        let _ = read(&format!("+proj=tmerc +{head}{with}"));
    }
}
