//! Input files of a command line, also those named in lists and folders.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use relevo::Error;

/// Most bytes of a list, since a device may have no end.
const LIST_BYTES: u64 = 64 << 20;

/// The path of the list if an input is written `@LIST`.
fn list_of(input: &Path) -> Option<PathBuf> {
    let name = input.to_string_lossy();
    name.strip_prefix('@').filter(|_| !input.exists()).map(PathBuf::from)
}

/// The list files among the inputs, which are read as well.
pub fn lists(inputs: &[PathBuf]) -> Vec<PathBuf> {
    inputs.iter().filter_map(|input| list_of(input)).collect()
}

/// Replaces every `@list.txt` by the files that it names, one a line, and `@-` by those that
/// standard input names. Empty lines and lines that begin with `#` are ignored. Relative names
/// start from the current folder.
pub fn expand(inputs: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    let mut files = Vec::with_capacity(inputs.len());
    for input in inputs {
        let Some(list) = list_of(input) else {
            files.push(input.clone());
            continue;
        };
        let text = if list == Path::new("-") { read(io::stdin().lock(), &list) } else { read_file(&list) }?;
        let before = files.len();
        files.extend(names(&text).map(PathBuf::from));
        if files.len() == before {
            return Err(Error::format("list of files", "one name a line", "none").at(&list));
        }
    }
    Ok(files)
}

/// File name extensions of rasters read natively, and of those that GDAL reads.
const NATIVE: [&str; 4] = ["tif", "tiff", "vrt", "hgt"];
const OF_GDAL: [&str; 14] =
    ["asc", "bil", "bt", "dem", "dt0", "dt1", "dt2", "flt", "grd", "img", "jp2", "nc", "rst", "ter"];

/// Replaces every folder by the rasters directly in it, recognised by extension and sorted by name.
pub fn of_folders(inputs: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    let mut files = Vec::with_capacity(inputs.len());
    for input in inputs {
        if input.is_dir() {
            files.extend(rasters(input)?);
        } else {
            files.push(input.clone());
        }
    }
    Ok(files)
}

/// The rasters in a folder.
fn rasters(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let failed = |source| Error::io(folder, "list the folder", source);
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        // As the shell would write it.
        let path = path.strip_prefix(".").map(Path::to_owned).unwrap_or(path);
        let hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
        if !hidden && is_raster(&path) && path.is_file() {
            files.push(path);
        }
    }
    if files.is_empty() {
        let gdal = if cfg!(feature = "gdal") { "and those of GDAL's formats, " } else { "" };
        let expected = format!("rasters (.tif, .tiff, .vrt, .hgt, {gdal}not those of folders within)");
        return Err(Error::format("folder", expected, "none").at(folder));
    }
    files.sort();
    Ok(files)
}

/// True if the file name is that of a raster.
fn is_raster(path: &Path) -> bool {
    let ending =
        |path: &Path| path.extension().map(|end| end.to_string_lossy().to_lowercase()).unwrap_or_default();
    let of = |end: &str| NATIVE.contains(&end) || cfg!(feature = "gdal") && OF_GDAL.contains(&end);
    match ending(path).as_str() {
        // A gzipped file counts as the file in it.
        "gz" => path
            .file_stem()
            .is_some_and(|stem| ["tif", "tiff", "hgt"].contains(&ending(Path::new(stem)).as_str())),
        end => of(end),
    }
}

fn read_file(list: &Path) -> Result<String, Error> {
    let file = File::open(list).map_err(|source| Error::io(list, "read the list of files", source))?;
    read(file, list)
}

fn read(from: impl Read, list: &Path) -> Result<String, Error> {
    let mut bytes = Vec::new();
    let read = from.take(LIST_BYTES + 1).read_to_end(&mut bytes);
    read.map_err(|source| Error::io(list, "read the list of files", source))?;
    if bytes.len() as u64 > LIST_BYTES {
        let what = "the length of the list of files in bytes";
        return Err(Error::limit(what, bytes.len() as u64, LIST_BYTES).at(list));
    }
    let wrong = |error| Error::format("list of files", "names in UTF-8", error).at(list);
    String::from_utf8(bytes).map_err(wrong)
}

/// The names in a list; some editors put a byte order mark before the first.
fn names(text: &str) -> impl Iterator<Item = &str> {
    let lines = text.strip_prefix('\u{FEFF}').unwrap_or(text).lines().map(str::trim);
    lines.filter(|line| !line.is_empty() && !line.starts_with('#'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_what_is_a_raster() {
        for (name, is) in
            [("a.tif", true), ("A.TIFF", true), ("n51.hgt.gz", true), ("a.tar.gz", false), ("a.txt", false)]
        {
            assert_eq!(is_raster(Path::new(name)), is, "{name}");
        }
        assert!(!is_raster(Path::new("tif")) && !is_raster(Path::new("a.tif.aux.xml")));
    }

    #[test]
    fn names_of_lists() {
        let of = |text| names(text).collect::<Vec<_>>();
        assert_eq!(of("\u{FEFF}a.tif\r\n# b\r\n\r\n  c d.tif "), ["a.tif", "c d.tif"]);
        assert_eq!(of("\u{FEFF}# a\nb"), ["b"]);
        assert_eq!(of("\u{FEFF}"), [""; 0]);
        let endless = read(io::repeat(b'a'), Path::new("list"));
        assert!(matches!(endless, Err(Error::Limit { .. })));
        let wide = read(&b"\xFF\xFEa\0"[..], Path::new("list")).expect_err("UTF-16").to_string();
        assert!(wide.contains("UTF-8"), "{wide}");
    }
}
