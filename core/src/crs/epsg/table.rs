//! The part of the EPSG dataset that rasters need: ellipsoids, datums, geographic, projected and
//! vertical systems.
//!
//! `table.z` is made by tools/epsg.py, which says how; the dataset is EPSG v10.076 (IOGP). Rows are
//! found by code.

use std::io::Read;
use std::sync::OnceLock;

use crate::geo::Ellipsoid;

/// The rows of one section: code and fields, by code.
type Rows = Vec<(u32, &'static str)>;

/// Sections in the order of the file.
#[derive(Clone, Copy)]
enum Section {
    Ellipsoids,
    Meridians,
    Datums,
    Geographic,
    Vertical,
    Systems,
    Methods,
    Conversions,
    Projected,
    Compound,
}

/// Name and shape.
pub struct NamedEllipsoid {
    pub name: &'static str,
    pub shape: Ellipsoid,
}

/// A geodetic datum with its ellipsoid and meridian.
pub struct Datum {
    pub name: &'static str,
    /// ESRI's name for it without `D_`; empty if it is the same.
    pub alias: &'static str,
    pub ellipsoid: NamedEllipsoid,
    /// Name, and degrees east of Greenwich.
    pub meridian: (&'static str, f64),
    /// Metres within which it is WGS 84 by the dataset, which has a transformation of zeros between
    /// them.
    pub within: Option<f64>,
}

/// A geographic system.
pub struct Geographic {
    pub name: &'static str,
    pub datum: Datum,
    /// EPSG code of the unit of its angles.
    pub unit: u32,
    /// True if it includes ellipsoidal heights.
    pub has_height: bool,
}

/// A projection with its parameters: EPSG codes of them, and values in degrees, metres and unity.
pub struct Conversion {
    pub name: &'static str,
    pub method: u32,
    pub parameters: Vec<(u32, f64)>,
}

/// Both axes of a plane: abbreviation and direction.
pub type Axes = [(&'static str, &'static str); 2];

/// A projected system.
pub struct Projected {
    pub name: String,
    /// Code of its geographic system.
    pub base: u32,
    /// Code of its projection.
    pub conversion: u32,
    pub axes: Axes,
    /// EPSG code of the unit.
    pub unit: u32,
}

/// A vertical system.
pub struct Vertical {
    pub name: &'static str,
    pub datum: &'static str,
    /// EPSG code of the unit.
    pub unit: u32,
    /// True if it counts downwards.
    pub down: bool,
}

const METRE: u32 = 9001;
const DEGREE: u32 = 9102;

fn sections() -> &'static [Rows] {
    static TEXT: OnceLock<String> = OnceLock::new();
    static SECTIONS: OnceLock<Vec<Rows>> = OnceLock::new();
    SECTIONS.get_or_init(|| {
        let text = TEXT.get_or_init(|| {
            let mut text = String::new();
            // Part of the program: a test reads every row of it.
            let read =
                flate2::read::ZlibDecoder::new(&include_bytes!("table.z")[..]).read_to_string(&mut text);
            read.map_or_else(|_| String::new(), |_| text)
        });
        let row = |line: &'static str| {
            let (code, fields) = line.split_once('|')?;
            Some((code.parse().ok()?, fields))
        };
        text.split("\n\n").map(|section| section.lines().filter_map(row).collect()).collect()
    })
}

fn rows(section: Section) -> &'static [(u32, &'static str)] {
    sections().get(section as usize).map_or(&[], Vec::as_slice)
}

/// The fields of a code.
fn fields(section: Section, code: u32) -> Option<std::str::Split<'static, char>> {
    let rows = rows(section);
    let at = rows.binary_search_by_key(&code, |row| row.0).ok()?;
    Some(rows[at].1.split('|'))
}

/// A code that is omitted if it is the usual one.
fn or(field: &str, usual: u32) -> Option<u32> {
    if field.is_empty() { Some(usual) } else { field.parse().ok() }
}

/// An ellipsoid by its code.
pub fn ellipsoid(code: u32) -> Option<NamedEllipsoid> {
    let mut fields = fields(Section::Ellipsoids, code)?;
    let name = fields.next()?;
    let shape =
        Ellipsoid { a: fields.next()?.parse().ok()?, inverse_flattening: fields.next()?.parse().ok()? };
    Some(NamedEllipsoid { name, shape })
}

/// Name and longitude of a prime meridian.
pub fn meridian(code: u32) -> Option<(&'static str, f64)> {
    let mut fields = fields(Section::Meridians, code)?;
    Some((fields.next()?, fields.next()?.parse().ok()?))
}

/// A geodetic datum by its code.
pub fn datum(code: u32) -> Option<Datum> {
    let mut fields = fields(Section::Datums, code)?;
    Some(Datum {
        name: fields.next()?,
        ellipsoid: ellipsoid(fields.next()?.parse().ok()?)?,
        meridian: meridian(or(fields.next()?, 8901)?)?,
        within: fields.next()?.parse().ok(),
        alias: fields.next()?,
    })
}

/// Codes of all datums.
pub fn datum_codes() -> impl Iterator<Item = u32> {
    rows(Section::Datums).iter().map(|row| row.0)
}

/// A geographic system by its code.
pub fn geographic(code: u32) -> Option<Geographic> {
    let mut fields = fields(Section::Geographic, code)?;
    Some(Geographic {
        name: fields.next()?,
        datum: datum(fields.next()?.parse().ok()?)?,
        unit: or(fields.next()?, DEGREE)?,
        has_height: fields.next()? == "3",
    })
}

/// A projection by its code.
pub fn conversion(code: u32) -> Option<Conversion> {
    let mut fields = fields(Section::Conversions, code)?;
    let (name, method) = (fields.next()?, fields.next()?.parse().ok()?);
    let keys = self::fields(Section::Methods, method)?;
    let parameters = keys.zip(fields).map(|(key, value)| Some((key.parse().ok()?, value.parse().ok()?)));
    Some(Conversion { name, method, parameters: parameters.collect::<Option<_>>()? })
}

/// A projected system by its code.
pub fn projected(code: u32) -> Option<Projected> {
    let mut fields = fields(Section::Projected, code)?;
    let (base, conversion) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
    let mut system = self::fields(Section::Systems, or(fields.next()?, 4400)?)?;
    let unit = system.next()?.parse().ok()?;
    let axes = [(system.next()?, system.next()?), (system.next()?, system.next()?)];
    let before = || self::fields(Section::Geographic, base)?.next();
    let name = match fields.next()? {
        "" => format!("{} / {}", before()?, self::fields(Section::Conversions, conversion)?.next()?),
        own => match own.strip_prefix('/') {
            Some(tail) => format!("{} / {tail}", before()?),
            None => own.to_owned(),
        },
    };
    Some(Projected { name, base, conversion, axes, unit })
}

/// Codes of the horizontal and of the vertical part of a compound system.
pub fn compound(code: u32) -> Option<(u32, u32)> {
    let mut fields = fields(Section::Compound, code)?;
    Some((fields.next()?.parse().ok()?, fields.next()?.parse().ok()?))
}

/// Codes of all projected systems.
#[cfg(test)]
pub fn projected_codes() -> impl Iterator<Item = u32> {
    rows(Section::Projected).iter().map(|row| row.0)
}

/// Codes of all geographic systems.
#[cfg(test)]
pub fn geographic_codes() -> impl Iterator<Item = u32> {
    rows(Section::Geographic).iter().map(|row| row.0)
}

/// A vertical system by its code.
pub fn vertical(code: u32) -> Option<Vertical> {
    let mut fields = fields(Section::Vertical, code)?;
    let name = fields.next()?;
    Some(Vertical {
        name,
        datum: fields.next().map(|datum| if datum.is_empty() { name } else { datum })?,
        unit: or(fields.next()?, METRE)?,
        down: fields.next()? == "down",
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_can_be_read() {
        let counts: Vec<usize> = sections().iter().map(Vec::len).collect();
        assert_eq!(counts, [55, 14, 608, 859, 258, 73, 48, 2495, 5500, 390]);
        for section in sections() {
            assert!(section.is_sorted_by(|a, b| a.0 < b.0));
        }
        let codes = |section| rows(section).iter().map(|row: &(u32, _)| row.0);
        assert!(codes(Section::Datums).all(|code| datum(code).is_some()));
        assert!(codes(Section::Geographic).all(|code| geographic(code).is_some()));
        assert!(codes(Section::Vertical).all(|code| vertical(code).is_some()));
        assert!(codes(Section::Conversions).all(|code| conversion(code).is_some()));
        for code in projected_codes() {
            let found = projected(code).expect("row");
            assert!(geographic(found.base).is_some() && conversion(found.conversion).is_some());
        }
    }

    #[test]
    fn names_are_put_together() {
        let name = |code| projected(code).expect("row").name;
        assert_eq!(name(32613), "WGS 84 / UTM zone 13N");
        assert_eq!(name(27700), "OSGB36 / British National Grid");
        assert_eq!(name(2263), "NAD83 / New York Long Island (ftUS)");
    }
}
