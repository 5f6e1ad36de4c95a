//! Cameras, in double precision: a pose on the lattice, where a view will be soon, and the fly and
//! orbit controls.

use relevo_core::select::{Frame, View};

/// Default vertical field of view, degrees.
pub const FOV: f64 = 50.0;
/// Highest pitch of the controls, radians: just short of straight up.
const STEEPEST: f64 = 1.55;

/// Where a camera stands and what it looks at: column, row and height in metres, independent of the
/// exaggeration.
///
/// Exaggeration raises the target, which is a place of the terrain, and the eye by as much. The
/// height of the eye above the target is not exaggerated: otherwise the terrain would leave the
/// picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Where the camera stands.
    pub eye: [f64; 3],
    /// What is in the middle of the picture.
    pub target: [f64; 3],
}

impl Pose {
    /// Returns the pose whose eye and target are at these places of the frame.
    pub fn of(frame: &Frame, eye: [f64; 3], target: [f64; 3]) -> Self {
        let [column, row, _] = frame.lattice(eye);
        let above = eye[2] - target[2];
        let target = frame.lattice(target);
        Self { eye: [column, row, target[2] + above], target }
    }

    /// Returns the places of eye and target in the frame.
    pub fn places(&self, frame: &Frame) -> ([f64; 3], [f64; 3]) {
        let [column, row, height] = self.target;
        let target = frame.position(column, row, height);
        let [x, y, _] = frame.position(self.eye[0], self.eye[1], 0.0);
        ([x, y, target[2] + (self.eye[2] - height)], target)
    }

    /// Returns the view from this pose; `fov` is the vertical field of view in degrees, `size` in
    /// pixels.
    pub fn view(&self, frame: &Frame, fov: f64, size: (u32, u32)) -> View {
        let (eye, target) = self.places(frame);
        View::look_at(eye, target, fov.to_radians(), size, near(frame))
    }
}

/// Returns the distance of the near plane in metres: a twentieth of a sample's spacing. The depth
/// buffer holds reversed floats, so a near plane close to the eye costs no precision.
pub fn near(frame: &Frame) -> f64 {
    0.05 * frame.dx.min(frame.dy)
}

/// Returns the view `ahead` seconds from now, if the camera goes on to move and turn as it did in
/// the `elapsed` seconds between two views.
pub fn predict(before: &View, now: &View, elapsed: f64, ahead: f64) -> View {
    if elapsed <= 0.0 || !elapsed.is_finite() {
        return *now;
    }
    // After a very short frame the motion must not be extrapolated too far.
    let factor = (ahead / elapsed).min(60.0);
    let onwards =
        |a: [f64; 3], b: [f64; 3]| -> [f64; 3] { std::array::from_fn(|i| b[i] + (b[i] - a[i]) * factor) };
    let eye = onwards(before.eye, now.eye);
    let turn = angle(before.forward, now.forward) * factor;
    // A turn is a straight line of the direction only while it is small; a wide one is cut off at
    // about 60 degrees.
    let limit = if turn > 1.0 { factor / turn } else { factor };
    let forward: [f64; 3] =
        std::array::from_fn(|i| now.forward[i] + (now.forward[i] - before.forward[i]) * limit);
    let target = std::array::from_fn(|i| eye[i] + forward[i]);
    let fov = 2.0 * now.tan_y.atan();
    let size = (now.width, now.height);
    View { tan_x: now.tan_x, ..View::look_at(eye, target, fov, size, now.near) }
}

fn angle(a: [f64; 3], b: [f64; 3]) -> f64 {
    (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]).clamp(-1.0, 1.0).acos()
}

/// Returns true if a point on the screen moves by more than about a hundredth of a pixel from one
/// view to the other.
pub fn moved(before: &View, now: &View) -> bool {
    let turned = (0..3).any(|i| (before.forward[i] - now.forward[i]).abs() > 1e-6);
    let sizes = (before.width, before.height) != (now.width, now.height);
    sizes || turned || (0..3).any(|i| (before.eye[i] - now.eye[i]).abs() > 1e-6 * (1.0 + now.eye[i].abs()))
}

/// How the controls move the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The eye moves.
    Fly,
    /// The eye goes round a point.
    Orbit,
}

/// A camera that keys and mouse control, in metres of the frame as drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rig {
    /// What a drag does.
    pub mode: Mode,
    /// Where the camera stands.
    pub eye: [f64; 3],
    /// Radians clockwise from north.
    pub yaw: f64,
    /// Radians upwards from the horizon.
    pub pitch: f64,
    /// Metres to the point that an orbit goes round.
    pub distance: f64,
}

impl Rig {
    /// Returns a rig with the eye and the target of a pose.
    pub fn new(pose: &Pose, frame: &Frame) -> Self {
        let (eye, target) = pose.places(frame);
        let d: [f64; 3] = std::array::from_fn(|i| target[i] - eye[i]);
        let distance = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt().max(near(frame));
        let pitch = (d[2] / distance).clamp(-1.0, 1.0).asin().clamp(-STEEPEST, STEEPEST);
        let yaw = if d[0].hypot(d[1]) > 1e-9 * distance { d[0].atan2(d[1]) } else { 0.0 };
        Self { mode: Mode::Fly, eye, yaw, pitch, distance }
    }

    /// Returns the unit vector of the direction of view.
    pub fn forward(&self) -> [f64; 3] {
        let (sy, cy) = self.yaw.sin_cos();
        let (sp, cp) = self.pitch.sin_cos();
        [sy * cp, cy * cp, sp]
    }

    fn ahead(&self, metres: f64) -> [f64; 3] {
        let forward = self.forward();
        std::array::from_fn(|i| self.eye[i] + forward[i] * metres)
    }

    /// Returns the pose on the lattice of `frame`.
    pub fn pose(&self, frame: &Frame) -> Pose {
        Pose::of(frame, self.eye, self.ahead(self.distance))
    }

    /// Turns the camera by angles in radians: in flight about the eye, in an orbit about the pivot.
    pub fn turn(&mut self, right: f64, up: f64) {
        let pivot = self.ahead(self.distance);
        self.yaw = (self.yaw + right) % std::f64::consts::TAU;
        self.pitch = (self.pitch + up).clamp(-STEEPEST, STEEPEST);
        if self.mode == Mode::Orbit {
            let forward = self.forward();
            self.eye = std::array::from_fn(|i| pivot[i] - forward[i] * self.distance);
        }
    }

    /// Moves the eye by metres forward, to the right and upwards.
    pub fn walk(&mut self, forward: f64, right: f64, up: f64) {
        let ahead = self.forward();
        let (sin, cos) = self.yaw.sin_cos();
        self.eye[0] += ahead[0] * forward + cos * right;
        self.eye[1] += ahead[1] * forward - sin * right;
        self.eye[2] += ahead[2] * forward + up;
    }

    /// Moves the eye towards the pivot (above 0) or away from it; in flight, ahead or back.
    pub fn zoom(&mut self, notches: f64) {
        let factor = 0.85_f64.powf(notches.clamp(-20.0, 20.0));
        let step = self.distance * (1.0 - factor);
        self.eye = self.ahead(step);
        if self.mode == Mode::Orbit {
            self.distance *= factor;
        }
    }

    /// Moves the eye when the exaggeration changes, so that it stays as far above ground of
    /// `ground` metres as it was.
    pub fn exaggerate(&mut self, before: f64, after: f64, ground: f64) {
        self.eye[2] += ground * (after - before);
    }

    /// Moves the eye horizontally, by metres ahead and to the right.
    pub fn slide(&mut self, ahead: f64, right: f64) {
        let (sin, cos) = self.yaw.sin_cos();
        self.eye[0] += sin * ahead + cos * right;
        self.eye[1] += cos * ahead - sin * right;
    }

    /// Keeps the eye at least `clearance` metres above the ground.
    pub fn stay_above(&mut self, ground: f64, clearance: f64) {
        self.eye[2] = self.eye[2].max(ground + clearance);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: Frame = Frame { dx: 30.0, dy: 20.0, exaggeration: 2.0 };

    fn close(a: [f64; 3], b: [f64; 3]) {
        for i in 0..3 {
            assert!((a[i] - b[i]).abs() < 1e-6 * (1.0 + b[i].abs()), "{a:?} is not {b:?}");
        }
    }

    #[test]
    fn a_rig_keeps_the_pose_it_began_with() {
        let pose = Pose { eye: [100.0, 300.0, 900.0], target: [120.0, 100.0, 500.0] };
        let rig = Rig::new(&pose, &FRAME);
        close(rig.pose(&FRAME).eye, pose.eye);
        close(rig.pose(&FRAME).target, pose.target);
        let (a, b) = (rig.pose(&FRAME).view(&FRAME, FOV, (64, 48)), pose.view(&FRAME, FOV, (64, 48)));
        close(a.forward, b.forward);
        close(a.right, b.right);
    }

    #[test]
    fn a_taller_terrain_stays_in_the_picture() {
        let pose = Pose { eye: [100.0, 300.0, 900.0], target: [120.0, 100.0, 500.0] };
        let flat = Frame { exaggeration: 1.0, ..FRAME };
        let before = pose.view(&flat, FOV, (64, 48));
        for exaggeration in [0.1, 1.0, 5.0, 50.0] {
            let frame = Frame { exaggeration, ..FRAME };
            let after = pose.view(&frame, FOV, (64, 48));
            close(after.forward, before.forward);
            let [column, row, height] = pose.target;
            let pixel = after.pixel(frame.position(column, row, height)).unwrap();
            assert!((pixel[0] - 32.0).abs() < 1e-6 && (pixel[1] - 24.0).abs() < 1e-6, "{pixel:?}");
            // In the window too: what lies below stays as far below.
            let mut rig = Rig::new(&pose, &flat);
            let above = rig.eye[2] - 450.0;
            rig.exaggerate(1.0, exaggeration, 450.0);
            assert!((rig.eye[2] - 450.0 * exaggeration - above).abs() < 1e-6);
        }
    }

    #[test]
    fn an_orbit_keeps_its_pivot_and_a_flight_its_eye() {
        let pose = Pose { eye: [100.0, 300.0, 900.0], target: [120.0, 100.0, 500.0] };
        let mut rig = Rig::new(&pose, &FRAME);
        let before = rig.eye;
        rig.turn(0.3, -0.1);
        close(rig.eye, before);
        let mut rig = Rig { mode: Mode::Orbit, ..Rig::new(&pose, &FRAME) };
        rig.turn(1.0, 0.2);
        rig.zoom(3.0);
        close(rig.pose(&FRAME).target, pose.target);
    }

    #[test]
    fn right_is_to_the_right() {
        let pose = Pose { eye: [0.0, 0.0, 0.0], target: [0.0, -10.0, 0.0] };
        let mut rig = Rig::new(&pose, &FRAME);
        let view = pose.view(&FRAME, FOV, (64, 48));
        rig.walk(0.0, 5.0, 0.0);
        close(rig.eye, view.right.map(|c| 5.0 * c));
        rig.walk(7.0, -5.0, 2.0);
        close(rig.eye, [0.0, 7.0, 2.0]);
    }

    #[test]
    fn a_prediction_goes_on_as_before() {
        let at = |x: f64, turn: f64| {
            let target = [x + turn.sin(), turn.cos(), 0.0];
            View::look_at([x, 0.0, 0.0], target, 1.0, (64, 48), 0.1)
        };
        let soon = predict(&at(0.0, 0.0), &at(1.0, 0.01), 0.1, 0.5);
        close(soon.eye, [6.0, 0.0, 0.0]);
        assert!((soon.forward[0].atan2(soon.forward[1]) - 0.06).abs() < 1e-3);
        assert_eq!(predict(&at(0.0, 0.0), &at(1.0, 0.5), 0.0, 0.5), at(1.0, 0.5));
        assert!(moved(&at(0.0, 0.0), &at(0.1, 0.0)) && !moved(&at(0.1, 0.2), &at(0.1, 0.2)));
    }
}
