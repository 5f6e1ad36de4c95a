//! The files behind a GDAL dataset and their current state: on disk, in archives, or on a server.

use std::ffi::{CStr, CString};
use std::path::{Path, PathBuf};

use gdal::Dataset;

use crate::error::Result;
use crate::source::archive::archive;
use crate::source::{FileStamp, Fingerprint, file_name};

/// The files of a dataset, the main file first; for a VRT also the files that it names.
pub(in crate::source) fn of(dataset: &Dataset, path: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    // SAFETY: the dataset is open; the list ends with a null pointer, its entries are C strings,
    // and it is ours to free.
    #[expect(unsafe_code, reason = "the bindings have no safe call for it")]
    unsafe {
        let list = gdal_sys::GDALGetFileList(dataset.c_dataset());
        let mut at = list;
        while !at.is_null() && !(*at).is_null() {
            files.push(PathBuf::from(CStr::from_ptr(*at).to_string_lossy().into_owned()));
            at = at.add(1);
        }
        gdal_sys::CSLDestroy(list);
    }
    if files.is_empty() {
        files.push(path.to_owned());
    }
    files
}

/// The fingerprint of files. A local file must exist. A virtual file of GDAL's has the stamp of its
/// archive, or if there is none, the properties that GDAL gives: length 0 once it is gone.
pub(in crate::source) fn fingerprint(files: &[PathBuf]) -> Result<Fingerprint> {
    let stamp = |path: &PathBuf| {
        if path.exists() {
            return FileStamp::of(path);
        }
        if let Some(archive) = archive(path) {
            return Ok(FileStamp { name: file_name(path), ..FileStamp::of(&archive)? });
        }
        // Also names such as `NETCDF:"file":variable`, if GDAL lists no file for them.
        let text = path.to_string_lossy();
        if text.starts_with("/vsi") || text.contains([':', '"']) {
            Ok(remote(path))
        } else {
            FileStamp::of(path)
        }
    };
    Ok(Fingerprint { files: files.iter().map(stamp).collect::<Result<_>>()? })
}

/// The stamp of a file that is not on this machine. GDAL's caches are emptied first, as they hold
/// its former state.
fn remote(path: &Path) -> FileStamp {
    let name = file_name(path);
    let Ok(c_path) = CString::new(path.to_string_lossy().into_owned()) else {
        return FileStamp { name, bytes: 0, modified_ns: 0 };
    };
    // SAFETY: the path is a C string; the handle is used while it is open, and closed once.
    #[expect(unsafe_code, reason = "the bindings have no safe call for it")]
    let bytes = unsafe {
        gdal_sys::VSICurlPartialClearCache(c_path.as_ptr());
        let file = gdal_sys::VSIFOpenL(c_path.as_ptr(), c"rb".as_ptr());
        if file.is_null() {
            0
        } else {
            let at_end = gdal_sys::VSIFSeekL(file, 0, 2) == 0;
            let length = gdal_sys::VSIFTellL(file);
            gdal_sys::VSIFCloseL(file);
            if at_end { length } else { 0 }
        }
    };
    FileStamp { name, bytes, modified_ns: 0 }
}
