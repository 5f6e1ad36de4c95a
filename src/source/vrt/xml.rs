//! Parses the XML of a `.vrt` and checks the form of every number; `vrt` interprets it.

use std::path::{Path, PathBuf};

use roxmltree::Node;

use super::{known, remote};
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::sample::SampleType;
use crate::source::open::NEEDS_GDAL;
use crate::source::tiff::no_band;
use crate::source::{markup, metadata};

/// A VRT with one of its bands.
#[derive(Debug, PartialEq)]
pub(super) struct Vrt {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) srs: Option<String>,
    pub(super) transform: Option<[f64; 6]>,
    pub(super) pixel_is_point: Option<bool>,
    pub(super) sample_type: SampleType,
    /// Number of bands other than alpha.
    pub(super) bands: u32,
    /// True if the user or an outer VRT chose the band.
    pub(super) chosen: bool,
    /// True if the masks of the sources give validity.
    pub(super) masked: bool,
    /// The colour of the band, if it is one.
    pub(super) colours: Option<&'static str>,
    pub(super) nodata: Option<f64>,
    pub(super) unit: Option<String>,
    pub(super) scale: Option<f64>,
    pub(super) offset: Option<f64>,
    pub(super) sources: Vec<VrtSource>,
}

/// A file in the band.
#[derive(Debug, PartialEq)]
pub(super) struct VrtSource {
    pub(super) path: PathBuf,
    /// Column, row, width and height in the file; `None`: all of it.
    pub(super) from: Option<[f64; 4]>,
    /// The destination in the VRT; `None`: all of it.
    pub(super) to: Option<[f64; 4]>,
    pub(super) nodata: Option<f64>,
    /// Band of the file, from 1.
    pub(super) band: u32,
    /// Factor and summand.
    pub(super) scaled: Option<(f64, f64)>,
}

/// The error for a feature that only GDAL reads.
pub(super) fn unsupported(what: impl Into<String>) -> Error {
    Error::unsupported(what, NEEDS_GDAL)
}

/// Parses the text of the VRT at `path`.
pub(super) fn read(text: &str, path: &Path, band: Option<u32>, limits: &Limits) -> Result<Vrt> {
    let document = markup::parse(text)?;
    let root = document.root_element();
    if root.tag_name().name() != "VRTDataset" {
        return Err(Error::format("XML", "a VRTDataset", format!("a {}", root.tag_name().name())));
    }
    if let Some(class) = root.attribute("subClass") {
        return Err(unsupported(format!("a VRT of the class {class}")));
    }
    known::dataset(root)?;
    let bands = || root.children().filter(|node| node.has_tag_name("VRTRasterBand"));
    // Bands are numbered by their order, as in GDAL.
    let count = bands().count() as u32;
    let at = band.unwrap_or(1).wrapping_sub(1);
    let chosen = band.is_some();
    let band = bands().nth(at as usize).ok_or_else(|| match count {
        0 => Error::format("VRTDataset", "a VRTRasterBand", "none"),
        _ => no_band(at, count),
    })?;
    let role = |band: Node| child(band, "ColorInterp").map_or("", |node| text_of(node).trim()).to_lowercase();
    let alphas = bands().filter(|&band| role(band) == "alpha").count() as u32;
    let colours = match role(band).as_str() {
        "red" | "green" | "blue" => Some("RGB"),
        "palette" => Some("palette"),
        _ => None,
    };
    check_band(band)?;
    check_alpha(bands().collect(), band)?;
    let mask = child(root, "MaskBand");
    if mask.is_some_and(|mask| !is_mask_of(mask, band)) {
        return Err(unsupported("a VRT with a mask that is not that of its sources"));
    }
    let name = band.attribute("dataType").unwrap_or("Byte");
    let sample_type = SampleType::ALL
        .into_iter()
        .find(|kind| kind.gdal_name() == name)
        .ok_or_else(|| unsupported(format!("a VRT of {name} samples")))?;
    let transform = child(root, "GeoTransform").map(|node| numbers::<6>(node, text_of(node).split(',')));
    Ok(Vrt {
        width: side(root, "rasterXSize", limits)?,
        height: side(root, "rasterYSize", limits)?,
        srs: child(root, "SRS").map(|node| text_of(node).trim().to_owned()).filter(|srs| !srs.is_empty()),
        transform: transform.transpose()?,
        pixel_is_point: pixel_is_point(root),
        sample_type,
        bands: count - alphas,
        chosen,
        masked: mask.is_some(),
        colours,
        nodata: nodata(band, "NoDataValue")?,
        unit: child(band, "UnitType").map(|node| text_of(node).trim().to_owned()),
        scale: number(band, "Scale")?,
        offset: number(band, "Offset")?,
        sources: sources(band, path)?,
    })
}

/// True if a mask consists of the masks of a band's sources, at their places, as `gdal_translate`
/// writes it.
fn is_mask_of(mask: Node, band: Node) -> bool {
    fn sources<'a, 'i>(band: Node<'a, 'i>) -> impl Iterator<Item = Node<'a, 'i>> {
        band.children().filter(|node| node.tag_name().name().ends_with("Source"))
    }
    let same = |(own, of): (Node, Node)| {
        let part = |node: Node, name: &str| {
            child(node, name).map(|part| {
                let attributes = part.attributes().map(|a| (a.name().to_owned(), a.value().to_owned()));
                (text_of(part).trim().to_owned(), attributes.collect::<Vec<_>>())
            })
        };
        let parts = ["SourceFilename", "SrcRect", "DstRect"];
        own.has_tag_name("SimpleSource")
            && child(own, "SourceBand").is_some_and(|node| text_of(node).trim().starts_with("mask"))
            && parts.into_iter().all(|name| part(own, name) == part(of, name))
    };
    let Some(mask) = child(mask, "VRTRasterBand") else { return false };
    check_band(mask).is_ok()
        && sources(mask).count() == sources(band).count()
        && sources(mask).zip(sources(band)).all(same)
}

/// Refuses features that give a band more than its sources.
fn check_band(band: Node) -> Result<()> {
    if let Some(class) = band.attribute("subClass") {
        return Err(unsupported(format!("a VRT band of the class {class}")));
    }
    for hidden in ["MaskBand", "HideNoDataValue", "PixelFunctionType"] {
        if child(band, hidden).is_some_and(|node| text_of(node).trim() != "0") {
            return Err(unsupported(format!("a VRT band with {hidden}")));
        }
    }
    known::band(band)?;
    let signed = |node: &Node| node.attribute("key") == Some("PIXELTYPE");
    if band.descendants().any(|node| signed(&node)) {
        return Err(unsupported("a VRT band of signed bytes in the old way"));
    }
    Ok(())
}

/// Refuses a VRT whose last band gives validity of the first in GDAL: an alpha band behind one or
/// three others, unless the first one has a nodata value.
fn check_alpha(bands: Vec<Node>, first: Node) -> Result<()> {
    let is_alpha =
        |band: &Node| child(*band, "ColorInterp").is_some_and(|node| text_of(node).trim() == "Alpha");
    let decides = matches!(bands.len(), 2 | 4) && child(first, "NoDataValue").is_none();
    match bands.last().filter(|band| decides && is_alpha(band)) {
        Some(_) => Err(unsupported("a VRT with an alpha band")),
        None => Ok(()),
    }
}

fn sources(band: Node, path: &Path) -> Result<Vec<VrtSource>> {
    let mut found = Vec::new();
    for node in band.children().filter(Node::is_element) {
        match node.tag_name().name() {
            kind @ ("SimpleSource" | "ComplexSource") => {
                found.push(source(node, kind == "ComplexSource", path)?);
            }
            kind if kind.to_ascii_lowercase().ends_with("source") => {
                return Err(unsupported(format!("a VRT with a {kind}")));
            }
            _ => {}
        }
    }
    if found.is_empty() {
        return Err(Error::format(place(band), "at least one source", "none"));
    }
    Ok(found)
}

fn source(node: Node, complex: bool, vrt: &Path) -> Result<VrtSource> {
    let file = child(node, "SourceFilename");
    let file = file.ok_or_else(|| Error::format(place(node), "a SourceFilename", "none"))?;
    let name = text_of(file);
    if remote::is_remote(name) {
        return Err(remote::refusal(vrt, name));
    }
    if name.starts_with("/vsi") {
        return Err(unsupported(format!("a source of GDAL's own kind of path, {name}")));
    }
    known::source(node)?;
    let relative = file.attribute("relativeToVRT").is_some_and(|word| word.trim() == "1");
    let folder = vrt.parent().filter(|_| relative).unwrap_or(Path::new(""));
    let band = child(node, "SourceBand").map_or("1", |node| text_of(node).trim());
    let Some(band) = band.parse().ok().filter(|&band| band > 0) else {
        return Err(unsupported(format!("a source that is band {band:?} of {name}")));
    };
    let masked = child(node, "UseMaskBand").map(text_of).unwrap_or_default().trim().to_ascii_lowercase();
    if complex && !matches!(masked.as_str(), "" | "0" | "no" | "false" | "off") {
        return Err(unsupported("a source with UseMaskBand"));
    }
    let (offset, ratio) = (number(node, "ScaleOffset")?, number(node, "ScaleRatio")?);
    let scaled = (ratio.unwrap_or(1.0), offset.unwrap_or(0.0));
    Ok(VrtSource {
        path: folder.join(name),
        band,
        from: rectangle(node, "SrcRect")?,
        to: rectangle(node, "DstRect")?,
        nodata: if complex { nodata(node, "NODATA")? } else { None },
        scaled: (complex && scaled != (1.0, 0.0)).then_some(scaled),
    })
}

fn rectangle(node: Node, name: &str) -> Result<Option<[f64; 4]>> {
    let Some(rect) = child(node, name) else { return Ok(None) };
    let sides = ["xOff", "yOff", "xSize", "ySize"].map(|side| rect.attribute(side).unwrap_or_default());
    numbers(rect, sides.into_iter()).map(Some)
}

fn pixel_is_point(root: Node) -> Option<bool> {
    let metadata =
        root.children().filter(|node| node.has_tag_name("Metadata") && !node.has_attribute("domain"));
    let item = metadata
        .flat_map(|node| node.children())
        .find(|node| node.attribute("key") == Some("AREA_OR_POINT"))?;
    Some(text_of(item).trim() == "Point")
}

fn side(root: Node, name: &str, limits: &Limits) -> Result<u32> {
    let text = root.attribute(name).unwrap_or_default();
    let side: u64 =
        text.trim().parse().map_err(|_| Error::format(name, "a number of samples", quoted(text)))?;
    match u32::try_from(side) {
        Ok(0) => Err(Error::format(name, "at least 1", 0)),
        Ok(own) if side <= limits.raster_side => Ok(own),
        _ => Err(Error::limit(name, side, limits.raster_side)),
    }
}

fn child<'a, 'input>(node: Node<'a, 'input>, name: &str) -> Option<Node<'a, 'input>> {
    node.children().find(|child| child.has_tag_name(name))
}

fn text_of<'a>(node: Node<'a, '_>) -> &'a str {
    node.text().unwrap_or_default()
}

fn number(node: Node, name: &str) -> Result<Option<f64>> {
    let Some(node) = child(node, name) else { return Ok(None) };
    numbers::<1>(node, std::iter::once(text_of(node))).map(|[number]| Some(number))
}

/// A number that may be NaN.
fn nodata(node: Node, name: &str) -> Result<Option<f64>> {
    let Some(node) = child(node, name) else { return Ok(None) };
    let text = text_of(node);
    let number = metadata::number(text);
    number.map(Some).ok_or_else(|| Error::format(place(node), "a number", quoted(text)))
}

/// `N` finite numbers.
fn numbers<'t, const N: usize>(node: Node, mut texts: impl Iterator<Item = &'t str>) -> Result<[f64; N]> {
    let mut all = [0.0; N];
    for number in &mut all {
        let text = texts.next().unwrap_or_default();
        *number = text
            .trim()
            .parse()
            .ok()
            .filter(|number: &f64| number.is_finite())
            .ok_or_else(|| Error::format(place(node), format!("{N} number(s)"), quoted(text)))?;
    }
    Ok(all)
}

/// An element and its line.
fn place(node: Node) -> String {
    let line = node.document().text_pos_at(node.range().start).row;
    format!("{} in line {line}", node.tag_name().name())
}

/// A text from a file, shortened.
fn quoted(text: &str) -> String {
    format!("{:?}", text.chars().take(40).collect::<String>())
}
