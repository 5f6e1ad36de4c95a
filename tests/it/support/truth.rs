//! The surface of full resolution, and the drawn triangles, in the plainest way.

use std::path::{Path, PathBuf};

use relevo::TileId;
use relevo::container::Reader;
use relevo::pipeline::{BuildOptions, Silent, build};
use relevo::sample::VALID;
use relevo::select::{Frame, TileData};
use relevo::source::Source;
use tempfile::TempDir;

/// A built file, as long as it is held.
pub struct Built {
    folder: TempDir,
    /// Open.
    pub reader: Reader,
}

impl Built {
    pub fn new(source: &dyn Source, tile: u32, patch: u32) -> Self {
        Self::with(source, &BuildOptions { tile, patch, ..BuildOptions::default() })
    }

    pub fn with(source: &dyn Source, options: &BuildOptions) -> Self {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a.rlv");
        build(source, &path, &BuildOptions { jobs: Some(2), ..options.clone() }, &Silent).expect("build");
        Self { reader: Reader::open(&path).expect("open"), folder }
    }

    pub fn path(&self) -> PathBuf {
        self.folder.path().join("a.rlv")
    }

    /// Every existing tile, coarse ones first.
    pub fn tiles(&self) -> Vec<TileId> {
        (0..=self.reader.header().levels).flat_map(|level| self.reader.tiles(level).expect("tiles")).collect()
    }

    pub fn data(&self, id: TileId) -> TileData {
        tile_data(&self.reader, &Frame::of(&self.reader), id)
    }
}

pub fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/dem").join(name)
}

pub fn open(path: &Path) -> Box<dyn Source> {
    relevo::source::open(path, &relevo::limits::Limits::default()).expect("source")
}

pub fn tile_data(reader: &Reader, frame: &Frame, id: TileId) -> TileData {
    let entry = reader.entry(id).expect("entry").expect("tile");
    let (lattice, table) = (reader.read_tile(id).expect("tile"), reader.read_errors(id).expect("errors"));
    TileData::new(reader.header(), reader.geo(), frame, &entry, &lattice, &table).expect("data")
}

/// A point of the lattice in quarters of an interval.
pub type Quarters = (u64, u64);

/// All samples of a raster and the surface between them.
pub struct Truth {
    pub width: u64,
    pub height: u64,
    pub z: Vec<f64>,
    pub valid: Vec<bool>,
    side: u64,
}

impl Truth {
    pub fn of(reader: &Reader) -> Self {
        let header = reader.header();
        let side = u64::from(header.tile()) << header.levels;
        let along = |samples: u32| (u64::from(samples) + 1).min(side + 1);
        let (width, height) = (along(header.width), along(header.height));
        let count = (width * height) as usize;
        let mut truth = Self { width, height, z: vec![0.0; count], valid: vec![false; count], side };
        for id in reader.tiles(header.levels).expect("tiles") {
            let (lattice, (left, top)) = (reader.read_tile(id).expect("tile"), header.origin(id));
            for y in (0..=lattice.n).filter(|&y| top + (y as u64) < height) {
                for x in (0..=lattice.n).filter(|&x| left + (x as u64) < width) {
                    let (from, to) =
                        (lattice.at(x, y), ((top + y as u64) * width + left + x as u64) as usize);
                    truth.z[to] = header.metres_of(lattice.code[from], lattice.low_at(from));
                    truth.valid[to] = lattice.state[from] == VALID;
                }
            }
        }
        truth
    }

    pub fn sample(&self, column: u64, row: u64) -> (f64, bool) {
        if column >= self.width || row >= self.height {
            return (0.0, false);
        }
        let at = (row * self.width + column) as usize;
        (self.z[at], self.valid[at])
    }

    pub fn has_voids(&self) -> bool {
        let raster =
            |i: usize| (i as u64 % self.width) + 1 < self.width && (i as u64 / self.width) + 1 < self.height;
        self.valid.iter().enumerate().any(|(i, &valid)| !valid && raster(i))
    }

    /// Validity and height at a point: twice, from the north-west and the south-east, if it is on
    /// the edge of cells, they agree.
    pub fn at(&self, (x, y): Quarters) -> (f64, f64) {
        let (i, j) = ((x / 4).min(self.side - 1), (y / 4).min(self.side - 1));
        let (u, v) = ((x - 4 * i) as f64 / 4.0, (y - 4 * j) as f64 / 4.0);
        let weights = if (i + j) % 2 == 0 {
            if u >= v { [1.0 - u, u - v, 0.0, v] } else { [1.0 - v, 0.0, v - u, u] }
        } else if u + v <= 1.0 {
            [1.0 - u - v, u, v, 0.0]
        } else {
            [0.0, 1.0 - v, 1.0 - u, u + v - 1.0]
        };
        let corners = [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)];
        let (mut validity, mut height) = (0.0, 0.0);
        for ((i, j), weight) in corners.into_iter().zip(weights) {
            let (z, valid) = self.sample(i, j);
            if weight > 0.0 {
                (validity, height) = (validity + if valid { weight } else { 0.0 }, height + weight * z);
            }
        }
        (validity, height)
    }

    /// Pieces of the outline, in samples: where validity is 1/2 in a triangle.
    pub fn outline(&self) -> Vec<[[f64; 2]; 2]> {
        let mut out = Vec::new();
        let last = |samples: u64| samples.min(self.side);
        for (x, y) in (0..last(self.height)).flat_map(|y| (0..last(self.width)).map(move |x| (x, y))) {
            let (a, b, c, d) = ((x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1));
            for triangle in if (x + y) % 2 == 0 { [[a, b, d], [a, c, d]] } else { [[a, b, c], [b, c, d]] } {
                let mut ends = Vec::new();
                for (p, q) in [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (triangle[i], triangle[j])) {
                    if self.sample(p.0, p.1).1 != self.sample(q.0, q.1).1 {
                        ends.push([(p.0 + q.0) as f64 / 2.0, (p.1 + q.1) as f64 / 2.0]);
                    }
                }
                if let [p, q] = ends[..] {
                    out.push([p, q]);
                }
            }
        }
        out
    }
}

/// Nearest point of some segments, in metres of the frame; its place in samples.
pub fn nearest(outline: &[[[f64; 2]; 2]], frame: &Frame, [x, y]: [f64; 2]) -> (f64, [f64; 2]) {
    let mut best = (f64::INFINITY, [x, y]);
    for &[p, q] in outline {
        let (ax, ay) = ((p[0] - x) * frame.dx, (p[1] - y) * frame.dy);
        let (ex, ey) = ((q[0] - p[0]) * frame.dx, (q[1] - p[1]) * frame.dy);
        let t = (-(ax * ex + ay * ey) / (ex * ex + ey * ey)).clamp(0.0, 1.0);
        let distance = (ax + t * ex).hypot(ay + t * ey);
        if distance < best.0 {
            best = (distance, [p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])]);
        }
    }
    best
}

/// A drawn triangle over the lattice: corners in quarters, heights, validity.
#[derive(Clone, Copy, Debug)]
pub struct Drawn {
    pub corners: [(i64, i64); 3],
    pub z: [f64; 3],
    pub valid: [bool; 3],
}

impl Drawn {
    /// Of corners of a patch that starts at sample `patch` of a tile at `origin`, whose samples are
    /// `spacing` apart.
    pub fn new(
        data: &TileData,
        origin: (u64, u64),
        spacing: u64,
        patch: (u32, u32),
        corners: [(u32, u32); 3],
    ) -> Self {
        let sample = corners.map(|(x, y)| (patch.0 + x, patch.1 + y));
        let at = sample.map(|(x, y)| (y * (data.n + 1) + x) as usize);
        Self {
            corners: sample.map(|(x, y)| {
                let along = |origin: u64, i: u32| 4 * (origin + u64::from(i) * spacing) as i64;
                (along(origin.0, x), along(origin.1, y))
            }),
            z: at.map(|at| f64::from(data.heights[at])),
            valid: at.map(|at| data.valid[at] == 1),
        }
    }

    /// Weights of the corners at a point; `None` outside.
    pub fn weights(&self, (x, y): Quarters) -> Option<[f64; 3]> {
        let [a, b, c] = self.corners;
        let p = (x as i64, y as i64);
        let area = |p: (i64, i64), q: (i64, i64), r: (i64, i64)| {
            (q.0 - p.0) * (r.1 - p.1) - (q.1 - p.1) * (r.0 - p.0)
        };
        let parts = [area(p, b, c), area(a, p, c), area(a, b, p)];
        let whole = area(a, b, c);
        parts.iter().all(|&part| part >= 0).then(|| parts.map(|part| part as f64 / whole as f64))
    }

    /// Validity and height there.
    pub fn at(&self, weights: [f64; 3]) -> (f64, f64) {
        let sum = |of: [f64; 3]| weights.iter().zip(of).filter(|(w, _)| **w > 0.0).map(|(w, v)| w * v).sum();
        (sum(self.valid.map(|valid| f64::from(u8::from(valid)))), sum(self.z))
    }

    /// Points in it that are `step` quarters apart.
    pub fn points(&self, step: u64) -> impl Iterator<Item = (Quarters, [f64; 3])> + '_ {
        let range = move |of: fn((i64, i64)) -> i64| {
            let all = self.corners.map(of);
            let (low, high) =
                (all.iter().min().copied().unwrap_or(0), all.iter().max().copied().unwrap_or(0));
            (low as u64..=high as u64).step_by(step as usize)
        };
        range(|p| p.1)
            .flat_map(move |y| range(|p| p.0).map(move |x| (x, y)))
            .filter_map(|p| Some((p, self.weights(p)?)))
    }
}
