//! Smooth seeded motion: a hand-held camera around the organ.

use crate::geometry::{Isometry, Point3, Vector3};
use crate::synth::random::{Random, uniform};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

/// Frames a second.
pub const RATE: f64 = 25.0;

/// `3t² − 2t³` of `t` held to `[0, 1]`.
pub(super) fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A sum of three sines between −1 and 1.
#[derive(Clone, Debug)]
pub(super) struct Wave([[f64; 3]; 3]);

impl Wave {
    /// Periods from about 4 to 17 seconds.
    pub(super) fn new(random: &mut Random) -> Self {
        let mut term = |amplitude: f64, hertz: f64| {
            let hertz = hertz * (0.8 + 0.4 * uniform(random));
            [amplitude, std::f64::consts::TAU * hertz, std::f64::consts::TAU * uniform(random)]
        };
        Self([term(0.55, 0.06), term(0.3, 0.13), term(0.15, 0.24)])
    }

    /// At `t` seconds.
    pub(super) fn at(&self, t: f64) -> f64 {
        self.0.iter().map(|[amplitude, omega, phase]| amplitude * (omega * t + phase).sin()).sum()
    }
}

/// Where the camera stands and looks.
#[derive(Clone, Copy, Debug)]
struct PathView {
    /// Angles about the vertical and the horizontal, rad.
    yaw: f64,
    tilt: f64,
    /// Distance from the point looked at, mm.
    distance: f64,
    roll: f64,
    /// What is looked at, mm from the organ's middle.
    target: [f64; 2],
}

impl PathView {
    /// `camera_from_template`.
    fn pose(&self) -> Isometry {
        let target = Point3::new(self.target[0], self.target[1], 0.0);
        let (sy, cy) = self.yaw.sin_cos();
        let (st, ct) = self.tilt.sin_cos();
        let eye = target + Vector3::new(sy * ct, st, -cy * ct) * self.distance;
        let z = (target - eye).normalize();
        let x = Vector3::y().cross(&z).normalize();
        let rows = Matrix3::from_rows(&[x.transpose(), z.cross(&x).transpose(), z.transpose()]);
        let level = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rows));
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.roll) * level;
        Isometry::from_parts((-(turn * eye.coords)).into(), turn)
    }
}

/// The camera's way, with one jump.
#[derive(Clone, Debug)]
pub(super) struct CameraPath {
    waves: [Wave; 6],
    tremor: [Wave; 2],
    cut: usize,
    /// Added from the cut on: yaw, tilt, roll in rad and a factor on the distance.
    jump: [f64; 4],
}

impl CameraPath {
    pub(super) fn new(cut: usize, seed: u64) -> Self {
        let mut random = Random::new(seed, 0xCA3E);
        let waves = std::array::from_fn(|_| Wave::new(&mut random));
        let tremor = std::array::from_fn(|_| Wave::new(&mut random));
        let mut side = || if uniform(&mut random) < 0.5 { -1.0 } else { 1.0 };
        let jump = [0.28 * side(), 0.12 * side(), 0.45 * side(), 1.0 + 0.1 * side()];
        Self { waves, tremor, cut, jump }
    }

    /// `camera_from_template` at frame `k`.
    pub(super) fn pose(&self, k: usize) -> Isometry {
        let t = k as f64 / RATE;
        let [yaw, tilt, distance, roll, x, y] = std::array::from_fn(|i| self.waves[i].at(t));
        // A hand trembles at 8 to 10 Hz.
        let [shake_x, shake_y] = std::array::from_fn(|i| self.tremor[i].at(60.0 * t));
        let jump = if k >= self.cut { self.jump } else { [0.0, 0.0, 0.0, 1.0] };
        let view = PathView {
            yaw: 0.22 * yaw + jump[0],
            tilt: 0.16 * tilt + jump[1],
            distance: (72.0 + 8.0 * distance) * jump[3],
            roll: 0.15 * roll + jump[2],
            target: [5.0 * x + 0.06 * shake_x, 4.0 * y + 0.06 * shake_y],
        };
        view.pose()
    }

    /// Exploration view `i` of `n`: a spiral over a cap of 35 degrees.
    pub(super) fn exploration(i: usize, n: usize) -> Isometry {
        let share = (i as f64 + 0.5) / n as f64;
        // The golden angle spreads the views evenly.
        let (radius, turn) = (0.61 * share.sqrt(), 2.399_963 * i as f64);
        let view = PathView {
            yaw: radius * turn.cos(),
            tilt: radius * turn.sin(),
            distance: 66.0 + 8.0 * (1.7 * i as f64).sin(),
            roll: 0.25 * (0.9 * i as f64).sin(),
            target: [3.0 * (1.3 * i as f64).cos(), 3.0 * (0.7 * i as f64).sin()],
        };
        view.pose()
    }
}
