//! The frame, the camera, and the size of errors on the screen.

use crate::container::{Header, Reader};
use crate::geo::Geo;

/// The flat coordinate frame of drawing, in metres: x east, y north, z up, the origin at sample (0,
/// 0), height 0.
///
/// Sample (column, row) is at `(column * dx, -row * dy, height * exaggeration)`: one spacing for
/// the whole raster.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Metres from one column to the next.
    pub dx: f64,
    /// Metres from one row to the next.
    pub dy: f64,
    /// Factor of heights and of vertical errors; 1 is true to scale.
    pub exaggeration: f64,
}

impl Frame {
    /// The frame of a file: its spacing in the middle of the raster.
    pub fn of(reader: &Reader) -> Self {
        Self::new(reader.header(), reader.geo())
    }

    /// The frame of a lattice.
    pub fn new(header: &Header, geo: &Geo) -> Self {
        Self::at(geo, header.width / 2, header.height / 2)
    }

    /// The frame whose columns and rows have the metres that they have at a sample.
    pub fn at(geo: &Geo, column: u32, row: u32) -> Self {
        let spacing = geo.spacing((column, column), (row, row));
        // At a pole, or if the spacing is not a number, a square spacing keeps the view finite.
        let good = |metres: f64| metres.is_finite() && metres > 0.0;
        let or = |metres: f64, other: f64| {
            if good(metres) {
                metres
            } else if good(other) {
                other
            } else {
                1.0
            }
        };
        Self { dx: or(spacing.dx, spacing.dy), dy: or(spacing.dy, spacing.dx), exaggeration: 1.0 }
    }

    /// The position of a point of the lattice, `height` in metres.
    pub fn position(&self, column: f64, row: f64, height: f64) -> [f64; 3] {
        [column * self.dx, -row * self.dy, height * self.exaggeration]
    }

    /// Column, row and height of a position.
    pub fn lattice(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        [x / self.dx, -y / self.dy, z / self.exaggeration]
    }
}

/// A box with sides along the axes of the frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Box3 {
    /// Least coordinates.
    pub low: [f64; 3],
    /// Greatest coordinates.
    pub high: [f64; 3],
}

impl Box3 {
    /// The box over the square of `side` intervals from sample `(left, top)`, with heights in
    /// metres.
    pub fn of_square(frame: &Frame, left: f64, top: f64, side: f64, low: f64, high: f64) -> Self {
        let north_west = frame.position(left, top, low);
        let south_east = frame.position(left + side, top + side, high);
        Self {
            low: [north_west[0], south_east[1], north_west[2]],
            high: [south_east[0], north_west[1], south_east[2]],
        }
    }

    /// Distance of a point to the nearest point of the box; 0 inside.
    pub fn distance(&self, p: [f64; 3]) -> f64 {
        let outside = |i: usize| (self.low[i] - p[i]).max(p[i] - self.high[i]).max(0.0);
        (outside(0).powi(2) + outside(1).powi(2) + outside(2).powi(2)).sqrt()
    }

    /// False if the whole box is outside one of the planes of [`View::planes`].
    pub fn is_inside(&self, planes: &[([f64; 3], f64)]) -> bool {
        planes.iter().all(|&([a, b, c], d)| {
            let far = |i: usize, n: f64| if n > 0.0 { self.high[i] } else { self.low[i] };
            a * far(0, a) + b * far(1, b) + c * far(2, c) + d >= 0.0
        })
    }

    /// The corners.
    pub fn corners(&self) -> [[f64; 3]; 8] {
        std::array::from_fn(|i| {
            std::array::from_fn(|axis| if i >> axis & 1 == 0 { self.low[axis] } else { self.high[axis] })
        })
    }
}

/// A perspective camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Its position in the frame.
    pub eye: [f64; 3],
    /// Unit vector to the right of the image.
    pub right: [f64; 3],
    /// Unit vector to the top of the image.
    pub up: [f64; 3],
    /// Unit vector of the viewing direction.
    pub forward: [f64; 3],
    /// Tangent of half the horizontal field of view.
    pub tan_x: f64,
    /// Tangent of half the vertical field of view.
    pub tan_y: f64,
    /// Width of the image in pixels.
    pub width: u32,
    /// Height of the image in pixels.
    pub height: u32,
    /// Metres to the near plane, above 0; nearer points are not drawn.
    pub near: f64,
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(a: [f64; 3]) -> Option<[f64; 3]> {
    let length = dot(a, a).sqrt();
    (length > 0.0 && length.is_finite()).then(|| a.map(|c| c / length))
}

impl View {
    /// A camera at `eye` that looks at `target` with the frame's z upwards (north, if it looks
    /// straight up or down); `fov_y` is the vertical field of view in radians.
    pub fn look_at(
        eye: [f64; 3],
        target: [f64; 3],
        fov_y: f64,
        (width, height): (u32, u32),
        near: f64,
    ) -> Self {
        let forward =
            unit([target[0] - eye[0], target[1] - eye[1], target[2] - eye[2]]).unwrap_or([0.0, 1.0, 0.0]);
        let steep = forward[2].abs() > 1.0 - 1e-9;
        let right = unit(cross(forward, if steep { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] }))
            .unwrap_or([1.0, 0.0, 0.0]);
        let tan_y = (fov_y / 2.0).tan();
        let tan_x = tan_y * f64::from(width) / f64::from(height.max(1));
        Self { eye, right, up: cross(right, forward), forward, tan_x, tan_y, width, height, near }
    }

    /// Pixels of a unit of tangent: lambda of papers 000 and 001, `width / (2 tan(theta / 2))`.
    pub fn lambda(&self) -> f64 {
        f64::from(self.width) / (2.0 * self.tan_x)
    }

    /// Coordinates along right, up and forward, relative to the eye.
    pub fn relative(&self, p: [f64; 3]) -> [f64; 3] {
        let d = [p[0] - self.eye[0], p[1] - self.eye[1], p[2] - self.eye[2]];
        [dot(d, self.right), dot(d, self.up), dot(d, self.forward)]
    }

    /// The pixel of a point, from the top left corner; `None` if it is nearer than the near plane.
    pub fn pixel(&self, p: [f64; 3]) -> Option<[f64; 2]> {
        let [x, y, z] = self.relative(p);
        let lambda = self.lambda();
        (z >= self.near).then(|| {
            [f64::from(self.width) / 2.0 + lambda * x / z, f64::from(self.height) / 2.0 - lambda * y / z]
        })
    }

    /// False if the whole box is outside one side of the view, or nearer than the near plane.
    pub fn sees(&self, space: &Box3) -> bool {
        space.is_inside(&self.planes())
    }

    /// The planes of the sides of the view (right, left, top, bottom) and the near plane:
    /// `n p + d >= 0` inside.
    pub fn planes(&self) -> [([f64; 3], f64); 5] {
        let side = |axis: [f64; 3], tan: f64| -> [f64; 3] {
            std::array::from_fn(|i| self.forward[i] * tan - axis[i])
        };
        let minus = |axis: [f64; 3]| axis.map(|c| -c);
        let normals = [
            side(self.right, self.tan_x),
            side(minus(self.right), self.tan_x),
            side(self.up, self.tan_y),
            side(minus(self.up), self.tan_y),
        ];
        let [a, b, c, d] = normals.map(|n| (n, -dot(n, self.eye)));
        [a, b, c, d, (self.forward, -dot(self.forward, self.eye) - self.near)]
    }

    /// The most pixels by which errors can move a point of a box on the screen: see [`PixelScale`].
    /// `vertical` is exaggerated.
    pub fn projected(&self, space: &Box3, vertical: f64, horizontal: f64) -> f64 {
        self.pixel_scale(space).pixels(vertical, horizontal)
    }

    /// The scale from metres of error to pixels for a box.
    pub fn pixel_scale(&self, space: &Box3) -> PixelScale {
        let corners = space.corners().map(|corner| self.relative(corner));
        let least = corners.iter().fold(f64::INFINITY, |least, q| least.min(q[2]));
        // The ranges of the tangents x / z and y / z in the view.
        let mut tangents = [[-self.tan_x, self.tan_x], [-self.tan_y, self.tan_y]];
        let mut rho2 = self.tan_x.powi(2) + self.tan_y.powi(2);
        if least > 0.0 {
            // The tangents of a convex body in front of the eye have their extremes at its corners.
            let of_box = corners.iter().map(|q| [q[0] / q[2], q[1] / q[2]]);
            rho2 = rho2.min(of_box.clone().map(|[x, y]| x * x + y * y).fold(0.0, f64::max));
            for (axis, ends) in tangents.iter_mut().enumerate() {
                let of_axis = of_box.clone().map(|t| t[axis].clamp(ends[0], ends[1]));
                *ends = [
                    of_axis.clone().fold(f64::INFINITY, f64::min),
                    of_axis.fold(f64::NEG_INFINITY, f64::max),
                ];
            }
        }
        let (z_x, z_y, z_z) = (self.right[2], self.up[2], self.forward[2]);
        // The function is convex in either tangent: greatest at an end.
        let along =
            |z: f64, ends: [f64; 2]| ends.map(|t| (z - t * z_z).abs()).into_iter().fold(0.0, f64::max);
        let stretch = (1.0 + rho2).sqrt();
        PixelScale {
            depth: least.max(self.near).max(space.distance(self.eye) / stretch),
            vertical: along(z_x, tangents[0]).hypot(along(z_y, tangents[1])).min(stretch),
            horizontal: stretch,
            lambda: self.lambda(),
        }
    }
}

/// The scale from metres of error in a box to pixels on the screen: an upper bound.
///
/// The papers take `lambda E / d`, with the distance `d` of the box. That is right for an error
/// across the line of sight in the middle of the image. Elsewhere perspective stretches the image,
/// and an error along the line of sight is seen less. A point at depth `z` with tangents
/// `t = (x, y) / z` that is moved by a vector with the components `e` along right and up, `f` along
/// forward, moves by `lambda |e - t f| / (z + f)` pixels. For a vector of length E that is at most
/// `lambda E sqrt(1 + |t|^2) / (z - E)`, and less for an upright one seen from above: `|e - t f|`
/// is convex in `t`, so its greatest value is at an end of the range of `t` over the points of the
/// box that are in the view. Their depth is at least the box's least one, and at least
/// `d / sqrt(1 + |t|^2)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelScale {
    /// Least depth, metres.
    pub depth: f64,
    /// Greatest apparent size, in metres at depth 1, of a metre of vertical error.
    pub vertical: f64,
    /// Greatest apparent size, in metres at depth 1, of a metre of horizontal error.
    pub horizontal: f64,
    /// Pixels of a unit of tangent.
    pub lambda: f64,
}

impl PixelScale {
    /// Most pixels of a vertical (exaggerated) and a horizontal error in metres; 0 for no error.
    pub fn pixels(&self, vertical: f64, horizontal: f64) -> f64 {
        let metres = vertical.hypot(horizontal);
        if metres <= 0.0 {
            return 0.0;
        }
        let left = self.depth - metres;
        let seen = (vertical * self.vertical).hypot(horizontal * self.horizontal);
        if left > 0.0 { self.lambda * seen / left } else { f64::INFINITY }
    }
}
