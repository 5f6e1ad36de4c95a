//! The XML of a `.vrt` to what it says, every number checked for its form; what it means is `vrt`'s.

use std::path::{Path, PathBuf};

use roxmltree::{Document, Node, ParsingOptions};

use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::sample::SampleType;
use crate::source::metadata;
use crate::source::open::NEEDS_GDAL;

/// A VRT with its first band.
#[derive(Debug, PartialEq)]
pub(super) struct Vrt {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) srs: Option<String>,
    pub(super) transform: Option<[f64; 6]>,
    pub(super) pixel_is_point: Option<bool>,
    pub(super) sample_type: SampleType,
    pub(super) nodata: Option<f64>,
    pub(super) unit: Option<String>,
    pub(super) scale: Option<f64>,
    pub(super) offset: Option<f64>,
    pub(super) sources: Vec<VrtSource>,
}

/// A file of the band.
#[derive(Debug, PartialEq)]
pub(super) struct VrtSource {
    pub(super) path: PathBuf,
    /// Column, row, width and height in the file; all of it if absent.
    pub(super) from: Option<[f64; 4]>,
    /// Where that goes in the VRT; everywhere if absent.
    pub(super) to: Option<[f64; 4]>,
    pub(super) nodata: Option<f64>,
    /// Factor and summand.
    pub(super) scaled: Option<(f64, f64)>,
}

/// Something that only GDAL reads.
pub(super) fn unsupported(what: impl Into<String>) -> Error {
    Error::unsupported(what, NEEDS_GDAL)
}

/// Reads the text of the VRT at a path.
pub(super) fn read(text: &str, path: &Path, limits: &Limits) -> Result<Vrt> {
    let options = ParsingOptions {
        nodes_limit: u32::try_from(limits.vrt_bytes).unwrap_or(u32::MAX),
        ..ParsingOptions::default()
    };
    let document = Document::parse_with_options(text, options)
        .map_err(|error| Error::format("XML", "a well-formed document", error))?;
    let root = document.root_element();
    if root.tag_name().name() != "VRTDataset" {
        return Err(Error::format("XML", "a VRTDataset", format!("a {}", root.tag_name().name())));
    }
    if let Some(class) = root.attribute("subClass") {
        return Err(unsupported(format!("a VRT of the class {class}")));
    }
    if child(root, "MaskBand").is_some() {
        return Err(unsupported("a VRT with a mask of its own"));
    }
    let bands = || root.children().filter(|node| node.has_tag_name("VRTRasterBand"));
    let first = bands().find(|band| band.attribute("band") == Some("1")).or_else(|| bands().next());
    let band = first.ok_or_else(|| Error::format("VRTDataset", "a VRTRasterBand", "none"))?;
    check_band(band)?;
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
        nodata: nodata(band, "NoDataValue")?,
        unit: child(band, "UnitType").map(|node| text_of(node).trim().to_owned()),
        scale: number(band, "Scale")?,
        offset: number(band, "Offset")?,
        sources: sources(band, path)?,
    })
}

/// Refuses what makes a band more than its sources.
fn check_band(band: Node) -> Result<()> {
    if let Some(class) = band.attribute("subClass") {
        return Err(unsupported(format!("a VRT band of the class {class}")));
    }
    for hidden in ["MaskBand", "HideNoDataValue", "PixelFunctionType"] {
        if child(band, hidden).is_some_and(|node| text_of(node).trim() != "0") {
            return Err(unsupported(format!("a VRT band with {hidden}")));
        }
    }
    let signed = |node: &Node| node.attribute("key") == Some("PIXELTYPE");
    if band.descendants().any(|node| signed(&node)) {
        return Err(unsupported("a VRT band of signed bytes in the old way"));
    }
    Ok(())
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
    if name.starts_with("/vsi") || name.contains("://") {
        return Err(unsupported(format!("a source of GDAL's own kind of path, {name}")));
    }
    let relative = file.attribute("relativeToVRT").is_some_and(|word| word.trim() == "1");
    let folder = vrt.parent().filter(|_| relative).unwrap_or(Path::new(""));
    if let Some(other) =
        child(node, "SourceBand").map(|node| text_of(node).trim()).filter(|&band| band != "1")
    {
        return Err(unsupported(format!("a source that is band {other} of {name}")));
    }
    let refused = ["OpenOptions", "LUT", "Exponent", "ColorTableComponent"];
    if let Some(what) = refused.into_iter().find(|what| child(node, what).is_some()) {
        return Err(unsupported(format!("a source with {what}")));
    }
    let (offset, ratio) = (number(node, "ScaleOffset")?, number(node, "ScaleRatio")?);
    let scaled = (ratio.unwrap_or(1.0), offset.unwrap_or(0.0));
    Ok(VrtSource {
        path: folder.join(name),
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

/// A value that may be NaN.
fn nodata(node: Node, name: &str) -> Result<Option<f64>> {
    let Some(node) = child(node, name) else { return Ok(None) };
    let text = text_of(node);
    let number = metadata::number(text);
    number.map(Some).ok_or_else(|| Error::format(place(node), "a number", quoted(text)))
}

/// So many finite numbers.
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

/// A text out of a file, cut short.
fn quoted(text: &str) -> String {
    format!("{:?}", text.chars().take(40).collect::<String>())
}
