//! OGC WKT 2 of the coordinate systems that most DEMs use; for all others the EPSG code and the keys must do.
//!
//! Ensembles are written as plain datums, which every reader takes for the same.

use crate::geo::CrsKind;

struct Base {
    code: u32,
    name: &'static str,
    datum: &'static str,
    ellipsoid: &'static str,
    axes: u8,
}

const WGS84: &str = "\"WGS 84\",6378137,298.257223563";
const GRS80: &str = "\"GRS 1980\",6378137,298.257222101";
const DEGREE: &str = "ANGLEUNIT[\"degree\",0.0174532925199433]";
const METRE: &str = "LENGTHUNIT[\"metre\",1]";

const BASES: [Base; 4] = [
    Base { code: 4326, name: "WGS 84", datum: "World Geodetic System 1984", ellipsoid: WGS84, axes: 2 },
    Base { code: 4979, name: "WGS 84", datum: "World Geodetic System 1984", ellipsoid: WGS84, axes: 3 },
    Base { code: 4269, name: "NAD83", datum: "North American Datum 1983", ellipsoid: GRS80, axes: 2 },
    Base {
        code: 4258,
        name: "ETRS89",
        datum: "European Terrestrial Reference System 1989",
        ellipsoid: GRS80,
        axes: 2,
    },
];

/// Name and WKT of an EPSG code, if it is one of those written here.
pub(crate) fn of_epsg(kind: CrsKind, code: u32) -> Option<(String, String)> {
    let base = |wanted| BASES.iter().find(|base| base.code == wanted);
    match (kind, code) {
        (CrsKind::Geographic, code) => base(code).map(|base| (base.name.to_owned(), geographic(base))),
        (CrsKind::Projected, 3857) => base(4326).map(|base| {
            let name = "WGS 84 / Pseudo-Mercator";
            (name.to_owned(), projected(name, base, &pseudo_mercator(), "(X)", "(Y)", 3857))
        }),
        (CrsKind::Projected, code) => {
            let (zone, south, datum) = utm_zone(code)?;
            let base = base(datum)?;
            let zone_name = format!("UTM zone {zone}{}", if south { 'S' } else { 'N' });
            let name = format!("{} / {zone_name}", base.name);
            let wkt = projected(&name, base, &utm(&zone_name, zone, south), "(E)", "(N)", code);
            Some((name, wkt))
        }
        (CrsKind::Engineering, _) => None,
    }
}

/// WKT of a grid that stands nowhere in particular.
pub(crate) fn engineering(metres: f64) -> String {
    let unit = if metres == 1.0 { METRE.to_owned() } else { format!("LENGTHUNIT[\"unknown\",{metres}]") };
    format!(
        "ENGCRS[\"Unknown engineering CRS\",EDATUM[\"Unknown engineering datum\"],CS[Cartesian,2],\
         AXIS[\"(E)\",east,ORDER[1],{unit}],AXIS[\"(N)\",north,ORDER[2],{unit}]]"
    )
}

/// UTM zone, southern hemisphere, geographic base.
fn utm_zone(code: u32) -> Option<(u32, bool, u32)> {
    match code {
        32601..=32660 => Some((code - 32600, false, 4326)),
        32701..=32760 => Some((code - 32700, true, 4326)),
        26901..=26923 => Some((code - 26900, false, 4269)),
        25828..=25838 => Some((code - 25800, false, 4258)),
        _ => None,
    }
}

fn datum(base: &Base) -> String {
    format!(
        "DATUM[\"{}\",ELLIPSOID[{},{METRE}]],PRIMEM[\"Greenwich\",0,{DEGREE}]",
        base.datum, base.ellipsoid
    )
}

fn geographic(base: &Base) -> String {
    let height = if base.axes == 3 {
        format!(",AXIS[\"ellipsoidal height (h)\",up,ORDER[3],{METRE}]")
    } else {
        String::new()
    };
    format!(
        "GEOGCRS[\"{}\",{},CS[ellipsoidal,{}],AXIS[\"geodetic latitude (Lat)\",north,ORDER[1],{DEGREE}],\
         AXIS[\"geodetic longitude (Lon)\",east,ORDER[2],{DEGREE}]{height},ID[\"EPSG\",{}]]",
        base.name,
        datum(base),
        base.axes,
        base.code
    )
}

fn projected(name: &str, base: &Base, conversion: &str, x: &str, y: &str, code: u32) -> String {
    format!(
        "PROJCRS[\"{name}\",BASEGEOGCRS[\"{}\",{},ID[\"EPSG\",{}]],{conversion},CS[Cartesian,2],\
         AXIS[\"{x}\",east,ORDER[1],{METRE}],AXIS[\"{y}\",north,ORDER[2],{METRE}],ID[\"EPSG\",{code}]]",
        base.name,
        datum(base),
        base.code
    )
}

fn parameter(name: &str, value: f64, unit: &str, code: u32) -> String {
    format!(",PARAMETER[\"{name}\",{value},{unit},ID[\"EPSG\",{code}]]")
}

fn utm(name: &str, zone: u32, south: bool) -> String {
    let meridian = f64::from(zone) * 6.0 - 183.0;
    [
        format!("CONVERSION[\"{name}\",METHOD[\"Transverse Mercator\",ID[\"EPSG\",9807]]"),
        parameter("Latitude of natural origin", 0.0, DEGREE, 8801),
        parameter("Longitude of natural origin", meridian, DEGREE, 8802),
        parameter("Scale factor at natural origin", 0.9996, "SCALEUNIT[\"unity\",1]", 8805),
        parameter("False easting", 500_000.0, METRE, 8806),
        parameter("False northing", if south { 10_000_000.0 } else { 0.0 }, METRE, 8807),
        "]".to_owned(),
    ]
    .concat()
}

fn pseudo_mercator() -> String {
    [
        "CONVERSION[\"Popular Visualisation Pseudo-Mercator\",\
         METHOD[\"Popular Visualisation Pseudo Mercator\",ID[\"EPSG\",1024]]"
            .to_owned(),
        parameter("Latitude of natural origin", 0.0, DEGREE, 8801),
        parameter("Longitude of natural origin", 0.0, DEGREE, 8802),
        parameter("False easting", 0.0, METRE, 8806),
        parameter("False northing", 0.0, METRE, 8807),
        "]".to_owned(),
    ]
    .concat()
}
