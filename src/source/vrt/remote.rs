//! Refuses VRTs that name files on a network, also where GDAL would fetch them: opening a file must
//! not connect to a place that someone else has chosen.

use std::path::Path;

use roxmltree::Node;

use super::DEPTH;
use crate::error::{Error, Result};
use crate::limits::Limits;
use crate::source::markup;

/// GDAL's network file systems, anywhere in a name: they may be chained, as in
/// `/vsizip//vsicurl/…`.
const SYSTEMS: [&str; 9] =
    ["/vsicurl", "/vsis3", "/vsigs", "/vsiaz", "/vsiadls", "/vsioss", "/vsiswift", "/vsihdfs", "/vsiwebhdfs"];

/// Prefixes of names of rasters that GDAL gets from servers.
const DRIVERS: [&str; 14] = [
    "wms:",
    "wcs:",
    "wfs:",
    "wmts:",
    "pg:",
    "eedai:",
    "plmosaic:",
    "plscenes:",
    "daas:",
    "ogcapi:",
    "stacit:",
    "stacta:",
    "ngw:",
    "dods",
];

/// True if the name of a raster refers to a network, or hides what it refers to.
pub(super) fn is_remote(name: &str) -> bool {
    let name = name.trim().to_ascii_lowercase();
    name.starts_with('<')
        || name.contains("://")
        || SYSTEMS.iter().any(|system| name.contains(system))
        || DRIVERS.iter().any(|driver| name.starts_with(driver))
}

/// The error for such a name.
pub(super) fn refusal(vrt: &Path, name: &str) -> Error {
    Error::usage(format!(
        "{}: it names {}, which is not a file of this machine; fetch that and name the file, or, where GDAL is built \
         in, give that name itself in place of the VRT",
        vrt.display(),
        name.trim().chars().take(200).collect::<String>()
    ))
}

/// Fails if a VRT names something on a network, or a VRT that does.
#[cfg_attr(
    not(any(test, feature = "gdal")),
    expect(dead_code, reason = "what is read natively is looked at on the way")
)]
pub(in crate::source) fn check(path: &Path, limits: &Limits) -> Result<()> {
    walk(path, 0, &mut 0, limits)
}

fn walk(path: &Path, depth: u32, files: &mut u64, limits: &Limits) -> Result<()> {
    if depth == DEPTH {
        return Err(super::too_deep().at(path));
    }
    let text = super::text(path, limits).map_err(|error| error.at(path))?;
    let document = markup::parse(&text).map_err(|error| error.at(path))?;
    for node in document.descendants().filter(Node::is_element) {
        let words = node.attributes().map(|attribute| attribute.value()).chain(node.text());
        let is_name = matches!(
            node.tag_name().name().to_ascii_lowercase().as_str(),
            "sourcefilename" | "sourcedataset"
        );
        for word in words {
            let lower = word.to_ascii_lowercase();
            if is_name && is_remote(word) || SYSTEMS.iter().any(|system| lower.contains(system)) {
                return Err(refusal(path, word));
            }
        }
        if is_name {
            *files += 1;
            if *files > limits.mosaic_files {
                return Err(Error::limit("the number of files of a mosaic", *files, limits.mosaic_files));
            }
            inner(path, node.text().unwrap_or_default().trim(), depth, files, limits)?;
        }
    }
    Ok(())
}

/// Checks a file that a VRT names, relative to the folder of the VRT and to the current folder.
fn inner(vrt: &Path, name: &str, depth: u32, files: &mut u64, limits: &Limits) -> Result<()> {
    let beside = vrt.parent().unwrap_or(Path::new("")).join(name);
    for path in [beside.as_path(), Path::new(name)] {
        // A file that cannot be opened is reported when it is read.
        let Ok(start) = super::super::open::start(path) else { continue };
        if super::is_vrt(&start) {
            walk(path, depth + 1, files, limits)?;
        } else if ["<GDAL_WMS", "<WCS_GDAL", "<WMTS"].iter().any(|head| contains(&start, head.as_bytes())) {
            return Err(refusal(vrt, name));
        }
    }
    Ok(())
}

fn contains(bytes: &[u8], word: &[u8]) -> bool {
    bytes.windows(word.len()).any(|part| part == word)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vrt(name: &str) -> String {
        format!(
            "<VRTDataset><VRTRasterBand><Warped>{}</Warped></VRTRasterBand></VRTDataset>",
            format_args!("<SourceFilename relativeToVRT=\"1\">{name}</SourceFilename>")
        )
    }

    #[test]
    fn names_on_networks_are_found_at_any_depth() {
        let folder = tempfile::tempdir().expect("folder");
        let write = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).expect("write");
            path
        };
        let limits = Limits::default();
        write("dem.tif", "II*\0");
        write("wms.xml", "<GDAL_WMS><Service name=\"TMS\"/></GDAL_WMS>");
        for (name, is_fine) in [
            ("dem.tif", true),
            ("missing.tif", true),
            ("/vsizip/a.zip/dem.tif", true),
            ("/vsicurl/http://localhost/a.tif", false),
            ("/vsizip//VSIS3/bucket/a.zip", false),
            ("http://localhost/a.tif", false),
            ("&#47;vsicurl&#47;a", false),
            (" WMS:http", false),
            ("&lt;GDAL_WMS/&gt;", false),
            ("wms.xml", false),
        ] {
            let outer = write("outer.vrt", &vrt("inner.vrt"));
            write("inner.vrt", &vrt(name));
            assert_eq!(check(&outer, &limits).is_ok(), is_fine, "{name}");
        }
        let own = write("own.vrt", &vrt("own.vrt"));
        assert!(matches!(check(&own, &limits), Err(Error::Format { .. })));
        let metadata =
            "<VRTDataset><Metadata><MDI key=\"SOFTWARE\">https://gdal.org</MDI></Metadata></VRTDataset>";
        assert!(check(&write("a.vrt", metadata), &limits).is_ok());
        let hidden = "<VRTDataset><Metadata><MDI key=\"X_DATASET\">/vsicurl/a</MDI></Metadata></VRTDataset>";
        assert!(check(&write("a.vrt", hidden), &limits).is_err());
        assert!(check(&write("a.vrt", "<VRTDataset>"), &limits).is_err());
    }
}
