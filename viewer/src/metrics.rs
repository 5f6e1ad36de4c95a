//! Figures of frames: as rows of a CSV file, and as the window shows them.

use std::io::{self, Write};

/// Figures of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Row {
    /// Number of the frame, from 0.
    pub frame: u32,
    /// Seconds since the start of the path.
    pub time: f64,
    /// Milliseconds that the selection of tiles and images took.
    pub select_ms: f64,
    /// Milliseconds that drawing took, up to its end on the device.
    pub frame_ms: f64,
    /// Tiles drawn.
    pub tiles: usize,
    /// Patches drawn.
    pub patches: u32,
    /// Triangles drawn.
    pub triangles: u64,
    /// Virtual tiles: tiles, each once for every image on it.
    pub draws: usize,
    /// Bytes of the GPU's memory that hold heights and imagery.
    pub gpu_bytes: u64,
    /// Tiles and images that would be drawn if they were loaded.
    pub pending: usize,
    /// Tolerance, pixels.
    pub tolerance: f64,
    /// Largest projected error of a drawn patch, pixels: what the tables promise.
    pub promised: f64,
    /// Largest distance between a sample's true place and the surface drawn, pixels; `None` if not
    /// asked for.
    pub observed: Option<f64>,
}

/// Figures of a window: what its title and its panel show.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Figures {
    /// Frames per second.
    pub fps: f64,
    /// Tiles drawn.
    pub tiles: usize,
    /// Patches drawn.
    pub patches: u32,
    /// Triangles drawn.
    pub triangles: u64,
    /// MiB of the GPU's memory that hold heights and imagery.
    pub megabytes: f64,
    /// Tiles and images that would be drawn if they were loaded.
    pub pending: usize,
    /// Tolerance, pixels.
    pub tolerance: f64,
    /// Largest projected error of a drawn patch, pixels: what the tables promise.
    pub promised: f64,
}

/// Names of the CSV columns.
pub const COLUMNS: &str = "frame,time_s,select_ms,frame_ms,tiles,patches,triangles,draws,gpu_bytes,loads_pending,\
                           tolerance_px,promised_px,observed_px";

impl Row {
    /// Returns the row as a line of CSV, without the line break.
    pub fn csv(&self) -> String {
        let observed = self.observed.map_or_else(String::new, |pixels| format!("{pixels:.4}"));
        format!(
            "{},{:.4},{:.3},{:.3},{},{},{},{},{},{},{:.4},{:.4},{observed}",
            self.frame,
            self.time,
            self.select_ms,
            self.frame_ms,
            self.tiles,
            self.patches,
            self.triangles,
            self.draws,
            self.gpu_bytes,
            self.pending,
            self.tolerance,
            self.promised,
        )
    }
}

/// A writer of CSV: the names of the columns, then a line a frame.
#[derive(Debug)]
pub struct Writer<W> {
    out: W,
}

impl<W: Write> Writer<W> {
    /// Returns a writer that has written the names of the columns.
    pub fn new(mut out: W) -> io::Result<Self> {
        writeln!(out, "{COLUMNS}")?;
        Ok(Self { out })
    }

    /// Returns the inner writer.
    pub fn into_inner(self) -> W {
        self.out
    }

    /// Writes a row and flushes it, so that it is there even if the run ends early.
    pub fn row(&mut self, row: &Row) -> io::Result<()> {
        writeln!(self.out, "{}", row.csv())?;
        self.out.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_a_field_for_every_column() {
        let fields = COLUMNS.split(',').count();
        assert_eq!(Row::default().csv().split(',').count(), fields);
        assert_eq!(Row { observed: Some(0.5), ..Row::default() }.csv().split(',').count(), fields);
        assert!(!COLUMNS.contains(' '));
    }
}
