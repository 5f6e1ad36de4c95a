//! Recognises files that are not read here by their first bytes, so that the refusal names their
//! format.
//!
//! Messages never contain the bytes themselves: a virtual raster may name any file that its reader
//! can open.

use super::open::NEEDS_GDAL;
use crate::error::Error;

/// Bytes read to recognise a file: a virtual raster may begin with comments.
pub(super) const LOOK: usize = 1024;

/// First bytes and names of formats that GDAL reads; `.` stands for any byte.
const RASTERS: [(&[u8], &str); 17] = [
    (b"\x89PNG", "a PNG picture"),
    (b"\xFF\xD8\xFF", "a JPEG picture"),
    (b"\x89HDF\r\n\x1A\n", "an HDF5 or NetCDF 4 file"),
    (b"CDF", "a NetCDF file"),
    (b"\x0E\x03\x13\x01", "an HDF4 file"),
    (b"GRIB", "a GRIB file"),
    (b"EHFA_HEADER_TAG", "an Erdas Imagine file"),
    (b"SQLite format 3", "an SQLite file, as GeoPackage and MBTiles are"),
    (b"\0\0\0\x0CjP  \r\n\x87\n", "a JPEG 2000 picture"),
    (b"\xFF\x4F\xFF\x51", "a JPEG 2000 picture"),
    (b"RIFF....WEBP", "a WebP picture"),
    (b"BM", "a BMP picture"),
    (b"GIF8", "a GIF picture"),
    (b"DSBB", "a Surfer grid"),
    (b"DSRB", "a Surfer grid"),
    (b"UHL1", "a DTED file"),
    (b"NITF", "a NITF file"),
];

/// First words of text files that GDAL reads as rasters.
const GRIDS: [&str; 16] = [
    "ncols", "nrows", "xllc", "yllc", "xll_", "yll_", "cellsize", "dsaa", "envi", "north:", "grid", "pds_",
    "ccsd", "isg", "!", "<",
];

/// First bytes and names of formats that are not rasters.
const OTHERS: [(&[u8], &str); 7] = [
    (b"%PDF", "a PDF document"),
    (b"\x7FELF", "a program"),
    (b"MZ", "a program"),
    (b"Rar!", "a RAR archive"),
    (b"7z\xBC\xAF", "a 7z archive"),
    (b"BZh", "a file packed with bzip2"),
    (b"\xFD7zXZ", "a file packed with xz"),
];

/// The error for a file that begins with these bytes.
pub(super) fn refusal(start: &[u8]) -> Error {
    let begins = |(magic, _): &&(&[u8], &str)| {
        start.len() >= magic.len() && magic.iter().zip(start).all(|(&m, &byte)| m == byte || m == b'.')
    };
    let no_raster = |got: &str| {
        let expected = "a raster (a GeoTIFF, a GDAL virtual raster or an SRTM tile)";
        Error::format("the file", expected, got)
    };
    if start.is_empty() {
        return no_raster("an empty file");
    }
    if start.starts_with(b"\x89RLV") {
        return no_raster("a Relevo file already: see relevo info, or relevo export to make a GeoTIFF of it");
    }
    if start.starts_with(b"PK\x03\x04") {
        return Error::unsupported("a zip archive", "unpack it and give the files in it");
    }
    if start.starts_with(b"\x1F\x8B") {
        return Error::unsupported("a file that was gzipped twice", "unpack it with gunzip");
    }
    if let Some((_, name)) = OTHERS.iter().find(begins) {
        return no_raster(name);
    }
    if is_usgs_dem(start) {
        return Error::unsupported("a USGS DEM", NEEDS_GDAL);
    }
    if let Some((_, name)) = RASTERS.iter().find(begins) {
        return Error::unsupported(*name, NEEDS_GDAL);
    }
    match first_word(start) {
        Some(word) if !is_grid(&word) => no_raster("a text file"),
        Some(_) => Error::unsupported("a raster written as text", NEEDS_GDAL),
        None => {
            Error::unsupported("not a TIFF, nor anything else that is known by its first bytes", NEEDS_GDAL)
        }
    }
}

/// True if a text begins as a USGS DEM does, in the fields that GDAL looks at: level 1 or 4, a
/// planimetric system.
fn is_usgs_dem(start: &[u8]) -> bool {
    let field = |from: usize| start.get(from..from + 6).unwrap_or_default();
    let systems: [&[u8]; 5] = [b"     0", b"     1", b"     2", b"     3", b" -9999"];
    [&b"     1"[..], b"     4"].contains(&field(150)) && systems.contains(&field(156))
}

/// The first word of a text in lower case; `None` if the bytes are not text.
fn first_word(start: &[u8]) -> Option<String> {
    let text = match std::str::from_utf8(start) {
        Ok(text) => text,
        // The last character may be cut off.
        Err(error) if error.error_len().is_none() => {
            std::str::from_utf8(&start[..error.valid_up_to()]).ok()?
        }
        Err(_) => return None,
    };
    let is_text = text.chars().all(|c| !c.is_control() || matches!(c, '\n' | '\r' | '\t' | '\u{C}'));
    let word = text.trim_start_matches('\u{FEFF}').split_whitespace().next()?;
    (is_text && start.len() >= 2).then(|| word.to_lowercase())
}

/// True if GDAL may read a text that begins with this word as a raster: one of its formats, or
/// columns of numbers.
fn is_grid(word: &str) -> bool {
    let word_of_numbers = word.split([',', ';']).all(|part| part.parse::<f64>().is_ok());
    word_of_numbers
        || matches!(word, "x" | "lon" | "longitude")
        || GRIDS.iter().any(|head| word.starts_with(head))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_named_and_never_quoted() {
        let mut dted = vec![b' '; 80];
        dted[..4].copy_from_slice(b"UHL1");
        let mut usgs = b"Mount St. Helens, WA".to_vec();
        usgs.resize(150, b' ');
        usgs.extend(b"     1     1    10");
        let helped = [
            (&b"\x89PNG\r\n\x1A\n\0\0\0\rIHDR"[..], "PNG"),
            (b"CDF\x01\0\0\0", "NetCDF"),
            (b"RIFF\x11\x22\x33\x44WEBPVP8", "WebP"),
            (&dted, "DTED"),
            (&usgs, "USGS DEM"),
            (b"ncols 4\nnrows 3\n", "as text"),
            (b"\xEF\xBB\xBFNCOLS 4", "as text"),
            (b"400000.5 5000000 12.25\n", "as text"),
            (b"400000,5000000,12\n", "as text"),
            (b"<PAMDataset>", "as text"),
            (b"\x01\x02\x03\x04\xFF\xFE", "known by its first bytes"),
        ];
        for (start, words) in helped {
            let message = refusal(start).to_string();
            assert!(message.contains(words) && message.contains("GDAL"), "{message}");
        }
        let not_helped = [
            (&b""[..], "an empty file"),
            (b"\x89RLV\r\n\x1A\n\x01", "relevo info"),
            (b"PK\x03\x04", "unpack"),
            (b"%PDF-1.7", "PDF"),
            (b"root:x:0:0:secret:/root:/bin/sh\n", "a text file"),
            ("Gipfelh\u{F6}hen \u{1F3D4}".as_bytes(), "a text file"),
            (&"Gipfelh\u{F6}hen".as_bytes()[..8], "a text file"),
        ];
        for (start, words) in not_helped {
            let message = refusal(start).to_string();
            assert!(message.contains(words), "{message}");
            assert!(!message.contains("install") && !message.contains("secret"), "{message}");
        }
    }
}
