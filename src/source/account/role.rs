//! The role of a band: a colour, grey, an index, alpha.

/// GDAL's colour interpretation of a band.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::source) enum Role {
    Undefined,
    Grey,
    Palette,
    Red,
    Green,
    Blue,
    Alpha,
    /// Cyan, hue, lightness and the like.
    Other,
}

impl Role {
    /// The role of one of GDAL's names, ignoring case.
    pub(super) fn of_name(name: &str) -> Option<Self> {
        Some(match name.trim().to_ascii_lowercase().as_str() {
            "undefined" => Self::Undefined,
            "gray" => Self::Grey,
            "palette" => Self::Palette,
            "red" => Self::Red,
            "green" => Self::Green,
            "blue" => Self::Blue,
            "alpha" => Self::Alpha,
            "hue" | "saturation" | "lightness" | "cyan" | "magenta" | "yellow" | "black" | "ycbcr_y"
            | "ycbcr_cb" | "ycbcr_cr" => Self::Other,
            _ => return None,
        })
    }
}
