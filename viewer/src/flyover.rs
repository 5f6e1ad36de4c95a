//! The camera path that is flown if none is given: an overview, a descent, a low flight across the
//! terrain, and a climb.

use relevo_core::container::Reader;
use relevo_core::select::Frame;
use relevo_core::tile::TileId;
use relevo_core::{Error, Result};

use crate::camera::{FOV, Pose};
use crate::path::{CameraPath, Key};

/// Seconds of the whole path.
const SECONDS: f64 = 20.0;
/// Places of the low flight, as fractions of the raster's width and height: it meanders from the
/// south to the north.
const FLIGHT: [[f64; 2]; 5] = [[0.45, 0.80], [0.60, 0.66], [0.40, 0.52], [0.58, 0.38], [0.50, 0.22]];

/// Returns the pose that shows all of a file from the south, its heights times `exaggeration`.
pub fn overview(reader: &Reader, exaggeration: f64) -> Result<Pose> {
    let land = Land::new(reader, exaggeration)?;
    Ok(land.overview())
}

/// Returns the camera path, which depends on the file and the exaggeration alone.
pub fn path(reader: &Reader, exaggeration: f64) -> Result<CameraPath> {
    let land = Land::new(reader, exaggeration)?;
    let mut keys = vec![Key { time: 0.0, pose: land.overview() }];
    let step = SECONDS / (FLIGHT.len() as f64 + 1.0);
    // The last place that is looked at lies beyond the last that is flown over.
    let beyond = FLIGHT[FLIGHT.len() - 1].map(|c| c * 0.6);
    for (index, &place) in FLIGHT.iter().enumerate() {
        let next = FLIGHT.get(index + 1).copied().unwrap_or(beyond);
        let time = step * (index as f64 + 1.0);
        keys.push(Key { time, pose: land.low_flight(place, next)? });
    }
    let ([x, y, z], _) = keys[keys.len() - 1].pose.places(&land.frame);
    let pose = Pose::of(&land.frame, [x, y, z + 0.25 * land.side], land.at([0.5, 0.5], land.low));
    keys.push(Key { time: SECONDS, pose });
    CameraPath::new(FOV, keys)
}

/// The extent of a file in the frame.
struct Land<'a> {
    reader: &'a Reader,
    columns: f64,
    rows: f64,
    /// Lowest and highest ground as drawn, metres.
    low: f64,
    high: f64,
    /// Metres of the longer side.
    side: f64,
    frame: Frame,
}

impl<'a> Land<'a> {
    fn new(reader: &'a Reader, exaggeration: f64) -> Result<Self> {
        let header = reader.header();
        let frame = Frame { exaggeration, ..Frame::of(reader) };
        let absent = || Error::format("index", "a root tile", "none").at(reader.path());
        let root = reader.entry(TileId::ROOT)?.ok_or_else(absent)?;
        let (columns, rows) = (f64::from(header.width - 1), f64::from(header.height - 1));
        let side = (columns * frame.dx).max(rows * frame.dy).max(frame.dx);
        let [low, high] = [root.min_m, root.max_m].map(|metres| f64::from(metres) * exaggeration);
        Ok(Self { reader, columns, rows, low, high, side, frame })
    }

    /// Returns a place of the frame, from fractions of the raster and metres as drawn.
    fn at(&self, [x, y]: [f64; 2], z: f64) -> [f64; 3] {
        let [x, y, _] = self.frame.position(x * self.columns, y * self.rows, 0.0);
        [x, y, z]
    }

    /// Returns the nearest pose in the south from which all corners are in a picture of 16 to 10.
    fn overview(&self) -> Pose {
        let target = self.at([0.5, 0.5], (self.low + self.high) / 2.0);
        let heights = [self.low, self.high];
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
        let mut away = 0.25 * self.side;
        loop {
            let eye = [target[0], target[1] - away, self.high + 0.8 * away];
            let pose = Pose::of(&self.frame, eye, target);
            let view = pose.view(&self.frame, FOV, (1600, 1000));
            let seen = |place: [f64; 3]| {
                let pixel = view.pixel(place);
                pixel.is_some_and(|[x, y]| (0.0..1600.0).contains(&x) && (0.0..1000.0).contains(&y))
            };
            let all =
                heights.iter().all(|&height| corners.iter().all(|&corner| seen(self.at(corner, height))));
            if all || away > 100.0 * self.side {
                return pose;
            }
            away *= 1.05;
        }
    }

    /// Returns a pose above the highest ground near `place`, looking to `next` and slightly down.
    fn low_flight(&self, place: [f64; 2], next: [f64; 2]) -> Result<Pose> {
        let height = self.highest_near(place)? + 0.012 * self.side;
        // Raise the look where the ground ahead is high.
        let ahead = (height - 0.06 * self.side).max(self.highest_near(next)? - 0.05 * self.side);
        Ok(Pose::of(&self.frame, self.at(place, height), self.at(next, ahead)))
    }

    /// Returns the greatest height as drawn within about a thirtieth of the raster, from the index
    /// alone.
    fn highest_near(&self, [x, y]: [f64; 2]) -> Result<f64> {
        let (column, row) = (x * self.columns, y * self.rows);
        let header = self.reader.header();
        let level = header.levels.min(5);
        let side = f64::from(header.tile()) * f64::from(header.spacing(level));
        let (x, y) = ((column.max(0.0) / side) as u32, (row.max(0.0) / side) as u32);
        let mut highest = f64::NEG_INFINITY;
        for (dx, dy) in (0..9).map(|i| (i % 3, i / 3)) {
            let (Some(x), Some(y)) = ((x + dx).checked_sub(1), (y + dy).checked_sub(1)) else { continue };
            if let Some(entry) = self.reader.entry(TileId::new(level, x, y))? {
                highest = highest.max(entry.max_m.into());
            }
        }
        Ok(if highest.is_finite() { highest * self.frame.exaggeration } else { self.high })
    }
}
