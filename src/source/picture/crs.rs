//! Whether two coordinate systems are the same, as far as files tell.

use crate::geo::{Crs, CrsKind};

/// True if coordinates of one are coordinates of the other.
pub(super) fn same(a: &Crs, b: &Crs) -> bool {
    if let (Some(a), Some(b)) = (a.epsg, b.epsg) {
        return a == b;
    }
    if is_unknown(a) || is_unknown(b) {
        return is_unknown(a) && is_unknown(b);
    }
    let close = |x: f64, y: f64| (x - y).abs() <= 1e-7 * x.abs().max(y.abs());
    let alike = a.kind == b.kind
        && close(a.unit, b.unit)
        && close(a.ellipsoid.a, b.ellipsoid.a)
        && close(a.ellipsoid.inverse_flattening, b.ellipsoid.inverse_flattening);
    // Of a user-defined projection the keys or the text hold the parameters; longitudes and latitudes have none.
    let keys = a.keys.is_some() && a.keys == b.keys;
    alike && (keys || (!a.wkt.is_empty() && a.wkt == b.wkt) || plain(&a.name) == plain(&b.name))
}

/// True if nothing is known of it but its unit.
pub(super) fn is_unknown(crs: &Crs) -> bool {
    crs.kind == CrsKind::Engineering && crs.epsg.is_none() && crs.name.is_empty()
}

/// For messages.
pub(super) fn name(crs: &Crs) -> String {
    match crs.epsg {
        _ if is_unknown(crs) => "an unknown coordinate system".to_owned(),
        Some(code) if crs.name.is_empty() => format!("EPSG:{code}"),
        Some(code) => format!("EPSG:{code} ({})", crs.name),
        None if crs.name.is_empty() => "an unnamed coordinate system".to_owned(),
        None => crs.name.clone(),
    }
}

/// Letters and digits of a name: `NAD83 / UTM zone 12N` and `NAD83_UTM_zone_12N` are one.
fn plain(name: &str) -> String {
    name.chars().filter(char::is_ascii_alphanumeric).map(|c| c.to_ascii_lowercase()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_decide_and_names_where_there_are_none() {
        let utm = Crs { kind: CrsKind::Projected, epsg: Some(32612), name: "a".into(), ..Crs::default() };
        let other = Crs { epsg: Some(32613), ..utm.clone() };
        assert!(same(&utm, &Crs { name: "b".into(), ..utm.clone() }) && !same(&utm, &other));
        let own = Crs { epsg: None, name: "NAD83 / UTM zone 12N".into(), ..utm.clone() };
        assert!(same(&own, &Crs { name: "NAD83_UTM_zone_12N".into(), ..own.clone() }));
        assert!(!same(&own, &Crs { unit: 0.3048, ..own.clone() }));
        assert!(!same(&own, &Crs { name: "NAD27 / UTM zone 12N".into(), ..own.clone() }));
        assert!(same(&Crs::default(), &Crs::default()) && !same(&Crs::default(), &utm));
    }
}
