//! The georeference of a lattice: geotransform, coordinate system, and metres of a sample step.
//!
//! Sample (column, row) is at the centre of its pixel. Here, and only here, half pixels are added:
//! the stored geotransform is GDAL's (it maps pixel *corners*, PixelIsArea and PixelIsPoint folded
//! into one).

mod scale;

pub use scale::{Plane, Planes, Scale};
use serde::{Deserialize, Serialize};

/// The kind of the horizontal coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "write", derive(wincode::SchemaRead, wincode::SchemaWrite))]
#[serde(rename_all = "lowercase")]
pub enum CrsKind {
    /// Longitude and latitude, in `unit` radians.
    Geographic,
    /// Easting and northing, in `unit` metres.
    Projected,
    /// Nothing known: coordinates in `unit` metres (1 unless the file says otherwise), as for
    /// seismic grids and models.
    #[default]
    Engineering,
}

/// An ellipsoid of revolution.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "write", derive(wincode::SchemaRead, wincode::SchemaWrite))]
pub struct Ellipsoid {
    /// Semi-major axis in metres.
    pub a: f64,
    /// Inverse flattening; 0 for a sphere.
    pub inverse_flattening: f64,
}

/// WGS 84, used if a geographic CRS does not name its ellipsoid.
pub const WGS84: Ellipsoid = Ellipsoid { a: 6_378_137.0, inverse_flattening: 298.257_223_563 };

/// The GeoTIFF keys of the source, which an export writes back unchanged.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "write", derive(wincode::SchemaRead, wincode::SchemaWrite))]
pub struct GeoKeys {
    /// Tag 34735.
    pub directory: Vec<u16>,
    /// Tag 34736.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub doubles: Vec<f64>,
    /// Tag 34737.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub ascii: String,
}

/// A coordinate reference system, as far as the file states it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "write", derive(wincode::SchemaRead, wincode::SchemaWrite))]
pub struct Crs {
    /// Geographic, projected or unknown.
    pub kind: CrsKind,
    /// EPSG code of the horizontal CRS; `None` if user-defined or absent.
    pub epsg: Option<u32>,
    /// Name for people; empty if unknown.
    pub name: String,
    /// OGC WKT 2 of the horizontal part if it could be written, else the source's own text; empty
    /// if there is none.
    pub wkt: String,
    /// Ellipsoid, for metres of a degree.
    pub ellipsoid: Ellipsoid,
    /// Radians (geographic) or metres (otherwise) of one horizontal unit.
    pub unit: f64,
    /// EPSG code of the vertical CRS, if the file names one.
    pub vertical_epsg: Option<u32>,
    /// Name of the vertical CRS or datum, for people; empty if the file names none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub vertical_name: String,
    /// True if the vertical system counts downwards: the samples are depths.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub vertical_down: bool,
    /// The source's own keys.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub keys: Option<GeoKeys>,
}

impl Default for Crs {
    fn default() -> Self {
        Self {
            kind: CrsKind::Engineering,
            epsg: None,
            name: String::new(),
            wkt: String::new(),
            ellipsoid: WGS84,
            unit: 1.0,
            vertical_epsg: None,
            vertical_name: String::new(),
            vertical_down: false,
            keys: None,
        }
    }
}

/// Metres of one step along a column and along a row of a tile: upper bounds over the whole tile,
/// such that the distance of two of its samples `i` columns and `j` rows apart is at most
/// `hypot(i * dx, j * dy)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spacing {
    /// Metres from one column to the next.
    pub dx: f64,
    /// Metres from one row to the next.
    pub dy: f64,
}

/// Georeference of a raster.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "write", derive(wincode::SchemaRead, wincode::SchemaWrite))]
pub struct Geo {
    /// GDAL geotransform (x0, dx/col, dx/row, y0, dy/col, dy/row) of pixel corners; `None` if the
    /// file has none.
    pub transform: Option<[f64; 6]>,
    /// True if the source said PixelIsPoint; only an export needs it.
    pub pixel_is_point: bool,
    /// The coordinate system.
    pub crs: Crs,
}

impl Geo {
    /// The geotransform, or GDAL's identity (x = column, y = row, of corners) if there is none.
    pub fn transform_or_identity(&self) -> [f64; 6] {
        self.transform.unwrap_or([0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    }

    /// World coordinates of sample (column, row), fractions allowed; the centre of its pixel.
    pub fn world_from_sample(&self, column: f64, row: f64) -> (f64, f64) {
        let [x0, a, b, y0, d, e] = self.transform_or_identity();
        let (c, r) = (column + 0.5, row + 0.5);
        (x0 + a * c + b * r, y0 + d * c + e * r)
    }

    /// Inverse of [`Geo::world_from_sample`]; `None` if the geotransform is singular.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// let (x, y) = reader.geo().world_from_sample(12.0, 34.0);
    /// let (column, row) = reader.geo().sample_from_world(x, y).unwrap();
    /// assert!((column - 12.0).abs() < 1e-6 && (row - 34.0).abs() < 1e-6);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn sample_from_world(&self, x: f64, y: f64) -> Option<(f64, f64)> {
        let [x0, a, b, y0, d, e] = self.transform_or_identity();
        let determinant = a * e - b * d;
        if determinant == 0.0 || !determinant.is_finite() {
            return None;
        }
        let (u, v) = (x - x0, y - y0);
        Some(((e * u - b * v) / determinant - 0.5, (a * v - d * u) / determinant - 0.5))
    }

    /// West, south, east and north of the outer pixel edges of a `width x height` lattice.
    ///
    /// ```
    /// # use relevo_core::{Reader, TileId};
    /// # let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../fixtures/vectors/int16-degrees.rlv");
    /// # let reader = Reader::open(path)?;
    /// let bounds = reader.geo().bounds(70, 50);
    /// assert!((bounds[0] - 10.0).abs() < 1e-9 && (bounds[3] - 62.0).abs() < 1e-9);
    /// # Ok::<(), relevo_core::Error>(())
    /// ```
    pub fn bounds(&self, width: u32, height: u32) -> [f64; 4] {
        let (w, h) = (f64::from(width) - 0.5, f64::from(height) - 0.5);
        let corners = [(-0.5, -0.5), (w, -0.5), (-0.5, h), (w, h)].map(|(c, r)| self.world_from_sample(c, r));
        corners.iter().fold(
            [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY],
            |[west, south, east, north], &(x, y)| [west.min(x), south.min(y), east.max(x), north.max(y)],
        )
    }

    /// Metres of a sample step over rows `rows` (inclusive) and columns `columns` of the lattice,
    /// rounded up.
    ///
    /// Projected and engineering: lengths of the column and row vectors. Geographic: arcs of the
    /// ellipsoid at the latitude of the range where they are longest. A sheared geotransform
    /// (column and row vector not at right angles) is covered by the factor `sqrt(1 + |cos|)` of
    /// their angle: `|iu + jv|^2 <= (1 + |cos|)(|iu|^2 + |jv|^2)`.
    pub fn spacing(&self, columns: (u32, u32), rows: (u32, u32)) -> Spacing {
        let [_, a, b, _, d, e] = self.transform_or_identity();
        let (mx, my) = self.metres_of_unit(columns, rows);
        let (ux, uy, vx, vy) = (a * mx, d * my, b * mx, e * my);
        let (u, v) = (ux.hypot(uy), vx.hypot(vy));
        let cos = if u > 0.0 && v > 0.0 { ((ux * vx + uy * vy) / (u * v)).abs() } else { 0.0 };
        let shear = if cos > 1e-9 { (1.0 + cos).sqrt() } else { 1.0 };
        // The factor covers the rounding of this function and of the sums made with its result.
        let up = shear * (1.0 + 1e-9);
        Spacing { dx: u * up, dy: v * up }
    }

    /// Metres of one horizontal unit along x and along y, at most, over a range of samples.
    fn metres_of_unit(&self, columns: (u32, u32), rows: (u32, u32)) -> (f64, f64) {
        if self.crs.kind != CrsKind::Geographic {
            return (self.crs.unit, self.crs.unit);
        }
        let mut nearest = f64::INFINITY;
        let mut farthest = 0.0_f64;
        let mut sign = 0.0;
        for column in [columns.0, columns.1] {
            for row in [rows.0, rows.1] {
                let (_, y) = self.world_from_sample(f64::from(column), f64::from(row));
                let latitude =
                    (y * self.crs.unit).clamp(-std::f64::consts::FRAC_PI_2, std::f64::consts::FRAC_PI_2);
                if latitude * sign < 0.0 {
                    nearest = 0.0;
                }
                sign = if latitude == 0.0 { sign } else { latitude.signum() };
                nearest = nearest.min(latitude.abs());
                farthest = farthest.max(latitude.abs());
            }
        }
        // A parallel is longest nearest the equator; a meridian's arc is longest nearest a pole.
        let (parallel, _) = self.crs.ellipsoid.metres_of_radian(nearest);
        let (_, meridian) = self.crs.ellipsoid.metres_of_radian(farthest);
        (parallel * self.crs.unit, meridian * self.crs.unit)
    }
}

impl Ellipsoid {
    /// Metres of one radian of longitude and of latitude at a latitude in radians: `N cos(lat)` and
    /// `M`.
    pub fn metres_of_radian(self, latitude: f64) -> (f64, f64) {
        let f = if self.inverse_flattening > 1.0 { 1.0 / self.inverse_flattening } else { 0.0 };
        let e2 = f * (2.0 - f);
        let w2 = 1.0 - e2 * latitude.sin().powi(2);
        (self.a / w2.sqrt() * latitude.cos().max(0.0), self.a * (1.0 - e2) / (w2 * w2.sqrt()))
    }
}
