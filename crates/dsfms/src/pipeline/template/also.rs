//! How the sparse points move in frames of the deformed organ: what moves apart is apart.
//!
//! Every such frame is posed on the points that agree with one camera, the rigid majority. What the others are off
//! is motion, and the parting of organ and wall learns which of the two it belongs to.

use super::Exploration;
use crate::geometry::{Isometry, Point2, Point3, median};
use crate::image::Frame;
use crate::sfm::random::Random;
use crate::sfm::{Reconstruction, ScenePoint, SfmOptions, detect, match_descriptors, resect};
use crate::camera::Camera;
use rayon::prelude::*;

/// Points that a frame must agree with, and their share of those matched.
const LEAST: usize = 20;
const SHARE: f64 = 0.2;
/// Error of a point that stays, over what structure from motion allows: a rigid pose over a bending surface.
const ALLOWED: f64 = 2.0;
/// Errors beyond this share of the frame's width are wrong matches.
const WRONG: f64 = 0.15;

/// Sparse points, and the logarithm of one more than the px that they moved in the median deformed frame.
pub(super) fn moved(
    exploration: &Exploration,
    sparse: &Reconstruction,
    options: &SfmOptions,
) -> Vec<(Point3, f64)> {
    let described: Vec<(usize, [u8; 128])> = (sparse.points.iter().enumerate())
        .filter_map(|(i, point)| Some((i, descriptor(point, sparse)?)))
        .collect();
    let seen: Vec<Vec<(usize, f64)>> = (exploration.also.par_iter().enumerate())
        .map(|(task, frame)| in_frame(frame, task as u64, &described, sparse, options))
        .collect();
    let mut errors: Vec<Vec<f64>> = vec![Vec::new(); sparse.points.len()];
    seen.iter().flatten().for_each(|&(i, px)| errors[i].push(px));
    let each = errors.iter_mut().zip(&sparse.points);
    each.filter_map(|(errors, point)| Some((point.position, median(errors)?.ln_1p()))).collect()
}

/// That of its first sighting that has one.
fn descriptor(point: &ScenePoint, sparse: &Reconstruction) -> Option<[u8; 128]> {
    let of = |frame: usize, feature: usize| sparse.features[frame].descriptors.get(feature).copied();
    point.track.iter().find_map(|seen| of(seen.frame, seen.feature))
}

/// The points matched in a deformed frame and by how many px they are off the rigid majority.
fn in_frame(
    frame: &Frame,
    task: u64,
    described: &[(usize, [u8; 128])],
    sparse: &Reconstruction,
    options: &SfmOptions,
) -> Vec<(usize, f64)> {
    let found = detect(frame, None, options);
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
    let most = WRONG * frame.size[0] as f64;
    let off = |&(i, pixel): &(usize, Point2)| {
        let px = error_px(&sparse.camera, &rigid.pose, &sparse.points[i].position, &pixel)?;
        (px < most).then_some((i, px))
    };
    pairs.iter().filter_map(off).collect()
}

/// Apart from the tasks of structure from motion.
const ALSO: u64 = 0xa150_0000;

fn error_px(camera: &dyn Camera, pose: &Isometry, point: &Point3, pixel: &Point2) -> Option<f64> {
    Some((camera.project(&(pose * point))?.pixel - pixel).norm())
}
