//! Matching again once the poses are known.

use super::SfmOptions;
use super::features::Features2d;
use super::frames::{Counter, SfmProgress, SfmStage};
use super::guided::{GuidedLimits, GuidedView, match_guided};
use super::map::{Map, MapTrack};
use super::matching::UnitDescriptors;
use super::tracks::{PairMatches, build_tracks};
use super::two_view::{chosen_pairs, mean_focal};
use crate::camera::Camera;
use rayon::prelude::*;

/// Match all registered pairs again along epipolar lines; new tracks, new points. `followed`:
/// verified matches of features beyond the described ones, which join as they are.
pub(super) fn rematch(
    map: &mut Map,
    descriptors: &[UnitDescriptors],
    followed: &[PairMatches],
    options: &SfmOptions,
    progress: SfmProgress,
) {
    let views: Vec<Option<GuidedView>> = (0..map.poses.len())
        .map(|v| {
            let described = &map.features[v].points[..descriptors[v].len()];
            let rays = described.iter().map(|p| map.camera.unproject(p)).collect();
            Some(GuidedView { pose: map.poses[v]?, rays, descriptors: descriptors[v].clone() })
        })
        .collect();
    let limits = GuidedLimits {
        angle: options.max_epipolar_px / mean_focal(&map.camera),
        ratio: 0.5 * (1.0 + options.ratio),
        max_distance: options.max_distance,
        depth: depth_range(map),
    };
    let pairs = related_pairs(map, options);
    let count = Counter::new(SfmStage::GuidedMatching, pairs.len(), progress);
    let guided = |&(a, b): &(usize, usize)| {
        let matches = match (&views[a], &views[b]) {
            (Some(from), Some(to)) => match_guided(from, to, &limits),
            _ => Vec::new(),
        };
        count.next();
        PairMatches { a, b, matches }
    };
    let mut matched: Vec<PairMatches> = pairs.par_iter().with_max_len(1).map(guided).collect();
    matched.extend_from_slice(followed);
    let counts: Vec<usize> = map.features.iter().map(Features2d::len).collect();
    map.tracks = build_tracks(&counts, &matched).into_iter().map(MapTrack::new).collect();
    map.triangulate(&options.limits());
}

/// Pairs that share some points already; neighbours while there are no points.
fn related_pairs(map: &Map, options: &SfmOptions) -> Vec<(usize, usize)> {
    /// Fewer say nothing of where the two frames look.
    const SHARED: usize = 5;
    let n = map.poses.len();
    let mut shared = vec![0usize; n * n];
    for track in map.tracks.iter().filter(|t| t.point.is_some()) {
        let views: Vec<usize> = track.seen().map(|m| m.view as usize).collect();
        for (i, a) in views.iter().enumerate() {
            views[i + 1..].iter().for_each(|b| shared[a * n + b] += 1);
        }
    }
    let mut pairs = chosen_pairs(n, options, &|a, b| shared[a * n + b]);
    if map.points() > 0 {
        pairs.retain(|&(a, b)| shared[a * n + b] >= SHARED);
    }
    pairs
}

/// Distances between which points are looked for: those of the known points with room, or, without
/// points, from a tenth of the camera path's extent to infinity.
fn depth_range(map: &Map) -> [f64; 2] {
    let mut depths: Vec<f64> = Vec::new();
    for track in &map.tracks {
        let Some(point) = track.point else { continue };
        depths.extend(
            track.seen().filter_map(|m| Some((map.poses[m.view as usize]? * point).coords.norm())),
        );
    }
    depths.sort_by(f64::total_cmp);
    if let (Some(near), Some(far)) =
        (depths.get(depths.len() / 100), depths.get(depths.len() * 99 / 100))
    {
        return [0.7 * near, 1.5 * far];
    }
    let centres: Vec<_> = map.poses.iter().flatten().map(super::triangulation::centre_of).collect();
    let extent = centres.iter().map(|c| (c - centres[0]).norm()).fold(0.0, f64::max);
    [0.1 * extent, 1e4 * extent]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraModel;
    use crate::geometry::Point3;
    use crate::sfm::tracks::Member;

    #[test]
    fn distant_frames_are_related_by_the_points_that_they_share() {
        let options =
            SfmOptions { all_pairs_up_to: 2, window: 1, retrieved: 1, ..Default::default() };
        let track = |views: [u32; 2]| MapTrack {
            members: views.map(|view| Member { view, feature: 0 }).to_vec(),
            used: vec![true; 2],
            point: Some(Point3::origin()),
        };
        let many = [[0, 1], [1, 2], [1, 4], [2, 3]].map(|views| vec![track(views); 6]).concat();
        let camera = CameraModel::pinhole([200, 150], [180.0; 2], [99.5, 74.5]);
        let mut map = Map {
            camera: camera.clone(),
            prior: camera,
            features: &[],
            poses: vec![None; 5],
            tracks: [many, vec![track([0, 4]); 4]].concat(),
        };
        // Frames 0 and 4 share too few points, 3 and 4 none.
        assert_eq!(related_pairs(&map, &options), [(0, 1), (1, 2), (1, 4), (2, 3)]);
        map.tracks.clear();
        assert_eq!(related_pairs(&map, &options), [(0, 1), (1, 2), (2, 3), (3, 4)]);
    }
}
