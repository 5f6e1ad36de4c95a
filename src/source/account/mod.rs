//! Properties of a raster, gathered once from tags and sidecars: place and coordinate system, and
//! for each band nodata, unit, scale, offset and role, each with its origin.
//!
//! Several places can state the same property. The first in the table counts, in the order of GDAL
//! (3.6.2, found by trial):
//!
//! | of a TIFF | first | then | then | last |
//! |---|---|---|---|---|
//! | place | `.aux.xml` | tags 33550 and 33922, or 34264 | | world file |
//! | coordinate system | `.aux.xml` | GeoKeys | | `.prj` |
//! | pixel is point | `.aux.xml` where it has the coordinate system, or where there are no GeoKeys | GeoKeys | | |
//! | nodata | `.aux.xml` | tag 42113 | | |
//! | scale and offset, both | tags 33550 and 33922 (GeoTIFF 1.1 with a vertical system) | tag 42112 | | `.aux.xml` |
//! | unit | tag 42112 | `.aux.xml` | vertical system of the GeoKeys | vertical system of the `.aux.xml` |
//! | role of a band | `.aux.xml` | tag 42112 | | tags 262 and 338 |
//!
//! - Scale and offset are one thing: what says one of them says the other too (1 or 0).
//! - A `.aux.xml` whose `SRS` is empty says that there is no coordinate system. Control points in
//!   it hide the place that tags or a world file give, as they do in GDAL; a raster that only they
//!   place has neither place nor coordinate system.
//! - The vertical unit of the `.aux.xml`'s system and the `.prj` are beyond GDAL, which passes over
//!   both. A `.prj` counts where there is a place and nothing else names its coordinates. GDAL's
//!   order has a `MapInfo` table, `.tab`, before the world file: a raster that needs it is left to
//!   GDAL.
//! - World files are `dem.tfw`, `dem.tifw` and `dem.wld`, in this order and in any case.
//! - What lies beside a gzipped raster, `dem.tif.gz`, has the name that it has unpacked:
//!   `dem.tif.aux.xml`, `dem.tfw`.
//! - Of an SRTM tile `.aux.xml` gives scale, offset and pixel is point; of a virtual raster nothing
//!   beside it counts.

mod aux_xml;
mod gdal_metadata;
mod origin;
mod role;
mod sidecar;
mod world;
mod xml;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use self::aux_xml::AuxXml;
use self::gdal_metadata::Items;
pub use self::origin::{Origin, Origins};
pub(in crate::source) use self::role::Role;
use super::open::NEEDS_GDAL;
use super::{advice, file_name, metadata, unit};
use crate::crs::Definition;
use crate::error::{Error, Result};
use crate::geo::{Crs, CrsKind, Geo};
use crate::limits::Limits;

/// Properties from the tags of a TIFF; GDAL's texts are unparsed.
#[derive(Clone, Debug, Default)]
pub(in crate::source) struct Tags {
    /// The geotransform, and the tag that it comes from.
    pub(in crate::source) transform: Option<([f64; 6], u16)>,
    /// True if there are tie points but no geotransform.
    pub(in crate::source) control_points: bool,
    /// True if there are GeoKeys.
    pub(in crate::source) has_keys: bool,
    /// The coordinate system of the GeoKeys.
    pub(in crate::source) crs: Crs,
    /// True if the GeoKeys say that pixels are points.
    pub(in crate::source) pixel_is_point: bool,
    /// Metres and name of the unit of the GeoKeys' vertical system.
    pub(in crate::source) vertical_unit: Option<(f64, String)>,
    /// Scale and offset of heights, from the third dimension of the tags that give the place.
    pub(in crate::source) scale_offset: Option<(f64, f64)>,
    /// Tag 42113.
    pub(in crate::source) nodata: Option<String>,
    /// Tag 42112.
    pub(in crate::source) metadata: Option<String>,
    /// Warnings about contradictions.
    pub(in crate::source) warnings: Vec<String>,
}

/// The properties of a raster.
#[derive(Clone, Debug, Default)]
pub(in crate::source) struct Account {
    /// Georeference.
    pub(in crate::source) geo: Geo,
    /// Where place and coordinate system were found.
    pub(in crate::source) origins: Origins,
    /// Sidecars that were used, or ignored with a warning.
    pub(in crate::source) files: Vec<PathBuf>,
    /// Warnings about unreadable or contradictory properties, a sentence each.
    pub(in crate::source) warnings: Vec<String>,
    /// Name of the raster.
    name: String,
    tags: Tags,
    items: BTreeMap<u32, Items>,
    aux: AuxXml,
    /// Name of the sidecar.
    aux_name: String,
    /// Metres and name of the unit of the vertical part of the sidecar's coordinate system.
    aux_unit: Option<(f64, String)>,
}

/// The properties of a band of heights.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::source) struct Band {
    /// The nodata value as stated, before it is rounded to the sample type.
    pub(in crate::source) nodata: Option<f64>,
    /// GDAL scale.
    pub(in crate::source) scale: f64,
    /// GDAL offset.
    pub(in crate::source) offset: f64,
    /// Metres and name of the vertical unit.
    pub(in crate::source) unit: (f64, String),
    /// Where these were found, and the raster's place and coordinate system.
    pub(in crate::source) origins: Origins,
}

impl Account {
    /// Gathers the properties from the tags of a raster, if it has any, and from its sidecars.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a coordinate system that is not understood, and for a place that
    /// only GDAL reads.
    pub(in crate::source) fn gathered(raster: &Path, tags: Tags, limits: &Limits) -> Result<Self> {
        let raster = &sidecar::unpacked(raster);
        let mut account = Self::beside(raster, limits);
        account.name = file_name(raster);
        for text in &tags.warnings {
            account.warn(text);
        }
        if let Some(text) = &tags.metadata {
            match gdal_metadata::read(text) {
                Ok(items) => account.items = items,
                Err(reason) => account.warn(&format!(
                    "TIFF tag 42112 (GDAL_METADATA) is passed over, as GDAL does ({reason}): unit, scale and \
                     offset in it do not count; state them, or write the tag again"
                )),
            }
        }
        account.tags = tags;
        account.place(raster, limits)?;
        account.system(raster, limits)?;
        account.doubt();
        Ok(account)
    }

    /// Gathers scale, offset and pixel-is-point from the `.aux.xml` of a raster in another format.
    pub(in crate::source) fn beside(raster: &Path, limits: &Limits) -> Self {
        let raster = &sidecar::unpacked(raster);
        let mut account = Self::default();
        if let Some((path, aux)) = aux_xml::of(raster, limits) {
            account.warnings.extend(aux.warnings.iter().cloned());
            account.aux_name = file_name(&path);
            // Image viewers write sidecars with nothing but statistics, and delete them again.
            if aux != AuxXml::default() {
                account.files.push(path);
            }
            account.aux = aux;
        }
        account
    }

    /// True if the `.aux.xml` says that pixels are points, false if areas; `None` if it does not
    /// say.
    pub(in crate::source) fn aux_pixel_is_point(&self) -> Option<bool> {
        self.aux.pixel_is_point
    }

    /// The properties of a band, counted from 1.
    ///
    /// # Errors
    /// [`Error::Format`] for a scale or offset that is no finite number.
    pub(in crate::source) fn band(&self, number: u32) -> Result<Band> {
        let mut origins = self.origins.clone();
        let nodata = self.nodata(number).map(|(value, origin)| {
            origins.nodata = Some(origin);
            value
        });
        let (scale, offset, origin) = self.scale_offset(number)?;
        (origins.scale, origins.offset) = (origin.clone(), origin);
        let unit = self.unit(number).map(|(unit, origin)| {
            origins.unit = Some(origin);
            unit
        });
        Ok(Band { nodata, scale, offset, unit: unit.unwrap_or((1.0, String::new())), origins })
    }

    /// Nodata value of a band, with its origin.
    pub(in crate::source) fn nodata(&self, number: u32) -> Option<(f64, Origin)> {
        let said = self.aux.bands.get(&number).and_then(|band| band.nodata.as_deref());
        let aux = said.and_then(metadata::number).map(|value| (value, self.aux_origin()));
        aux.or_else(|| {
            let tag = self.tags.nodata.as_deref().and_then(metadata::number)?;
            Some((tag, Origin::Tag(42113)))
        })
    }

    /// Role of a band, if it is stated; else its position decides.
    pub(in crate::source) fn role(&self, number: u32) -> Option<Role> {
        let aux = self.aux.bands.get(&number).and_then(|band| band.role);
        aux.or_else(|| self.items.get(&number).and_then(|items| items.role))
    }

    /// Adds a warning.
    fn warn(&mut self, text: &str) {
        self.warnings.push(format!("{}: {text}", self.name));
    }

    fn aux_origin(&self) -> Origin {
        Origin::AuxXml(self.aux_name.clone())
    }

    fn scale_offset(&self, number: u32) -> Result<(f64, f64, Option<Origin>)> {
        if let Some((scale, offset)) = self.tags.scale_offset {
            return Ok((scale, offset, Some(Origin::Tag(33922))));
        }
        let items = self.items.get(&number).map(|items| (items.scale.as_deref(), items.offset.as_deref()));
        let aux = self.aux.bands.get(&number).map(|band| (band.scale.as_deref(), band.offset.as_deref()));
        let says = |pair: &(Option<&str>, Option<&str>)| pair.0.is_some() || pair.1.is_some();
        let (found, origin) = match (items.filter(says), aux.filter(says)) {
            (Some(found), _) => (found, Origin::GdalMetadata),
            (None, Some(found)) => (found, self.aux_origin()),
            (None, None) => return Ok((1.0, 0.0, None)),
        };
        let number = |what: &str, text: Option<&str>, usual: f64| {
            let Some(text) = text else { return Ok(usual) };
            metadata::number(text).filter(|value| value.is_finite()).ok_or_else(|| {
                let got: String = text.chars().take(40).collect();
                let place = format!("the {what} of band {number} ({origin})");
                Error::format(place, "a finite number (give it one with gdal_edit.py)", format!("{got:?}"))
            })
        };
        Ok((number("scale", found.0, 1.0)?, number("offset", found.1, 0.0)?, Some(origin)))
    }

    fn unit(&self, number: u32) -> Option<((f64, String), Origin)> {
        let named = |name: &Option<String>| {
            let name = name.as_deref().map(str::trim).filter(|name| !name.is_empty())?;
            Some((unit::metres_of(name).unwrap_or(1.0), name.to_owned()))
        };
        let item = self.items.get(&number).and_then(|items| named(&items.unit));
        let aux = || self.aux.bands.get(&number).and_then(|band| named(&band.unit));
        item.map(|unit| (unit, Origin::GdalMetadata))
            .or_else(|| aux().map(|unit| (unit, self.aux_origin())))
            .or_else(|| self.tags.vertical_unit.clone().map(|unit| (unit, Origin::GeoKeys)))
            .or_else(|| self.aux_unit.clone().map(|unit| (unit, self.aux_origin())))
    }

    /// Finds the geotransform.
    fn place(&mut self, raster: &Path, limits: &Limits) -> Result<()> {
        if let Some(transform) = self.aux.transform {
            (self.geo.transform, self.origins.place) = (Some(transform), Some(self.aux_origin()));
        } else if self.aux.control_points {
            // Control points hide every other georeference.
        } else if let Some((transform, tag)) = self.tags.transform {
            (self.geo.transform, self.origins.place) = (Some(transform), Some(Origin::Tag(tag)));
        } else {
            refuse_table(raster, limits)?;
            self.world(raster, limits);
        }
        Ok(())
    }

    /// Takes the place from a world file if there is one.
    fn world(&mut self, raster: &Path, limits: &Limits) {
        let extension =
            raster.extension().map(|word| word.to_string_lossy().into_owned()).unwrap_or_default();
        let Some(path) = sidecar::beside(raster, &world::extensions(&extension)) else { return };
        match sidecar::text(&path, limits).and_then(|text| world::parse(&text)) {
            Ok(transform) => {
                self.geo.transform = Some(transform);
                self.origins.place = Some(Origin::WorldFile(file_name(&path)));
            }
            Err(error) => self.warnings.push(format!(
                "{}: passed over, as GDAL does: {error}; mend or remove it, or give the raster its place with gdal_edit.py",
                file_name(&path)
            )),
        }
        self.files.push(path);
    }

    /// Finds the coordinate system and whether pixels are points.
    fn system(&mut self, raster: &Path, limits: &Limits) -> Result<()> {
        let by_aux = self.aux.srs.is_some() || !self.tags.has_keys;
        let own = self.tags.pixel_is_point;
        self.geo.pixel_is_point = if by_aux { self.aux.pixel_is_point.unwrap_or(false) } else { own };
        self.geo.crs = self.tags.crs.clone();
        if self.tags.has_keys && !is_unknown(&self.geo.crs) {
            self.origins.crs = Some(Origin::GeoKeys);
        }
        if self.geo.transform.is_none() && (self.aux.control_points || self.tags.control_points) {
            (self.geo.crs, self.origins.crs) = (unknown(), None);
            self.warn(
                "it is placed by control points alone, which do not count: its samples lie one metre apart, in no place; \
                 bring it into a grid with gdalwarp",
            );
            return Ok(());
        }
        if let Some(text) = self.aux.srs.clone() {
            let origin = self.aux_origin();
            if text.is_empty() {
                (self.geo.crs, self.origins.crs) = (unknown(), Some(origin));
                return Ok(());
            }
            let beside = self.files.first().cloned().unwrap_or_default();
            let system = system_of(&text, self.aux.axes.as_deref()).map_err(|error| error.at(&beside))?;
            self.aux_unit = system.vertical.as_ref().map(|vertical| vertical.unit.clone());
            (self.geo.crs, self.origins.crs) = (of_text(&system, &text), Some(origin));
        } else if self.geo.transform.is_some()
            && is_unknown(&self.geo.crs)
            && let Some((path, crs)) = prj(raster, limits)?
        {
            (self.geo.crs, self.origins.crs) = (crs, Some(Origin::Prj(file_name(&path))));
            self.files.push(path);
        }
        Ok(())
    }

    /// Warns of a coordinate system without a place, and of a nodata value that is not a number.
    fn doubt(&mut self) {
        if self.geo.transform.is_none() && self.geo.crs.kind != CrsKind::Engineering {
            self.warn(&format!(
                "it names a coordinate system ({}) but no place in it: its first sample counts as (0.5, 0.5), and samples lie one \
                 unit apart; give it its place with gdal_edit.py -a_ullr",
                super::mosaic::crs_name(&self.geo.crs)
            ));
        }
        for (number, band) in &self.aux.bands {
            if let Some(text) = band.nodata.as_deref().filter(|text| metadata::number(text).is_none()) {
                let got: String = text.chars().take(40).collect();
                let aux = &self.aux_name;
                self.warnings.push(format!(
                    "{aux}: nodata of band {number} is no number ({got:?}) and is passed over; mend it, or {}",
                    advice::NODATA
                ));
            }
        }
    }
}

/// True if a world file lies beside a raster.
#[cfg(feature = "gdal")]
pub(in crate::source) fn has_world_file(raster: &Path) -> bool {
    let extension = raster.extension().map(|word| word.to_string_lossy().into_owned()).unwrap_or_default();
    sidecar::beside(raster, &world::extensions(&extension)).is_some()
}

/// The coordinate system in `dem.prj`, if there is one.
fn prj(raster: &Path, limits: &Limits) -> Result<Option<(PathBuf, Crs)>> {
    let Some((path, text)) = prj_text(raster, limits)? else { return Ok(None) };
    let system = system_of(&text, None).map_err(|error| error.at(&path))?;
    Ok(Some((path, of_text(&system, &text))))
}

/// The path and text of `dem.prj`, if there is one.
pub(in crate::source) fn prj_text(raster: &Path, limits: &Limits) -> Result<Option<(PathBuf, String)>> {
    let Some(path) = sidecar::beside(raster, &["prj".to_owned()]) else { return Ok(None) };
    let text = sidecar::text(&path, limits)?;
    Ok(Some((path, text)))
}

/// True if only the unit of a coordinate system is known.
pub(in crate::source) fn is_unknown(crs: &Crs) -> bool {
    crs.kind == CrsKind::Engineering && crs.epsg.is_none() && crs.name.is_empty()
}

/// An unknown coordinate system.
fn unknown() -> Crs {
    crate::crs::geokeys::read(crate::geo::GeoKeys::default()).crs
}

/// The CRS to record; a projection without a known name keeps the text.
fn of_text(system: &Definition, text: &str) -> Crs {
    crate::crs::read(text).unwrap_or_else(|_| system.crs())
}

/// The coordinate system that a text defines; refused if x is not east.
fn system_of(text: &str, axes: Option<&str>) -> Result<Definition> {
    let system = Definition::read(text)?;
    // If the text does not list its axes, x is east whatever axis numbers the sidecar gives.
    let listed =
        text.to_ascii_uppercase().contains("AXIS[") || text.to_ascii_uppercase().starts_with("EPSG:");
    let first =
        axes.and_then(|axes| axes.split(',').next()).and_then(|axis| axis.trim().parse::<usize>().ok());
    let Some(first @ 1..=2) = first.filter(|_| listed) else { return Ok(system) };
    let is = |axis: usize, words: [&str; 2]| {
        words.iter().any(|word| system.axes[axis].1.eq_ignore_ascii_case(word))
    };
    if is(first - 1, ["north", "south"]) && is(2 - first, ["east", "west"]) {
        let what =
            format!("a raster whose x is {} and y is {}", system.axes[first - 1].1, system.axes[2 - first].1);
        return Err(Error::unsupported(what, "bring it into x east and y north with gdalwarp"));
    }
    Ok(system)
}

/// Refuses a raster placed by a `MapInfo` table, which GDAL reads before a world file.
fn refuse_table(raster: &Path, limits: &Limits) -> Result<()> {
    let Some(path) = sidecar::beside(raster, &["tab".to_owned()]) else { return Ok(()) };
    let text = sidecar::text(&path, limits)?.to_ascii_lowercase();
    if text.contains("\"raster\"") && text.contains("label") {
        return Err(Error::unsupported("a place in a MapInfo table", NEEDS_GDAL).at(&path));
    }
    Ok(())
}
