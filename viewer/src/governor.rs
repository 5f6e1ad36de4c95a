//! Dynamic error (paper 002): the tolerance follows what a frame costs while the camera moves, and
//! returns to the asked one when it rests.

/// The limit for the cost of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// Frames per second.
    Fps(f64),
    /// Triangles of a frame.
    Triangles(u64),
}

/// The cost of the last frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// Seconds since the frame before it.
    pub seconds: f64,
    /// Triangles drawn.
    pub triangles: u64,
    /// True if the camera moved or turned.
    pub moving: bool,
}

/// Frames at rest after which refinement begins.
const REST_FRAMES: u32 = 3;
/// The tolerance never rises above this many times the asked one.
const MOST: f64 = 64.0;

/// Adapts the tolerance.
#[derive(Clone, Copy, Debug)]
pub struct Governor {
    target: Option<Target>,
    tolerance: f64,
    resting: u32,
}

impl Governor {
    /// Returns a governor that begins at the asked tolerance.
    pub fn new(target: Option<Target>, asked: f64) -> Self {
        Self { target, tolerance: asked, resting: 0 }
    }

    /// Returns the tolerance of the next frame in pixels, never below `asked`.
    ///
    /// Triangles fall with about the square of the tolerance, so the step to the goal is the root
    /// of the cost's ratio; it is damped, and a band of 10 % around the goal is left alone so that
    /// a picture at rest does not oscillate.
    pub fn next(&mut self, asked: f64, load: Load) -> f64 {
        let Some(target) = self.target else {
            self.tolerance = asked;
            return asked;
        };
        self.resting = if load.moving { 0 } else { self.resting.saturating_add(1) };
        if self.resting > REST_FRAMES {
            // Towards the asked one in a few frames, so that the picture does not change at once.
            self.tolerance = (self.tolerance * 0.75).max(asked);
            return self.tolerance;
        }
        let cost = match target {
            Target::Fps(fps) => load.seconds * fps,
            Target::Triangles(most) => load.triangles as f64 / (most.max(1)) as f64,
        };
        if cost > 1.0 || (cost < 0.9 && cost > 0.0) {
            // Aims at the middle of the band.
            let step = (cost / 0.95).sqrt().clamp(0.8, 1.5);
            self.tolerance *= step;
        }
        self.tolerance = self.tolerance.clamp(asked, asked * MOST);
        self.tolerance
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scene whose triangles fall with the square of the tolerance.
    fn triangles(tolerance: f64) -> u64 {
        (4e6 / (tolerance * tolerance)) as u64
    }

    fn run(target: Target, frames: usize, moving: bool, governor: &mut Governor, mut tolerance: f64) -> f64 {
        for _ in 0..frames {
            let triangles = triangles(tolerance);
            let load = Load { seconds: 4e-8 * triangles as f64, triangles, moving };
            tolerance = governor.next(0.5, load);
        }
        let _ = target;
        tolerance
    }

    #[test]
    fn moving_reaches_the_target_and_rest_the_asked_tolerance() {
        for target in [Target::Fps(50.0), Target::Triangles(500_000)] {
            let mut governor = Governor::new(Some(target), 0.5);
            let moving = run(target, 40, true, &mut governor, 0.5);
            let got = triangles(moving);
            assert!((400_000..=500_000).contains(&got), "{target:?}: {got} triangles at {moving}");
            assert_eq!(run(target, 1, true, &mut governor, moving), moving, "it stays there");
            assert_eq!(run(target, 40, false, &mut governor, moving), 0.5);
        }
    }

    #[test]
    fn without_a_target_it_is_what_was_asked() {
        let mut governor = Governor::new(None, 2.0);
        assert_eq!(governor.next(0.7, Load { seconds: 9.0, triangles: 1 << 40, moving: true }), 0.7);
    }

    #[test]
    fn a_hopeless_target_is_bounded() {
        let mut governor = Governor::new(Some(Target::Triangles(1)), 1.0);
        let load = Load { seconds: 1.0, triangles: 1_000_000, moving: true };
        let last = (0..200).fold(0.0, |_, _| governor.next(1.0, load));
        assert_eq!(last, 64.0);
    }
}
