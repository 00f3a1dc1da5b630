//! How the sparse points move in frames of the deformed organ: what moves apart is apart.
//!
//! Every such frame is posed on the points that agree with one camera, the rigid majority. What the
//! others are off is motion, and the parting of organ and wall learns which of the two it belongs
//! to.

use super::exploration::Exploration;
use crate::geometry::{Point2, Point3, median};
use crate::sfm::random::Random;
use crate::sfm::{
    Features2d, ScenePoint, SfmOptions, SparseReconstruction, detect, error_px, match_descriptors,
    resect,
};
use rayon::prelude::*;

/// Points that a frame must agree with, and their share of those matched.
const LEAST: usize = 20;
const SHARE: f64 = 0.2;
/// Error of a point that stays, over what structure from motion allows: a rigid pose over a bending
/// surface.
const ALLOWED: f64 = 2.0;
/// Errors beyond this share of the frame's width are wrong matches.
const WRONG: f64 = 0.15;

/// Sparse points, and the logarithm of one more than the px that they moved in the median deformed
/// frame.
pub(super) fn moved(
    exploration: &Exploration,
    sparse: &SparseReconstruction,
    options: &SfmOptions,
) -> Vec<(Point3, f64)> {
    let described: Vec<(usize, [u8; 128])> = (sparse.points.iter().enumerate())
        .filter_map(|(i, point)| Some((i, descriptor(point, sparse)?)))
        .collect();
    let seen: Vec<Vec<(usize, f64)>> = (exploration.also.par_iter().enumerate())
        .map(|(task, frame)| {
            let found = detect(frame, None, options);
            in_frame(&found, frame.size[0], task as u64, &described, sparse, options)
        })
        .collect();
    let mut errors: Vec<Vec<f64>> = vec![Vec::new(); sparse.points.len()];
    seen.iter().flatten().for_each(|&(i, px)| errors[i].push(px));
    let each = errors.iter_mut().zip(&sparse.points);
    each.filter_map(|(errors, point)| Some((point.position, median(errors)?.ln_1p()))).collect()
}

/// That of its first sighting that has one.
fn descriptor(point: &ScenePoint, sparse: &SparseReconstruction) -> Option<[u8; 128]> {
    let of =
        |frame: usize, feature: usize| sparse.features[frame].descriptors.get(feature).copied();
    point.track.iter().find_map(|seen| of(seen.frame, seen.feature))
}

/// The points matched in a deformed frame of some `width`, and by how many px they are off the
/// rigid majority.
fn in_frame(
    found: &Features2d,
    width: usize,
    task: u64,
    described: &[(usize, [u8; 128])],
    sparse: &SparseReconstruction,
    options: &SfmOptions,
) -> Vec<(usize, f64)> {
    let known: Vec<[u8; 128]> = described.iter().map(|d| d.1).collect();
    let matched =
        match_descriptors(&known, &found.descriptors, options.ratio, options.max_distance);
    let pairs: Vec<(usize, Point2)> =
        matched.iter().map(|m| (described[m.a as usize].0, found.points[m.b as usize])).collect();
    let points: Vec<Point3> = pairs.iter().map(|p| sparse.points[p.0].position).collect();
    let pixels: Vec<Point2> = pairs.iter().map(|p| p.1).collect();
    let threshold = ALLOWED * options.max_reprojection_px;
    let mut random = Random::new(options.seed, ALSO ^ task);
    let Some(rigid) = resect(&sparse.camera, &points, &pixels, threshold, &mut random) else {
        return Vec::new();
    };
    let agree = rigid.inliers.len();
    if agree < LEAST || (agree as f64) < SHARE * pairs.len() as f64 {
        return Vec::new();
    }
    let most = WRONG * width as f64;
    let off = |&(i, pixel): &(usize, Point2)| {
        let px = error_px(&sparse.camera, &rigid.pose, &sparse.points[i].position, &pixel);
        (px < most).then_some((i, px))
    };
    pairs.iter().filter_map(off).collect()
}

/// Apart from the tasks of structure from motion.
const ALSO: u64 = 0xa150_0000;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, CameraModel};
    use crate::geometry::Isometry;
    use crate::sfm::TrackedPixel;

    #[test]
    fn points_that_move_with_none_of_the_others_are_off_by_what_they_moved() {
        let camera = CameraModel::pinhole([640, 480], [500.0; 2], [319.5, 239.5]);
        let mut random = Random::new(3, 0);
        let mut draw = |least: f64, most: f64| {
            least + (most - least) * random.below(1 << 20) as f64 / f64::from(1 << 20)
        };
        let places: Vec<Point3> = (0..80)
            .map(|_| Point3::new(draw(-20.0, 20.0), draw(-15.0, 15.0), draw(55.0, 75.0)))
            .collect();
        let descriptors: Vec<[u8; 128]> =
            (0..80).map(|_| std::array::from_fn(|_| draw(0.0, 90.0) as u8)).collect();
        let point = |(i, &position): (usize, &Point3)| {
            let pixel = camera.project(&position).unwrap().pixel;
            let track = vec![TrackedPixel { frame: 0, feature: i, pixel }; 2];
            ScenePoint { position, rgb: [0; 3], track, error_px: 0.0 }
        };
        // Seen from another place, the last fifteen moved by 8 px.
        let pose = Isometry::translation(2.0, -1.0, 1.5);
        let seen = |(i, p): (usize, &Point3)| {
            let moved = if i < 65 { 0.0 } else { 8.0 };
            camera.project(&(pose * p)).unwrap().pixel + Point2::new(moved, 0.0).coords
        };
        let features = |points: Vec<Point2>| Features2d {
            scale: vec![1.0; 80],
            angle: vec![0.0; 80],
            descriptors: descriptors.clone(),
            points,
        };
        let known = features(vec![Point2::origin(); 80]);
        let sparse = SparseReconstruction {
            poses: vec![Some(Isometry::identity())],
            rejected: Vec::new(),
            models: Vec::new(),
            points: places.iter().enumerate().map(point).collect(),
            camera: camera.clone(),
            reprojection_px: vec![0.0],
            features: vec![known],
        };
        let described: Vec<(usize, [u8; 128])> =
            (0..80).filter_map(|i| Some((i, descriptor(&sparse.points[i], &sparse)?))).collect();
        let deformed = features(places.iter().enumerate().map(seen).collect());
        let options = SfmOptions::default();
        let found = in_frame(&deformed, 640, 0, &described, &sparse, &options);
        assert_eq!(found.len(), 80);
        for (i, px) in found {
            let wanted = if i < 65 { 0.0 } else { 8.0 };
            assert!((px - wanted).abs() < 0.05, "point {i}: {px} px, {wanted} expected");
        }
    }
}
