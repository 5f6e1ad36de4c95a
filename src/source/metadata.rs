//! The texts that GDAL keeps beside samples: nodata, scale, offset, and the name of the vertical unit.

use super::unit;
use crate::sample::SampleType;

/// A number as GDAL reads it from text: the longest prefix that is one; `None` where there is none at all.
pub(crate) fn number(text: &str) -> Option<f64> {
    let text = text.trim_start().replace(',', ".");
    let signed = text.strip_prefix(['-', '+']).unwrap_or(&text);
    if signed.starts_with("1.#") {
        let infinite = signed.starts_with("1.#INF");
        let value = if infinite { f64::INFINITY } else { f64::NAN };
        return Some(if text.starts_with('-') { -value } else { value });
    }
    // No longer prefix is worth a try: GDAL writes 18 digits.
    let mut ends = (1..=text.len().min(64)).rev().filter(|&end| text.is_char_boundary(end));
    ends.find_map(|end| text[..end].trim_end().parse().ok())
}

/// The nodata value of GDAL's tag, rounded as the samples are: a float32 raster holds no other value.
pub(crate) fn nodata(text: &str, kind: SampleType) -> Option<f64> {
    number(text).map(|value| rounded(value, kind))
}

/// A nodata value as samples of this type would hold it.
pub(crate) fn rounded(value: f64, kind: SampleType) -> f64 {
    if kind == SampleType::Float32 { nearest_f32(value) } else { value }
}

/// A value as a float32 would hold it; one far outside stays as it is, so that no sample equals it. Texts of the
/// largest float are often rounded up in their last digit: rounding takes them back.
fn nearest_f32(value: f64) -> f64 {
    let nearest = f64::from(value as f32);
    if nearest.is_infinite() { value } else { nearest }
}

/// Scale, offset and unit of band 1 in GDAL's XML (tag 42112).
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Items {
    pub(crate) scale: Option<f64>,
    pub(crate) offset: Option<f64>,
    pub(crate) unit: Option<String>,
}

/// Reads `<Item name=".." sample="0" role="scale">0.1</Item>` and its kin; whatever else is there is passed over.
pub(crate) fn items(xml: &str) -> Items {
    let mut found = Items::default();
    for part in xml.split("<Item").skip(1) {
        let Some((attributes, rest)) = part.split_once('>') else { break };
        if attribute(attributes, "sample") != Some("0") {
            continue;
        }
        // GDAL escapes values twice.
        let text = unescape(&unescape(rest.split_once("</Item").map_or(rest, |(text, _)| text)));
        match attribute(attributes, "role") {
            Some("scale") => found.scale = number(&text),
            Some("offset") => found.offset = number(&text),
            Some("unittype") => found.unit = Some(text.trim().to_owned()),
            _ => {}
        }
    }
    found
}

fn attribute<'a>(attributes: &'a str, name: &str) -> Option<&'a str> {
    attributes.match_indices(name).find_map(|(at, _)| {
        let before = attributes[..at].chars().next_back();
        let value = attributes[at + name.len()..].trim_start().strip_prefix('=')?.trim_start();
        let quote = value.chars().next().filter(|quote| matches!(quote, '"' | '\''))?;
        let value = value[1..].split(quote).next()?;
        before.is_none_or(char::is_whitespace).then_some(value)
    })
}

fn unescape(text: &str) -> String {
    text.replace("&lt;", "<")
        .replace("&gt;", ">")
        .replace("&quot;", "\"")
        .replace("&apos;", "'")
        .replace("&amp;", "&")
}

/// Metres and name of the vertical unit: the unit type of the band first, else that of the vertical CRS. A name that
/// means nothing here counts as metres; the name is kept for whoever wants to warn.
pub(crate) fn vertical_unit(unit_type: Option<&str>, of_crs: Option<(f64, String)>) -> (f64, String) {
    match unit_type.map(str::trim).filter(|name| !name.is_empty()) {
        Some(name) => (unit::metres_of(name).unwrap_or(1.0), name.to_owned()),
        None => of_crs.unwrap_or((1.0, String::new())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_as_gdal_reads_them() {
        assert_eq!(number("-9999 "), Some(-9999.0));
        assert_eq!(number("  -3.4028234663852886e+38"), Some(-3.402_823_466_385_288_6e38));
        assert_eq!(number("1,5"), Some(1.5));
        assert_eq!(number("12abc"), Some(12.0));
        assert!(number("nan").is_some_and(f64::is_nan) && number("-1.#IND").is_some_and(f64::is_nan));
        assert_eq!(number("-inf"), Some(f64::NEG_INFINITY));
        assert_eq!(number(""), None);
        assert_eq!(number("none"), None);
    }

    #[test]
    fn nodata_of_a_float32() {
        assert_eq!(nodata("0.1", SampleType::Float32), Some(f64::from(0.1_f32)));
        assert_eq!(nodata("-3.4028235e+38", SampleType::Float32), Some(-f64::from(f32::MAX)));
        assert_eq!(nodata("-1e300", SampleType::Float32), Some(-1e300));
        assert_eq!(nodata("0.1", SampleType::Float64), Some(0.1));
        assert_eq!(nodata("-9999", SampleType::Uint8), Some(-9999.0));
    }

    #[test]
    fn items_of_band_one() {
        let xml = "<GDALMetadata>\n  <Item name=\"OFFSET\" sample=\"0\" role=\"offset\">100</Item>\n\
                   <Item role='scale' sample='0' name='SCALE'>0.25</Item>\n\
                   <Item name=\"SCALE\" sample=\"1\" role=\"scale\">9</Item>\n\
                   <Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">a &lt;b&gt; &amp;amp;</Item>\n\
                   <Item name=\"sample\">0</Item><Item name=\"x";
        let expected = Items { scale: Some(0.25), offset: Some(100.0), unit: Some("a <b> &".to_owned()) };
        assert_eq!(items(xml), expected);
    }

    #[test]
    fn units() {
        assert_eq!(
            vertical_unit(Some("US survey foot"), None),
            (1200.0 / 3937.0, "US survey foot".to_owned())
        );
        assert_eq!(vertical_unit(Some("ft"), Some((1.0, "metre".to_owned()))).0, 0.3048);
        assert_eq!(vertical_unit(None, Some((0.3048, "foot".to_owned()))).0, 0.3048);
        assert_eq!(vertical_unit(Some("cubits"), None), (1.0, "cubits".to_owned()));
        assert_eq!(vertical_unit(Some(""), None), (1.0, String::new()));
    }
}
