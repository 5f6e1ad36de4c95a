//! Descriptions of a file and its source, for problems in the report.

use crate::geo::{Crs, CrsKind};

/// A geotransform as text.
pub(super) fn transform(transform: Option<[f64; 6]>) -> String {
    let Some(numbers) = transform else { return "none".into() };
    let numbers: Vec<String> = numbers.iter().map(ToString::to_string).collect();
    numbers.join(" ")
}

/// Two coordinate systems as text: their names if these differ, else the properties that differ.
pub(super) fn crs(expected: &Crs, got: &Crs) -> (String, String) {
    let (a, b) = (name(expected), name(got));
    if a != b {
        return (a, b);
    }
    let parts = parts(expected).into_iter().zip(parts(got));
    let different: Vec<_> = parts.filter(|(a, b)| a != b).collect();
    let join = |words: Vec<String>| format!("{a} with {}", words.join(", "));
    if different.is_empty() {
        return (format!("{a} as the source has it"), "another of that name".into());
    }
    let (expected, got) = different.into_iter().unzip();
    (join(expected), join(got))
}

/// Name of a coordinate system.
fn name(crs: &Crs) -> String {
    let code = crs.epsg.map(|code| format!("EPSG:{code}"));
    match (crs.name.is_empty(), code) {
        (true, None) => "no coordinate system".into(),
        (true, Some(code)) => code,
        (false, None) => crs.name.clone(),
        (false, Some(code)) => format!("{} ({code})", crs.name),
    }
}

/// All properties that distinguish systems of the same name.
fn parts(crs: &Crs) -> [String; 7] {
    let kind = match crs.kind {
        CrsKind::Geographic => "geographic",
        CrsKind::Projected => "projected",
        CrsKind::Engineering => "engineering",
    };
    let vertical = crs.vertical_epsg.map_or("none".into(), |code| format!("EPSG:{code}"));
    [
        format!("kind {kind}"),
        format!("ellipsoid {} / {}", crs.ellipsoid.a, crs.ellipsoid.inverse_flattening),
        format!("unit {}", crs.unit),
        format!("vertical system {vertical}"),
        format!("vertical name {}", if crs.vertical_name.is_empty() { "none" } else { &crs.vertical_name }),
        format!("heights counted {}", if crs.vertical_down { "downwards" } else { "upwards" }),
        format!("WKT {}", if crs.wkt.is_empty() { "none" } else { &crs.wkt }),
    ]
}
