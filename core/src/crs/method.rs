//! Map projections: names and parameters in OGC WKT of both versions, at ESRI, in the EPSG dataset
//! and in PROJ.
//!
//! A parameter has one key here, that of PROJ (`lat_0`, `lon_0`, `k_0`, ..), in all methods and
//! notations. Angles are in degrees, lengths in metres.

use std::borrow::Cow;

use super::plain;

/// A method of projection.
#[derive(Debug)]
pub struct Method {
    /// Its EPSG code; 0 if it has none.
    pub code: u32,
    /// Its name in WKT 2.
    pub name: &'static str,
    /// Its name for `+proj=`; empty if PROJ needs more than this and the parameters.
    pub proj: &'static str,
    /// Keys and EPSG codes of its parameters.
    pub parameters: &'static [(&'static str, u32)],
    /// Other names, of letters and digits only.
    other: &'static [&'static str],
}

impl PartialEq for Method {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

const ORIGIN: &[(&str, u32)] = &[("lat_0", 8801), ("lon_0", 8802), ("x_0", 8806), ("y_0", 8807)];
const SCALED: &[(&str, u32)] =
    &[("lat_0", 8801), ("lon_0", 8802), ("k_0", 8805), ("x_0", 8806), ("y_0", 8807)];
const CONIC: &[(&str, u32)] =
    &[("lat_0", 8821), ("lon_0", 8822), ("lat_1", 8823), ("lat_2", 8824), ("x_0", 8826), ("y_0", 8827)];
const MICHIGAN: &[(&str, u32)] = &[
    ("lat_0", 8821),
    ("lon_0", 8822),
    ("lat_1", 8823),
    ("lat_2", 8824),
    ("x_0", 8826),
    ("y_0", 8827),
    ("k_0", 1038),
];
const PARALLEL: &[(&str, u32)] = &[("lat_1", 8823), ("lon_0", 8802), ("x_0", 8806), ("y_0", 8807)];
const MERIDIAN: &[(&str, u32)] = &[("lon_0", 8802), ("x_0", 8806), ("y_0", 8807)];
const POLAR: &[(&str, u32)] = &[("lat_1", 8832), ("lon_0", 8833), ("x_0", 8806), ("y_0", 8807)];
const POLAR_C: &[(&str, u32)] = &[("lat_1", 8832), ("lon_0", 8833), ("x_0", 8826), ("y_0", 8827)];
const OBLIQUE_A: &[(&str, u32)] = &[
    ("lat_0", 8811),
    ("lon_0", 8812),
    ("alpha", 8813),
    ("gamma", 8814),
    ("k_0", 8815),
    ("x_0", 8806),
    ("y_0", 8807),
];
const OBLIQUE_B: &[(&str, u32)] = &[
    ("lat_0", 8811),
    ("lon_0", 8812),
    ("alpha", 8813),
    ("gamma", 8814),
    ("k_0", 8815),
    ("x_0", 8816),
    ("y_0", 8817),
];
const LABORDE: &[(&str, u32)] =
    &[("lat_0", 8811), ("lon_0", 8812), ("alpha", 8813), ("k_0", 8815), ("x_0", 8806), ("y_0", 8807)];
const KROVAK: &[(&str, u32)] = &[
    ("lat_0", 8811),
    ("lon_0", 8833),
    ("alpha", 1036),
    ("lat_1", 8818),
    ("k_0", 8819),
    ("x_0", 8806),
    ("y_0", 8807),
];
const FALSE_ORIGIN: &[(&str, u32)] = &[("lat_0", 8821), ("lon_0", 8822), ("x_0", 8826), ("y_0", 8827)];
const COLOMBIA: &[(&str, u32)] =
    &[("lat_0", 8801), ("lon_0", 8802), ("x_0", 8806), ("y_0", 8807), ("h_0", 1039)];
const ZONED: &[(&str, u32)] =
    &[("lat_0", 8801), ("lon_0", 8830), ("zone", 8831), ("k_0", 8805), ("x_0", 8806), ("y_0", 8807)];
/// The parameters of a method that EPSG does not have: two parallels and an origin.
const EQUIDISTANT_CONIC: &[(&str, u32)] =
    &[("lat_0", 8801), ("lon_0", 8802), ("lat_1", 8823), ("lat_2", 8824), ("x_0", 8806), ("y_0", 8807)];
const SATELLITE: &[(&str, u32)] = &[("lon_0", 8802), ("h", 0), ("x_0", 8806), ("y_0", 8807)];
const EQUIRECTANGULAR: &[(&str, u32)] =
    &[("lat_1", 8823), ("lat_0", 8801), ("lon_0", 8802), ("x_0", 8806), ("y_0", 8807)];

const fn method(
    code: u32,
    name: &'static str,
    proj: &'static str,
    parameters: &'static [(&'static str, u32)],
    other: &'static [&'static str],
) -> Method {
    Method { code, name, proj, parameters, other }
}

/// The known methods; those with EPSG codes below 9800 are newer.
#[rustfmt::skip]
static METHODS: &[Method] = &[
    method(9807, "Transverse Mercator", "tmerc", SCALED, &["gausskruger", "transversemercatorcomplex"]),
    method(9808, "Transverse Mercator (South Orientated)", "", SCALED, &[]),
    method(9801, "Lambert Conic Conformal (1SP)", "lcc", SCALED, &["lambertconformalconic1sp"]),
    method(9802, "Lambert Conic Conformal (2SP)", "lcc", CONIC, &["lambertconformalconic2sp", "lambertconformalconic"]),
    method(9803, "Lambert Conic Conformal (2SP Belgium)", "", CONIC, &["lambertconformalconic2spbelgium"]),
    method(1051, "Lambert Conic Conformal (2SP Michigan)", "", MICHIGAN, &[]),
    method(9826, "Lambert Conic Conformal (West Orientated)", "", SCALED, &[]),
    method(9817, "Lambert Conic Near-Conformal", "", SCALED, &[]),
    method(9822, "Albers Equal Area", "aea", CONIC, &["albersconicequalarea", "albers"]),
    method(9820, "Lambert Azimuthal Equal Area", "laea", ORIGIN, &[]),
    method(1027, "Lambert Azimuthal Equal Area (Spherical)", "", ORIGIN, &[]),
    method(9810, "Polar Stereographic (variant A)", "stere", SCALED, &["polarstereographic"]),
    method(9829, "Polar Stereographic (variant B)", "stere", POLAR, &["stereographicnorthpole", "stereographicsouthpole"]),
    method(9830, "Polar Stereographic (variant C)", "", POLAR_C, &[]),
    method(9809, "Oblique Stereographic", "sterea", SCALED, &["doublestereographic"]),
    method(0, "Stereographic", "stere", SCALED, &[]),
    method(9804, "Mercator (variant A)", "merc", SCALED, &["mercator1sp"]),
    method(9805, "Mercator (variant B)", "merc", PARALLEL, &["mercator2sp", "mercator"]),
    method(9841, "Mercator (1SP) (Spherical)", "", SCALED, &[]),
    method(1024, "Popular Visualisation Pseudo Mercator", "webmerc", ORIGIN, &["mercatorauxiliarysphere"]),
    method(9812, "Hotine Oblique Mercator (variant A)", "omerc", OBLIQUE_A,
           &["hotineobliquemercator", "hotineobliquemercatorazimuthnaturalorigin", "rectifiedskeworthomorphicnaturalorigin"]),
    method(9815, "Hotine Oblique Mercator (variant B)", "omerc", OBLIQUE_B,
           &["hotineobliquemercatorazimuthcenter", "rectifiedskeworthomorphiccenter", "obliquemercator"]),
    method(9813, "Laborde Oblique Mercator", "", LABORDE, &["labordeobliquemercator"]),
    method(9806, "Cassini-Soldner", "cass", ORIGIN, &["cassini"]),
    method(9833, "Hyperbolic Cassini-Soldner", "", ORIGIN, &[]),
    method(9818, "American Polyconic", "poly", ORIGIN, &["polyconic"]),
    method(9819, "Krovak", "", KROVAK, &[]),
    method(1041, "Krovak (North Orientated)", "", KROVAK, &[]),
    method(1042, "Krovak Modified", "", KROVAK, &[]),
    method(1043, "Krovak Modified (North Orientated)", "", KROVAK, &[]),
    method(9811, "New Zealand Map Grid", "", ORIGIN, &[]),
    method(1052, "Colombia Urban", "", COLOMBIA, &[]),
    method(1078, "Equal Earth", "eqearth", MERIDIAN, &[]),
    method(1111, "Transverse Mercator 3D", "tmerc", SCALED, &[]),
    method(9824, "Transverse Mercator Zoned Grid System", "", ZONED, &[]),
    method(9816, "Tunisia Mining Grid", "", FALSE_ORIGIN, &["tunisiamininggrid"]),
    method(9831, "Guam Projection", "", ORIGIN, &[]),
    method(9832, "Modified Azimuthal Equidistant", "", ORIGIN, &["azimuthalequidistant"]),
    method(9827, "Bonne", "bonne", ORIGIN, &[]),
    method(9828, "Bonne (South Orientated)", "", ORIGIN, &[]),
    method(9835, "Lambert Cylindrical Equal Area", "cea", PARALLEL, &["cylindricalequalarea", "behrmann"]),
    method(9834, "Lambert Cylindrical Equal Area (Spherical)", "", PARALLEL, &[]),
    method(1028, "Equidistant Cylindrical", "eqc", EQUIRECTANGULAR, &["equirectangular", "platecarree"]),
    method(1029, "Equidistant Cylindrical (Spherical)", "", EQUIRECTANGULAR, &[]),
    method(9840, "Orthographic", "ortho", ORIGIN, &[]),
    method(0, "Equidistant Conic", "eqdc", EQUIDISTANT_CONIC, &[]),
    method(0, "Gnomonic", "gnom", ORIGIN, &[]),
    method(0, "Miller Cylindrical", "mill", MERIDIAN, &[]),
    method(0, "Robinson", "robin", MERIDIAN, &[]),
    method(0, "Sinusoidal", "sinu", MERIDIAN, &[]),
    method(0, "Mollweide", "moll", MERIDIAN, &[]),
    method(0, "Eckert I", "eck1", MERIDIAN, &[]),
    method(0, "Eckert II", "eck2", MERIDIAN, &[]),
    method(0, "Eckert III", "eck3", MERIDIAN, &[]),
    method(0, "Eckert IV", "eck4", MERIDIAN, &[]),
    method(0, "Eckert V", "eck5", MERIDIAN, &[]),
    method(0, "Eckert VI", "eck6", MERIDIAN, &[]),
    method(0, "Van Der Grinten", "vandg", MERIDIAN, &["vandergrinteni"]),
    method(0, "Gall Stereographic", "gall", MERIDIAN, &[]),
    method(0, "Goode Homolosine", "goode", MERIDIAN, &[]),
    method(0, "Interrupted Goode Homolosine", "igh", MERIDIAN, &[]),
    method(0, "Geostationary Satellite (Sweep Y)", "geos", SATELLITE, &["geostationarysatellite"]),
    method(0, "Geostationary Satellite (Sweep X)", "", SATELLITE, &[]),
];

/// A method by its EPSG code; spherical and older variants count as the method.
pub fn by_code(code: u32) -> Option<&'static Method> {
    let code = match code {
        9842 => 1028,
        9823 => 1029,
        other => other,
    };
    METHODS.iter().find(|method| method.code == code && code != 0)
}

/// A method by its name in any notation.
pub fn by_name(name: &str) -> Option<&'static Method> {
    let name = plain(name);
    METHODS.iter().find(|method| plain(method.name) == name || method.other.contains(&name.as_str()))
}

/// A method by PROJ's name; the first, if several have the name.
pub fn by_proj(name: &str) -> Option<&'static Method> {
    METHODS.iter().find(|method| method.proj == name && !name.is_empty())
}

/// Name of a parameter in WKT 2, and whether its value is an angle, a length or a plain number.
pub(super) fn parameter(code: u32) -> (&'static str, Quantity) {
    use Quantity::{Angle, Length, Ratio};
    match code {
        8801 => ("Latitude of natural origin", Angle),
        8802 => ("Longitude of natural origin", Angle),
        8805 => ("Scale factor at natural origin", Ratio),
        8806 => ("False easting", Length),
        8807 => ("False northing", Length),
        8811 => ("Latitude of projection centre", Angle),
        8812 => ("Longitude of projection centre", Angle),
        8813 => ("Azimuth of initial line", Angle),
        8814 => ("Angle from Rectified to Skew Grid", Angle),
        8815 => ("Scale factor on initial line", Ratio),
        8816 => ("Easting at projection centre", Length),
        8817 => ("Northing at projection centre", Length),
        8818 => ("Latitude of pseudo standard parallel", Angle),
        8819 => ("Scale factor on pseudo standard parallel", Ratio),
        8821 => ("Latitude of false origin", Angle),
        8822 => ("Longitude of false origin", Angle),
        8823 => ("Latitude of 1st standard parallel", Angle),
        8824 => ("Latitude of 2nd standard parallel", Angle),
        8826 => ("Easting at false origin", Length),
        8827 => ("Northing at false origin", Length),
        8830 => ("Initial longitude", Angle),
        8831 => ("Zone width", Angle),
        8832 => ("Latitude of standard parallel", Angle),
        8833 => ("Longitude of origin", Angle),
        1036 => ("Co-latitude of cone axis", Angle),
        1038 => ("Ellipsoid scaling factor", Ratio),
        1039 => ("Projection plane origin height", Length),
        _ => ("Satellite Height", Length),
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Quantity {
    Angle,
    Length,
    Ratio,
}

/// The key of a parameter in any notation; of an unknown parameter its letters and digits.
pub(super) fn key(name: &str) -> Cow<'static, str> {
    let name = plain(name);
    Cow::Borrowed(match name.as_str() {
        "latitudeoforigin"
        | "latitudeofcenter"
        | "latitudeofcentre"
        | "latitudeofnaturalorigin"
        | "centralparallel"
        | "latitudeoffalseorigin"
        | "latitudeofprojectioncentre"
        | "latitudeofprojectioncenter" => "lat_0",
        "centralmeridian"
        | "longitudeoforigin"
        | "longitudeofcenter"
        | "longitudeofcentre"
        | "longitudeofnaturalorigin"
        | "longitudeoffalseorigin"
        | "longitudeofprojectioncentre"
        | "longitudeofprojectioncenter"
        | "initiallongitude" => "lon_0",
        "standardparallel1"
        | "latitudeof1ststandardparallel"
        | "latitudeofstandardparallel"
        | "latitudeofpseudostandardparallel"
        | "pseudostandardparallel1" => "lat_1",
        "standardparallel2" | "latitudeof2ndstandardparallel" => "lat_2",
        "scalefactor"
        | "scalefactoratnaturalorigin"
        | "scalefactoroninitialline"
        | "ellipsoidscalingfactor"
        | "scalefactoronpseudostandardparallel"
        | "scalefactoratprojectioncentre" => "k_0",
        "falseeasting" | "eastingatfalseorigin" | "eastingatprojectioncentre" => "x_0",
        "falsenorthing" | "northingatfalseorigin" | "northingatprojectioncentre" => "y_0",
        "azimuth" | "azimuthofinitialline" | "azimuthatprojectioncentre" | "colatitudeofconeaxis" => "alpha",
        "rectifiedgridangle" | "anglefromrectifiedtoskewgrid" | "xyplanerotation" => "gamma",
        "satelliteheight" | "height" => "h",
        "zonewidth" => "zone",
        "projectionplaneoriginheight" => "h_0",
        _ => return Cow::Owned(name),
    })
}

/// The quantity of a key's value.
pub(super) fn quantity(key: &str) -> Quantity {
    match key {
        "x_0" | "y_0" | "h" | "h_0" => Quantity::Length,
        "k_0" => Quantity::Ratio,
        "alpha" | "gamma" | "zone" => Quantity::Angle,
        key if key.starts_with("lat") || key.starts_with("lon") || key.contains("parallel") => {
            Quantity::Angle
        }
        _ => Quantity::Ratio,
    }
}

/// The default value of a parameter.
pub fn usual(key: &str) -> f64 {
    if key == "k_0" { 1.0 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_method_of_the_dataset_has_its_parameters() {
        for code in crate::crs::epsg::table::projected_codes() {
            let projected = crate::crs::epsg::table::projected(code).expect("row");
            let conversion = crate::crs::epsg::table::conversion(projected.conversion).expect("row");
            let Some(method) = by_code(conversion.method) else {
                panic!("EPSG:{code}: no method {}", conversion.method)
            };
            if method.code != conversion.method {
                continue;
            }
            let mut ours: Vec<u32> = method.parameters.iter().map(|p| p.1).collect();
            let mut theirs: Vec<u32> = conversion.parameters.iter().map(|p| p.0).collect();
            if method.name.starts_with("Equidistant Cylindrical") {
                ours.retain(|&code| code != 8801);
            }
            ours.sort_unstable();
            theirs.sort_unstable();
            assert_eq!(ours, theirs, "{}", method.name);
        }
    }

    #[test]
    fn names_of_parameters_lead_to_their_keys() {
        for method in METHODS {
            assert_eq!(by_name(method.name), Some(method));
            for &(wanted, code) in method.parameters {
                assert_eq!(key(parameter(code).0), wanted, "{} {code}", method.name);
                assert!(parameter(code).1 == quantity(wanted), "{wanted}");
            }
        }
    }
}
