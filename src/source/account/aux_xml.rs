//! GDAL's sidecar `dem.tif.aux.xml` (PAM): properties stated beside a raster.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use roxmltree::Node;

use super::role::Role;
use super::{sidecar, xml};
use crate::limits::Limits;
use crate::source::{file_name, metadata};

/// The properties of a band, as written in the sidecar.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Band {
    pub(super) nodata: Option<String>,
    pub(super) unit: Option<String>,
    pub(super) scale: Option<String>,
    pub(super) offset: Option<String>,
    pub(super) role: Option<Role>,
}

/// The content of a sidecar.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct AuxXml {
    /// The coordinate system, in any form that GDAL reads. An empty text means that there is none.
    pub(super) srs: Option<String>,
    /// The axes of the coordinate system that x and y are, from 1.
    pub(super) axes: Option<String>,
    pub(super) transform: Option<[f64; 6]>,
    pub(super) pixel_is_point: Option<bool>,
    /// True if the raster is placed by control points.
    pub(super) control_points: bool,
    /// Bands by number, from 1.
    pub(super) bands: BTreeMap<u32, Band>,
    /// Warnings about unreadable content.
    pub(super) warnings: Vec<String>,
}

/// The path and content of a raster's sidecar; `None` if there is none.
pub(super) fn of(raster: &Path, limits: &Limits) -> Option<(PathBuf, AuxXml)> {
    let path = sidecar::appended(raster, ".aux.xml")?;
    let ignored = |reason: String| AuxXml {
        warnings: vec![format!(
            "{}: passed over, as GDAL does: {reason}; nodata, unit, scale and place in it do not count: mend or remove it",
            file_name(&path)
        )],
        ..AuxXml::default()
    };
    let found = match sidecar::text(&path, limits) {
        Err(error) => ignored(error.to_string()),
        Ok(text) => match xml::read(&text, "PAMDataset", dataset) {
            Err(reason) => ignored(reason),
            Ok(None) => ignored("it has no PAMDataset".to_owned()),
            Ok(Some(mut found)) => {
                for warning in &mut found.warnings {
                    *warning = format!("{}: {warning}", file_name(&path));
                }
                found
            }
        },
    };
    Some((path, found))
}

fn dataset(root: Node<'_, '_>) -> AuxXml {
    let mut found = AuxXml::default();
    if let Some(srs) = xml::child(root, "SRS") {
        found.srs = Some(xml::text(srs).unwrap_or_default().trim().to_owned());
        found.axes = xml::attribute(srs, "dataAxisToSRSAxisMapping").map(str::to_owned);
    }
    if let Some(text) = xml::text_of(root, "GeoTransform") {
        found.transform = transform(text);
        if found.transform.is_none() {
            let got: String = text.chars().take(80).collect();
            found.warnings.push(format!(
                "GeoTransform is passed over: expected six numbers that span a plane, got {got:?}; mend or remove it"
            ));
        }
    }
    let points = xml::child(root, "GCPList").is_some_and(|list| xml::child(list, "GCP").is_some());
    for metadata in xml::children(root, "Metadata") {
        match xml::attribute(metadata, "domain").unwrap_or_default() {
            "" => found.pixel_is_point = pixel_is_point(metadata).or(found.pixel_is_point),
            domain if domain.eq_ignore_ascii_case("xml:ESRI") => esri(metadata, &mut found),
            _ => {}
        }
    }
    found.control_points |= points;
    for band in xml::children(root, "PAMRasterBand") {
        let number = xml::attribute(band, "band").and_then(|number| number.trim().parse().ok());
        if let Some(number) = number.filter(|&number: &u32| number > 0) {
            add(band, found.bands.entry(number).or_default());
        }
    }
    found.bands.retain(|_, band| *band != Band::default());
    found
}

/// Reads the coordinate system and control points that Esri's programs write in their own elements.
fn esri(metadata: Node<'_, '_>, found: &mut AuxXml) {
    let Some(form) = xml::child(metadata, "GeodataXform") else { return };
    let wkt = xml::child(form, "SpatialReference").and_then(|system| xml::text_of(system, "WKT"));
    if let (None, Some(wkt)) = (&found.srs, wkt) {
        found.srs = Some(wkt.trim().to_owned());
    }
    found.control_points |= form.descendants().any(|node| xml::is(node, "SourceGCPs"));
}

fn pixel_is_point(metadata: Node<'_, '_>) -> Option<bool> {
    let says = |item: &Node<'_, '_>| {
        xml::attribute(*item, "key").is_some_and(|key| key.eq_ignore_ascii_case("AREA_OR_POINT"))
    };
    let item = xml::children(metadata, "MDI").find(says)?;
    Some(xml::text(item)?.trim().eq_ignore_ascii_case("Point"))
}

fn transform(text: &str) -> Option<[f64; 6]> {
    let numbers: Vec<f64> = text.split(',').map_while(metadata::number).collect();
    let found: [f64; 6] = numbers.try_into().ok()?;
    let [_, a, b, _, d, e] = found;
    let spans = a * e - b * d != 0.0 && found.iter().all(|number| number.is_finite());
    (spans && text.split(',').count() == 6).then_some(found)
}

/// Adds the properties in an element to those of a band, replacing earlier ones.
fn add(node: Node<'_, '_>, band: &mut Band) {
    let text = |name| xml::text_of(node, name).map(str::to_owned);
    let exact = xml::child(node, "NoDataValue").and_then(|node| xml::attribute(node, "le_hex_equiv"));
    let nodata =
        exact.and_then(float_of_hex).map(|value| format!("{value:?}")).or_else(|| text("NoDataValue"));
    band.nodata = nodata.or(band.nodata.take());
    band.unit = text("UnitType").or(band.unit.take());
    band.scale = text("Scale").or(band.scale.take());
    band.offset = text("Offset").or(band.offset.take());
    let role = text("ColorInterp").and_then(|name| Role::of_name(&name));
    band.role = role.filter(|role| *role != Role::Undefined).or(band.role);
}

/// A float64 from 16 hexadecimal digits, low byte first, which GDAL writes beside a decimal that
/// does not hold it exactly.
fn float_of_hex(digits: &str) -> Option<f64> {
    let whole = u64::from_str_radix(digits, 16).ok().filter(|_| digits.len() == 16)?;
    Some(f64::from_bits(whole.swap_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(inside: &str) -> AuxXml {
        xml::read(&format!("<PAMDataset>{inside}</PAMDataset>"), "PAMDataset", dataset)
            .expect("XML")
            .expect("root")
    }

    #[test]
    fn everything() {
        let found = read(
            "<SRS dataAxisToSRSAxisMapping=\"2,1\"> EPSG:4326 </SRS><GeoTransform> 500, 3, 0, 600,0, -3</GeoTransform>\
             <Metadata domain=\"x\"><MDI key=\"AREA_OR_POINT\">Area</MDI></Metadata>\
             <Metadata><MDI key=\"AREA_OR_POINT\">Point</MDI></Metadata>\
             <PAMRasterBand band=\"1\"><NoDataValue>-9.99900000000000E+03</NoDataValue><UnitType>ft</UnitType>\
             <Offset>7</Offset><Scale>0.5</Scale><ColorInterp>Blue</ColorInterp></PAMRasterBand>\
             <PAMRasterBand band=\"2\"><NoDataValue le_hex_equiv=\"0000000000C05EC0\">-5</NoDataValue></PAMRasterBand>\
             <PAMRasterBand><NoDataValue>3</NoDataValue></PAMRasterBand>",
        );
        let text = |text: &str| Some(text.to_owned());
        let one = Band {
            nodata: text("-9.99900000000000E+03"),
            unit: text("ft"),
            scale: text("0.5"),
            offset: text("7"),
            role: Some(Role::Blue),
        };
        let two = Band { nodata: text("-123.0"), ..Band::default() };
        let expected = AuxXml {
            srs: text("EPSG:4326"),
            axes: text("2,1"),
            transform: Some([500.0, 3.0, 0.0, 600.0, 0.0, -3.0]),
            pixel_is_point: Some(true),
            control_points: false,
            bands: BTreeMap::from([(1, one), (2, two)]),
            warnings: Vec::new(),
        };
        assert_eq!(found, expected);
    }

    #[test]
    fn the_last_of_a_band_counts_and_the_first_within_it() {
        let nodata = |value| format!("<NoDataValue>{value}</NoDataValue>");
        let band = |inside: String| format!("<PAMRasterBand band=\"1\">{inside}</PAMRasterBand>");
        let found =
            read(&[band(nodata(-5) + &nodata(-6)), band("<UnitType>ft</UnitType>".to_owned())].concat());
        assert_eq!(found.bands[&1].nodata.as_deref(), Some("-5"));
        assert_eq!(found.bands[&1].unit.as_deref(), Some("ft"));
        assert_eq!(
            read(&[band(nodata(-5)), band(nodata(-7))].concat()).bands[&1].nodata.as_deref(),
            Some("-7")
        );
        for nothing in
            ["<UnitType></UnitType>", "<ColorInterp>Undefined</ColorInterp>", "<ColorInterp>x</ColorInterp>"]
        {
            assert_eq!(read(&band(nothing.to_owned())), AuxXml::default());
        }
    }

    #[test]
    fn transforms_that_make_no_sense_are_said() {
        for text in ["1,2,3", "500,3,0,600,0,-3,7", "a,b,c,d,e,f", "0,0,0,0,0,0", "nan,1,0,0,0,-1"] {
            let found = read(&format!("<GeoTransform>{text}</GeoTransform>"));
            assert_eq!((found.transform, found.warnings.len()), (None, 1), "{text}");
        }
        assert_eq!(read("<GeoTransform/>"), AuxXml::default());
        assert_eq!(read("<SRS/>").srs.as_deref(), Some(""));
    }

    #[test]
    fn control_points_and_esri() {
        assert!(
            read("<GCPList><GCP Id=\"1\"/></GCPList>").control_points && !read("<GCPList/>").control_points
        );
        let esri = |inside: &str| {
            let form = format!("<GeodataXform>{inside}</GeodataXform>");
            read(&format!("<Metadata domain=\"xml:ESRI\" format=\"xml\">{form}</Metadata>"))
        };
        let found = esri("<SpatialReference><WKT>PROJCS[\"a\"]</WKT></SpatialReference>");
        assert_eq!((found.srs.as_deref(), found.control_points), (Some("PROJCS[\"a\"]"), false));
        assert!(esri("<SourceGCPs/>").control_points);
    }
}
