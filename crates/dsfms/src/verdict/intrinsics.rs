//! Whether two calibrations are the same camera, and which of them matches confirm.

use crate::camera::{Camera, CameraModel};
use crate::geometry::Point2;
use crate::image::diagonal;
use crate::mesh::Mesh;
use crate::register::{Match, RegisterOptions, pose};

/// Places along each side at which sightlines are compared.
const PLACES: usize = 9;

/// A camera for frames of another size of the same view.
fn resized(camera: &CameraModel, size: [usize; 2]) -> CameraModel {
    let scale = [0, 1].map(|k| size[k] as f64 / camera.size[k].max(1) as f64);
    CameraModel {
        size,
        focal: [0, 1].map(|k| camera.focal[k] * scale[k]),
        centre: [0, 1].map(|k| (camera.centre[k] + 0.5) * scale[k] - 0.5),
        lens: camera.lens,
    }
}

/// Largest angle between the sightlines of two cameras at the same place of the frame, px of the
/// first; infinite where one has none.
pub fn apart_px(given: &CameraModel, own: &CameraModel) -> f64 {
    let own = resized(own, given.size);
    let focal = 0.5 * (given.focal[0] + given.focal[1]);
    let at = |i: usize, side: usize| i as f64 / (PLACES - 1) as f64 * (side as f64 - 1.0);
    let angle = |k: usize| {
        let pixel = Point2::new(at(k % PLACES, given.size[0]), at(k / PLACES, given.size[1]));
        match (given.unproject(&pixel), own.unproject(&pixel)) {
            (Some(a), Some(b)) => a.cross(&b).norm() * focal,
            (None, None) => 0.0,
            _ => f64::INFINITY,
        }
    };
    (0..PLACES * PLACES).map(angle).fold(0.0, f64::max)
}

/// Where a camera is not the template's (its sightlines lie more than `limit` of the diagonal
/// apart): how far apart they are, px, and the median distance of the matches from the rigid pose
/// under the given camera and under the template's own, px; infinite without a pose.
pub fn other_camera(
    [given, own]: [&CameraModel; 2],
    limit: f64,
    rest: &Mesh,
    matches: &[Match],
    options: &RegisterOptions,
    seed: u64,
) -> Option<(f64, [f64; 2])> {
    let apart = apart_px(given, own);
    let fit = |camera: &CameraModel| {
        pose(camera, rest, matches, options, seed).map_or(f64::INFINITY, |p| p.median_px())
    };
    let differ = apart > limit * diagonal(given.size);
    differ.then(|| (apart, [fit(given), fit(&resized(own, given.size))]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Lens;

    #[test]
    fn sightlines_differ_by_what_focal_length_and_centre_do() {
        let camera = CameraModel {
            size: [640, 360],
            focal: [500.0, 500.0],
            centre: [319.5, 179.5],
            lens: Lens::Pinhole,
        };
        assert_eq!(apart_px(&camera, &camera), 0.0);
        // Half the size, the same view.
        assert!(apart_px(&camera.halved(), &camera) < 1e-9);
        let moved = CameraModel { centre: [329.5, 179.5], ..camera.clone() };
        let found = apart_px(&moved, &camera);
        assert!((7.0..10.1).contains(&found), "{found}");
        let longer = CameraModel { focal: [510.0, 510.0], ..camera.clone() };
        let found = apart_px(&longer, &camera);
        assert!((3.0..8.0).contains(&found), "{found}");
    }
}
