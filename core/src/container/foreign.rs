//! Names the format of a file that is not a container, for the error message: rasters are often
//! given in a container's place.

use std::path::Path;

use super::opening::MAGIC;
use crate::error::Error;

/// First bytes and name of formats that are often given in a container's place.
const KINDS: [(&[u8], &str); 14] = [
    (b"II*\0", "a TIFF"),
    (b"MM\0*", "a TIFF"),
    (b"II+\0", "a BigTIFF"),
    (b"MM\0+", "a BigTIFF"),
    (b"<VRTDataset", "a VRT"),
    (b"<?xml", "an XML file"),
    (b"\x1f\x8b", "a gzip file"),
    (b"PK\x03\x04", "a zip archive"),
    (b"\x89PNG", "a PNG picture"),
    (b"\xff\xd8\xff", "a JPEG picture"),
    (b"\x89HDF", "an HDF5 file"),
    (b"ncols", "an Arc/Info grid"),
    (b"NCOLS", "an Arc/Info grid"),
    (b"UHL1", "a DTED file"),
];

/// The error of a file of a known other format; `None` for a container or an unknown format.
pub(super) fn refused(start: &[u8], path: &Path) -> Option<Error> {
    if start.starts_with(&MAGIC) {
        return None;
    }
    let text = start.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(start).trim_ascii_start();
    let by_start = KINDS.iter().find(|(first, _)| start.starts_with(first) || text.starts_with(first));
    // Raw heights have no signature.
    let is_hgt = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("hgt"));
    let kind = by_start.map(|(_, kind)| *kind).or(is_hgt.then_some("an SRTM tile"))?;
    let hint = format!("make one of it first: relevo build {}", path.display());
    Some(Error::unsupported(format!("{kind}, not an .rlv file"), hint))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_known_is_named_and_containers_pass() {
        let said = |start: &[u8], name: &str| refused(start, Path::new(name)).map(|error| error.to_string());
        assert_eq!(
            said(b"II*\0\x08\0\0\0", "dem.tif").as_deref(),
            Some("a TIFF, not an .rlv file: make one of it first: relevo build dem.tif")
        );
        assert!(said(b"\n <VRTDataset rasterXSize=", "a.vrt").is_some_and(|text| text.contains("VRT")));
        assert!(said(&[0, 1, 0, 2], "N51E001.HGT").is_some_and(|text| text.contains("SRTM")));
        assert_eq!(said(&MAGIC, "n51.hgt"), None);
        assert_eq!((said(b"", "a.rlv"), said(b"xyz", "a.rlv")), (None, None));
    }
}
