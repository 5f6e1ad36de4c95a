//! Reads kind, code, ellipsoid and unit of a WKT, without knowing coordinate systems. Independent
//! of the parser of the sources, which it checks.

use crate::geo::{CrsKind, Ellipsoid};

/// A node of a WKT: `KEYWORD["name",number,CHILD[...]]`.
#[derive(Debug)]
pub(super) struct Wkt<'a> {
    keyword: &'a str,
    /// Quoted texts without their quotes, words and numbers.
    values: Vec<&'a str>,
    children: Vec<Wkt<'a>>,
}

/// Deepest nesting that is read.
const DEEPEST: usize = 32;

impl<'a> Wkt<'a> {
    /// The root node of a text; `None` if the text is not a single node.
    pub fn of(text: &'a str) -> Option<Self> {
        let (node, rest) = Self::read(text.trim(), 0)?;
        rest.trim().is_empty().then_some(node)
    }

    /// The node at the start of a text, and the text behind it.
    fn read(text: &'a str, depth: usize) -> Option<(Self, &'a str)> {
        let open = text.find(['[', '('])?;
        let keyword = text[..open].trim();
        if depth > DEEPEST
            || keyword.is_empty()
            || !keyword.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_')
        {
            return None;
        }
        let mut node = Wkt { keyword, values: Vec::new(), children: Vec::new() };
        let mut rest = text[open + 1..].trim_start();
        loop {
            if let Some(quoted) = rest.strip_prefix('"') {
                // A quote within a text is written twice.
                let mut end = quoted.find('"')?;
                while quoted[end + 1..].starts_with('"') {
                    end += 2 + quoted[end + 2..].find('"')?;
                }
                node.values.push(&quoted[..end]);
                rest = quoted[end + 1..].trim_start();
            } else {
                let end = rest.find([',', ']', ')', '[', '('])?;
                if rest[end..].starts_with(['[', '(']) {
                    let (child, after) = Self::read(rest, depth + 1)?;
                    node.children.push(child);
                    rest = after.trim_start();
                } else {
                    node.values.push(rest[..end].trim());
                    rest = &rest[end..];
                }
            }
            match rest.as_bytes().first()? {
                b',' => rest = rest[1..].trim_start(),
                b']' | b')' => return Some((node, &rest[1..])),
                _ => return None,
            }
        }
    }

    fn is(&self, keywords: &[&str]) -> bool {
        keywords.iter().any(|keyword| self.keyword.eq_ignore_ascii_case(keyword))
    }

    fn child(&self, keywords: &[&str]) -> Option<&Self> {
        self.children.iter().find(|child| child.is(keywords))
    }

    /// The first node with one of these keywords, at or below this one.
    fn find(&self, keywords: &[&str]) -> Option<&Self> {
        if self.is(keywords) {
            return Some(self);
        }
        self.children.iter().find_map(|child| child.find(keywords))
    }

    fn number(&self, index: usize) -> Option<f64> {
        self.values.get(index)?.parse().ok().filter(|number: &f64| number.is_finite())
    }

    /// Kind of the system; `None` for compound ones and kinds that rasters do not have.
    pub fn kind(&self) -> Option<CrsKind> {
        if self.is(&["GEOGCRS", "GEOGRAPHICCRS", "GEOGCS"]) {
            Some(CrsKind::Geographic)
        } else if self.is(&["PROJCRS", "PROJECTEDCRS", "PROJCS"]) {
            Some(CrsKind::Projected)
        } else if self.is(&["ENGCRS", "ENGINEERINGCRS", "LOCAL_CS"]) {
            Some(CrsKind::Engineering)
        } else {
            None
        }
    }

    /// EPSG code of the system itself.
    pub fn epsg(&self) -> Option<u32> {
        self.kind()?;
        let id = self.child(&["ID", "AUTHORITY"])?;
        let code = id.values.get(1).filter(|_| id.values[0].eq_ignore_ascii_case("EPSG"))?;
        code.parse().ok()
    }

    /// Ellipsoid of the system.
    pub fn ellipsoid(&self) -> Option<Ellipsoid> {
        self.kind()?;
        let node = self.find(&["ELLIPSOID", "SPHEROID"])?;
        let metres = node.child(&["LENGTHUNIT", "UNIT"]).map_or(Some(1.0), |unit| unit.number(1))?;
        Some(Ellipsoid { a: node.number(1)? * metres, inverse_flattening: node.number(2)? })
    }

    /// Radians or metres of the coordinate unit, if all coordinates have the same one.
    pub fn unit(&self) -> Option<f64> {
        self.kind()?;
        let units = ["ANGLEUNIT", "LENGTHUNIT", "UNIT"];
        let axes = || self.children.iter().filter(|child| child.is(&["AXIS"])).take(2);
        let own = self.child(&units).or_else(|| axes().find_map(|axis| axis.child(&units)))?;
        own.number(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_dialects_are_read() {
        let one = r#"PROJCS["NAD83 / feet ""here""",GEOGCS["NAD83",DATUM["d",SPHEROID["GRS 1980",6378137,298.257222101,AUTHORITY["EPSG","7019"]]],
            UNIT["degree",0.0174532925199433]],PROJECTION["Lambert"],PARAMETER["x",1.5],UNIT["US survey foot",0.304800609601219],AXIS["X",EAST],AUTHORITY["EPSG","2263"]]"#;
        let wkt = Wkt::of(one).unwrap();
        assert_eq!((wkt.kind(), wkt.epsg()), (Some(CrsKind::Projected), Some(2263)));
        assert_eq!(wkt.unit(), Some(0.304_800_609_601_219));
        assert_eq!(wkt.ellipsoid(), Some(Ellipsoid { a: 6_378_137.0, inverse_flattening: 298.257_222_101 }));
        let two = r#"GEOGCRS["NTF",DATUM["NTF",ELLIPSOID["Clarke",20925832.16,294.97,LENGTHUNIT["f",0.3048]]],PRIMEM["Paris",2.3,ANGLEUNIT["grad",0.0157]],
            CS[ellipsoidal,2],AXIS["lat",north,ORDER[1],ANGLEUNIT["degree",0.0174532925199433]],AXIS["lon",east],ID["EPSG",4275]]"#;
        let wkt = Wkt::of(two).unwrap();
        assert_eq!((wkt.kind(), wkt.epsg()), (Some(CrsKind::Geographic), Some(4275)));
        assert_eq!(wkt.unit(), Some(0.017_453_292_519_943_3));
        assert!((wkt.ellipsoid().unwrap().a - 20_925_832.16 * 0.3048).abs() < 1e-6);
        for other in
            ["", "GEOGCRS", "GEOGCRS[", "GEOGCRS[\"a", "a b[1]", "COMPOUNDCRS[\"x\",GEOGCRS[\"y\"]]x"]
        {
            assert!(Wkt::of(other).is_none(), "{other}");
        }
        assert_eq!(Wkt::of("COMPOUNDCRS[\"x\",GEOGCRS[\"y\",ID[\"EPSG\",1]]]").unwrap().epsg(), None);
        assert!(Wkt::of(&"A[".repeat(100_000)).is_none());
    }
}
