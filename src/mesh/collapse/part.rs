//! Collapses within a part of a mesh: the vertices whose triangles all lie in it.
//!
//! A vertex `u` is drawn onto a neighbour `v`: its two triangles at that edge go, the others get
//! `v` in its place. That is done only if each of these is off by no more than the limit at its
//! samples, and each new edge where it crosses edges of the terrain. Edges that stay have been
//! looked at before. The collapse whose result is off by least comes first.

use std::cmp::Ordering;
use std::collections::{BTreeSet, BinaryHeap};

use super::ground::{Ground, Point, area};

/// A part of a mesh while vertices are collapsed.
pub(super) struct Part<'a> {
    pub ground: &'a Ground,
    pub points: Vec<Point>,
    /// Which vertices may go.
    pub may_go: Vec<Freedom>,
    pub triangles: Vec<[u32; 3]>,
    /// What triangles and edges may be off by, in numbers.
    pub limit: f64,
    /// Least angle of a new triangle, in radians.
    pub least_angle: f64,
    /// Metres from one column and one row to the next.
    pub metres: (f64, f64),
    /// Triangles of each vertex.
    of: Vec<Vec<u32>>,
    is_gone: Vec<bool>,
    stamps: Vec<u32>,
}

/// Where a vertex may go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Freedom {
    /// Nowhere.
    Fixed,
    /// To a neighbour on the same side of the window.
    AlongColumn,
    /// The same.
    AlongRow,
    /// To any neighbour.
    Free,
}

/// A collapse that is possible.
struct Candidate {
    off: f64,
    from: u32,
    to: u32,
    stamp: u32,
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    /// The least result is the greatest; ties go by number.
    fn cmp(&self, other: &Self) -> Ordering {
        other.off.total_cmp(&self.off).then(other.from.cmp(&self.from)).then(other.to.cmp(&self.to))
    }
}

impl<'a> Part<'a> {
    /// A part of these vertices and triangles.
    pub fn new(
        ground: &'a Ground,
        points: Vec<Point>,
        may_go: Vec<Freedom>,
        triangles: Vec<[u32; 3]>,
    ) -> Self {
        let mut of = vec![Vec::new(); points.len()];
        for (number, triangle) in triangles.iter().enumerate() {
            for &at in triangle {
                of[at as usize].push(number as u32);
            }
        }
        let (is_gone, stamps) = (vec![false; triangles.len()], vec![0; points.len()]);
        Self {
            ground,
            points,
            may_go,
            triangles,
            limit: 0.0,
            least_angle: 0.0,
            metres: (1.0, 1.0),
            of,
            is_gone,
            stamps,
        }
    }

    /// Collapses what can be collapsed. Returns the triangles that are left.
    pub fn run(mut self) -> Vec<[u32; 3]> {
        let mut heap = BinaryHeap::new();
        for vertex in 0..self.points.len() as u32 {
            heap.extend(self.best(vertex));
        }
        let mut around = BTreeSet::new();
        while let Some(Candidate { from, to, stamp, .. }) = heap.pop() {
            if self.stamps[from as usize] != stamp {
                continue;
            }
            around.clear();
            around.extend(self.neighbours(from));
            self.collapse(from, to);
            around.remove(&from);
            for &vertex in &around {
                self.stamps[vertex as usize] += 1;
                heap.extend(self.best(vertex));
            }
        }
        let kept = self.triangles.iter().zip(&self.is_gone).filter(|(_, gone)| !**gone);
        kept.map(|(triangle, _)| *triangle).collect()
    }

    /// The neighbours of a vertex.
    fn neighbours(&self, vertex: u32) -> impl Iterator<Item = u32> {
        let triangles = self.of[vertex as usize].iter().flat_map(|&number| self.triangles[number as usize]);
        triangles.filter(move |&other| other != vertex)
    }

    /// The collapse of a vertex with the least result, if one is within the limit.
    fn best(&self, from: u32) -> Option<Candidate> {
        let freedom = self.may_go[from as usize];
        if freedom == Freedom::Fixed || self.of[from as usize].is_empty() {
            return None;
        }
        let here = self.points[from as usize];
        let mut others: Vec<u32> = self.neighbours(from).collect();
        others.sort_unstable();
        others.dedup();
        let mut best: Option<(f64, u32)> = None;
        for to in others {
            let there = self.points[to as usize];
            let is_open = match freedom {
                Freedom::Free => true,
                Freedom::AlongColumn => there.x == here.x,
                Freedom::AlongRow => there.y == here.y,
                Freedom::Fixed => false,
            };
            if !is_open {
                continue;
            }
            let cap = best.map_or(self.limit, |(off, _)| off);
            if let Some(off) = self.result(from, to, cap)
                && best.is_none_or(|(least, _)| off < least)
            {
                best = Some((off, to));
            }
        }
        best.map(|(off, to)| Candidate { off, from, to, stamp: self.stamps[from as usize] })
    }

    /// What the new triangles and edges of a collapse are off by, if that is at most `cap` and
    /// their shape is good.
    fn result(&self, from: u32, to: u32, cap: f64) -> Option<f64> {
        let triangles = &self.of[from as usize];
        let mut shared = 0;
        for &number in triangles {
            let triangle = self.triangles[number as usize];
            if triangle.contains(&to) {
                shared += 1;
                continue;
            }
            let corners = triangle.map(|at| &self.points[if at == from { to } else { at } as usize]);
            if area(corners[0], corners[1], corners[2]) <= 0 || !self.is_wide(corners) {
                return None;
            }
        }
        // Vertices beside both ends must be those of the triangles that go, else surfaces touch.
        let beside = |at: u32| {
            self.of[at as usize].iter().any(|&number| self.triangles[number as usize].contains(&to))
        };
        let mut common: Vec<u32> =
            self.neighbours(from).filter(|&other| other != to && beside(other)).collect();
        common.sort_unstable();
        common.dedup();
        if common.len() != shared {
            return None;
        }
        let mut most = 0.0_f64;
        let end = &self.points[to as usize];
        for &number in triangles {
            let triangle = self.triangles[number as usize];
            if triangle.contains(&to) {
                continue;
            }
            let corners = triangle.map(|at| &self.points[if at == from { to } else { at } as usize]);
            most = most.max(self.ground.triangle(corners, cap));
            if most > cap {
                return None;
            }
        }
        let mut ring: Vec<u32> =
            self.neighbours(from).filter(|other| *other != to && !common.contains(other)).collect();
        ring.sort_unstable();
        ring.dedup();
        for other in ring {
            most = most.max(self.ground.edge(end, &self.points[other as usize], cap));
            if most > cap {
                return None;
            }
        }
        Some(most)
    }

    /// True if no angle of a triangle is below the least one.
    fn is_wide(&self, corners: [&Point; 3]) -> bool {
        if self.least_angle <= 0.0 {
            return true;
        }
        let (dx, dy) = self.metres;
        let p = corners.map(|point| (f64::from(point.x) * dx, f64::from(point.y) * dy));
        (0..3).all(|i| {
            let (a, b, c) = (p[i], p[(i + 1) % 3], p[(i + 2) % 3]);
            let (u, v) = ((b.0 - a.0, b.1 - a.1), (c.0 - a.0, c.1 - a.1));
            let (dot, cross) = (u.0 * v.0 + u.1 * v.1, (u.0 * v.1 - u.1 * v.0).abs());
            cross.atan2(dot) >= self.least_angle
        })
    }

    /// Draws a vertex onto another.
    fn collapse(&mut self, from: u32, to: u32) {
        for number in std::mem::take(&mut self.of[from as usize]) {
            let triangle = &mut self.triangles[number as usize];
            if triangle.contains(&to) {
                self.is_gone[number as usize] = true;
                for at in *triangle {
                    self.of[at as usize].retain(|&other| other != number);
                }
            } else {
                triangle.iter_mut().filter(|at| **at == from).for_each(|at| *at = to);
                self.of[to as usize].push(number);
            }
        }
        self.stamps[from as usize] += 1;
    }
}
