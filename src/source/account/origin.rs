//! Where the properties of a raster were found.

use std::collections::BTreeMap;
use std::fmt;

use wincode::{SchemaRead, SchemaWrite};

/// Where a property of a raster was found. Names are of files, without folders; empty if each
/// raster of a mosaic has its own.
#[derive(Clone, Debug, PartialEq, Eq, SchemaRead, SchemaWrite)]
pub enum Origin {
    /// A tag of the TIFF, by number.
    Tag(u16),
    /// The GeoTIFF keys.
    GeoKeys,
    /// The XML in TIFF tag 42112.
    GdalMetadata,
    /// GDAL's sidecar `dem.tif.aux.xml`.
    AuxXml(String),
    /// A world file, `dem.tfw` or `dem.wld`.
    WorldFile(String),
    /// The coordinate system in `dem.prj`.
    Prj(String),
    /// A mask beside the raster, `dem.tif.msk`.
    MaskFile(String),
    /// A mask or an alpha band in the raster itself.
    Inside,
    /// A virtual raster.
    Vrt(String),
    /// The name of the file.
    FileName,
    /// The format, which allows no other value.
    Format,
    /// GDAL, as the reader of the file.
    Driver,
    /// The user.
    User,
    /// Different origins in the rasters of a mosaic.
    Several,
}

impl fmt::Display for Origin {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let file = |out: &mut fmt::Formatter<'_>, name: &str, kind: &str| match name {
            "" => write!(out, "the {kind} of each file"),
            name => out.write_str(name),
        };
        match self {
            Self::Tag(number) => write!(out, "TIFF tag {number}"),
            Self::GeoKeys => out.write_str("GeoKeys"),
            Self::GdalMetadata => out.write_str("GDAL_METADATA, TIFF tag 42112"),
            Self::AuxXml(name) => file(out, name, ".aux.xml"),
            Self::WorldFile(name) => file(out, name, "world file"),
            Self::Prj(name) => file(out, name, ".prj"),
            Self::MaskFile(name) => file(out, name, ".msk"),
            Self::Inside => out.write_str("in the file"),
            Self::Vrt(name) => file(out, name, "VRT"),
            Self::FileName => out.write_str("file name"),
            Self::Format => out.write_str("file format"),
            Self::Driver => out.write_str("GDAL"),
            Self::User => out.write_str("stated by the user"),
            Self::Several => out.write_str("the files, each in its way"),
        }
    }
}

impl Origin {
    /// The common origin of two rasters of a mosaic.
    fn joined(self, other: &Self) -> Self {
        if self == *other {
            return self;
        }
        match (self, other) {
            (Self::AuxXml(_), Self::AuxXml(_)) => Self::AuxXml(String::new()),
            (Self::WorldFile(_), Self::WorldFile(_)) => Self::WorldFile(String::new()),
            (Self::Prj(_), Self::Prj(_)) => Self::Prj(String::new()),
            (Self::MaskFile(_), Self::MaskFile(_)) => Self::MaskFile(String::new()),
            (Self::Vrt(_), Self::Vrt(_)) => Self::Vrt(String::new()),
            _ => Self::Several,
        }
    }
}

/// Where each property of a raster was found; `None` for one that is not given.
#[derive(Clone, Debug, Default, PartialEq, Eq, SchemaRead, SchemaWrite)]
pub struct Origins {
    /// The geotransform.
    pub place: Option<Origin>,
    /// The coordinate system.
    pub crs: Option<Origin>,
    /// The nodata value.
    pub nodata: Option<Origin>,
    /// The vertical unit.
    pub unit: Option<Origin>,
    /// GDAL scale.
    pub scale: Option<Origin>,
    /// GDAL offset.
    pub offset: Option<Origin>,
    /// The mask.
    pub mask: Option<Origin>,
}

impl Origins {
    /// All properties with their names.
    pub fn all(&self) -> [(&'static str, Option<&Origin>); 7] {
        [
            ("place", self.place.as_ref()),
            ("crs", self.crs.as_ref()),
            ("nodata", self.nodata.as_ref()),
            ("unit", self.unit.as_ref()),
            ("scale", self.scale.as_ref()),
            ("offset", self.offset.as_ref()),
            ("mask", self.mask.as_ref()),
        ]
    }

    /// The known origins as text, by property name, as printed and recorded.
    pub fn texts(&self) -> BTreeMap<String, String> {
        let known =
            self.all().into_iter().filter_map(|(name, origin)| Some((name.to_owned(), origin?.to_string())));
        known.collect()
    }

    /// The origins of a mosaic: for each property, the common origin of all rasters that have it.
    pub(in crate::source) fn joined<'a>(mut all: impl Iterator<Item = &'a Self>) -> Self {
        let mut joined = all.next().cloned().unwrap_or_default();
        for other in all {
            let add = |one: &mut Option<Origin>, other: &Option<Origin>| {
                *one = match (one.take(), other) {
                    (Some(one), Some(other)) => Some(one.joined(other)),
                    (one, other) => one.or_else(|| other.clone()),
                };
            };
            add(&mut joined.place, &other.place);
            add(&mut joined.crs, &other.crs);
            add(&mut joined.nodata, &other.nodata);
            add(&mut joined.unit, &other.unit);
            add(&mut joined.scale, &other.scale);
            add(&mut joined.offset, &other.offset);
            add(&mut joined.mask, &other.mask);
        }
        joined
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn origins_of_a_mosaic() {
        let of = |place, nodata| Origins { place, nodata, ..Origins::default() };
        let world = |name: &str| Some(Origin::WorldFile(name.to_owned()));
        let all = [
            of(world("a.tfw"), Some(Origin::Tag(42113))),
            of(world("b.tfw"), None),
            of(world("c.tfw"), Some(Origin::AuxXml("c.tif.aux.xml".to_owned()))),
        ];
        let joined = Origins::joined(all.iter());
        assert_eq!(joined, of(world(""), Some(Origin::Several)));
        assert_eq!(joined.place.expect("a place").to_string(), "the world file of each file");
        assert_eq!(Origins::joined(all[1..2].iter()), all[1]);
        assert_eq!(Origins::joined([].iter()), Origins::default());
    }
}
