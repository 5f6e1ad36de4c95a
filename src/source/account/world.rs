//! World files: six lines beside a raster with its geotransform.

use crate::error::{Error, Result};
use crate::source::metadata;

/// Extensions of world files for a raster with this extension, in GDAL's order.
pub(super) fn extensions(extension: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut letters = extension.chars();
    if let (Some(first), Some(last)) = (letters.next(), letters.next_back()) {
        found.push(format!("{first}{last}w"));
        found.push(format!("{extension}w"));
    }
    found.push("wld".to_owned());
    found
}

/// The geotransform of a world file. The file gives the column step in x and y, the row step in x
/// and y, and the centre of the first pixel.
pub(super) fn parse(text: &str) -> Result<[f64; 6]> {
    let lines: Vec<&str> =
        text.lines().flat_map(|line| line.split('\r')).filter(|l| !l.trim().is_empty()).collect();
    // GDAL reads one number a line and takes the rest for a remark; other programs write all
    // numbers in one line.
    let words: Vec<&str> = if lines.len() < 6 { text.split_whitespace().collect() } else { lines };
    let numbers: Vec<f64> = words.iter().take(6).map_while(|word| metadata::number(word)).collect();
    match numbers[..] {
        [a, d, b, e, x, y] if numbers.iter().all(|n| n.is_finite()) && a * e - b * d != 0.0 => {
            Ok([x - (a + b) / 2.0, a, b, y - (d + e) / 2.0, d, e])
        }
        _ => {
            let got = text.trim().chars().take(80).collect::<String>();
            Err(Error::format("world file", "six numbers that span a plane", format!("{got:?}")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn six_lines_of_a_pixel_centre() {
        let expected = [100.0, 2.0, 0.0, 200.0, 0.0, -4.0];
        for text in [
            "2\n0\n0\n-4\n101\n198\n",
            "2\r\n0\r\n0\r\n-4\r\n101\r\n198",
            "2\r0\r0\r-4\r101\r198\r",
            "\n 2 \n\n0\n0\n-4,0\n101\n198\n\nby hand\n7\n",
            "2 0 0 -4 101 198",
        ] {
            assert_eq!(parse(text).expect("six"), expected, "{text:?}");
        }
        for text in
            ["2 0 0 -4 101", "2 0 0 0 1 1", "", "a\n0\n0\n-4\n101\n198\n", "inf\n0\n0\n-4\n101\n198\n"]
        {
            assert!(parse(text).is_err(), "{text:?}");
        }
    }

    #[test]
    fn names_by_the_extension() {
        assert_eq!(extensions("tif"), ["tfw", "tifw", "wld"]);
        assert_eq!(extensions("tiff"), ["tfw", "tiffw", "wld"]);
        assert_eq!(extensions("TIF"), ["TFw", "TIFw", "wld"]);
        assert_eq!(extensions("png"), ["pgw", "pngw", "wld"]);
        assert_eq!(extensions("x"), ["wld"]);
        assert_eq!(extensions(""), ["wld"]);
    }
}
