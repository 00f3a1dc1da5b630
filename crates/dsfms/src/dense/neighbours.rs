//! Which frames are compared with which, and between which depths.

use super::options::DenseOptions;
use super::view::StereoPyramid;
use crate::geometry::{Isometry, Point3, median};

/// Sparse points looked at, at most.
const MAX_POINTS: usize = 2000;

/// For each frame the frames it is compared with, best first.
///
/// The score of a pair is the number of shared points, each weighted by how close its parallax is
/// to the angle at which baseline and similarity of the images balance (about 15 degrees). Pairs
/// without any follow by their places alone: tissue may be seen where no point was found.
pub(super) fn select(
    views: &[StereoPyramid],
    sparse: &[Point3],
    options: &DenseOptions,
) -> Vec<Vec<usize>> {
    let points = thinned(sparse);
    (0..views.len())
        .map(|i| {
            let mut scored: Vec<([f64; 2], usize)> = (0..views.len())
                .filter(|&j| j != i)
                .map(|j| (pair_score(&views[i], &views[j], &points, options), j))
                .filter(|s| s.0 != [0.0; 2])
                .collect();
            scored.sort_by(|a, b| {
                let order = b.0[0].total_cmp(&a.0[0]).then(b.0[1].total_cmp(&a.0[1]));
                order.then(a.1.cmp(&b.1))
            });
            scored.iter().take(options.max_sources).map(|s| s.1).collect()
        })
        .collect()
}

/// Of many frames those that lie farthest apart, at most `count`, in order: more pixels in each
/// tell more than many that see the same. Two frames are as far apart as their centres and the
/// places they look at, in the median distance of the points.
pub(super) fn spread(poses: &[Isometry], sparse: &[Point3], count: usize) -> Vec<usize> {
    let all: Vec<usize> = (0..poses.len()).collect();
    if poses.len() <= count {
        return all;
    }
    let points = thinned(sparse);
    let depth = |pose: &Isometry| {
        let mut depths: Vec<f64> =
            points.iter().map(|p| (pose * p).z).filter(|z| *z > 0.0).collect();
        median(&mut depths).unwrap_or(0.0)
    };
    let places: Vec<[Point3; 2]> = poses
        .iter()
        .map(|pose| {
            let target = Point3::new(0.0, 0.0, depth(pose));
            [Point3::origin(), target].map(|p| pose.inverse_transform_point(&p))
        })
        .collect();
    let apart =
        |a: usize, b: usize| -> f64 { (0..2).map(|k| (places[a][k] - places[b][k]).norm()).sum() };
    let mut chosen = vec![0];
    let mut nearest: Vec<f64> = all.iter().map(|&i| apart(0, i)).collect();
    while chosen.len() < count {
        // Of equal ones the first.
        let next = all.iter().rev().max_by(|&&a, &&b| nearest[a].total_cmp(&nearest[b]));
        let Some(&next) = next else { break };
        chosen.push(next);
        all.iter().for_each(|&i| nearest[i] = nearest[i].min(apart(next, i)));
    }
    chosen.sort_unstable();
    chosen
}

fn thinned(sparse: &[Point3]) -> Vec<Point3> {
    let step = sparse.len().div_ceil(MAX_POINTS).max(1);
    sparse.iter().step_by(step).copied().collect()
}

fn pair_score(
    a: &StereoPyramid,
    b: &StereoPyramid,
    points: &[Point3],
    options: &DenseOptions,
) -> [f64; 2] {
    let (ca, cb) = (a.posed.centre(), b.posed.centre());
    // Nothing known of the scene: the nearest frames that did move.
    let baseline = (cb - ca).norm();
    let turn = (a.posed.pose.rotation.inverse() * b.posed.pose.rotation).angle();
    let overlap = (1.0 - turn / 1.2).max(0.0);
    let place = if baseline > 0.0 { overlap / (1.0 + baseline) } else { 0.0 };
    let weight = |p: &Point3| {
        if !sees(a, p) || !sees(b, p) {
            return 0.0;
        }
        let angle = (ca - p).angle(&(cb - p)).to_degrees();
        if angle < options.min_parallax_deg || angle > options.max_parallax_deg {
            return 0.0;
        }
        let sigma = if angle < 15.0 { 6.0 } else { 14.0 };
        (-(angle - 15.0f64).powi(2) / (2.0 * sigma * sigma)).exp()
    };
    [points.iter().map(weight).sum(), place]
}

/// Whether the point projects on usable pixels (which does not exclude occlusion).
pub(super) fn sees(view: &StereoPyramid, point: &Point3) -> bool {
    view.posed.usable_pixel(&(view.posed.pose * point)).is_some()
}

/// Nearest and farthest depth searched in a frame: the sparse points it may see, with a margin; or,
/// without points, 1 to 40 times the median distance to the frames it is compared with.
pub(super) fn depth_range(
    views: &[StereoPyramid],
    frame: usize,
    sources: &[usize],
    sparse: &[Point3],
) -> [f64; 2] {
    let view = &views[frame];
    let mut depths: Vec<f64> =
        thinned(sparse).iter().filter(|p| sees(view, p)).map(|p| (view.posed.pose * p).z).collect();
    depths.sort_by(f64::total_cmp);
    if depths.len() >= 8 {
        let at = |q: f64| depths[((depths.len() - 1) as f64 * q).round() as usize];
        let (near, far) = (at(0.01), at(0.99));
        let margin = 0.6 * (far - near) + 0.1 * near;
        return [(near - margin).max(0.3 * near), far + margin];
    }
    let centre = view.posed.centre();
    let mut baselines: Vec<f64> =
        sources.iter().map(|&j| (views[j].posed.centre() - centre).norm()).collect();
    let baseline = median(&mut baselines).unwrap_or(1.0);
    [baseline, 40.0 * baseline]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_that_see_the_same_are_thinned() {
        let at = |x: f64| Isometry::translation(-x, 0.0, 0.0);
        let poses = [0.0, 0.1, 5.0, 5.1, 10.0].map(at);
        let points = [Point3::new(5.0, 0.0, 50.0)];
        assert_eq!(spread(&poses, &points, 3), [0, 2, 4]);
        assert_eq!(spread(&poses, &points, 9), [0, 1, 2, 3, 4]);
        // Turning on the spot shows new things too.
        let turned = Isometry::rotation(crate::geometry::Vector3::y() * 0.3);
        assert_eq!(spread(&[at(0.0), at(0.2), turned], &points, 2), [0, 2]);
    }
}
