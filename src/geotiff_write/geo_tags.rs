//! Tags about the raster that GDAL reads: georeference, nodata, scale and unit.

use super::{GeotiffSpec, Tag, Value, tags};
use crate::crs::Definition;
use crate::crs::geokeys;
use crate::geo::{Crs, CrsKind, Geo, GeoKeys};

/// Radians of a degree.
const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// Value of a key that other keys define, for want of a code.
const USER_DEFINED: u16 = 32767;
/// The key `GTRasterTypeGeoKey`.
const RASTER_TYPE: u16 = 1025;

/// All tags of this module that a spec needs.
pub(super) fn tags(spec: &GeotiffSpec) -> Vec<Tag> {
    let keys = spec.geo.crs.keys.clone().filter(|keys| !keys.directory.is_empty());
    let keys = keys.or_else(|| keys_of(spec.geo));
    let is_point = keys.as_ref().is_some_and(geokeys::is_point);
    let mut tags = spec.geo.transform.map_or_else(Vec::new, |transform| place(transform, is_point));
    if let Some(keys) = keys {
        tags.push(Tag::new(tags::GEO_KEY_DIRECTORY, Value::Shorts(keys.directory)));
        if !keys.doubles.is_empty() {
            tags.push(Tag::new(tags::GEO_DOUBLE_PARAMS, Value::Doubles(keys.doubles)));
        }
        if !keys.ascii.is_empty() {
            let ascii = keys.ascii.trim_end_matches('\0').to_owned();
            tags.push(Tag::new(tags::GEO_ASCII_PARAMS, Value::Ascii(ascii)));
        }
    }
    if let Some(xml) = metadata(spec) {
        tags.push(Tag::new(tags::GDAL_METADATA, Value::Ascii(xml)));
    }
    if let Some(nodata) = spec.nodata {
        tags.push(Tag::new(tags::GDAL_NODATA, Value::Ascii(gdal_number(nodata))));
    }
    tags
}

/// Tags for a geotransform: pixel scale and tie point if the raster is north-up, else a matrix.
fn place([x0, a, b, y0, d, e]: [f64; 6], is_point: bool) -> Vec<Tag> {
    let (x, y) =
        if is_point { (shifted(x0, a * 0.5 + b * 0.5), shifted(y0, d * 0.5 + e * 0.5)) } else { (x0, y0) };
    if b == 0.0 && d == 0.0 && a > 0.0 && e < 0.0 {
        return vec![
            Tag::new(tags::MODEL_PIXEL_SCALE, Value::Doubles(vec![a, -e, 0.0])),
            Tag::new(tags::MODEL_TIEPOINT, Value::Doubles(vec![0.0, 0.0, 0.0, x, y, 0.0])),
        ];
    }
    let matrix = vec![a, b, 0.0, x, d, e, 0.0, y, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    vec![Tag::new(tags::MODEL_TRANSFORMATION, Value::Doubles(matrix))]
}

/// The number from which a reader that subtracts `half` gets `corner` exactly, if there is one.
fn shifted(corner: f64, half: f64) -> f64 {
    let sum = corner + half;
    let exact = [sum, sum.next_up(), sum.next_down()].into_iter().find(|&x| x - half == corner);
    exact.unwrap_or(sum)
}

/// GeoKeys made from the fields of a CRS; `None` if nothing is known of it.
fn keys_of(geo: &Geo) -> Option<GeoKeys> {
    let crs = &geo.crs;
    let mut keys = KeyBuilder::default();
    let code = crs.epsg.and_then(|code| u16::try_from(code).ok());
    let model = match crs.kind {
        // GDAL reads a CRS from text only if the model type is user-defined.
        CrsKind::Projected if code.is_none() && !crs.wkt.is_empty() => Some(USER_DEFINED),
        CrsKind::Projected => Some(1),
        CrsKind::Geographic => Some(2),
        CrsKind::Engineering if !crs.name.is_empty() => Some(USER_DEFINED),
        CrsKind::Engineering => None,
    };
    if let Some(model) = model {
        keys.short(1024, model);
    }
    if model.is_some() || geo.pixel_is_point {
        keys.short(RASTER_TYPE, if geo.pixel_is_point { 2 } else { 1 });
    }
    match (crs.kind, code) {
        (CrsKind::Geographic, Some(code)) => keys.short(2048, code),
        (CrsKind::Geographic, None) => keys.geographic(crs),
        (CrsKind::Projected, Some(code)) => keys.short(3072, code),
        (CrsKind::Projected, None) => keys.projected(crs),
        (CrsKind::Engineering, _) => keys.text(1026, &crs.name),
    }
    if let Some(vertical) = crs.vertical_epsg.and_then(|code| u16::try_from(code).ok()) {
        keys.short(4096, vertical);
    }
    keys.finish()
}

/// Collects GeoKeys, in ascending order.
#[derive(Default)]
struct KeyBuilder {
    entries: Vec<[u16; 4]>,
    doubles: Vec<f64>,
    ascii: String,
}

impl KeyBuilder {
    fn short(&mut self, key: u16, value: u16) {
        self.entries.push([key, 0, 1, value]);
    }

    fn double(&mut self, key: u16, value: f64) {
        self.entries.push([key, tags::GEO_DOUBLE_PARAMS, 1, self.doubles.len() as u16]);
        self.doubles.push(value);
    }

    /// Adds a text, closed by the `|` that stands for a NUL; leaves it out if it is empty or too
    /// long for a key.
    fn text(&mut self, key: u16, text: &str) {
        if text.is_empty() {
            return;
        }
        self.plain_text(key, &(text.replace('|', "_") + "|"));
    }

    /// Adds a text unchanged.
    fn plain_text(&mut self, key: u16, text: &str) {
        if let (Ok(length), Ok(start)) = (u16::try_from(text.len()), u16::try_from(self.ascii.len())) {
            self.entries.push([key, tags::GEO_ASCII_PARAMS, length, start]);
            self.ascii += text;
        }
    }

    /// Adds a geographic CRS without a code: its datum if it is known, or only its ellipsoid.
    fn geographic(&mut self, crs: &Crs) {
        let definition = Definition::of(crs);
        let base = definition.as_ref().and_then(|definition| definition.base.as_ref());
        let datum = definition.as_ref().and_then(Definition::datum_code);
        self.short(2048, USER_DEFINED);
        if let Some(base) = base.filter(|_| datum.is_none()) {
            let parts = [
                ("GCS Name", &crs.name),
                ("Datum", &base.datum),
                ("Ellipsoid", &base.ellipsoid_name),
                ("Primem", &base.meridian.0),
            ];
            let parts: Vec<String> =
                parts.map(|(what, name)| format!("{what} = {}", name.replace('|', "_"))).to_vec();
            self.plain_text(2049, &(parts.join("|") + "|"));
        } else {
            self.text(2049, &crs.name);
        }
        self.short(2050, datum.and_then(|code| u16::try_from(code).ok()).unwrap_or(USER_DEFINED));
        self.angular_unit(crs.unit);
        if datum.is_none() {
            self.short(2056, USER_DEFINED);
            self.double(2057, crs.ellipsoid.a);
            self.double(2059, crs.ellipsoid.inverse_flattening);
        }
        if let Some(base) = base.filter(|base| base.meridian.1 != 0.0 && datum.is_none()) {
            self.double(2061, base.meridian.1 * DEGREE / crs.unit);
        }
    }

    fn angular_unit(&mut self, radians: f64) {
        if (radians.to_degrees() - 1.0).abs() < 1e-9 {
            self.short(2054, 9102);
        } else if (radians.to_degrees() - 0.9).abs() < 1e-9 {
            self.short(2054, 9105);
        } else if radians == 1.0 {
            self.short(2054, 9101);
        } else {
            self.short(2054, USER_DEFINED);
            self.double(2055, radians);
        }
    }

    /// Adds a projected CRS without a code: its WKT, which GDAL reads, and its unit. Proper GeoKeys
    /// would need the parameters of the projection.
    fn projected(&mut self, crs: &Crs) {
        self.short(3072, USER_DEFINED);
        if !crs.wkt.is_empty() {
            self.text(3073, &format!("ESRI PE String = {}", crs.wkt));
        }
        self.short(3074, USER_DEFINED);
        if crs.unit == 1.0 {
            self.short(3076, 9001);
        } else {
            self.short(3076, USER_DEFINED);
            self.double(3077, crs.unit);
        }
    }

    fn finish(self) -> Option<GeoKeys> {
        if self.entries.is_empty() {
            return None;
        }
        // GeoTIFF 1.1 if a vertical CRS needs it, else 1.0, which every reader accepts.
        let minor = u16::from(self.entries.iter().any(|entry| entry[0] == 4096));
        let mut directory = vec![1, 1, minor, self.entries.len() as u16];
        directory.extend(self.entries.iter().flatten());
        Some(GeoKeys { directory, doubles: self.doubles, ascii: self.ascii })
    }
}

/// GDAL's XML for scale, offset and unit; `None` if these are the defaults.
fn metadata(spec: &GeotiffSpec) -> Option<String> {
    let mut items = Vec::new();
    if spec.band_offset != 0.0 {
        items.push(("OFFSET", "offset", gdal_number(spec.band_offset)));
    }
    if spec.band_scale != 1.0 {
        items.push(("SCALE", "scale", gdal_number(spec.band_scale)));
    }
    if !spec.unit.is_empty() {
        // Escaped twice: GDAL decodes the text of an item once more after parsing the XML.
        items.push(("UNITTYPE", "unittype", xml_escaped(&xml_escaped(spec.unit))));
    }
    if items.is_empty() {
        return None;
    }
    let lines = items.into_iter().map(|(name, role, value)| {
        format!("  <Item name=\"{name}\" sample=\"0\" role=\"{role}\">{value}</Item>\n")
    });
    Some(format!("<GDALMetadata>\n{}</GDALMetadata>\n", lines.collect::<String>()))
}

fn xml_escaped(text: &str) -> String {
    text.replace('\0', "").replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// A number as GDAL writes it, by C's `%.17g`: `-32768`, `0.10000000000000001`,
/// `-3.4028234663852886e+38`, `nan`.
pub(super) fn gdal_number(value: f64) -> String {
    if value.is_nan() {
        return "nan".to_owned();
    }
    if value.is_infinite() {
        return if value > 0.0 { "inf" } else { "-inf" }.to_owned();
    }
    let scientific = format!("{value:.16e}");
    let (digits, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if (-4..17).contains(&exponent) {
        return trim_zeros(&format!("{value:.*}", (16 - exponent) as usize)).to_owned();
    }
    let sign = if exponent < 0 { '-' } else { '+' };
    format!("{}e{sign}{:02}", trim_zeros(digits), exponent.unsigned_abs())
}

/// A number without trailing zeros of the fraction, and without a trailing point.
fn trim_zeros(number: &str) -> &str {
    if number.contains('.') { number.trim_end_matches('0').trim_end_matches('.') } else { number }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_as_c_writes_them() {
        for (value, text) in [
            (-32768.0, "-32768"),
            (0.0, "0"),
            (0.1, "0.10000000000000001"),
            (-9999.5, "-9999.5"),
            (f64::from(-f32::MAX), "-3.4028234663852886e+38"),
            (1e17, "1e+17"),
            (123_456_789_012_345_680.0, "1.2345678901234568e+17"),
            (65535.0, "65535"),
            (1e-5, "1.0000000000000001e-05"),
            (1e-4, "0.0001"),
            (f64::NAN, "nan"),
            (f64::NEG_INFINITY, "-inf"),
        ] {
            assert_eq!(gdal_number(value), text);
        }
    }

    #[test]
    fn a_point_tie_is_undone_exactly_where_floats_allow() {
        for (corner, half) in
            [(-123.000_416_666_666_7, 0.000_416_666_666_666_666_7), (500_000.1, 15.05), (0.3, -0.1)]
        {
            assert_eq!(shifted(corner, half) - half, corner);
        }
    }
}
