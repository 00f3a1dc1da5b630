//! Shared intrinsics as unknowns of the bundle adjustment.

use crate::camera::{BrownConrady, CameraModel, Lens};
use crate::geometry::{Point2, Point3, Vector2};
use nalgebra::SMatrix;
use serde::{Deserialize, Serialize};

/// Which intrinsics the bundle adjustment may change, each under a prior about its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RefineIntrinsics {
    /// One factor on both focal lengths; prior 5 % (standard deviation).
    pub focal: bool,
    /// Principal point; prior 2 % of the image width.
    pub centre: bool,
    /// First radial coefficient (of Brown–Conrady for a pinhole start); prior 0.05.
    pub distortion: bool,
    /// Second radial coefficient; prior 0.05. Only with `distortion`.
    pub second_distortion: bool,
}

impl RefineIntrinsics {
    /// Whether anything is refined.
    pub fn any(&self) -> bool {
        !self.active().is_empty()
    }

    /// Indices into the parameter vector `(ln f, cx, cy, k1, k2)`.
    pub(super) fn active(&self) -> Vec<usize> {
        let groups: [(bool, &[usize]); 4] = [
            (self.focal, &[0]),
            (self.centre, &[1, 2]),
            (self.distortion, &[3]),
            (self.distortion && self.second_distortion, &[4]),
        ];
        groups
            .iter()
            .filter(|(on, _)| *on)
            .flat_map(|(_, indices)| indices.iter().copied())
            .collect()
    }
}

/// Number of intrinsic parameters: `ln f, cx, cy, k1, k2`.
pub(super) const COUNT: usize = 5;

/// Standard deviations of the priors on `(ln f, cx, cy, k1, k2)`, for a mean number of
/// `per_view` sightings in a view.
///
/// The errors of the sightings of one view are not independent (tissue moves, highlights pull at
/// features): a view is counted as `INDEPENDENT` sightings at most, so the deviations shrink as
/// the redundancy grows. Without this, thousands of sightings that hardly depend on the focal
/// length (little parallax) would outvote any prior by their common bias.
pub(super) fn prior_sigmas(camera: &CameraModel, per_view: f64) -> [f64; COUNT] {
    const INDEPENDENT: f64 = 30.0;
    let redundancy = (per_view / INDEPENDENT).max(1.0).sqrt();
    let shift = 0.02 * camera.size[0] as f64;
    [0.05, shift, shift, 0.05, 0.05].map(|sigma| sigma / redundancy)
}

/// The camera with room for the coefficients to be refined: a pinhole becomes Brown–Conrady with
/// zero coefficients when `distortion` is on.
pub(super) fn prepared(camera: &CameraModel, refine: &RefineIntrinsics) -> CameraModel {
    let mut camera = camera.clone();
    if refine.distortion && camera.lens == Lens::default() {
        camera.lens = BrownConrady::default().into();
    }
    camera
}

/// `∂pixel/∂(ln f, cx, cy, k1, k2)` at a point in camera axes that projects to `pixel`.
///
/// From `pixel = f·x_d + c`: `∂/∂ln f = pixel − c`, and `f·∂x_d/∂kₙ`, which the lens tells
/// ([`Lens::radial_derivatives`]).
pub(super) fn jacobian(
    camera: &CameraModel,
    point: &Point3,
    pixel: &Point2,
) -> SMatrix<f64, 2, COUNT> {
    let normalised = Vector2::new(point.x / point.z, point.y / point.z);
    let [d_k1, d_k2] = camera.lens.radial_derivatives(&normalised);
    let [fx, fy] = camera.focal;
    let [cx, cy] = camera.centre;
    SMatrix::<f64, 2, COUNT>::from_row_slice(&[
        pixel.x - cx,
        1.0,
        0.0,
        fx * d_k1.x,
        fx * d_k2.x,
        pixel.y - cy,
        0.0,
        1.0,
        fy * d_k1.y,
        fy * d_k2.y,
    ])
}

/// `camera − prior` in `(ln f, cx, cy, k1, k2)`; a pinhole has zero coefficients.
pub(super) fn difference(camera: &CameraModel, prior: &CameraModel) -> [f64; COUNT] {
    let (k, k0) = (camera.lens.radial(), prior.lens.radial());
    [
        (camera.focal[0] / prior.focal[0]).ln(),
        camera.centre[0] - prior.centre[0],
        camera.centre[1] - prior.centre[1],
        k[0] - k0[0],
        k[1] - k0[1],
    ]
}

/// The camera after a step in `(ln f, cx, cy, k1, k2)`.
pub(super) fn retract(camera: &CameraModel, step: &[f64; COUNT]) -> CameraModel {
    let mut moved = camera.clone();
    moved.focal = camera.focal.map(|f| f * step[0].exp());
    moved.centre = [camera.centre[0] + step[1], camera.centre[1] + step[2]];
    moved.lens = camera.lens.radial_moved([step[3], step[4]]);
    moved
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;

    #[test]
    fn difference_undoes_retract() {
        let lens = Lens::BrownConrady { k: [0.1, 0.0, 0.0], p: [0.0; 2] };
        let start =
            CameraModel { size: [640, 480], focal: [500.0, 510.0], centre: [310.0, 250.0], lens };
        let step = [0.03, 2.0, -1.0, 0.02, -0.01];
        let found = difference(&retract(&start, &step), &start);
        assert!(found.iter().zip(&step).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    }

    #[test]
    fn jacobian_matches_central_differences() {
        let lenses = [
            Lens::Pinhole,
            Lens::BrownConrady { k: [-0.1, 0.03, 0.0], p: [0.001, -0.002] },
            Lens::KannalaBrandt { k: [0.02, -0.01, 0.003, 0.0] },
            Lens::Rational { k: [0.3, 0.02, 0.0, 0.4, 0.1, 0.0], p: [0.001, -0.002] },
        ];
        let point = Point3::new(0.4, -0.3, 1.1);
        for lens in lenses {
            let camera = CameraModel {
                size: [640, 480],
                focal: [500.0, 510.0],
                centre: [310.0, 250.0],
                lens,
            };
            let pixel = camera.project(&point).unwrap().pixel;
            let analytic = jacobian(&camera, &point, &pixel);
            for k in 0..COUNT {
                let at = |h: f64| {
                    let mut step = [0.0; COUNT];
                    step[k] = h;
                    retract(&camera, &step).project(&point).unwrap().pixel
                };
                let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
                assert!((numeric - analytic.column(k)).norm() < 1e-4, "{lens:?}, parameter {k}");
            }
        }
    }
}
