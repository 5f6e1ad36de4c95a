//! How places of a mesh become coordinates in a file: columns, rows and metres to metres, or to a
//! coordinate system; and what that rounds.

use super::made::middle;
use super::nested::Place;
use super::save::{Frame, MeshOptions};
use super::terrain::metres_of_number;
use crate::container::Reader;
use crate::error::{Error, Result};
use crate::mesh_file::{Affine, Encoding, Format};
use crate::rect::Rect;
use crate::sample::Coding;
use crate::select::Frame as Metres;
use crate::tile::TileId;

/// How places become coordinates.
pub(super) struct Placing {
    /// Column and row that places are relative to.
    pub origin: (f64, f64),
    /// Places to coordinates.
    pub map: Affine,
    /// Columns, rows and metres to coordinates.
    pub whole: Affine,
    /// True if triangles change their sense.
    pub turns: bool,
    /// Least and largest height in metres that can come.
    heights: (f64, f64),
    pub encoding: Encoding,
    /// What the surface is rounded by at most, in metres; 0 if that has to be tried.
    pub rounding_m: f64,
}

impl Placing {
    pub fn new(reader: &Reader, window: &Rect, options: &MeshOptions, format: Format) -> Result<Self> {
        let (column, row) = middle(window);
        let whole = match options.frame {
            Frame::Local => {
                let Metres { dx, dy, .. } = Metres::at(reader.geo(), column, row);
                Affine {
                    matrix: [[dx, 0.0, 0.0], [0.0, -dy, 0.0], [0.0, 0.0, 1.0]],
                    offset: [-dx * f64::from(column), dy * f64::from(row), 0.0],
                }
            }
            Frame::Crs => {
                if format == Format::Stl {
                    return Err(Error::usage(
                        "an STL file has 32-bit numbers, too coarse for coordinates of a coordinate system; \
                         write GLB, PLY or OBJ, or take local coordinates",
                    ));
                }
                let [x0, a, b, y0, d, e] = reader.geo().transform_or_identity();
                Affine {
                    matrix: [[a, b, 0.0], [d, e, 0.0], [0.0, 0.0, 1.0]],
                    offset: [x0 + 0.5 * (a + b), y0 + 0.5 * (d + e), 0.0],
                }
            }
        };
        let origin = (f64::from(column), f64::from(row));
        let offset = whole.apply([origin.0, origin.1, 0.0]);
        let offset = if options.frame == Frame::Local { [0.0; 3] } else { offset };
        let [[a, b, _], [d, e, _], _] = whole.matrix;
        let root = reader.entry(TileId::ROOT)?;
        let heights = root.map_or((0.0, 0.0), |root| (f64::from(root.min_m), f64::from(root.max_m)));
        let highest = heights.0.abs().max(heights.1.abs());
        let is_whole = matches!(reader.header().coding, Coding::Integer { .. });
        let mut placing = Self {
            origin,
            map: Affine { matrix: whole.matrix, offset },
            whole,
            turns: a * e - b * d > 0.0,
            heights,
            encoding: Encoding::Float,
            rounding_m: match format {
                Format::Glb | Format::Stl if !is_whole => highest * f64::from(f32::EPSILON),
                // 64 bits, or decimals that read back as these.
                _ => 0.0,
            },
        };
        if options.quantise {
            placing.quantise(reader, window, format)?;
        }
        Ok(placing)
    }

    /// Keeps columns and rows exactly, in halves where an outline of voids can need them, and
    /// heights by the finest step that 16 bits allow: exactly, if they are whole steps of the file.
    fn quantise(&mut self, reader: &Reader, window: &Rect, format: Format) -> Result<()> {
        let too_many = |what: &str| {
            Error::usage(format!("{what} does not fit 16 bits; take a window, or keep 32-bit numbers"))
        };
        if format != Format::Glb {
            return Err(Error::usage("only GLB files keep coordinates in 16 bits"));
        }
        if window.columns.len().max(window.rows.len()) > 32_768 {
            return Err(too_many("a window of more than 32 767 intervals"));
        }
        let (low, high) = self.heights;
        let step = metres_of_number(reader.header());
        let is_whole = matches!(reader.header().coding, Coding::Integer { .. });
        let range = high - low;
        // Points halfway between samples have half steps.
        let fitting = [step / 2.0, step].into_iter().find(|step| is_whole && range / step < 65_535.0);
        let height_step = fitting.unwrap_or(if range > 0.0 { range / 65_534.0 } else { 1.0 });
        let (west, north) =
            (f64::from(window.columns.start) - self.origin.0, f64::from(window.rows.start) - self.origin.1);
        self.encoding = Encoding::Short { origin: [west, north, low], step: [0.5, 0.5, height_step] };
        self.rounding_m = if fitting.is_some() { 0.0 } else { 0.5001 * height_step };
        Ok(())
    }

    /// A place relative to the origin.
    pub fn place(&self, [x, y, z]: Place) -> [f64; 3] {
        [x - self.origin.0, y - self.origin.1, z]
    }
}
