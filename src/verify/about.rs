//! Checks what a file says about itself without a sample: metadata against the header, and parts of
//! the coordinate system against each other.
//!
//! A file states many properties twice: geotransform and bounds, name and metres of the vertical
//! unit, GeoTIFF keys, WKT and the fields derived from them. Where the two differ one of them is
//! wrong, and there is no telling which: that is a problem.

use serde_json::Value;

use super::report::{Check, Place};
use super::wkt::Wkt;
use crate::container::layout::Header;
use crate::container::metadata::Metadata;
use crate::container::reader::Reader;
use crate::geo::{Crs, CrsKind, Ellipsoid, GeoKeys};
use crate::sample::Coding;
use crate::source::unit;

/// Relative difference allowed because f64 operations were done in another order.
const SLACK: f64 = 1e-9;
/// Relative difference allowed for lengths printed with few digits.
const PRINTED: f64 = 1e-6;

/// Checks bounds, units, options, coordinate system, and the notes on imagery.
pub(super) fn check(reader: &Reader, keep: usize) -> Check {
    let mut check = Check::new("metadata", "members", keep);
    let (header, metadata) = (reader.header(), reader.metadata());
    check_bounds(header, metadata.bounds, &mut check);
    check_values(header, metadata, &mut check);
    check_options(header, metadata, &mut check);
    check_crs(header, metadata, &mut check);
    check_imagery(reader, &mut check);
    check
}

impl Check {
    /// Counts a member of the metadata, and a problem if `is` is false.
    fn member(&mut self, is: bool, name: &str, expected: impl ToString, got: impl ToString) {
        self.looked_at += 1;
        self.demand(is, || Place::of(name), expected, got);
    }

    /// Checks that two numbers are equal but for their last digits.
    fn number(&mut self, name: &str, expected: f64, got: f64, slack: f64) {
        let largest = expected.abs().max(got.abs());
        let is = expected == got || (largest.is_finite() && (expected - got).abs() <= slack * largest);
        self.member(is, name, expected, got);
    }
}

/// Checks the outer edges of the raster against the geotransform.
fn check_bounds(header: &Header, stored: Option<[f64; 4]>, check: &mut Check) {
    let Some([x0, a, b, y0, d, e]) = header.transform else {
        let got = if stored.is_none() { "null" } else { "numbers" };
        check.member(stored.is_none(), "bounds", "null, for there is no geotransform", got);
        return;
    };
    let (width, height) = (f64::from(header.width), f64::from(header.height));
    let edges = |first: f64, columns: f64, rows: f64| {
        let (columns, rows) = (columns * width, rows * height);
        let low = first + columns.min(0.0) + rows.min(0.0);
        (low, first + columns.max(0.0) + rows.max(0.0))
    };
    let ((west, east), (south, north)) = (edges(x0, a, b), edges(y0, d, e));
    let expected = [west, south, east, north];
    // Rounding errors depend on the numbers that were added, not on their sum.
    let largest =
        [x0, y0, a * width, b * height, d * width, e * height].map(f64::abs).into_iter().fold(0.0, f64::max);
    let near = |stored: [f64; 4]| {
        expected.iter().zip(stored).all(|(edge, stored)| (edge - stored).abs() <= SLACK * largest)
    };
    let got = stored.map_or("null".to_owned(), |stored| format!("{stored:?}"));
    check.member(stored.is_some_and(near), "bounds", format!("{expected:?}"), got);
}

/// Checks the vertical unit, and that codes of integers are integers.
fn check_values(header: &Header, metadata: &Metadata, check: &mut Check) {
    if let Some(metres) = unit::metres_of(&metadata.vertical_unit) {
        check.number("vertical_unit", metres, header.unit_metres, PRINTED);
    }
    let Coding::Integer { scale, offset } = header.coding else { return };
    if header.quantisation_error == 0.0 && !header.source_type.is_float() {
        let whole = scale.fract() == 0.0 && offset.fract() == 0.0;
        let got = format_args!("scale {scale}, offset {offset}");
        check.member(whole, "scale and offset of lossless whole numbers", "whole numbers", got);
    }
}

/// Checks options that the header states too. Options of other programs are ignored.
fn check_options(header: &Header, metadata: &Metadata, check: &mut Check) {
    if !metadata.tool.starts_with("relevo ") {
        return;
    }
    let options = &metadata.options;
    for (name, expected) in [("tile", header.tile()), ("patch", header.patch())] {
        if let Some(got) = options.get(name) {
            check.member(got.as_u64() == Some(expected.into()), &format!("options, {name}"), expected, got);
        }
    }
    if let Some(got) = options.get("metric") {
        let expected = header.metric.as_str();
        check.member(got.as_str() == Some(expected), "options, metric", expected, got);
    }
    if let Some(got) = options.get("nodata") {
        let expected = header.nodata.filter(|nodata| nodata.is_finite());
        let is = got.as_f64() == expected;
        let nodata = expected.map_or("null".to_owned(), |nodata| nodata.to_string());
        check.member(is, "options, nodata", format!("{nodata}, as in the header"), got);
    }
    let error = header.quantisation_error * header.band_scale.abs() * header.unit_metres;
    match options.get("precision_m").map(Value::as_f64) {
        None => {}
        Some(None) => {
            check.member(error == 0.0, "options, precision_m", "a length, for heights are rounded", "null");
        }
        Some(Some(precision)) => {
            let is = error <= 0.5 * precision * (1.0 + SLACK);
            check.member(is, "options, precision_m", format_args!("{} m or more", 2.0 * error), precision);
        }
    }
}

/// Checks the coordinate system against its keys, its WKT, and the Earth.
fn check_crs(header: &Header, metadata: &Metadata, check: &mut Check) {
    let crs = &metadata.crs;
    let Ellipsoid { a, inverse_flattening } = crs.ellipsoid;
    let sound = a.is_finite() && a > 0.0 && (inverse_flattening == 0.0 || inverse_flattening > 1.0);
    let expected = "an axis above 0, an inverse flattening of 0 or above 1";
    check.member(sound, "crs, ellipsoid", expected, format_args!("{a}, {inverse_flattening}"));
    let sound = crs.unit.is_finite() && crs.unit > 0.0;
    check.member(sound, "crs, unit", "a number above 0", crs.unit);
    if let Some(keys) = &crs.keys {
        check_keys(crs, keys, metadata.pixel_is_point, check);
    }
    check_wkt(crs, check);
    if let (CrsKind::Geographic, Some([_, _, _, y0, d, e])) = (crs.kind, header.transform) {
        check_latitudes(header, crs.unit, [y0, d, e], check);
    }
}

/// Checks GeoTIFF keys whose values stand in the key directory itself.
fn check_keys(crs: &Crs, keys: &GeoKeys, pixel_is_point: bool, check: &mut Check) {
    // Entries beyond the number of keys in the header do not count; of two equal keys, the last
    // does.
    let count = keys.directory.get(3).copied().map_or(0, usize::from);
    let row = |key: u16| keys.directory.chunks_exact(4).skip(1).take(count).rfind(|row| row[0] == key);
    let short = |key: u16| row(key).filter(|row| row[1] == 0).map(|row| row[3]);
    let double = |key: u16| {
        let row = row(key).filter(|row| row[1] == 34736)?;
        keys.doubles.get(usize::from(row[3])).copied()
    };
    let kind = match short(1024) {
        Some(1) => Some(CrsKind::Projected),
        Some(2) => Some(CrsKind::Geographic),
        _ => None,
    };
    if let Some(kind) = kind {
        // Keys without a valid meaning give an engineering system.
        let is = crs.kind == kind || crs.kind == CrsKind::Engineering;
        check.member(is, "crs, kind", format!("{kind:?}, by its keys"), format!("{:?}", crs.kind));
    }
    if let Some(raster @ (1 | 2)) = short(1025) {
        check.member(pixel_is_point == (raster == 2), "pixel_is_point", raster == 2, pixel_is_point);
    }
    if crs.kind != CrsKind::Engineering {
        for (name, key, got) in [
            ("crs, ellipsoid, a", 2057, crs.ellipsoid.a),
            ("crs, ellipsoid, inverse_flattening", 2059, crs.ellipsoid.inverse_flattening),
        ] {
            // Axes may have a unit of their own; their keys are then not comparable.
            if let (Some(expected), None) = (double(key), short(2052).filter(|&unit| unit != 9001)) {
                check.number(name, expected, got, PRINTED);
            }
        }
    }
}

/// Checks the WKT if it is simple enough to be parsed.
fn check_wkt(crs: &Crs, check: &mut Check) {
    let Some(wkt) = Wkt::of(&crs.wkt) else { return };
    if let Some(kind) = wkt.kind() {
        check.member(
            crs.kind == kind,
            "crs, kind",
            format!("{kind:?}, by its WKT"),
            format!("{:?}", crs.kind),
        );
    }
    if let (Some(expected), Some(got)) = (wkt.epsg(), crs.epsg) {
        check.member(expected == got, "crs, epsg", format_args!("{expected}, by its WKT"), got);
    }
    if let (Some(Ellipsoid { a, inverse_flattening }), true) =
        (wkt.ellipsoid(), crs.kind != CrsKind::Engineering)
    {
        check.number("crs, ellipsoid, a", a, crs.ellipsoid.a, PRINTED);
        let got = crs.ellipsoid.inverse_flattening;
        check.number("crs, ellipsoid, inverse_flattening", inverse_flattening, got, PRINTED);
    }
    if let Some(unit) = wkt.unit() {
        check.number("crs, unit", unit, crs.unit, PRINTED);
    }
}

/// Checks that no sample of a geographic raster lies beyond a pole by more than a pixel.
fn check_latitudes(header: &Header, unit: f64, [y0, d, e]: [f64; 3], check: &mut Check) {
    let (columns, rows) = (f64::from(header.width - 1), f64::from(header.height - 1));
    let pole = std::f64::consts::FRAC_PI_2 / unit + d.abs() + e.abs();
    let at = |column: f64, row: f64| y0 + d * (column + 0.5) + e * (row + 0.5);
    let corners = [at(0.0, 0.0), at(columns, 0.0), at(0.0, rows), at(columns, rows)];
    let farthest = corners.into_iter().fold(0.0, |far: f64, y| if y.abs() > far.abs() { y } else { far });
    let expected = format_args!("latitudes up to {} of its units", std::f64::consts::FRAC_PI_2 / unit);
    check.member(farthest.abs() <= pole, "geotransform of a geographic raster", expected, farthest);
}

/// Checks the notes on imagery against the layer.
fn check_imagery(reader: &Reader, check: &mut Check) {
    let (layer, note) = (reader.imagery(), &reader.metadata().imagery);
    let word = |is: bool| if is { "a note" } else { "none" };
    check.member(layer.is_some() == note.is_some(), "imagery", word(layer.is_some()), word(note.is_some()));
    let (Some(layer), Some(note)) = (layer, note) else { return };
    let listed = note.sources.len() as u64;
    check.member(
        note.pictures >= listed,
        "imagery, pictures",
        format_args!("{listed} or more"),
        note.pictures,
    );
    if !note.tool.starts_with("relevo ") {
        return;
    }
    let header = layer.header();
    let members = [
        ("codec", Value::from(header.codec.as_str())),
        ("quality", Value::from(header.quality)),
        ("tile", Value::from(header.tile)),
    ];
    for (name, expected) in members {
        if let Some(got) = note.options.get(name) {
            check.member(*got == expected, &format!("imagery, options, {name}"), expected, got);
        }
    }
}
