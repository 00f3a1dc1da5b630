//! Whether values that were kept are such as the stages make: every index is of something that is
//! there.

use super::features::Features2d;
use super::followed::Followed;
use super::reconstruction::SparseReconstruction;
use super::two_view::VerifiedPair;

/// Features of so many frames, with all their vectors of one length.
pub(super) fn whole_features(features: &[Features2d], frames: usize) -> bool {
    let even = |f: &Features2d| {
        [f.scale.len(), f.angle.len(), f.descriptors.len()].iter().all(|n| *n == f.points.len())
    };
    features.len() == frames && features.iter().all(even)
}

/// Pairs and corners of frames and features that there are.
pub(super) fn whole_matches(
    pairs: &[VerifiedPair],
    followed: &[Followed],
    features: &[Features2d],
) -> bool {
    let has = |frame: usize, i: u32| (i as usize) < features[frame].len();
    let pair = |p: &VerifiedPair| {
        p.a < p.b
            && p.b < features.len()
            && p.matches.iter().all(|m| has(p.a, m.a) && has(p.b, m.b))
    };
    let reach =
        |f: &Followed| f.first.checked_add(f.pixels.len()).is_some_and(|n| n <= features.len());
    pairs.iter().all(pair) && followed.iter().all(reach)
}

/// Poses and points of frames and features that there are.
pub(super) fn whole_poses(found: &SparseReconstruction, features: &[Features2d]) -> bool {
    let frames = features.len();
    let posed = |frame: usize| found.poses.get(frame).is_some_and(Option::is_some);
    let seen = found.points.iter().flat_map(|p| &p.track);
    found.poses.len() == frames
        && found.reprojection_px.len() == frames
        && found.camera.validate().is_ok()
        && found.rejected.iter().all(|r| r.0 < frames)
        && found.models.iter().flat_map(|m| &m.frames).all(|&f| f < frames)
        && found.points.iter().all(|p| !p.track.is_empty())
        && { seen }.all(|t| posed(t.frame) && t.feature < features[t.frame].len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraModel;
    use crate::geometry::{Isometry, Point2, Point3};
    use crate::sfm::DescriptorMatch;
    use crate::sfm::reconstruction::{FoundModel, NoPose, ScenePoint, TrackedPixel};

    #[test]
    fn indices_of_nothing_are_found() {
        let one = Features2d {
            points: vec![Point2::origin()],
            scale: vec![1.0],
            angle: vec![0.0],
            descriptors: vec![[0; 128]],
        };
        let features = vec![one.clone(), one];
        assert!(whole_features(&features, 2) && !whole_features(&features, 3));
        let mut uneven = features.clone();
        uneven[1].angle.clear();
        assert!(!whole_features(&uneven, 2));
        let pair = |b: usize, feature: u32| VerifiedPair {
            a: 0,
            b,
            b_from_a: Isometry::identity(),
            matches: vec![DescriptorMatch { a: 0, b: feature, distance: 0.0 }],
            parallax_deg: 1.0,
        };
        assert!(whole_matches(&[pair(1, 0)], &[], &features));
        for bad in [pair(2, 0), pair(1, 1), pair(0, 0)] {
            assert!(!whole_matches(&[bad], &[], &features));
        }
        let followed = |first: usize| Followed { first, pixels: vec![Point2::origin(); 2] };
        assert!(whole_matches(&[], &[followed(0)], &features));
        assert!(!whole_matches(&[], &[followed(1)], &features));
        assert!(!whole_matches(&[], &[followed(usize::MAX)], &features));

        let seen = |frame, feature| TrackedPixel { frame, feature, pixel: Point2::origin() };
        let poses = |last: TrackedPixel| SparseReconstruction {
            poses: vec![Some(Isometry::identity()), None],
            rejected: vec![(1, NoPose::Unmatched)],
            models: vec![FoundModel { frames: vec![0], points: 1 }],
            points: vec![ScenePoint {
                position: Point3::origin(),
                rgb: [0; 3],
                track: vec![seen(0, 0), last],
                error_px: 0.0,
            }],
            camera: CameraModel::pinhole([64, 48], [60.0; 2], [31.5, 23.5]),
            reprojection_px: vec![0.0; 2],
            features: Vec::new(),
        };
        assert!(whole_poses(&poses(seen(0, 0)), &features));
        // A feature too many, a frame without a pose, one that is not there.
        for bad in [seen(0, 1), seen(1, 0), seen(2, 0)] {
            assert!(!whole_poses(&poses(bad), &features));
        }
        for bad in [
            SparseReconstruction { rejected: vec![(2, NoPose::Unmatched)], ..poses(seen(0, 0)) },
            SparseReconstruction {
                models: vec![FoundModel { frames: vec![2], points: 1 }],
                ..poses(seen(0, 0))
            },
            SparseReconstruction { reprojection_px: vec![0.0], ..poses(seen(0, 0)) },
        ] {
            assert!(!whole_poses(&bad, &features));
        }
    }
}
