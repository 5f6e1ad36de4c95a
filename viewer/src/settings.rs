//! The settings of a window or of a run without one, and the parsers of their texts.

use std::path::PathBuf;

use relevo_core::select::EdgeRule;

use crate::governor::Target;
use crate::gpu::Paint;

/// The rule that chooses the triangles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Lod {
    /// Tiles by their errors, and the steps of their patches by theirs.
    #[default]
    Hybrid,
    /// Tiles by their errors, every patch at full resolution: chunked level of detail, to compare
    /// with.
    Tiles,
    /// The leaves at full resolution.
    Full,
}

/// The system of the two coordinates of a place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Coordinates {
    /// Columns and rows of samples.
    #[default]
    Samples,
    /// The file's own coordinate system.
    Crs,
    /// Degrees of longitude and latitude.
    LonLat,
}

/// Settings of the window and of the runs without one.
#[derive(Clone, Debug)]
pub struct Settings {
    /// The `.rlv` file.
    pub file: PathBuf,
    /// Pixels by which what is drawn may be off.
    pub tolerance: f64,
    /// Factor of heights.
    pub exaggeration: f64,
    /// Rule for the steps of shared edges.
    pub rule: EdgeRule,
    /// The rule that chooses the triangles; a window takes [`Lod::Hybrid`].
    pub lod: Lod,
    /// Budget on the GPU, in bytes.
    pub gpu_memory: u64,
    /// Budget for decoded tiles in main memory, in bytes.
    pub ram_cache: u64,
    /// Size of the picture or the window, in pixels.
    pub size: (u32, u32),
    /// Limit for the cost of a frame.
    pub target: Option<Target>,
    /// `auto`, `software`, or a part of an adapter's name.
    pub adapter: String,
    /// Colours.
    pub paint: Paint,
    /// Draw the edges of triangles.
    pub wireframe: bool,
    /// Draw the borders of tiles.
    pub borders: bool,
}

/// Parses a number of bytes such as `512MiB`, `2GiB`, `1500000`.
pub fn bytes(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let at = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(at);
    let factor: u64 = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 1,
        "kib" | "k" => 1 << 10,
        "mib" | "m" => 1 << 20,
        "gib" | "g" => 1 << 30,
        "kb" => 1_000,
        "mb" => 1_000_000,
        "gb" => 1_000_000_000,
        other => return Err(format!("no such unit: {other}; use KiB, MiB or GiB")),
    };
    let number: f64 =
        number.parse().map_err(|_| format!("{text:?} is not a number of bytes; write 512MiB"))?;
    Ok((number * factor as f64) as u64)
}

/// Parses a width and a height such as `1280x720`.
pub fn size(text: &str) -> Result<(u32, u32), String> {
    let bad = || format!("{text:?} is not a size; write 1280x720, each at most 16384");
    let (width, height) = text.split_once(['x', 'X']).ok_or_else(bad)?;
    let side = |text: &str| text.parse().ok().filter(|side| (1..=16_384).contains(side));
    Ok((side(width).ok_or_else(bad)?, side(height).ok_or_else(bad)?))
}

/// Parses a number above 0.
pub fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite() && *number > 0.0);
    number.ok_or_else(|| format!("{text:?} is not a number above 0"))
}

/// Parses two coordinates and a height such as `600,400,2500`.
pub fn place(text: &str) -> Result<[f64; 3], String> {
    let bad = || format!("{text:?} is not a place; write two coordinates and a height: 600,400,2500");
    let numbers: Option<Vec<f64>> = text
        .split(',')
        .map(|part| part.trim().parse().ok().filter(|number: &f64| number.is_finite()))
        .collect();
    numbers.and_then(|list| list.try_into().ok()).ok_or_else(bad)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_read_or_refused() {
        assert_eq!(bytes("512MiB"), Ok(512 << 20));
        assert_eq!(bytes("1.5 GiB"), Ok(3 << 29));
        assert_eq!((bytes("7"), bytes("2mb")), (Ok(7), Ok(2_000_000)));
        assert!(bytes("many").is_err() && bytes("3 XiB").is_err() && bytes("").is_err());
        assert_eq!(size("1280x720"), Ok((1280, 720)));
        assert!(size("1280").is_err() && size("0x7").is_err() && size("99999x1").is_err());
        assert_eq!(place("1, 2.5,-3"), Ok([1.0, 2.5, -3.0]));
        assert!(place("1,2").is_err() && place("a,b,c").is_err() && place("1,2,inf").is_err());
        assert!(positive("0").is_err() && positive("-1").is_err() && positive("0.5").is_ok());
    }
}
