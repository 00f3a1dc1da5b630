//! The stage where poses are given: points and features alone.

use super::collect::collect;
use super::error::SfmError;
use super::features::Features2d;
use super::frames::{SfmProgress, ValidAreas, check_input, unusable};
use super::kept::whole_poses;
use super::map::Map;
use super::matching::UnitDescriptors;
use super::reconstruct::features;
use super::reconstruction::{NoPose, SparseReconstruction};
use super::rematch::rematch;
use super::{RefineIntrinsics, SfmOptions};
use crate::camera::CameraModel;
use crate::checkpoint::Keep;
use crate::geometry::Isometry;
use crate::image::{Frame, Mask};
use crate::solver::Loss;

/// Points and features for poses that are known: features, matching along epipolar lines and
/// triangulation; neither poses nor intrinsics are changed.
///
/// `poses`: `camera_from_world` per frame, `None` for frames to leave out.
///
/// # Errors
/// Input that cannot belong together (counts, sizes, camera), options out of range, or too few
/// frames with features.
pub(crate) fn triangulate_known(
    frames: &[Frame],
    masks: &[Option<Mask>],
    camera: &CameraModel,
    poses: &[Option<Isometry>],
    options: &SfmOptions,
    progress: SfmProgress,
    keep: Keep,
) -> Result<SparseReconstruction, SfmError> {
    check_input(frames, masks, camera, options)?;
    if poses.len() != frames.len() {
        return Err(SfmError::Count { what: "poses", found: poses.len(), frames: frames.len() });
    }
    let areas = ValidAreas::new(frames, masks, options);
    let features = features(frames, &areas, options, progress, &keep)?;
    let whole = |found: &SparseReconstruction| whole_poses(found, &features);
    let mut found = keep.stage("poses", SparseReconstruction::registered, whole, || {
        Ok::<_, SfmError>(triangulate(frames, &features, camera, poses, options, progress))
    })?;
    found.features = features;
    Ok(found)
}

/// Matching along epipolar lines and triangulation.
fn triangulate(
    frames: &[Frame],
    features: &[Features2d],
    camera: &CameraModel,
    poses: &[Option<Isometry>],
    options: &SfmOptions,
    progress: SfmProgress,
) -> SparseReconstruction {
    let mut rejected = unusable(frames, features);
    let missing = (0..frames.len()).filter(|&v| poses[v].is_none());
    rejected.extend(missing.map(|v| (v, NoPose::NotGiven)));
    rejected.sort_by_key(|r| r.0);
    rejected.dedup_by_key(|r| r.0);
    let descriptors: Vec<_> =
        features.iter().map(|f| UnitDescriptors::new(&f.descriptors)).collect();
    let mut map = Map {
        camera: camera.clone(),
        prior: camera.clone(),
        features,
        poses: poses.to_vec(),
        tracks: Vec::new(),
    };
    rematch(&mut map, &descriptors, &[], options, progress);
    let none = RefineIntrinsics::default();
    // Without points there is nothing to adjust, and the caller sees an empty cloud.
    let _ = map.adjust(&|_| true, Loss::GemanMcClure(1.5), none, 20);
    map.filter(&options.limits());
    collect(map, frames, rejected, Vec::new())
}
