//! World files: six lines beside a picture that say where it lies.

use std::path::Path;

use crate::error::{Error, Result};

/// The geotransform of `a.tfw`, `a.tifw` or `a.wld` beside `a.tif`; `None` if there is no such file.
pub(super) fn read(picture: &Path) -> Result<Option<[f64; 6]>> {
    let extension = picture.extension().map(|word| word.to_string_lossy().into_owned()).unwrap_or_default();
    let short: String = extension.chars().take(1).chain(extension.chars().last()).chain(['w']).collect();
    for name in [short, format!("{extension}w"), "wld".to_owned()] {
        let path = picture.with_extension(name);
        if path.is_file() {
            let text = std::fs::read_to_string(&path).map_err(|error| Error::io(&path, "read", error))?;
            return parse(&text).map(Some).map_err(|error| error.at(&path));
        }
    }
    Ok(None)
}

/// Column step in x and y, row step in x and y, and the centre of the first pixel, to GDAL's order and the corner.
fn parse(text: &str) -> Result<[f64; 6]> {
    let numbers: Vec<f64> = text.split_whitespace().map_while(|word| word.parse().ok()).collect();
    match numbers[..] {
        [a, d, b, e, x, y] if numbers.iter().all(|n| n.is_finite()) && a * e - b * d != 0.0 => {
            Ok([x - (a + b) / 2.0, a, b, y - (d + e) / 2.0, d, e])
        }
        _ => Err(Error::format("world file", "six numbers that span a plane", format!("{:?}", text.trim()))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn six_lines_of_a_pixel_centre() {
        assert_eq!(parse("2\n0\n0\n-4\n101\n198\n").expect("six"), [100.0, 2.0, 0.0, 200.0, 0.0, -4.0]);
        assert!(parse("2 0 0 -4 101").is_err() && parse("2 0 0 0 1 1").is_err() && parse("").is_err());
    }
}
