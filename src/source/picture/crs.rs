//! Compares coordinate systems of pictures and heights.

use crate::crs;
use crate::geo::{Crs, CrsKind};

/// True if two systems are the same, as far as files tell.
pub(in crate::source) fn same(a: &Crs, b: &Crs) -> bool {
    if is_unknown(a) || is_unknown(b) {
        return is_unknown(a) && is_unknown(b);
    }
    crs::are_same(a, b)
}

/// True if only the unit of a system is known.
pub(in crate::source) fn is_unknown(crs: &Crs) -> bool {
    crs.kind == CrsKind::Engineering && crs.epsg.is_none() && crs.name.is_empty()
}

/// Name of a system, for messages.
pub(in crate::source) fn name(crs: &Crs) -> String {
    match crs.epsg {
        _ if is_unknown(crs) => "an unknown coordinate system".to_owned(),
        Some(code) if crs.name.is_empty() => format!("EPSG:{code}"),
        Some(code) => format!("EPSG:{code} ({})", crs.name),
        None if crs.name.is_empty() => "an unnamed coordinate system".to_owned(),
        None => crs.name.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_they_define_decides_and_no_name() {
        let utm = crs::read("EPSG:32612").expect("code");
        let same_name = Crs { name: utm.name.clone(), ..crs::read("EPSG:32613").expect("code") };
        assert!(same(&utm, &Crs { name: "b".into(), ..utm.clone() }) && !same(&utm, &same_name));
        let own = crs::read("+proj=utm +zone=12 +datum=WGS84").expect("PROJ");
        assert!(own.epsg.is_none() && same(&own, &utm));
        assert!(!same(&own, &Crs { unit: 0.3048, ..own.clone() }));
        let other = crs::read("+proj=utm +zone=12 +datum=NAD27").expect("PROJ");
        assert!(!same(&own, &Crs { name: own.name.clone(), ..other }));
        assert!(same(&Crs::default(), &Crs::default()) && !same(&Crs::default(), &utm));
    }
}
