//! A mesh while it is read.

use super::{Mesh, Up};
use crate::error::{Error, Result};

/// Vertices and triangles so far, in the axes of the file.
#[derive(Default)]
pub(super) struct Building {
    pub(super) mesh: Mesh,
    /// The largest vertex of a triangle, and where it is named.
    largest: Option<(u64, String)>,
}

impl Building {
    /// Adds a vertex.
    pub(super) fn vertex(&mut self, point: [f64; 3], place: impl Fn() -> String) -> Result<()> {
        if let Some(value) = point.iter().find(|value| !value.is_finite()) {
            return Err(Error::format(place(), "a finite coordinate", value));
        }
        if self.mesh.vertices.len() as u64 >= u64::from(u32::MAX) {
            return Err(Error::limit("number of vertices", u64::from(u32::MAX) + 1, u32::MAX.into()));
        }
        self.mesh.vertices.push(point);
        Ok(())
    }

    /// The number of vertices.
    pub(super) fn count(&self) -> u64 {
        self.mesh.vertices.len() as u64
    }

    /// Adds a polygon as a fan; its vertices may be still to come.
    pub(super) fn polygon(&mut self, corners: &[u64], place: impl Fn() -> String) -> Result<()> {
        if corners.len() < 3 {
            return Err(Error::format(place(), "3 corners or more", corners.len()));
        }
        let largest = corners.iter().copied().max().unwrap_or_default();
        if largest >= u64::from(u32::MAX) {
            return Err(Error::format(place(), "the number of a vertex", largest));
        }
        if self.largest.as_ref().is_none_or(|(before, _)| largest > *before) {
            // Named only if it is not there yet: else it can be no fault.
            let place = if largest < self.count() { String::new() } else { place() };
            self.largest = Some((largest, place));
        }
        let first = corners[0] as u32;
        let fan = corners[1..].windows(2).map(|pair| [first, pair[0] as u32, pair[1] as u32]);
        self.mesh.triangles.extend(fan);
        Ok(())
    }

    /// Fails if a triangle has a vertex that there is not.
    pub(super) fn check(&self) -> Result<()> {
        match &self.largest {
            Some((largest, place)) if *largest >= self.count() => Err(Error::format(
                place.clone(),
                format!("one of the {} vertices, counted from 0", self.count()),
                format!("vertex {largest}"),
            )),
            _ => Ok(()),
        }
    }

    /// The mesh with z up.
    pub(super) fn finish(mut self, up: Up) -> Mesh {
        for vertex in &mut self.mesh.vertices {
            *vertex = up.to_z_up(*vertex);
        }
        self.mesh
    }
}
