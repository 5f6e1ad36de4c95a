//! The archives that names of GDAL's virtual file systems point into.

use std::path::{Path, PathBuf};

/// The local archive of a path such as `/vsizip/folder/a.zip/dem.tif`, also chained
/// (`/vsitar//vsigzip/…`) or in braces.
pub(in crate::source) fn archive(path: &Path) -> Option<PathBuf> {
    let text = path.to_string_lossy();
    let mut rest = text.strip_prefix("/vsi")?.split_once('/')?.1;
    while let Some(inner) = rest.strip_prefix("/vsi").or_else(|| rest.strip_prefix("vsi")) {
        rest = inner.split_once('/')?.1;
    }
    let rest = rest.replace(['{', '}'], "");
    // Absolute paths have a second slash, `/vsizip//data/a.zip`, which users sometimes leave out.
    [PathBuf::from(&rest), PathBuf::from(format!("/{rest}"))]
        .into_iter()
        .find_map(|name| name.ancestors().find(|folder| folder.is_file()).map(Path::to_owned))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn archives_of_virtual_names() {
        let folder = tempfile::tempdir().expect("folder");
        let zip = folder.path().join("a.zip");
        std::fs::write(&zip, "PK").expect("write");
        let zip_name = zip.display();
        for name in [
            format!("/vsizip/{zip_name}/in/dem.tif"),
            format!("/vsizip/{{{zip_name}}}/dem.tif"),
            format!("/vsitar//vsigzip/{zip_name}/dem.tif"),
            format!("/vsigzip/{zip_name}"),
        ] {
            assert_eq!(archive(Path::new(&name)), Some(zip.clone()), "{name}");
        }
        assert_eq!(archive(Path::new("/vsicurl/http://localhost/a.tif")), None);
        assert_eq!(archive(&zip), None);
    }
}
