//! A mesh of either kind, made.

use std::ops::Range;

use super::collapse::Collapsed;
use super::nested::{Nested, Place, Triangle};
use crate::container::Reader;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::rect::Rect;
use crate::select::Frame;

/// How the triangles of a mesh are found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// Triangles of any shape, with no angle below so many degrees but those of 45 degrees that the
    /// nested mesh has: few triangles. The whole mesh is held in memory.
    Free(f64),
    /// The nested mesh: more triangles, in less time and memory.
    Nested,
}

/// What to make a mesh of.
#[derive(Clone, Copy)]
pub(super) struct Wish<'a> {
    pub reader: &'a Reader,
    pub window: &'a Rect,
    pub method: Method,
    /// Bytes of memory to keep within.
    pub memory: Option<u64>,
}

/// The sample in the middle of a window that is not empty.
pub(super) fn middle(window: &Rect) -> (u32, u32) {
    let of = |range: &Range<u32>| range.start + (range.end - 1 - range.start) / 2;
    (of(&window.columns), of(&window.rows))
}

/// Bytes for each triangle of the nested mesh that making free triangles of it takes (45 were
/// measured).
const PER_TRIANGLE: u64 = 60;
/// Bytes that each thread takes besides, and that the reader's cache takes.
const PER_THREAD: u64 = 64 << 20;

/// Fails if free triangles of a nested mesh take more memory than there may be.
fn check_memory(triangles: u64, memory: Option<u64>) -> Result<()> {
    let threads = rayon::current_num_threads() as u64 + 2;
    let needed = triangles.saturating_mul(PER_TRIANGLE).saturating_add(threads * PER_THREAD);
    match memory {
        Some(memory) if needed > memory => Err(Error::usage(format!(
            "free triangles made of {triangles} others take up to {} MiB of memory, more than {} MiB; \
             take the nested mesh, allow a larger error, or take a window",
            needed.div_ceil(1 << 20),
            memory >> 20
        ))),
        _ => Ok(()),
    }
}

/// A mesh.
pub(super) struct Made<'a> {
    nested: Nested<'a>,
    free: Option<Collapsed>,
}

impl<'a> Made<'a> {
    /// The mesh that is off by at most `error_m` metres.
    pub fn new(wish: Wish<'a>, error_m: f64, progress: &dyn Progress) -> Result<Self> {
        let Wish { reader, window, method, memory } = wish;
        let nested = Nested::new(reader, Some(window), error_m, progress)?;
        let free = match method {
            Method::Nested => None,
            Method::Free(degrees) => {
                check_memory(nested.triangle_count(), memory)?;
                let (column, row) = middle(window);
                let Frame { dx, dy, .. } = Frame::at(reader.geo(), column, row);
                Some(Collapsed::new(&nested, degrees.to_radians(), (dx, dy), progress)?)
            }
        };
        Ok(Self { nested, free })
    }

    /// The file.
    pub fn reader(&self) -> &Reader {
        self.nested.reader()
    }

    /// The part of the raster.
    pub fn window(&self) -> Rect {
        self.nested.window()
    }

    /// What its surface is off by at most, in metres.
    pub fn promised_m(&self) -> f64 {
        self.nested.promised_m() + self.free.as_ref().map_or(0.0, Collapsed::rounding_m)
    }

    /// Vertices.
    pub fn vertex_count(&self) -> u64 {
        self.free.as_ref().map_or_else(|| self.nested.vertex_count(), |free| free.places().len() as u64)
    }

    /// Triangles.
    pub fn triangle_count(&self) -> u64 {
        self.free.as_ref().map_or_else(|| self.nested.triangle_count(), |free| free.triangles().len() as u64)
    }

    /// Hands on the vertices.
    pub fn each_vertex(&self, out: &mut dyn FnMut(&[Place]) -> Result<()>) -> Result<()> {
        match &self.free {
            Some(free) => free.places().chunks(1 << 15).try_for_each(out),
            None => self.nested.each_vertex(out),
        }
    }

    /// Hands on the triangles.
    pub fn each_triangle(
        &self,
        out: &mut dyn FnMut(&[Triangle]) -> Result<()>,
        progress: &dyn Progress,
    ) -> Result<()> {
        match &self.free {
            Some(free) => free.triangles().chunks(1 << 15).try_for_each(out),
            None => self.nested.each_triangle(out, progress),
        }
    }
}
