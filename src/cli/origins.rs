//! One line that says where the properties of a raster were found.

use std::collections::BTreeMap;

/// Properties in the file and their names for people, in printing order.
const NAMES: [(&str, &str); 7] = [
    ("place", "place"),
    ("crs", "CRS"),
    ("nodata", "nodata"),
    ("unit", "unit"),
    ("scale", "scale"),
    ("offset", "offset"),
    ("mask", "mask"),
];

/// A line such as `place, nodata: dem.tif.aux.xml; CRS: GeoKeys`; `None` if no origin is known.
pub fn line(origins: &BTreeMap<String, String>) -> Option<String> {
    let mut found: Vec<(&str, String)> = Vec::new();
    for (key, name) in NAMES {
        let Some(origin) = origins.get(key) else { continue };
        match found.iter_mut().find(|(known, _)| known == origin) {
            Some((_, names)) => {
                names.push_str(", ");
                names.push_str(name);
            }
            None => found.push((origin, name.to_owned())),
        }
    }
    let parts: Vec<String> = found.into_iter().map(|(origin, names)| format!("{names}: {origin}")).collect();
    (!parts.is_empty()).then(|| parts.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn things_of_one_origin_stand_together() {
        let all = [("crs", "GeoKeys"), ("nodata", "a.aux.xml"), ("place", "a.aux.xml"), ("other", "x")];
        let all = all.map(|(key, origin)| (key.to_owned(), origin.to_owned())).into();
        assert_eq!(line(&all).as_deref(), Some("place, nodata: a.aux.xml; CRS: GeoKeys"));
        assert_eq!(line(&BTreeMap::new()), None);
    }
}
