//! How far the exploration's cameras and points may be off.

use crate::geometry::median;
use crate::image::Frame;
use crate::sfm::{Covariance, SparseReconstruction};
use crate::template::LengthUnit;
use serde::Serialize;

/// Expected errors after a similarity alignment of the cameras, in the template's unit, from the
/// spread of the sightings about their points ([`crate::sfm::bundle::covariance`]). Errors that
/// neighbouring sightings share and wrong intrinsics are not in them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SparsePrecision {
    /// Unit of lengths.
    pub unit: LengthUnit,
    /// The registered frames.
    pub frames: Vec<FramePrecision>,
    /// Median over the sparse points of the expected distance from the truth (root mean square).
    pub point_median: f64,
}

/// Precision of one camera.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FramePrecision {
    /// Name of the frame.
    pub name: String,
    /// Expected distance of the camera centre from the truth (root mean square).
    pub centre: f64,
    /// Expected angle between the rotation and the truth (root mean square), degrees.
    pub rotation_deg: f64,
    /// Rows of the covariance: rotation about the camera's own axes (rad), then the centre in
    /// template axes.
    pub covariance: [[f64; 6]; 6],
}

impl SparsePrecision {
    /// Of the frames with poses in a reconstruction.
    pub(super) fn of(
        covariance: &Covariance,
        sparse: &SparseReconstruction,
        frames: &[Frame],
        unit: LengthUnit,
    ) -> Self {
        let registered = frames.iter().zip(&sparse.poses).filter(|(_, pose)| pose.is_some());
        let frame = |(view, (frame, _)): (usize, (&Frame, _))| FramePrecision {
            name: frame.name.clone(),
            centre: covariance.centre_error(view),
            rotation_deg: covariance.rotation_error(view).to_degrees(),
            covariance: covariance.poses[view].transpose().into(),
        };
        let mut points: Vec<f64> =
            (0..covariance.points.len()).map(|p| covariance.point_error(p)).collect();
        Self {
            unit,
            frames: registered.enumerate().map(frame).collect(),
            point_median: median(&mut points).unwrap_or(0.0),
        }
    }

    /// Root mean squares over the frames: centre, and rotation in degrees.
    pub fn cameras(&self) -> (f64, f64) {
        let count = self.frames.len().max(1) as f64;
        let rms = |of: fn(&FramePrecision) -> f64| {
            (self.frames.iter().map(|f| of(f).powi(2)).sum::<f64>() / count).sqrt()
        };
        (rms(|f| f.centre), rms(|f| f.rotation_deg))
    }
}
