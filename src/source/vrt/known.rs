//! The elements and attributes of a VRT that are understood; any other is refused by name.
//!
//! GDAL ignores elements that it does not know, but it knows more than are read here, and newer
//! versions know even more: each may make samples void, scaled or resampled. Listed are the
//! elements that are read (see `xml`), and those that change neither samples of band 1 nor their
//! place.

use roxmltree::Node;

use super::xml::unsupported;
use crate::error::Result;

/// Elements of a `VRTDataset`; control points give no grid, overviews and block sizes only affect
/// speed.
const DATASET: [&str; 8] =
    ["SRS", "GeoTransform", "Metadata", "GCPList", "OverviewList", "BlockXSize", "BlockYSize", "MaskBand"];
/// Elements of a band; names, colours and statistics are for people.
const BAND: [&str; 13] = [
    "NoDataValue",
    "HideNoDataValue",
    "UnitType",
    "Scale",
    "Offset",
    "Description",
    "Metadata",
    "Histograms",
    "CategoryNames",
    "ColorInterp",
    "ColorTable",
    "Overview",
    "PixelFunctionType",
];
/// Elements of a source; its properties only allow opening it late.
const SOURCE: [&str; 5] = ["SourceFilename", "SourceBand", "SourceProperties", "SrcRect", "DstRect"];
/// More elements of a complex source; GDAL ignores them in a simple one.
const COMPLEX: [&str; 4] = ["NODATA", "ScaleOffset", "ScaleRatio", "UseMaskBand"];

/// Checks the dataset element, but not its bands.
pub(super) fn dataset(root: Node) -> Result<()> {
    attributes(root, &["rasterXSize", "rasterYSize", "subClass"])?;
    elements(root, |name| name == "VRTRasterBand" || DATASET.contains(&name))?;
    let metadata =
        root.children().filter(|node| node.has_tag_name("Metadata")).flat_map(|node| node.children());
    if metadata.into_iter().any(|item| item.attribute("key") == Some("NODATA_VALUES")) {
        return Err(unsupported("a VRT with NODATA_VALUES"));
    }
    Ok(())
}

/// Checks a band, but not its sources.
pub(super) fn band(band: Node) -> Result<()> {
    attributes(band, &["dataType", "band", "subClass", "blockXSize", "blockYSize"])?;
    elements(band, |name| BAND.contains(&name) || name.to_ascii_lowercase().ends_with("source"))
}

/// Checks a source and its elements.
pub(super) fn source(node: Node) -> Result<()> {
    attributes(node, &["name", "resampling"])?;
    let is_complex = node.has_tag_name("ComplexSource");
    elements(node, |name| SOURCE.contains(&name) || COMPLEX.contains(&name) && is_complex)?;
    for part in node.children().filter(Node::is_element) {
        match part.tag_name().name() {
            "SourceFilename" => attributes(part, &["relativeToVRT", "shared"])?,
            "SrcRect" | "DstRect" => attributes(part, &["xOff", "yOff", "xSize", "ySize"])?,
            "SourceProperties" => {}
            _ => attributes(part, &["le_hex_endian"])?,
        }
    }
    Ok(())
}

fn elements(node: Node, is_known: impl Fn(&str) -> bool) -> Result<()> {
    let mut names = node.children().filter(Node::is_element).map(|child| child.tag_name().name());
    match names.find(|name| !is_known(name)) {
        Some(name) => Err(unsupported(format!("a {} with {name}", node.tag_name().name()))),
        None => Ok(()),
    }
}

fn attributes(node: Node, known: &[&str]) -> Result<()> {
    match node.attributes().map(|attribute| attribute.name()).find(|name| !known.contains(name)) {
        Some(name) => Err(unsupported(format!("a {} with {name}", node.tag_name().name()))),
        None => Ok(()),
    }
}
