//! The frame of a mesh: from its coordinates to columns, rows and metres.

use std::path::Path;

use relevo::mesh_file::Mesh;
use relevo::select;
use relevo::{Error, Geo, Rect};
use serde_json::Value;

/// What the coordinates of a mesh are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frame {
    /// Metres, as the mesh itself says.
    Local,
    /// The coordinate system of the terrain.
    Crs,
    /// Columns and rows.
    Pixel,
    /// Columns, and rows counted from the last.
    PixelNorth,
}

impl Frame {
    const ALL: [Self; 4] = [Self::Local, Self::Crs, Self::Pixel, Self::PixelNorth];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Local => "local",
            Self::Crs => "crs",
            Self::Pixel => "pixel",
            Self::PixelNorth => "pixel-north",
        }
    }

    /// The frame with a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|frame| frame.name() == name)
    }
}

/// `matrix * x + offset`.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    matrix: [[f64; 3]; 3],
    offset: [f64; 3],
}

/// What a mesh of this program says of itself.
#[derive(Default)]
pub struct About {
    /// What its coordinates are, if it says so by a name that is known.
    pub frame: Option<Frame>,
    /// From column, row and metres to its coordinates.
    to_frame: Option<Map>,
    /// The samples that it covers.
    pub window: Option<Rect>,
    /// How far it promises to be off at most.
    pub max_error_m: Option<f64>,
    /// True if it has walls and a floor.
    pub is_solid: bool,
}

/// A window of samples: column, row, columns, rows.
pub fn rect([x, y, width, height]: [u32; 4]) -> Option<Rect> {
    let (columns, rows) = (x..x.checked_add(width)?, y..y.checked_add(height)?);
    Some(Rect { columns, rows }).filter(|rect| !rect.is_empty())
}

fn numbers<const N: usize>(value: &Value) -> Option<[f64; N]> {
    let list: Option<Vec<f64>> = value.as_array()?.iter().map(Value::as_f64).collect();
    list?.try_into().ok()
}

impl About {
    /// What a file says; fails if that cannot be.
    pub fn of(about: &Value) -> Result<Self, Error> {
        let relevo = &about["relevo"];
        let wrong = |name: &str, expected: &str| {
            Error::format(format!("`{name}` of what the mesh says of itself"), expected, &relevo[name])
        };
        let told = |name: &str| Some(&relevo[name]).filter(|value| !value.is_null());
        let window = told("window").map(|value| {
            let list = numbers::<4>(value)?.map(|number| number as u32);
            rect(list)
        });
        let to_frame = told("to_frame").map(|value| {
            let rows = value["matrix"].as_array()?.iter().map(numbers).collect::<Option<Vec<[f64; 3]>>>()?;
            Some(Map { matrix: rows.try_into().ok()?, offset: numbers(&value["offset"])? })
        });
        let max_error_m = told("max_error_m").map(|value| value.as_f64().filter(|metres| *metres >= 0.0));
        let or = |name: &'static str, expected: &'static str| move || wrong(name, expected);
        Ok(Self {
            frame: relevo["frame"].as_str().and_then(Frame::named),
            to_frame: to_frame
                .map(|map| map.ok_or_else(or("to_frame", "a matrix of 3 x 3 and an offset")))
                .transpose()?,
            window: window
                .map(|rect| rect.ok_or_else(or("window", "column, row, columns, rows")))
                .transpose()?,
            max_error_m: max_error_m
                .map(|metres| metres.ok_or_else(or("max_error_m", "metres")))
                .transpose()?,
            is_solid: relevo["solid"].as_bool().unwrap_or(false),
        })
    }
}

impl About {
    /// Takes coordinates as those of `relevo mesh`, unless the mesh says itself what they are:
    /// metres from the sample in the middle of the window.
    pub fn assume_local(&mut self, geo: &Geo, [width, height]: [u32; 2], window: Option<&Rect>) {
        if self.to_frame.is_some() {
            return;
        }
        let middle = |range: std::ops::Range<u32>| range.start + (range.end.max(1) - 1 - range.start) / 2;
        let whole = Rect { columns: 0..width, rows: 0..height };
        let window = window.unwrap_or(&whole).clone();
        let (column, row) = (middle(window.columns), middle(window.rows));
        let metres = select::Frame::at(geo, column, row);
        self.to_frame = Some(Map {
            matrix: [[metres.dx, 0.0, 0.0], [0.0, -metres.dy, 0.0], [0.0, 0.0, 1.0]],
            offset: [-metres.dx * f64::from(column), metres.dy * f64::from(row), 0.0],
        });
    }
}

impl Map {
    fn determinant(&self) -> f64 {
        let [a, b, c] = self.matrix;
        a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
    }

    /// The way back; `None` if there is none.
    fn inverse(&self) -> Option<Self> {
        let (m, determinant) = (&self.matrix, self.determinant());
        if determinant == 0.0 || !determinant.is_finite() {
            return None;
        }
        let minor = |r: usize, c: usize| {
            let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
            m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
        };
        let matrix = [0, 1, 2].map(|r| [0, 1, 2].map(|c| minor(c, r) / determinant));
        let back = Self { matrix, offset: [0.0; 3] }.of(self.offset);
        Some(Self { matrix, offset: back.map(|v| -v) })
    }

    fn of(&self, place: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|r| {
            let [a, b, c] = self.matrix[r];
            a * place[0] + b * place[1] + c * place[2] + self.offset[r]
        })
    }
}

/// The map from coordinates of a mesh to column, row and metres.
pub fn map(
    frame: Frame,
    about: &About,
    geo: &Geo,
    [_, height]: [u32; 2],
    z_scale: f64,
) -> Result<Map, Error> {
    let z = [0.0, 0.0, 1.0 / z_scale];
    let last = f64::from(height) - 1.0;
    match frame {
        Frame::Local => {
            let to_frame = about.to_frame.as_ref().ok_or_else(|| {
                Error::usage(
                    "the mesh does not say what its coordinates are: give --frame crs (those of the terrain's coordinate system), \
                     pixel (columns and rows), pixel-north (rows counted from the last) or local (those of relevo mesh)",
                )
            })?;
            let mut map = to_frame.inverse().ok_or_else(|| {
                Error::format(
                    "`to_frame` of what the mesh says of itself",
                    "a matrix that can be inverted",
                    "another",
                )
            })?;
            map.matrix[2] = map.matrix[2].map(|v| v / z_scale);
            map.offset[2] /= z_scale;
            Ok(map)
        }
        Frame::Crs => {
            let [_, a, b, _, d, e] = geo.transform_or_identity();
            let columns = geo.sample_from_world(0.0, 0.0).ok_or_else(|| {
                Error::usage("the terrain has a geotransform that cannot be inverted: give --frame pixel or pixel-north")
            })?;
            let determinant = a * e - b * d;
            let matrix =
                [[e / determinant, -b / determinant, 0.0], [-d / determinant, a / determinant, 0.0], z];
            Ok(Map { matrix, offset: [columns.0, columns.1, 0.0] })
        }
        Frame::Pixel => Ok(Map { matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], z], offset: [0.0; 3] }),
        Frame::PixelNorth => {
            Ok(Map { matrix: [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], z], offset: [0.0, last, 0.0] })
        }
    }
}

/// True if a format keeps coordinates as float32.
pub fn keeps_f32(file: &Path) -> bool {
    file.extension().is_some_and(|end| ["glb", "stl"].iter().any(|of| end.eq_ignore_ascii_case(of)))
}

/// A mesh in columns, rows and metres.
pub struct Placed {
    pub vertices: Vec<[f64; 3]>,
    pub triangles: Vec<[u32; 3]>,
    /// How near a triangle a sample counts as covered.
    pub near: f64,
}

/// Puts a mesh into columns, rows and metres.
pub fn place(mesh: Mesh, map: &Map, is_f32: bool) -> Placed {
    let Mesh { vertices, mut triangles, .. } = mesh;
    // What is counter-clockwise stays so where rows run against the second coordinate.
    if map.determinant() > 0.0 {
        for triangle in &mut triangles {
            triangle.swap(1, 2);
        }
    }
    let largest =
        [0, 1, 2].map(|axis| vertices.iter().fold(0.0_f64, |largest, v| largest.max(v[axis].abs())));
    let rounding = |row: &[f64; 3]| row.iter().zip(largest).map(|(by, size)| by.abs() * size).sum::<f64>();
    let rounding = rounding(&map.matrix[0]).max(rounding(&map.matrix[1])) / f64::from(1_u32 << 24);
    let near = if is_f32 { rounding.clamp(1e-6, 0.25) } else { 1e-6 };
    let vertices = vertices.into_iter().map(|vertex| map.of(vertex)).collect();
    Placed { vertices, triangles, near }
}
