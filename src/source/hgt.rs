//! SRTM tiles, read natively: `N44W072.hgt`, big-endian 16-bit metres of one square degree, row by
//! row from the north.
//!
//! The name is the only georeference: it gives the south-western corner, and a sample stands on
//! each corner of the degree. As in GDAL, a `.aux.xml` beside the tile can give scale and offset,
//! and nothing else. A tile may be gzipped (`N44W072.hgt.gz`), as tiles are often published.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::account::Account;
use super::{
    FileStamp, Fingerprint, Origin, Origins, Part, ReadMemory, Samples, Source, SourceInfo, Window,
    check_window, file_name, gzip,
};
use crate::error::{Error, Result};
use crate::file::read_exact_at;
use crate::geo::{CrsKind, Geo};
use crate::limits::Limits;
use crate::sample::SampleType;

/// The sample value that means void.
const VOID: i16 = -32768;
/// Columns and rows of the tiles that are not square: those north of 50 degrees, where meridians
/// are close.
const NARROW: (u64, u64) = (1801, 3601);

/// An SRTM tile as a source.
pub struct HgtSource {
    path: PathBuf,
    file: File,
    info: SourceInfo,
    /// Files beside the tile that were read.
    beside: Vec<PathBuf>,
}

impl HgtSource {
    /// Opens a tile. Its name must give its place, and its length must be that of a square (or of
    /// 1801 x 3601).
    pub fn open(path: &Path, limits: &Limits) -> Result<Self> {
        let (latitude, longitude) = corner(&file_name(path)).map_err(|error| error.at(path))?;
        let gzip::Content { file, length, is_gzipped } = gzip::open(path, limits)?;
        let (width, height) = size(length, limits).map_err(|error| error.at(path))?;
        let (dx, dy) = (1.0 / f64::from(width - 1), 1.0 / f64::from(height - 1));
        let transform = [longitude - 0.5 * dx, dx, 0.0, latitude + 1.0 + 0.5 * dy, 0.0, -dy];
        let description = if is_gzipped { "SRTM .hgt, gzipped" } else { "SRTM .hgt" }.to_owned();
        let account = Account::beside(path, limits);
        let band = account.band(1).map_err(|error| error.at(path))?;
        let origins = Origins {
            place: Some(Origin::FileName),
            crs: Some(Origin::Format),
            nodata: Some(Origin::Format),
            unit: Some(Origin::Format),
            ..band.origins
        };
        let info = SourceInfo {
            width,
            height,
            sample_type: SampleType::Int16,
            nodata: Some(VOID.into()),
            band_scale: band.scale,
            band_offset: band.offset,
            vertical_unit: (1.0, "m".to_owned()),
            geo: Geo {
                transform: Some(transform),
                pixel_is_point: account.aux_pixel_is_point().unwrap_or(true),
                crs: crate::crs::of_code(CrsKind::Geographic, 4326),
            },
            parts: vec![Part { name: file_name(path), description: description.clone() }],
            description,
            footprint: None,
            overlap: None,
            block_rows: 1,
            // The bytes of the file, and the samples made of them.
            reading: ReadMemory::plain(4),
            warnings: account.warnings,
            origins,
        };
        Ok(Self { path: path.to_owned(), file, info, beside: account.files })
    }

    fn read(&self, bytes: &mut [u8], first: u64) -> Result<()> {
        read_exact_at(&self.file, bytes, 2 * first).map_err(|error| {
            let what = format!("{} bytes from offset {} on", bytes.len(), 2 * first);
            if error.kind() == io::ErrorKind::UnexpectedEof {
                let got = "the end of the file (start again when nothing writes to it)";
                return Error::format("samples", what, got).at(&self.path);
            }
            Error::io(&self.path, format!("read {what}"), error)
        })
    }
}

impl Source for HgtSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_window(&self, columns: Range<u32>, rows: Range<u32>) -> Result<Window> {
        check_window(&self.info, &columns, &rows)?;
        let width = self.info.width as usize;
        let mut samples = Vec::with_capacity(columns.len() * rows.len());
        let big = |bytes: &[u8], samples: &mut Vec<i16>| {
            samples.extend(bytes.as_chunks::<2>().0.iter().map(|&pair| i16::from_be_bytes(pair)));
        };
        let first = |row: u32| u64::from(row) * width as u64 + u64::from(columns.start);
        if columns.len() == width {
            let mut bytes = vec![0; 2 * width * rows.len()];
            self.read(&mut bytes, first(rows.start))?;
            big(&bytes, &mut samples);
        } else {
            let mut bytes = vec![0; 2 * columns.len()];
            for row in rows {
                self.read(&mut bytes, first(row))?;
                big(&bytes, &mut samples);
            }
        }
        Ok(Window { samples: Samples::Int16(samples), mask: None })
    }

    fn fingerprint(&self) -> Result<Fingerprint> {
        Ok(Fingerprint { files: self.files().iter().map(|path| FileStamp::of(path)).collect::<Result<_>>()? })
    }

    fn files(&self) -> Vec<PathBuf> {
        std::iter::once(&self.path).chain(&self.beside).cloned().collect()
    }
}

/// Latitude and longitude of the south-western corner, from a name that begins like `N44W072`.
fn corner(name: &str) -> Result<(f64, f64)> {
    let wrong = || {
        let expected = "a place at its start, such as N44W072 (the south-western corner in degrees)";
        Error::format("the name of the file", expected, name)
    };
    let degrees = |at: Range<usize>, plus: char, minus: char, least: i32, most: i32| {
        let text = name.get(at).filter(|text| text.is_ascii()).ok_or_else(wrong)?;
        let number =
            text.get(1..).filter(|digits| digits.bytes().all(|b| b.is_ascii_digit())).ok_or_else(wrong)?;
        let number: i32 = number.parse().map_err(|_| wrong())?;
        let sign = text.chars().next().map(|sign| sign.to_ascii_uppercase());
        let degrees = if sign == Some(plus) {
            number
        } else if sign == Some(minus) {
            -number
        } else {
            return Err(wrong());
        };
        if (least..=most).contains(&degrees) { Ok(f64::from(degrees)) } else { Err(wrong()) }
    };
    Ok((degrees(0..3, 'N', 'S', -90, 89)?, degrees(3..7, 'E', 'W', -180, 179)?))
}

/// Columns and rows of a tile that is `bytes` long.
fn size(bytes: u64, limits: &Limits) -> Result<(u32, u32)> {
    if bytes == 2 * NARROW.0 * NARROW.1 {
        return Ok((NARROW.0 as u32, NARROW.1 as u32));
    }
    let side = (bytes / 2).isqrt();
    if side < 2 || Some(bytes) != side.checked_mul(2 * side) {
        let expected =
            "2 bytes for each sample of a square, as in 1201 x 1201 (2884802) or 3601 x 3601 (25934402)";
        let hint = "it is cut off, packed, or no SRTM tile of heights";
        return Err(Error::format("the length of the file", expected, format!("{bytes} ({hint})")));
    }
    match u32::try_from(side) {
        Ok(own) if side <= limits.raster_side => Ok((own, own)),
        _ => Err(Error::limit("the side of the tile", side, limits.raster_side)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_the_corner() {
        assert_eq!(corner("N44W072.hgt").expect("name"), (44.0, -72.0));
        assert_eq!(corner("s01e179.SRTMGL1.hgt").expect("name"), (-1.0, 179.0));
        assert_eq!(corner("N00E000.hgt").expect("name"), (0.0, 0.0));
        for name in [
            "",
            "N44",
            "N4W072.hgt",
            "X44W072.hgt",
            "N44W0721",
            "N90E000.hgt",
            "N44W181.hgt",
            "dem.hgt",
            "N+4W072",
            "é44W072.hgt",
        ] {
            if name == "N44W0721" {
                assert!(corner(name).is_ok(), "what follows the place does not matter");
            } else {
                assert!(corner(name).is_err(), "{name}");
            }
        }
    }

    #[test]
    fn lengths_say_the_size() {
        let limits = Limits::default();
        assert_eq!(size(2_884_802, &limits).expect("size"), (1201, 1201));
        assert_eq!(size(25_934_402, &limits).expect("size"), (3601, 3601));
        assert_eq!(size(2 * 1801 * 3601, &limits).expect("size"), (1801, 3601));
        assert_eq!(size(8, &limits).expect("size"), (2, 2));
        for bytes in [0, 1, 2, 7, 9, 2_884_801, 1201 * 1201, u64::MAX] {
            assert!(matches!(size(bytes, &limits), Err(Error::Format { .. })), "{bytes}");
        }
    }
}
