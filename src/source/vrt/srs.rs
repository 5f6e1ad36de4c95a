//! The coordinate system of a VRT, as far as it can be told without a database: that of its sources, or an EPSG code.

use super::xml::unsupported;
use crate::error::Result;
use crate::geo::{Crs, CrsKind, GeoKeys};
use crate::source::geokeys;

/// What a text says of a coordinate system.
#[derive(Debug, Default, PartialEq)]
struct Said {
    kind: Option<CrsKind>,
    epsg: Option<u32>,
    name: String,
}

/// The coordinate system of a VRT whose sources have `of_sources`, which says more of itself than WKT has words for:
/// it is taken if both are the same, or if the VRT says nothing.
pub(super) fn resolve(text: Option<&str>, of_sources: &Crs) -> Result<Crs> {
    let Some(said) = text.map(read) else { return Ok(of_sources.clone()) };
    let codes = said.epsg.zip(of_sources.epsg);
    let same_name = !said.name.is_empty() && said.name.eq_ignore_ascii_case(&of_sources.name);
    if codes.map_or(same_name, |(said, known)| said == known) {
        return Ok(of_sources.clone());
    }
    match (said.kind, said.epsg.and_then(|code| u16::try_from(code).ok())) {
        (Some(kind), Some(code)) => Ok(of_code(kind, code)),
        _ => Err(unsupported(format!(
            "a VRT in the coordinate system {:?}, of which only GDAL knows whether it is that of its sources",
            if said.name.is_empty() {
                text.unwrap_or_default().chars().take(60).collect()
            } else {
                said.name
            }
        ))),
    }
}

/// The coordinate system of an EPSG code.
pub(crate) fn of_code(kind: CrsKind, code: u16) -> Crs {
    let (model, key) = if kind == CrsKind::Projected { (1, 3072) } else { (2, 2048) };
    let directory = vec![1, 1, 0, 2, 1024, 0, 1, model, key, 0, 1, code];
    Crs { keys: None, ..geokeys::read(GeoKeys { directory, ..GeoKeys::default() }).crs }
}

/// `EPSG:4326`, or WKT of either version.
fn read(text: &str) -> Said {
    let text = text.trim();
    if let Some(code) = text.get(..5).filter(|head| head.eq_ignore_ascii_case("EPSG:")).map(|_| &text[5..]) {
        let horizontal = code.split('+').next().unwrap_or_default();
        return Said { epsg: horizontal.parse().ok(), ..Said::default() };
    }
    let (keyword, items) = node(text);
    let kind = match keyword.to_ascii_uppercase().as_str() {
        "GEOGCS" | "GEOGCRS" | "GEODCRS" | "GEOGRAPHICCRS" => CrsKind::Geographic,
        "PROJCS" | "PROJCRS" | "PROJECTEDCRS" => CrsKind::Projected,
        // The horizontal part comes first, after the name.
        "COMPD_CS" | "COMPOUNDCRS" => return items.get(1).map(|part| read(part)).unwrap_or_default(),
        _ => return Said::default(),
    };
    let epsg = items.iter().find_map(|item| {
        let (keyword, items) = node(item);
        let is_code = ["AUTHORITY", "ID"].iter().any(|word| keyword.eq_ignore_ascii_case(word));
        let ours = is_code && items.first().is_some_and(|name| unquoted(name).eq_ignore_ascii_case("EPSG"));
        items.get(1).filter(|_| ours)?;
        unquoted(items[1]).parse().ok()
    });
    Said {
        kind: Some(kind),
        epsg,
        name: items.first().map(|name| unquoted(name).to_owned()).unwrap_or_default(),
    }
}

fn unquoted(text: &str) -> &str {
    text.trim().trim_matches('"')
}

/// Keyword and items of `KEYWORD[item,item,..]`; a text that is no such thing has no items.
fn node(text: &str) -> (&str, Vec<&str>) {
    let Some((keyword, rest)) = text.split_once(['[', '(']) else { return (text.trim(), Vec::new()) };
    let (mut items, mut start, mut depth, mut quoted) = (Vec::new(), 0, 0_u32, false);
    for (at, byte) in rest.bytes().enumerate() {
        match byte {
            b'"' => quoted = !quoted,
            _ if quoted => {}
            b'[' | b'(' => depth += 1,
            b']' | b')' if depth == 0 => {
                items.push(rest[start..at].trim());
                break;
            }
            b']' | b')' => depth -= 1,
            b',' if depth == 0 => {
                items.push(rest[start..at].trim());
                start = at + 1;
            }
            _ => {}
        }
    }
    (keyword.trim(), items)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WKT1: &str = "GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563,\
                        AUTHORITY[\"EPSG\",\"7030\"]],AUTHORITY[\"EPSG\",\"6326\"]],AUTHORITY[\"EPSG\",\"4326\"]]";

    #[test]
    fn codes_of_wkt_are_those_of_the_root() {
        let said = read(WKT1);
        assert_eq!(said, Said { kind: Some(CrsKind::Geographic), epsg: Some(4326), name: "WGS 84".into() });
        let two = "PROJCRS[\"a [odd, name\", BASEGEOGCRS[\"x\",ID[\"EPSG\",4269]],\n CS[Cartesian,2], ID[\"EPSG\",26913]]";
        let said = read(two);
        assert_eq!((said.kind, said.epsg), (Some(CrsKind::Projected), Some(26913)));
        assert_eq!(said.name, "a [odd, name");
        let compound = format!("COMPD_CS[\"both\",{WKT1},VERT_CS[\"EGM96\",AUTHORITY[\"EPSG\",\"5773\"]]]");
        assert_eq!(read(&compound).epsg, Some(4326));
        assert_eq!(read("EPSG:4326+5773").epsg, Some(4326));
    }

    #[test]
    fn nonsense_says_nothing() {
        for text in [
            "",
            "[",
            "GEOGCS",
            "GEOGCS[",
            "COMPD_CS[\"x\"]",
            "LOCAL_CS[\"x\",UNIT[\"m\",1]]",
            "\"",
            "é[é]",
            "EPS",
        ] {
            assert_eq!(read(text).epsg, None, "{text}");
        }
    }

    #[test]
    fn that_of_the_sources_or_a_code_or_nothing() {
        let sources = Crs { unit: 7.0, ..of_code(CrsKind::Geographic, 4326) };
        assert_eq!(resolve(None, &sources).expect("sources'"), sources);
        assert_eq!(resolve(Some(WKT1), &sources).expect("the same"), sources);
        let other = resolve(Some("PROJCS[\"u\",AUTHORITY[\"EPSG\",\"32610\"]]"), &sources).expect("code");
        assert_eq!((other.kind, other.epsg, other.unit), (CrsKind::Projected, Some(32610), 1.0));
        assert_eq!(other.name, "WGS 84 / UTM zone 10N");
        assert!(resolve(Some("PROJCS[\"local\",UNIT[\"metre\",1]]"), &sources).is_err());
        let named = Crs { epsg: None, name: "Local".into(), ..sources };
        assert_eq!(resolve(Some("PROJCS[\"local\",UNIT[\"metre\",1]]"), &named).expect("name"), named);
    }
}
