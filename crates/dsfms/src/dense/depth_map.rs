//! The depth of one frame, and what it says of a point.

use crate::camera::CameraModel;
use crate::geometry::{Isometry, Point2, Point3, Vector3};
use crate::image::{Mask, nearest_pixel};

/// Depth of one frame on a pinhole grid of its own (undistorted, usually coarser than the frame).
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
pub struct DepthMap {
    /// The pinhole camera of the grid; its size is that of the vectors, row major.
    pub camera: CameraModel,
    /// `camera_from_world`.
    pub pose: Isometry,
    /// Depth z in camera axes, length units; 0 = none.
    pub depth: Vec<f32>,
    /// Unit normal towards the camera, camera axes; zero where there is no depth.
    pub normal: Vec<[f32; 3]>,
    /// Standard deviation of the depth expected from image noise and texture, length units;
    /// infinity where there is no depth.
    pub sigma: Vec<f32>,
    /// Trust in `[0, 1]`: correlation with, and agreement of, the other views; 0 = none.
    /// Depth filled in from the neighbourhood has a low value.
    pub confidence: Vec<f32>,
}

impl DepthMap {
    /// Place in the grid of a point in camera axes; `None` behind the camera or beside the grid.
    pub(super) fn pixel(&self, p: &Point3) -> Option<usize> {
        let ([fx, fy], [cx, cy]) = (self.camera.focal, self.camera.centre);
        let pixel = Point2::new(fx * p.x / p.z + cx, fy * p.y / p.z + cy);
        let [u, v] = nearest_pixel(&pixel, self.camera.size).filter(|_| p.z > 0.0)?;
        Some(v * self.camera.size[0] + u)
    }

    /// What it says of a point in camera axes; `None` behind the camera or beside the grid.
    pub(super) fn compare(&self, p: &Point3) -> Option<(usize, Said)> {
        let place = self.pixel(p)?;
        let (z, facing) = self.seen(place);
        let said = match z - p.z {
            _ if z <= 0.0 => Said::Nothing,
            step if step.abs() <= tolerance(p.z, facing) => Said::Agrees,
            step if step > 0.0 => Said::Before,
            _ => Said::Behind,
        };
        Some((place, said))
    }

    /// Every point it holds, world axes.
    pub(crate) fn points(&self) -> impl Iterator<Item = Point3> + '_ {
        let back = self.pose.inverse();
        let places = 0..self.depth.len();
        places.filter(|&i| self.depth[i] > 0.0).map(move |i| back * self.point(i))
    }

    /// The line of sight through a place, camera axes, of depth 1.
    pub(super) fn ray(&self, place: usize) -> Vector3 {
        let w = self.camera.size[0];
        let ([u, v], [cx, cy]) = ([(place % w) as f64, (place / w) as f64], self.camera.centre);
        let [fx, fy] = self.camera.focal;
        Vector3::new((u - cx) / fx, (v - cy) / fy, 1.0)
    }

    /// No depth where the mask, on its pixels, is `true`.
    pub(crate) fn leave_out(&mut self, mask: &Mask) {
        for place in (0..self.depth.len()).filter(|&place| mask.data[place]) {
            self.depth[place] = 0.0;
            self.normal[place] = [0.0; 3];
            self.sigma[place] = f32::INFINITY;
            self.confidence[place] = 0.0;
        }
    }

    /// The point at a place with depth, camera axes.
    pub(crate) fn point(&self, place: usize) -> Point3 {
        (self.ray(place) * f64::from(self.depth[place])).into()
    }

    /// Depth at a place and the cosine of its normal to the camera's axis.
    pub(super) fn seen(&self, place: usize) -> (f64, f64) {
        (f64::from(self.depth[place]), -f64::from(self.normal[place][2]))
    }
}

/// What a depth map says of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Said {
    /// Its surface is there.
    Agrees,
    /// The point lies before its surface.
    Before,
    /// The point lies behind its surface.
    Behind,
    /// It has no depth there.
    Nothing,
}

/// Depths that differ by less than this fraction, times one over the cosine to the sightline, are
/// of the same surface.
pub(super) const SAME_SURFACE: f64 = 0.01;
/// Cosine below which depths may not differ by more.
pub(super) const GRAZING: f64 = 0.25;

/// By how much depths of one surface may differ where it is seen under a cosine of `facing`, length
/// units.
pub(super) fn tolerance(z: f64, facing: f64) -> f64 {
    SAME_SURFACE * z / facing.max(GRAZING)
}
