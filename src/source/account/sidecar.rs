//! Finds and reads files beside a raster.

use std::ffi::OsString;
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::limits::Limits;

/// Most entries of a folder searched for a name in another case, as in GDAL.
const LISTED: usize = 1000;

/// The path of a raster without `.gz`, after which its sidecars are named.
pub(super) fn unpacked(raster: &Path) -> PathBuf {
    let is_packed = raster.extension().is_some_and(|word| word.eq_ignore_ascii_case("gz"));
    if is_packed { raster.with_extension("") } else { raster.to_owned() }
}

/// The sidecar named after the whole raster, such as `dem.tif.aux.xml`; `None` if there is none.
pub(super) fn appended(raster: &Path, more: &str) -> Option<PathBuf> {
    let mut name = raster.as_os_str().to_owned();
    name.push(more);
    Some(PathBuf::from(name)).filter(|path| path.is_file())
}

/// The first sidecar with the raster's name and one of these extensions: first as given, then in
/// lower or upper case, then in mixed case if the folder is not too full to search.
pub(super) fn beside(raster: &Path, extensions: &[String]) -> Option<PathBuf> {
    for extension in extensions {
        let spelled = [extension.clone(), extension.to_ascii_lowercase(), extension.to_ascii_uppercase()];
        let found = spelled.iter().map(|one| raster.with_extension(one)).find(|path| path.is_file());
        if found.is_some() {
            return found;
        }
    }
    let names = listed(raster)?;
    extensions.iter().find_map(|extension| {
        let wanted = raster.with_extension(extension);
        let name =
            names.iter().find(|name| name.eq_ignore_ascii_case(wanted.file_name().unwrap_or_default()))?;
        Some(raster.with_file_name(name)).filter(|path| path.is_file() && path != raster)
    })
}

/// Sorted names in the raster's folder; `None` if there are too many.
fn listed(raster: &Path) -> Option<Vec<OsString>> {
    let folder = raster.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(folder).ok()?.flatten().take(LISTED + 1);
    let mut names: Vec<OsString> = entries.map(|entry| entry.file_name()).collect();
    names.sort();
    (names.len() <= LISTED).then_some(names)
}

/// The content of a file that is not too long; bytes that are not UTF-8 become U+FFFD.
pub(super) fn text(path: &Path, limits: &Limits) -> Result<String> {
    let read = || {
        let mut bytes = Vec::new();
        crate::file::open(path)?.take(limits.vrt_bytes + 1).read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    let bytes = read().map_err(|error| Error::io(path, "read", error))?;
    if bytes.len() as u64 > limits.vrt_bytes {
        let what = "the length in bytes of a file beside a raster";
        return Err(Error::limit(what, bytes.len() as u64, limits.vrt_bytes).at(path));
    }
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::file_name;

    #[test]
    fn names_in_any_case() {
        let folder = tempfile::tempdir().expect("folder");
        let raster = folder.path().join("Dem.tif");
        let wanted = ["tfw".to_owned(), "tifw".to_owned(), "wld".to_owned()];
        let found = || beside(&raster, &wanted).map(|path| file_name(&path));
        assert_eq!(found(), None);
        for name in
            ["dem.Wld", "Dem.tfwx", "dem.TFw", "Dem.WLD", "Dem.TIFW", "Dem.tifw", "Dem.TFW", "Dem.tfw"]
        {
            std::fs::write(folder.path().join(name), "").expect("write");
            let expected = if name == "Dem.tfwx" { "dem.Wld" } else { name };
            assert_eq!(found().as_deref(), Some(expected));
        }
        assert_eq!(appended(&raster, ".aux.xml"), None);
    }
}
