//! GDAL's virtual rasters, read natively: files side by side or overlapping, sample for sample.
//!
//! Supported are bands with simple and complex sources without resampling, their nodata, ratio and
//! offset, and VRTs within VRTs. Anything else is [`Error::Unsupported`], and left to GDAL if it is
//! built in: an unknown element or attribute is refused by name. Files on a network are refused
//! even with GDAL, see `remote`.
//!
//! Samples equal GDAL's wherever GDAL has a valid one, except where no source lies: void here, but
//! 0 in GDAL if the band has no nodata value. The VRT decides what is void: `NODATA` of a complex
//! source and `NoDataValue` of the band, not the nodata value of a file itself; samples masked out
//! in a file are void as well. A void never hides a valid sample of an earlier source, while in
//! GDAL it does if it comes from a simple source.

mod known;
mod remote;
mod srs;
mod xml;

use std::collections::BTreeSet;
use std::io::Read;
use std::path::Path;

#[cfg(feature = "gdal")]
pub(super) use self::remote::check as check_remote;
use self::xml::{Vrt, VrtSource, unsupported};
use super::mosaic::{self, Assembly, Member, Mosaic, Piece, Rule, Scaled};
use super::open::Nest;
use super::{Nodata, Origin, Origins, Overlap, Rect, SourceInfo, file_name, gzip, metadata, warn};
use crate::error::{Error, Result};
use crate::geo::Geo;
use crate::limits::Limits;
use crate::sample::SampleType;

/// Deepest nesting of VRTs.
const DEPTH: u32 = 8;
/// Largest distance, in pixels, of a source from whole pixels: rounding of world coordinates.
const WHOLE: f64 = 0.01;

/// Opens a VRT; `nodata` replaces the nodata value of every file that the VRT gives.
pub(super) fn open(path: &Path, nodata: Option<f64>, nest: &Nest) -> Result<Mosaic> {
    open_inner(path, nodata, nest).map_err(|error| error.at(path))
}

fn open_inner(path: &Path, nodata: Option<f64>, nest: &Nest) -> Result<Mosaic> {
    if nest.depth == DEPTH {
        return Err(too_deep());
    }
    let text = text(path, nest.limits)?;
    let mut vrt = xml::read(&text, path, nest.band, nest.limits)?;
    let sources = std::mem::take(&mut vrt.sources);
    let mut pieces: Vec<(Piece, VrtSource)> = Vec::with_capacity(sources.len());
    let inner = Nest { depth: nest.depth + 1, ..*nest };
    for mut source in sources {
        nest.count()?;
        // The VRT chooses the band of each file.
        let inner = Nest { band: Some(source.band), ..inner };
        let piece = super::open::piece(&source.path, nodata, &inner)?;
        // Only the mask counts if there is one; for a file without a mask its nodata value is the
        // mask.
        let own = if vrt.masked { piece.info.nodata } else { source.nodata };
        source.nodata = nodata.or(own);
        pieces.push((piece, source));
        let (piece, first) = (&pieces[pieces.len() - 1].0, &pieces[0].0);
        mosaic::same_crs((&first.path, &first.info), (&piece.path, &piece.info))?;
    }
    let hidden = vrt.nodata.filter(|_| vrt.masked);
    vrt.nodata = nodata
        .or(vrt.nodata.filter(|_| !vrt.masked))
        .map(|value| metadata::rounded(value, vrt.sample_type))
        .filter(|value| !value.is_nan());
    let mut info = describe(path, &vrt, &pieces)?;
    info.warnings.extend(hidden.map(|value| warn::mask_and_nodata(path, value)));
    let mut members = Vec::with_capacity(pieces.len());
    for (piece, source) in pieces {
        members.extend(member(piece, &source, &vrt)?);
    }
    let nodata_of_all = info.nodata.is_some();
    if !nodata_of_all && members.iter().all(|member| member.scaled.is_none()) {
        let all: Vec<Option<f64>> = members.iter().map(|member| member.nodata).collect();
        let kinds = || members.iter().map(|member| member.sample_type);
        let alike = |value: &f64| kinds().all(|kind| Nodata::is_alike(Some(*value), kind, info.sample_type));
        info.nodata = mosaic::common_nodata(&all).filter(alike);
    }
    let overlap = Overlap::Last;
    Ok(Mosaic::assemble(Assembly { info, members, overlap, nodata_of_all, beside: vec![path.to_owned()] }))
}

/// True if a file that begins with these bytes is a VRT.
pub(super) fn is_vrt(start: &[u8]) -> bool {
    let text = start.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(start).trim_ascii_start();
    text.first() == Some(&b'<') && text.windows(11).any(|word| word == b"<VRTDataset")
}

fn too_deep() -> Error {
    let got = "one more (does it contain itself?)";
    Error::format("VRT", format!("at most {DEPTH} within one another"), got)
}

/// The content of a file that is not too long.
fn text(path: &Path, limits: &Limits) -> Result<String> {
    let mut bytes = Vec::new();
    let from = gzip::stream(path)?.0;
    let read = from.take(limits.vrt_bytes + 1).read_to_end(&mut bytes);
    read.map_err(|error| gzip::read_error(path, error))?;
    if bytes.len() as u64 > limits.vrt_bytes {
        return Err(Error::limit("the length of the VRT in bytes", bytes.len() as u64, limits.vrt_bytes));
    }
    String::from_utf8(bytes).map_err(|error| Error::format("XML", "UTF-8", error))
}

/// The properties of a VRT; those that it does not give come from its sources.
fn describe(path: &Path, vrt: &Vrt, pieces: &[(Piece, VrtSource)]) -> Result<SourceInfo> {
    let infos = || pieces.iter().map(|(piece, _)| &piece.info);
    let mut seen = BTreeSet::new();
    let distinct: Vec<&SourceInfo> =
        pieces.iter().filter(|(piece, _)| seen.insert(&piece.path)).map(|(piece, _)| &piece.info).collect();
    let (first, _) = &pieces[0];
    let scaled = pieces.iter().any(|(_, source)| source.scaled.is_some());
    let (band_scale, band_offset) = match (vrt.scale, vrt.offset) {
        (None, None) if !scaled => common_scale(pieces)?,
        (scale, offset) => (scale.unwrap_or(1.0), offset.unwrap_or(0.0)),
    };
    metadata::check_scale(band_scale, band_offset)?;
    let vertical_unit = match &vrt.unit {
        Some(unit) if !unit.is_empty() => {
            let said = metadata::vertical_unit(Some(unit), None);
            // If the unit is the same, its name in the files is used.
            let own = mosaic::vertical_unit(infos());
            if own.0 == said.0 && !own.1.is_empty() { own } else { said }
        }
        _ if scaled => (1.0, String::new()),
        _ => {
            for (piece, _) in pieces {
                mosaic::same_unit((&first.path, &first.info), (&piece.path, &piece.info))?;
            }
            mosaic::vertical_unit(infos())
        }
    };
    let geo = Geo {
        transform: vrt.transform,
        pixel_is_point: vrt.pixel_is_point.unwrap_or_else(|| infos().all(|info| info.geo.pixel_is_point)),
        crs: srs::resolve(vrt.srs.as_deref(), &first.info.geo.crs)?,
    };
    let mut warnings = warn::joined(distinct.iter().map(|info| &info.warnings[..]));
    if !vrt.chosen {
        warnings.extend(warn::odd_band(path, vrt.bands, vrt.sample_type, vrt.colours));
    }
    let (count, kinds) = (distinct.len(), mosaic::kinds(distinct.iter().copied()));
    let description = match count {
        1 => format!("VRT of one file: {kinds}"),
        _ => format!("VRT mosaic of {count} files, {}: {kinds}", Overlap::Last.words()),
    };
    Ok(SourceInfo {
        width: vrt.width,
        height: vrt.height,
        sample_type: vrt.sample_type,
        nodata: vrt.nodata,
        band_scale,
        band_offset,
        vertical_unit,
        geo,
        description,
        parts: mosaic::parts(distinct.into_iter()),
        footprint: None,
        overlap: None,
        block_rows: infos().map(|info| info.block_rows).max().unwrap_or(1),
        reading: mosaic::reading(vrt.sample_type, Overlap::Last, infos()),
        warnings,
        origins: origins(vrt, pieces, path),
    })
}

/// Origins of the properties: the VRT or its sources.
fn origins(vrt: &Vrt, pieces: &[(Piece, VrtSource)], path: &Path) -> Origins {
    let scaled = pieces.iter().any(|(_, source)| source.scaled.is_some());
    let of_sources = Origins::joined(pieces.iter().map(|(piece, _)| &piece.info.origins));
    let or = |says: bool, other: Option<Origin>| {
        if says { Some(Origin::Vrt(file_name(path))) } else { other }
    };
    let has_scale = vrt.scale.is_some() || vrt.offset.is_some();
    let has_unit = vrt.unit.as_ref().is_some_and(|unit| !unit.is_empty());
    Origins {
        place: or(vrt.transform.is_some(), None),
        crs: or(vrt.srs.is_some(), of_sources.crs),
        nodata: or(vrt.nodata.is_some(), of_sources.nodata),
        unit: or(has_unit, of_sources.unit.filter(|_| !scaled)),
        scale: or(has_scale, of_sources.scale.filter(|_| !scaled)),
        offset: or(has_scale, of_sources.offset.filter(|_| !scaled)),
        mask: of_sources.mask,
    }
}

/// The common GDAL scale and offset of all sources, which the VRT does not give.
fn common_scale(pieces: &[(Piece, VrtSource)]) -> Result<(f64, f64)> {
    let scale = |piece: &Piece| (piece.info.band_scale, piece.info.band_offset);
    let (first, _) = &pieces[0];
    match pieces.iter().find(|(piece, _)| scale(piece) != scale(first)) {
        None => Ok(scale(first)),
        Some((other, _)) => Err(Error::usage(format!(
            "{}: scale and offset of its samples are {:?}, those of {} {:?}, and the VRT says nothing of them; \
             give the files themselves, which are brought together then",
            other.path.display(),
            scale(other),
            first.path.display(),
            scale(first)
        ))),
    }
}

/// A source as a member at its place; `None` if no part of it lies in the VRT.
fn member(piece: Piece, source: &VrtSource, vrt: &Vrt) -> Result<Option<Member>> {
    let info = &piece.info;
    let (kind, band) = (info.sample_type, vrt.sample_type);
    // GDAL computes in float32 unless the band type needs more.
    let single = !matches!(band, SampleType::Int32 | SampleType::Uint32 | SampleType::Float64);
    let computed = if single { SampleType::Float32 } else { SampleType::Float64 };
    let into = if source.scaled.is_some() { computed } else { band };
    if !mosaic::holds_all(into, kind) {
        let what =
            format!("{} samples of {} as {}", kind.gdal_name(), piece.path.display(), band.gdal_name());
        return Err(unsupported(what));
    }
    let Some((rect, origin)) = place(source, (info.width, info.height), (vrt.width, vrt.height))? else {
        return Ok(None);
    };
    // GDAL compares integers of a source unrounded: none equals -9999.5.
    let told = source.nodata.filter(|value| kind.is_float() || value.fract() == 0.0);
    let nodata = told.map(|value| metadata::rounded(value, kind));
    let scaled = source.scaled.map(|(ratio, offset)| Scaled { ratio, offset, single });
    Ok(Some(mosaic::member(piece, rect, origin, nodata, scaled)))
}

/// The rectangle of a source in the VRT, and its first column and row: both rectangles of the
/// source, cut to the rasters.
fn place(source: &VrtSource, own: (u32, u32), all: (u32, u32)) -> Result<Option<(Rect, (u32, u32))>> {
    let whole = |size: (u32, u32)| [0.0, 0.0, f64::from(size.0), f64::from(size.1)];
    let [x0, y0, width, height] = integers(source.from.unwrap_or(whole(own)))?;
    let [x1, y1, to_width, to_height] = integers(source.to.unwrap_or(whole(all)))?;
    if (width, height) != (to_width, to_height) {
        return Err(unsupported(format!(
            "{} resampled from {width} x {height} to {to_width} x {to_height} samples",
            source.path.display()
        )));
    }
    let columns = cut(x0, x1, width, own.0, all.0);
    let rows = cut(y0, y1, height, own.1, all.1);
    Ok(columns.zip(rows).map(|((x0, columns), (y0, rows))| (Rect { columns, rows }, (x0, y0))))
}

/// A run of samples from `from` to `to`, cut to two lengths.
fn cut(from: i64, to: i64, count: i64, own: u32, all: u32) -> Option<(u32, std::ops::Range<u32>)> {
    let skip = (-from).max(-to).max(0);
    let (from, to) = (from + skip, to + skip);
    let count = (count - skip).min(i64::from(own) - from).min(i64::from(all) - to);
    (count > 0).then(|| (from as u32, to as u32..(to + count) as u32))
}

/// A rectangle in whole samples.
fn integers(rect: [f64; 4]) -> Result<[i64; 4]> {
    let far = f64::from(u32::MAX);
    if rect.iter().any(|side| (side - side.round()).abs() > WHOLE || side.abs() > far) {
        return Err(unsupported(format!("a source at parts of samples, {rect:?}")));
    }
    Ok(rect.map(|side| side.round() as i64))
}
