//! Corners followed by optical flow from frame to frame, where features are few: on smooth tissue
//! descriptors say little, but a patch of it is where its neighbour frame shows the same faint
//! pattern.

use super::SfmOptions;
use super::features::{Features2d, highlights, local_contrast};
use super::frames::{SfmProgress, SfmStage, ValidAreas};
use super::matching::{DescriptorMatch, UnitDescriptors, match_unit};
use super::tracks::PairMatches;
use super::two_view::{VerifiedPair, sightlines, verify_pair};
use crate::camera::CameraModel;
use crate::geometry::Point2;
use crate::image::corners::{CornerGrid, corners};
use crate::image::flow::{Pyramid, correlation, follow, most_alike, whole};
use crate::image::{Frame, Mask};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Where corners are sought, px.
const GRID: CornerGrid = CornerGrid { cell: 12, stride: 3, most: 2000 };

/// A corner nearer than this to one that is followed already is not sought, px.
const APART: f64 = 8.0;

/// The coarsest image has at least so many rows.
const COARSEST_ROWS: usize = 75;

/// A patch is sought in the coarsest image within this of where it was, of the width.
const REACH: f64 = 0.125;

/// Followed forth and back a corner must return to within this, px.
const MAX_RETURN_PX: f64 = 0.5;

/// Least normalised cross-correlation of the two patches; noise and quantisation leave little of it
/// where texture is faint, and the epipolar geometry has the last word.
const LEAST_ALIKE: f64 = 0.6;

/// Standard deviation of a Gaussian as wide as a patch (17 px / √12), px: a followed corner counts
/// as much as a feature of that scale.
const SCALE: f32 = 4.9;

/// A corner in one frame after another.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(super) struct Followed {
    /// Index of the first frame.
    pub first: usize,
    /// Position in it and in those that follow, px; at least two.
    pub pixels: Vec<Point2>,
}

/// Follow corners through every run of neighbouring frames with fewer than `options.flow_below`
/// verified matches; nothing where there are enough.
pub(super) fn follow_where_few(
    frames: &[Frame],
    areas: &ValidAreas,
    pairs: &[VerifiedPair],
    options: &SfmOptions,
    progress: SfmProgress,
) -> Vec<Followed> {
    let matches =
        |a: usize| pairs.iter().find(|p| (p.a, p.b) == (a, a + 1)).map_or(0, |p| p.matches.len());
    let few: Vec<usize> =
        (0..frames.len().saturating_sub(1)).filter(|&a| matches(a) < options.flow_below).collect();
    let mut tracks: Vec<Followed> = Vec::new();
    let mut last: Option<(usize, FollowedFrame)> = None;
    for (done, &a) in few.iter().enumerate() {
        let look = |i: usize| FollowedFrame::new(&frames[i], areas.of(i), options);
        let from = match last.take() {
            Some((frame, looked)) if frame == a => looked,
            _ => look(a),
        };
        let to = look(a + 1);
        step(&mut tracks, a, &from, &to);
        last = Some((a + 1, to));
        progress(SfmStage::OpticalFlow, done + 1, few.len());
    }
    tracks.retain(|t| t.pixels.len() > 1);
    tracks
}

/// A frame as patches of it are compared: shading, which moves with the light, taken away.
struct FollowedFrame {
    pyramid: Pyramid,
    usable: Mask,
}

impl FollowedFrame {
    fn new(frame: &Frame, area: Option<Mask>, options: &SfmOptions) -> Self {
        let area = area.unwrap_or_else(|| Mask::filled(frame.size, true));
        let usable = match highlights(frame, options) {
            Some(blocked) => area.minus(&blocked),
            None => area,
        };
        let rows = frame.size[0].min(frame.size[1]);
        let levels = (0..).take_while(|l| rows >> l >= COARSEST_ROWS).count();
        Self { pyramid: Pyramid::new(local_contrast(&frame.luma()), levels), usable }
    }
}

/// Follow what is seen in frame `a`, and corners beside it, to the next frame.
fn step(tracks: &mut Vec<Followed>, a: usize, from: &FollowedFrame, to: &FollowedFrame) {
    let live = |t: &Followed| (t.first + t.pixels.len() == a + 1).then(|| t.pixels[a - t.first]);
    let known: Vec<Point2> = tracks.iter().filter_map(live).collect();
    let fresh = corners(&from.pyramid.levels[0], &from.usable, &GRID)
        .into_iter()
        .map(|[x, y]| Point2::new(x as f64, y as f64))
        .filter(|c| known.iter().all(|k| (k - c).norm() >= APART));
    tracks.extend(fresh.map(|c| Followed { first: a, pixels: vec![c] }));
    tracks.par_iter_mut().for_each(|track| {
        if let Some(next) = live(track).and_then(|at| next(from, to, at)) {
            track.pixels.push(next);
        }
    });
}

/// Where the patch about a place of one frame is in the next; `None` where it is not the same
/// patch.
fn next(from: &FollowedFrame, to: &FollowedFrame, at: Point2) -> Option<Point2> {
    let found = sought(&from.pyramid, &to.pyramid, at)?;
    whole(&to.usable, found).then_some(())?;
    let back = sought(&to.pyramid, &from.pyramid, found)?;
    let alike = correlation(&from.pyramid.levels[0], at, &to.pyramid.levels[0], found)?;
    ((back - at).norm() <= MAX_RETURN_PX && alike >= LEAST_ALIKE).then_some(found)
}

/// The most alike place of the coarsest image, and from there by optical flow.
fn sought(from: &Pyramid, to: &Pyramid, at: Point2) -> Option<Point2> {
    let level = from.levels.len() - 1;
    let (a, b) = (&from.levels[level], &to.levels[level]);
    let scale = f64::from(1u32 << level);
    let centre = at.map(|c| (c + 0.5) / scale - 0.5);
    let reach = (REACH * b.size[0] as f64).ceil() as i32;
    let found = most_alike(a, centre, b, centre, reach)?;
    follow(from, to, at, at + (found - centre) * scale)
}

/// Give the tracks to the features of their frames, and verify every pair within the window that
/// shares enough of them again, with its descriptors' matches. Returns the tracks' verified
/// matches.
pub(super) fn join(
    tracks: &[Followed],
    camera: &CameraModel,
    features: &mut [Features2d],
    descriptors: &[UnitDescriptors],
    pairs: &mut Vec<VerifiedPair>,
    options: &SfmOptions,
) -> Vec<PairMatches> {
    let candidates: Vec<PairMatches> = shared(tracks, features, options);
    if candidates.is_empty() {
        return candidates;
    }
    let rays = sightlines(camera, features);
    let verify = |c: &PairMatches| {
        let [a, b] = [c.a, c.b];
        let (ratio, most) = (options.ratio, options.max_distance);
        let mut matches = match_unit(&descriptors[a], &descriptors[b], ratio, most);
        matches.extend_from_slice(&c.matches);
        verify_pair(camera, [a, b], [&rays[a], &rays[b]], matches, options)
    };
    let verified: Vec<_> = candidates.par_iter().with_max_len(1).map(verify).collect();
    for pair in verified.into_iter().flatten() {
        match pairs.binary_search_by_key(&(pair.a, pair.b), |p| (p.a, p.b)) {
            Ok(at) if pairs[at].matches.len() < pair.matches.len() => pairs[at] = pair,
            Ok(_) => {}
            Err(at) => pairs.insert(at, pair),
        }
    }
    let followed = |p: &VerifiedPair| {
        let beyond = |m: &&DescriptorMatch| m.a as usize >= descriptors[p.a].len();
        PairMatches { a: p.a, b: p.b, matches: p.matches.iter().filter(beyond).copied().collect() }
    };
    pairs.iter().map(followed).filter(|p| !p.matches.is_empty()).collect()
}

/// Append the tracks' pixels to the features; pairs of frames that share enough tracks, in order.
fn shared(
    tracks: &[Followed],
    features: &mut [Features2d],
    options: &SfmOptions,
) -> Vec<PairMatches> {
    let mut shared: BTreeMap<(usize, usize), Vec<DescriptorMatch>> = BTreeMap::new();
    for track in tracks {
        let frames = track.first..track.first + track.pixels.len();
        let index: Vec<u32> = frames.clone().map(|frame| features[frame].len() as u32).collect();
        for (frame, pixel) in frames.zip(&track.pixels) {
            let own = &mut features[frame];
            own.points.push(*pixel);
            own.scale.push(SCALE);
            own.angle.push(0.0);
        }
        for (i, &a) in index.iter().enumerate() {
            for (j, &b) in index.iter().enumerate().skip(i + 1).take(options.window) {
                // No descriptor competes with it: corners are linked to corners alone.
                let link = DescriptorMatch { a, b, distance: 0.0 };
                shared.entry((track.first + i, track.first + j)).or_default().push(link);
            }
        }
    }
    shared.retain(|_, matches| matches.len() >= options.min_matches);
    shared.into_iter().map(|((a, b), matches)| PairMatches { a, b, matches }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Isometry, Vector2};
    use crate::sfm::random::Random;

    const SIZE: [usize; 2] = [200, 150];

    /// From frame to frame, px.
    const MOTION: [f64; 2] = [4.3, -2.6];

    /// Smooth noise of lattice values, -0.5 to 0.5, as fine over the width as the texture of tissue
    /// is.
    fn noise(x: f64, y: f64) -> f64 {
        let value = |i: f64, j: f64| {
            let seed = (i as i64 + 1000) as u64 * 5000 + (j as i64 + 1000) as u64;
            Random::new(seed, 0).below(1000) as f64 / 999.0 - 0.5
        };
        let smooth = |t: f64| t * t * (3.0 - 2.0 * t);
        let (u, v) = (smooth(x - x.floor()), smooth(y - y.floor()));
        let row = |j: f64| (1.0 - u) * value(x.floor(), j) + u * value(x.floor() + 1.0, j);
        (1.0 - v) * row(y.floor()) + v * row(y.floor() + 1.0)
    }

    /// A faint pattern (three grey levels) on shading that stays where it is; in the last
    /// frame the lower right shows something else.
    fn frame(index: usize) -> Frame {
        let [dx, dy] = MOTION.map(|m| m * index as f64);
        let value = |i: usize| {
            let (x, y) = ((i % SIZE[0]) as f64, (i / SIZE[0]) as f64);
            let shading = 120.0 - 0.004 * ((x - 100.0).powi(2) + (y - 75.0).powi(2));
            let other = index == 3 && x > 130.0 && y > 90.0;
            let (u, v) = if other { (y + 31.0, 190.0 - x) } else { (x - dx, y - dy) };
            [(shading + 6.0 * noise(u / 3.0, v / 3.0)).round() as u8; 3]
        };
        let rgb = (0..SIZE[0] * SIZE[1]).map(value).collect();
        Frame { name: format!("{index}"), size: SIZE, rgb }
    }

    fn tracks(options: &SfmOptions) -> Vec<Followed> {
        let frames: Vec<Frame> = (0..4).map(frame).collect();
        let areas = ValidAreas::new(&frames, &[], options);
        follow_where_few(&frames, &areas, &[], options, &|_, _, _| ())
    }

    #[test]
    fn a_faint_pattern_is_followed_and_what_is_replaced_is_not() {
        let tracks = tracks(&SfmOptions::default());
        let whole = tracks.iter().filter(|t| t.pixels.len() == 4).count();
        assert!(whole > 20, "{whole} of {}", tracks.len());
        for track in &tracks {
            let moved = |k: usize| Vector2::from(MOTION) * k as f64;
            for (k, found) in track.pixels.iter().enumerate() {
                let expected = track.pixels[0] + moved(k);
                assert!((found - expected).norm() < 0.3, "{:?}", track);
            }
        }
        let replaced = |t: &&Followed| {
            t.first + t.pixels.len() == 4
                && t.pixels.last().is_some_and(|p| p.x > 138.0 && p.y > 98.0)
        };
        assert_eq!(tracks.iter().find(replaced), None);
    }

    #[test]
    fn nothing_is_followed_where_it_is_switched_off_or_matches_suffice() {
        assert!(tracks(&SfmOptions { flow_below: 0, ..Default::default() }).is_empty());
        let frames: Vec<Frame> = (0..2).map(frame).collect();
        let options = SfmOptions { flow_below: 3, ..Default::default() };
        let areas = ValidAreas::new(&frames, &[], &options);
        let pair = |count: u32| VerifiedPair {
            a: 0,
            b: 1,
            b_from_a: Isometry::identity(),
            matches: (0..count).map(|i| DescriptorMatch { a: i, b: i, distance: 0.1 }).collect(),
            parallax_deg: 3.0,
        };
        let found =
            |count| follow_where_few(&frames, &areas, &[pair(count)], &options, &|_, _, _| ());
        assert!(found(3).is_empty() && !found(2).is_empty());
    }
}
