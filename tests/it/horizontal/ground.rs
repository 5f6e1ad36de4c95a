//! Metres of the lattice, by integrals over the ellipsoid.

use std::f64::consts::FRAC_PI_2;

/// A point of the lattice: column, row.
pub type Point = (f64, f64);

/// Where the lattice lies: WGS 84 if in degrees, else in metres.
#[derive(Clone, Copy, Debug)]
pub struct Ground {
    pub transform: [f64; 6],
    pub degrees: bool,
}

/// Nodes and weights of the quadrature of Gauss and Legendre over 0..1, of five points.
const GAUSS: [(f64, f64); 5] = [
    (0.046_910_077_030_668, 0.118_463_442_528_095),
    (0.230_765_344_947_158, 0.239_314_335_249_683),
    (0.5, 0.284_444_444_444_444),
    (0.769_234_655_052_842, 0.239_314_335_249_683),
    (0.953_089_922_969_332, 0.118_463_442_528_095),
];

/// Metres of a radian of longitude and of latitude.
fn radians(latitude: f64) -> (f64, f64) {
    let (a, f) = (6_378_137.0, 1.0 / 298.257_223_563);
    let e2: f64 = f * (2.0 - f);
    let w = (1.0 - e2 * latitude.sin() * latitude.sin()).sqrt();
    (a * latitude.cos() / w, a * (1.0 - e2) / (w * w * w))
}

impl Ground {
    fn place(self, (c, r): Point) -> (f64, f64) {
        let [x0, a, b, y0, d, e] = self.transform;
        let (c, r) = (c + 0.5, r + 0.5);
        let place = (x0 + a * c + b * r, y0 + d * c + e * r);
        if self.degrees { (place.0.to_radians(), place.1.to_radians()) } else { place }
    }

    /// Length of the line between two points.
    pub fn distance(self, p: Point, q: Point) -> f64 {
        let (p, q) = (self.place(p), self.place(q));
        let (dx, dy) = (q.0 - p.0, q.1 - p.1);
        if !self.degrees {
            return dx.hypot(dy);
        }
        // Pieces that do not cross a pole, short enough for the quadrature.
        let mut cuts = vec![0.0, 1.0];
        cuts.extend(
            [FRAC_PI_2, -FRAC_PI_2]
                .map(|pole| (pole - p.1) / dy)
                .into_iter()
                .filter(|t| *t > 0.0 && *t < 1.0),
        );
        // Near a pole a parallel shrinks fast.
        let few = if dy.abs() < 0.002 { 1 } else { 4 };
        cuts.extend((1..few).map(|i| f64::from(i) / f64::from(few)));
        cuts.sort_by(f64::total_cmp);
        let piece = |from: f64, to: f64| {
            let at = |&(t, weight): &(f64, f64)| {
                let latitude = p.1 + dy * (from + (to - from) * t);
                // Beyond a pole there is the pole.
                let (parallel, meridian) =
                    if latitude.abs() < FRAC_PI_2 { radians(latitude) } else { (0.0, 0.0) };
                weight * (parallel * dx).hypot(meridian * dy)
            };
            (to - from) * GAUSS.iter().map(at).sum::<f64>()
        };
        cuts.windows(2).map(|cut| piece(cut[0], cut[1])).sum()
    }

    /// A point as [`about`] takes it: place, and metres of its units.
    pub fn mark(self, point: Point) -> [f64; 4] {
        let (x, y) = self.place(point);
        let (parallel, meridian) =
            if self.degrees { radians(y.clamp(-FRAC_PI_2, FRAC_PI_2)) } else { (1.0, 1.0) };
        [x, y, parallel, meridian]
    }

    /// Distance from a point to the nearest point of a piece: of a line that is straight on the
    /// ground, or by halving.
    pub fn to_piece(self, p: Point, [a, b]: [Point; 2]) -> f64 {
        let on = |t: f64| (a.0 + t * (b.0 - a.0), a.1 + t * (b.1 - a.1));
        if !self.degrees {
            let [p, a, b] = [p, a, b].map(|point| self.place(point));
            let (u, v) = (b.0 - a.0, b.1 - a.1);
            let t = (((p.0 - a.0) * u + (p.1 - a.1) * v) / (u * u + v * v)).clamp(0.0, 1.0);
            return (p.0 - a.0 - t * u).hypot(p.1 - a.1 - t * v);
        }
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..14 {
            let (t, u) = (low + (high - low) * 0.45, low + (high - low) * 0.55);
            if self.distance(p, on(t)) < self.distance(p, on(u)) { high = u } else { low = t }
        }
        let found = self.distance(p, on(0.5 * (low + high)));
        found.min(self.distance(p, a)).min(self.distance(p, b))
    }
}

/// About [`Ground::distance`], quickly.
pub fn about(p: &[f64; 4], q: &[f64; 4]) -> f64 {
    let (dx, dy) = ((q[0] - p[0]) * 0.5 * (p[2] + q[2]), (q[1] - p[1]) * p[3]);
    (dx * dx + dy * dy).sqrt()
}
