//! The registered frames, and stereo on them.

use super::click;
use super::error::TemplateError;
use super::exploration::Exploration;
use super::options::TemplateOptions;
use crate::camera::CameraModel;
use crate::dense::{DenseError, DenseOptions, DepthMap, PosedFrame, depth_maps};
use crate::geometry::{Isometry, Point3};
use crate::image::Frame;
use crate::mesh::Mesh;
use crate::pipeline::Progress;
use crate::sfm::SparseReconstruction;

/// The registered frames and what structure from motion knows of them.
pub(super) struct RegisteredFrames<'a> {
    pub(super) exploration: &'a Exploration<'a>,
    pub(super) sparse: &'a SparseReconstruction,
    pub(super) camera: &'a CameraModel,
    pub(super) views: Vec<PosedFrame<'a>>,
    pub(super) points: &'a [Point3],
    /// Name and `camera_from_world`.
    pub(super) named: Vec<(&'a str, Isometry)>,
    pub(super) options: &'a TemplateOptions,
    pub(super) progress: &'a dyn Progress,
}

impl RegisteredFrames<'_> {
    pub(super) fn stereo(
        &self,
        views: &[PosedFrame],
        options: &DenseOptions,
        stage: &str,
    ) -> Result<Vec<DepthMap>, DenseError> {
        let report = |done, total| self.progress.step(stage, done, total);
        depth_maps(views, self.points, options, &report)
    }

    /// The piece of a surface that was clicked; all of it without a click.
    pub(super) fn piece(&self, mesh: Mesh) -> Result<Mesh, TemplateError> {
        click::pick(mesh, self.camera, &self.named, self.options.organ.click())
    }
}

/// Those that have a pose, with their masks.
pub(super) fn posed<'a>(
    exploration: &'a Exploration,
    camera: &'a CameraModel,
    poses: &[Option<Isometry>],
) -> Vec<PosedFrame<'a>> {
    let one = |(i, pose): (usize, &Option<Isometry>)| {
        Some(PosedFrame {
            frame: &exploration.frames[i],
            camera,
            pose: (*pose)?,
            valid: exploration.valid.get(i).and_then(Option::as_ref),
            organ: exploration.organ.get(i).and_then(Option::as_ref),
        })
    };
    poses.iter().enumerate().filter_map(one).collect()
}

/// Name and pose of every registered frame.
pub(super) fn named<'a>(
    frames: &'a [Frame],
    poses: &[Option<Isometry>],
) -> Vec<(&'a str, Isometry)> {
    frames.iter().zip(poses).filter_map(|(f, p)| Some((f.name.as_str(), (*p)?))).collect()
}
