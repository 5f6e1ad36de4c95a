//! The coordinate system of a VRT, described as its sources do if both are the same.

use crate::crs;
use crate::error::Result;
use crate::geo::Crs;

/// The coordinate system of a VRT whose sources have `of_sources`: theirs, which has more detail
/// than WKT, if the VRT gives none or the same one; else its own, whatever their names.
pub(super) fn resolve(text: Option<&str>, of_sources: &Crs) -> Result<Crs> {
    let Some(text) = text.filter(|text| !text.trim().is_empty()) else { return Ok(of_sources.clone()) };
    let said = crs::read(text)?;
    if !crs::are_same(&said, of_sources) {
        return Ok(said);
    }
    let other_heights = said.vertical_epsg.is_some() && said.vertical_epsg != of_sources.vertical_epsg
        || said.vertical_down && !of_sources.vertical_down;
    Ok(if other_heights { said } else { of_sources.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geo::CrsKind;

    const WKT1: &str = "GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\",6378137,298.257223563,\
                        AUTHORITY[\"EPSG\",\"7030\"]],AUTHORITY[\"EPSG\",\"6326\"]],PRIMEM[\"Greenwich\",0],\
                        UNIT[\"degree\",0.0174532925199433],AUTHORITY[\"EPSG\",\"4326\"]]";

    fn albers(lat_1: u32) -> String {
        format!(
            "PROJCS[\"unknown\",{WKT1},PROJECTION[\"Albers_Conic_Equal_Area\"],PARAMETER[\"latitude_of_center\",40],\
             PARAMETER[\"longitude_of_center\",-96],PARAMETER[\"standard_parallel_1\",{lat_1}],\
             PARAMETER[\"standard_parallel_2\",60],UNIT[\"metre\",1]]"
        )
    }

    #[test]
    fn that_of_the_sources_or_its_own() {
        let sources = Crs { name: "as they say".into(), ..crs::read("EPSG:4326").expect("code") };
        assert_eq!(resolve(None, &sources).expect("sources'"), sources);
        assert_eq!(resolve(Some(WKT1), &sources).expect("the same"), sources);
        let other = resolve(Some("PROJCS[\"u\",AUTHORITY[\"EPSG\",\"32610\"]]"), &sources).expect("code");
        assert_eq!((other.kind, other.epsg, other.unit), (CrsKind::Projected, Some(32610), 1.0));
        assert_eq!(other.name, "WGS 84 / UTM zone 10N");
        let heights = resolve(Some("EPSG:4326+5703"), &sources).expect("codes");
        assert_eq!(heights.vertical_epsg, Some(5703));
        assert!(resolve(Some("PROJCS[\"local\",UNIT[\"metre\",1]]"), &sources).is_err());
    }

    #[test]
    fn one_name_and_other_parameters_are_another_system() {
        let sources = crs::read(&albers(20)).expect("WKT");
        assert_eq!(resolve(Some(&albers(20)), &sources).expect("the same"), sources);
        let other = resolve(Some(&albers(21)), &sources).expect("WKT");
        assert!(other.name == sources.name && other != sources);
    }
}
