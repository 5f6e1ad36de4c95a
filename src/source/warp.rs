//! What a raster is warped to: the request, without the means (those are `gdal`'s).

use serde::{Deserialize, Serialize};

/// A coordinate system, a resolution, and how samples are made. Any raster is warped if there is a
/// request at all.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Warp {
    /// `EPSG:…`, WKT, or whatever else GDAL takes for one; `None`: that of the first file.
    pub crs: Option<String>,
    /// Steps along x and y in units of the coordinate system; `None`: what `gdalwarp` chooses, the
    /// finest of all files.
    pub resolution: Option<(f64, f64)>,
    /// How a sample is made of those around it.
    pub resampling: Resampling,
}

/// How a sample is made of those around it, by GDAL's names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Resampling {
    /// The nearest one: no height that is not in the file, but steps of up to half a sample
    /// sideways.
    Near,
    /// Linear between the four around it: continuous, and never above or below them. The default.
    #[default]
    Bilinear,
    /// Cubic convolution of 16; overshoots at cliffs.
    Cubic,
    /// Cubic B-spline of 16: smooths.
    CubicSpline,
    /// Windowed sinc of 36; overshoots at cliffs.
    Lanczos,
    /// Mean of all that a sample covers: for much coarser resolutions.
    Average,
}

impl Resampling {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Near, Self::Bilinear, Self::Cubic, Self::CubicSpline, Self::Lanczos, Self::Average];

    /// Its name, which `gdalwarp -r` takes too.
    pub fn name(self) -> &'static str {
        match self {
            Self::Near => "near",
            Self::Bilinear => "bilinear",
            Self::Cubic => "cubic",
            Self::CubicSpline => "cubicspline",
            Self::Lanczos => "lanczos",
            Self::Average => "average",
        }
    }
}
