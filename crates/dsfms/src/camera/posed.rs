//! A frame whose camera and pose are known: what stereo, albedo, features and texture look at.

use super::{Camera, CameraModel};
use crate::geometry::{Isometry, Point2, Point3};
use crate::image::{Frame, Mask, within_centres};

/// A frame whose camera and pose are known.
#[derive(Clone, Copy, Debug)]
pub struct PosedFrame<'a> {
    /// The image, encoded as in the file.
    pub frame: &'a Frame,
    /// Its camera.
    pub camera: &'a CameraModel,
    /// `camera_from_world`; of a registered frame `camera_from_template`.
    pub pose: Isometry,
    /// `true` where pixels may be used (inside the viewport, not an instrument); `None` = all.
    pub valid: Option<&'a Mask>,
    /// `true` where the organ is the first surface hit; `None` = whatever is seen.
    /// Points that project outside it are not organ.
    pub organ: Option<&'a Mask>,
}

impl<'a> PosedFrame<'a> {
    /// A frame all of which may be used, of whatever is seen.
    pub fn new(frame: &'a Frame, camera: &'a CameraModel, pose: Isometry) -> Self {
        Self { frame, camera, pose, valid: None, organ: None }
    }

    /// Centre of projection, world axes.
    pub(crate) fn centre(&self) -> Point3 {
        self.pose.inverse_transform_point(&Point3::origin())
    }

    /// Where it shows a point (world axes), px; `None` where the camera cannot.
    pub(crate) fn pixel_of(&self, point: &Point3) -> Option<Point2> {
        Some(self.camera.project(&(self.pose * point))?.pixel)
    }

    /// Where it shows a point (camera axes) inside the image and both masks, px; whether something
    /// else lies before the point is not asked.
    pub(crate) fn usable_pixel(&self, point: &Point3) -> Option<Point2> {
        let pixel = self.camera.project(point)?.pixel;
        let masks = [self.valid, self.organ].into_iter().flatten();
        let usable = || masks.into_iter().all(|mask| mask.at_pixel(&pixel));
        (within_centres(&pixel, self.camera.size) && usable()).then_some(pixel)
    }
}
