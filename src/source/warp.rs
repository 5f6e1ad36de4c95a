//! Options of warping: the target grid and how samples are made. The work is done by `gdal`.

use serde::{Deserialize, Serialize};

/// A request to warp: coordinate system, resolution and resampling. If there is one, every raster
/// is warped.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Warp {
    /// `EPSG:…`, WKT, or another form that GDAL reads; `None`: that of the first file.
    pub crs: Option<String>,
    /// Sample spacing along x and y in units of the coordinate system; `None`: what `gdalwarp`
    /// chooses, the finest of all files.
    pub resolution: Option<(f64, f64)>,
    /// How a sample is computed from its neighbours.
    pub resampling: Resampling,
}

/// How a sample is computed from its neighbours, by GDAL's names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Resampling {
    /// The nearest sample: no new heights, but shifts of up to half a sample.
    Near,
    /// Linear between four neighbours: continuous, never above or below them. The default.
    #[default]
    Bilinear,
    /// Cubic convolution of 16 samples; overshoots at cliffs.
    Cubic,
    /// Cubic B-spline of 16 samples; smooths.
    CubicSpline,
    /// Windowed sinc of 36 samples; overshoots at cliffs.
    Lanczos,
    /// Mean of all samples that the new one covers: for much coarser resolutions.
    Average,
}

impl Resampling {
    /// All methods.
    pub const ALL: [Self; 6] =
        [Self::Near, Self::Bilinear, Self::Cubic, Self::CubicSpline, Self::Lanczos, Self::Average];

    /// The method's name, which `gdalwarp -r` takes too.
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
