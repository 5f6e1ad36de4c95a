//! Joins rasters into one mosaic: checks what must agree, and reconciles what may differ.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::member::{Member, MemberSource, Opener, Scaled};
use super::{AHEAD, Assembly, Mosaic, canvas, lattice, same};
use crate::error::Result;
use crate::geo::Geo;
use crate::limits::Limits;
use crate::sample::SampleType;
use crate::source::{
    Nodata, OpenOptions, Origin, Origins, Overlap, Part, ReadMemory, Rect, Source, SourceInfo, metadata, warn,
};

/// A raster to be joined.
pub struct Piece {
    /// Path of the raster.
    pub path: PathBuf,
    pub(crate) info: SourceInfo,
    pub(crate) files: Vec<PathBuf>,
    pub(crate) held: MemberSource,
}

impl Piece {
    /// A piece that stays open.
    pub fn held(path: PathBuf, source: Box<dyn Source>) -> Self {
        let (info, files) = (source.info().clone(), source.files());
        Self { path, info, files, held: MemberSource::Open(Arc::from(source)) }
    }

    /// A piece that is reopened when needed; `source` gives its properties.
    pub(crate) fn lazy(path: PathBuf, source: &dyn Source, open: Opener) -> Self {
        Self { path, info: source.info().clone(), files: source.files(), held: MemberSource::Lazy(open) }
    }

    fn named(&self) -> (&Path, &SourceInfo) {
        (&self.path, &self.info)
    }
}

/// An overlap rule in words.
pub(crate) trait Rule {
    /// The rule, such as `last on top`.
    fn words(self) -> &'static str;
}

impl Rule for Overlap {
    fn words(self) -> &'static str {
        match self {
            Self::First => "first on top",
            Self::Last => "last on top",
            Self::Min => "the lowest counts",
            Self::Max => "the highest counts",
            Self::Mean => "their mean counts",
        }
    }
}

impl Mosaic {
    /// Joins open rasters; see [`Mosaic::of`].
    pub fn join(
        parts: Vec<(PathBuf, Box<dyn Source>)>,
        options: &OpenOptions,
        limits: &Limits,
    ) -> Result<Self> {
        let pieces = parts.into_iter().map(|(path, source)| Piece::held(path, source)).collect();
        Self::of(pieces, options, limits)
    }

    /// Joins rasters that share a grid, a coordinate system and a vertical unit, in any order,
    /// overlapping or apart.
    ///
    /// The sample type is the narrowest that holds all samples. If GDAL scales or offsets differ,
    /// samples become real values in float64, `offset + scale * sample`, with one more rounding
    /// than in a file of its own; nodata values are then those of each file.
    ///
    /// # Errors
    /// [`Error::Usage`](crate::Error::Usage), by file name, for a raster without a place, off the
    /// grid of the others, or in other coordinates or units; [`Error::Limit`](crate::Error::Limit)
    /// if all together are too large.
    pub fn of(pieces: Vec<Piece>, options: &OpenOptions, limits: &Limits) -> Result<Self> {
        let rasters: Vec<_> = pieces.iter().map(Piece::named).collect();
        if let Some((&first, others)) = rasters.split_first() {
            for &other in others {
                same::same_crs(first, other)?;
                same::same_unit(first, other)?;
            }
        }
        let lattice = lattice::of(&rasters, limits)?;
        let scales = Scales::of(&rasters);
        let infos = || pieces.iter().map(|piece| &piece.info);
        let sample_type = match scales {
            Scales::Same(..) => narrowest(infos().map(|info| info.sample_type)),
            Scales::Different => SampleType::Float64,
        };
        let nodata: Vec<Option<f64>> = infos().map(|info| effective_nodata(info, options)).collect();
        // Only if no member has a valid sample that this value would make void in the common type.
        let alike =
            |value: &f64| infos().all(|info| Nodata::is_alike(Some(*value), info.sample_type, sample_type));
        let common = common_nodata(&nodata).filter(|_| scales != Scales::Different).filter(alike);
        let (band_scale, band_offset) =
            if let Scales::Same(scale, offset) = scales { (scale, offset) } else { (1.0, 0.0) };
        let mut warnings = warn::joined(infos().map(|info| &info.warnings[..]));
        warnings.extend(lattice::far_apart(&lattice, &rasters));
        let crs = infos().next().map(|info| info.geo.crs.clone()).unwrap_or_default();
        let info = SourceInfo {
            width: lattice.width,
            height: lattice.height,
            sample_type,
            nodata: common,
            band_scale,
            band_offset,
            vertical_unit: vertical_unit(infos()),
            geo: Geo {
                transform: Some(lattice.transform),
                pixel_is_point: infos().all(|info| info.geo.pixel_is_point),
                crs,
            },
            description: format!(
                "mosaic of {} files, {}: {}",
                pieces.len(),
                options.overlap.words(),
                kinds(infos())
            ),
            parts: parts(infos()),
            footprint: None,
            overlap: None,
            block_rows: infos().map(|info| info.block_rows).max().unwrap_or(1),
            reading: reading(sample_type, options.overlap, infos()),
            warnings,
            origins: origins(&pieces, options),
        };
        let members = pieces.into_iter().zip(lattice.rects).zip(nodata).map(|((piece, rect), nodata)| {
            let own = (piece.info.band_scale, piece.info.band_offset);
            let scaled = Scaled { ratio: own.0, offset: own.1, single: false };
            member(piece, rect, (0, 0), nodata, (scales == Scales::Different).then_some(scaled))
        });
        let members = members.collect();
        let overlap = options.overlap;
        Ok(Self::assemble(Assembly { info, members, overlap, nodata_of_all: false, beside: Vec::new() }))
    }
}

/// Memory for reading a mosaic: samples, validity and sums, and members read ahead.
pub(crate) fn reading<'a>(
    sample_type: SampleType,
    overlap: Overlap,
    infos: impl Iterator<Item = &'a SourceInfo>,
) -> ReadMemory {
    // A sum and a count, with padding.
    let sums = if overlap == Overlap::Mean { 16 } else { 0 };
    let members = infos.map(|info| info.reading).fold(ReadMemory::default(), ReadMemory::or);
    let sample =
        (sample_type.bytes() as u64 + 1 + sums).saturating_add(members.sample.saturating_mul(AHEAD as u64));
    ReadMemory { sample, ..members }
}

/// Origins of the properties of all pieces.
fn origins(pieces: &[Piece], options: &OpenOptions) -> Origins {
    let mut joined = Origins::joined(pieces.iter().map(|piece| &piece.info.origins));
    if options.nodata.is_some() {
        joined.nodata = Some(Origin::User);
    }
    joined
}

/// A piece as a member at its place.
pub(crate) fn member(
    piece: Piece,
    rect: Rect,
    origin: (u32, u32),
    nodata: Option<f64>,
    scaled: Option<Scaled>,
) -> Member {
    let info = &piece.info;
    // Only if every void of the piece is void in the mosaic.
    let own = info.footprint.as_ref().filter(|_| info.nodata.is_none() || info.nodata == nodata);
    let shifted = |own: &Rect| {
        let inside = own.within(
            &(origin.0..origin.0 + rect.columns.len() as u32),
            &(origin.1..origin.1 + rect.rows.len() as u32),
        );
        let (right, down) = (rect.columns.start, rect.rows.start);
        let place = Rect {
            columns: inside.columns.start - origin.0 + right..inside.columns.end - origin.0 + right,
            rows: inside.rows.start - origin.1 + down..inside.rows.end - origin.1 + down,
        };
        (place.area() > 0).then_some(place)
    };
    let footprint = own.map_or_else(|| vec![rect.clone()], |own| own.iter().filter_map(shifted).collect());
    Member {
        size: (info.width, info.height),
        sample_type: info.sample_type,
        path: piece.path,
        rect,
        origin,
        nodata,
        voids: Nodata::new(nodata, info.sample_type),
        scaled,
        footprint,
        files: piece.files,
        held: piece.held,
    }
}

/// GDAL scale and offset of all pieces.
#[derive(Clone, Copy, PartialEq)]
enum Scales {
    Same(f64, f64),
    Different,
}

impl Scales {
    fn of(rasters: &[(&Path, &SourceInfo)]) -> Self {
        let mut all = rasters.iter().map(|(_, info)| (info.band_scale, info.band_offset));
        let (scale, offset) = all.next().unwrap_or((1.0, 0.0));
        if all.all(|other| other == (scale, offset)) { Self::Same(scale, offset) } else { Self::Different }
    }
}

/// The narrowest type that holds every sample of several types exactly.
pub(crate) fn narrowest(kinds: impl Iterator<Item = SampleType> + Clone) -> SampleType {
    let all = |&wide: &SampleType| kinds.clone().all(|kind| canvas::holds_all(wide, kind));
    SampleType::ALL.into_iter().find(all).unwrap_or(SampleType::Float64)
}

/// The nodata value of a raster as rounded to its sample type.
fn effective_nodata(info: &SourceInfo, options: &OpenOptions) -> Option<f64> {
    options.nodata.map(|value| metadata::rounded(value, info.sample_type)).or(info.nodata)
}

/// The nodata value that all share; NaN is void without it.
pub(crate) fn common_nodata(all: &[Option<f64>]) -> Option<f64> {
    let first = all.first().copied().flatten().filter(|value| !value.is_nan())?;
    all.iter().all(|other| *other == Some(first)).then_some(first)
}

/// Metres and name of the vertical unit: of the first raster that names it, as all agree.
pub(crate) fn vertical_unit<'a>(mut infos: impl Iterator<Item = &'a SourceInfo> + Clone) -> (f64, String) {
    let first = infos.clone().next().map(|info| info.vertical_unit.clone());
    let named = infos.find(|info| !info.vertical_unit.1.is_empty()).map(|info| info.vertical_unit.clone());
    named.or(first).unwrap_or((1.0, String::new()))
}

/// The files of all rasters.
pub(crate) fn parts<'a>(infos: impl Iterator<Item = &'a SourceInfo>) -> Vec<Part> {
    infos.flat_map(|info| info.parts.iter().cloned()).collect()
}

/// A description of all rasters: that of the first, and the number of those that differ.
pub(crate) fn kinds<'a>(mut infos: impl Iterator<Item = &'a SourceInfo>) -> String {
    let first = infos.next().map(|info| info.description.clone()).unwrap_or_default();
    match infos.filter(|info| info.description != first).count() {
        0 => first,
        others => format!("{first}, and {others} more"),
    }
}
