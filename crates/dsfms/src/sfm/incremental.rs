//! Incremental reconstruction (paper §4): a first pair, then view after view by resection, with
//! triangulation and bundle adjustment in between.

use super::intrinsics::RefineIntrinsics;
use super::map::{Map, MapTrack};
use super::random::Random;
use super::resection::resect;
use super::tracks::Member;
use super::two_view::VerifiedPair;
use super::{SfmOptions, features::Features2d};
use crate::camera::CameraModel;
use crate::geometry::{Isometry, Point2, Point3};
use crate::solver::Loss;
use rayon::prelude::*;

/// Pairs from which a model is grown, no view in two of them.
const STARTS: usize = 4;
/// Pairs that are tried for it.
const TRIED: usize = 40;

/// Grow models from the best pairs among the `allowed` views, and keep the one in which most
/// sightings agree; `None` when no pair starts one.
///
/// Frames of narrow parallax leave two answers that differ little in error, one nearly the other
/// with near and far exchanged. Which of them a single pair starts is chance; over all frames the
/// right one explains more.
pub(super) fn grow<'a>(
    camera: &CameraModel,
    features: &'a [Features2d],
    tracks: &[Vec<Member>],
    pairs: &[VerifiedPair],
    allowed: &[bool],
    options: &SfmOptions,
    progress: &(dyn Fn(usize) + Sync),
) -> Option<Map<'a>> {
    let empty = Map {
        camera: camera.clone(),
        prior: camera.clone(),
        features,
        poses: vec![None; features.len()],
        tracks: tracks.iter().cloned().map(MapTrack::new).collect(),
    };
    let mut starts: Vec<Map> = Vec::new();
    let started =
        |map: &Map, pair: &VerifiedPair| map.poses[pair.a].is_some() || map.poses[pair.b].is_some();
    let mut tries = 0;
    for pair in ranked_pairs(pairs, allowed, options) {
        if starts.len() == STARTS || tries == TRIED {
            break;
        }
        if starts.iter().all(|map| !started(map, pair)) {
            tries += 1;
            starts.extend(start_from(&empty, pair, options));
        }
    }
    let grown: Vec<Map> =
        starts.into_par_iter().filter_map(|map| grown(map, allowed, options, progress)).collect();
    // Of equals the first, that of the best pair.
    let best = (0..grown.len()).rev().max_by_key(|&i| grown[i].sightings())?;
    grown.into_iter().nth(best)
}

/// Register view after view.
fn grown<'a>(
    mut map: Map<'a>,
    allowed: &[bool],
    options: &SfmOptions,
    progress: &(dyn Fn(usize) + Sync),
) -> Option<Map<'a>> {
    let first = map.poses.iter().position(Option::is_some)?;
    // A growing model of narrow parallax would trade focal length for depth: the intrinsics are
    // refined when all frames are in.
    const NOTHING: RefineIntrinsics = RefineIntrinsics {
        focal: false,
        centre: false,
        distortion: false,
        second_distortion: false,
    };
    let mut adjusted_at = map.registered();
    while register_next(&mut map, allowed, options) {
        progress(map.registered());
        map.triangulate(&options.limits());
        // A full adjustment whenever the model has grown by a tenth.
        if map.registered() * 10 >= adjusted_at * 11 {
            adjusted_at = map.registered();
            settle(&mut map, first, options, NOTHING, 1, 8);
        }
    }
    settle(&mut map, first, options, NOTHING, 2, 20);
    Some(map)
}

/// Pairs that can start a model, best first: many inliers and enough parallax.
fn ranked_pairs<'p>(
    pairs: &'p [VerifiedPair],
    allowed: &[bool],
    options: &SfmOptions,
) -> Vec<&'p VerifiedPair> {
    /// Beyond this, more parallax does not help but makes matches fewer.
    const AMPLE_DEG: f64 = 8.0;
    let score = |p: &VerifiedPair| p.matches.len() as f64 * p.parallax_deg.min(AMPLE_DEG);
    let mut ranked: Vec<_> = pairs
        .iter()
        .filter(|p| allowed[p.a] && allowed[p.b] && p.parallax_deg >= options.min_parallax_deg)
        .collect();
    ranked.sort_by(|x, y| score(y).total_cmp(&score(x)));
    ranked
}

/// The two-view model of a pair; `None` when it has too few points.
fn start_from<'a>(empty: &Map<'a>, pair: &VerifiedPair, options: &SfmOptions) -> Option<Map<'a>> {
    let mut map = empty.clone();
    map.poses[pair.a] = Some(Isometry::identity());
    map.poses[pair.b] = Some(pair.b_from_a);
    map.triangulate(&options.limits());
    map.adjust(&|v| v == pair.a, Loss::Huber(1.0), Default::default(), 20).ok()?;
    map.filter(&options.limits());
    (map.points() >= options.min_matches).then_some(map)
}

/// Register the view that sees the known points best; views that fail are passed over.
fn register_next(map: &mut Map, allowed: &[bool], options: &SfmOptions) -> bool {
    let mut waiting: Vec<(usize, usize)> = (0..map.poses.len())
        .filter(|&v| allowed[v] && map.poses[v].is_none())
        .map(|v| (spread(map, v), v))
        .filter(|(cells, _)| *cells > 0)
        .collect();
    waiting.sort_by_key(|&(cells, view)| (std::cmp::Reverse(cells), view));
    waiting.into_iter().any(|(_, view)| register(map, view, options))
}

/// How well known points cover a view: number of occupied cells of a 12 × 12 grid.
fn spread(map: &Map, view: usize) -> usize {
    /// Along each side: tells points in one corner from points all over.
    const CELLS: usize = 12;
    let [w, h] = map.camera.size;
    let mut occupied = [false; CELLS * CELLS];
    for (_, _, pixel) in map.known_in(view) {
        let cell = |v: f64, n: usize| ((v / n as f64 * CELLS as f64) as usize).min(CELLS - 1);
        occupied[cell(pixel.y, h) * CELLS + cell(pixel.x, w)] = true;
    }
    occupied.iter().filter(|&&o| o).count()
}

/// Resect one view; `false` leaves the map as it was.
pub(super) fn register(map: &mut Map, view: usize, options: &SfmOptions) -> bool {
    let known = map.known_in(view);
    if known.len() < options.min_matches {
        return false;
    }
    let points: Vec<Point3> = known.iter().map(|k| k.1).collect();
    let pixels: Vec<Point2> = known.iter().map(|k| k.2).collect();
    let mut random = Random::new(options.seed, 0x5EC7_0000 + view as u64);
    let threshold = 2.0 * options.max_reprojection_px;
    let Some(found) = resect(&map.camera, &points, &pixels, threshold, &mut random) else {
        return false;
    };
    let enough = found.inliers.len() >= options.min_matches
        && found.inliers.len() as f64 >= options.min_inlier_fraction * known.len() as f64;
    if enough {
        map.poses[view] = Some(found.pose);
    }
    enough
}

/// Adjust, drop what does not fit, triangulate anew; `rounds` times.
pub(super) fn settle(
    map: &mut Map,
    first: usize,
    options: &SfmOptions,
    refine: RefineIntrinsics,
    rounds: usize,
    max_steps: usize,
) {
    for _ in 0..rounds {
        // An infeasible start cannot happen: every sighting used has a finite error.
        let _ = map.adjust(&|v| v == first, Loss::Huber(1.0), refine, max_steps);
        map.filter(&options.limits());
        map.triangulate(&options.limits());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::geometry::Vector3;
    use crate::sfm::matching::DescriptorMatch;
    use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

    const POINTS: usize = 60;

    /// From 60 units away, turned by 3 degrees from view to view.
    fn pose(view: usize) -> Isometry {
        let turn = Vector3::new(0.03 * (view % 2) as f64, 0.0524 * (view as f64 - 2.5), 0.0);
        Isometry::new(Vector3::new(0.0, 0.0, 60.0), turn)
    }

    fn points() -> Vec<Point3> {
        let mut random = Random::new(5, 0);
        let mut unit = || random.below(1_000_000) as f64 / 1e6 - 0.5;
        (0..POINTS).map(|_| Point3::new(24.0 * unit(), 24.0 * unit(), 10.0 * unit())).collect()
    }

    /// The motion that exchanges near and far: of a scene of little depth it explains two views
    /// nearly as well as the true one.
    fn reversed(motion: &Isometry) -> Isometry {
        let flip = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
        let turned = flip * motion.rotation.to_rotation_matrix().matrix() * flip;
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&turned));
        let middle = Vector3::new(0.0, 0.0, 60.0);
        Isometry::from_parts((motion * Point3::from(middle) - rotation * middle).into(), rotation)
    }

    #[test]
    fn a_first_pair_with_near_and_far_exchanged_does_not_decide() {
        let camera = CameraModel::pinhole([640, 480], [800.0; 2], [320.0, 240.0]);
        let seen = |view: usize| Features2d {
            points: points()
                .iter()
                .map(|p| camera.project(&(pose(view) * p)).unwrap().pixel)
                .collect(),
            scale: vec![1.6; POINTS],
            ..Default::default()
        };
        let features: Vec<Features2d> = (0..6).map(seen).collect();
        let member =
            |view: usize, point: usize| Member { view: view as u32, feature: point as u32 };
        let tracks: Vec<Vec<Member>> =
            (0..POINTS).map(|p| (0..6).map(|v| member(v, p)).collect()).collect();
        let pair = |a: usize, b: usize, parallax_deg: f64| {
            let motion = pose(b) * pose(a).inverse();
            let same = |i| DescriptorMatch { a: i, b: i, distance: 0.1 };
            VerifiedPair {
                a,
                b,
                b_from_a: if a == 0 { reversed(&motion) } else { motion },
                parallax_deg,
                matches: (0..POINTS as u32).map(same).collect(),
            }
        };
        let pairs = [pair(0, 1, 8.0), pair(2, 3, 3.0), pair(4, 5, 3.0)];
        let map =
            grow(&camera, &features, &tracks, &pairs, &[true; 6], &SfmOptions::default(), &|_| ())
                .unwrap();
        assert_eq!((map.registered(), map.sightings()), (6, 6 * POINTS));
        let turn = |a: &Isometry, b: &Isometry| b.rotation * a.rotation.inverse();
        let found = turn(&map.poses[0].unwrap(), &map.poses[5].unwrap());
        assert!(found.angle_to(&turn(&pose(0), &pose(5))) < 1e-3);
    }
}
