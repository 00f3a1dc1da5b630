//! Automatic matches: the frame's features against the template's, cleaned by geometry.

use super::RegisterOptions;
use super::correspondence::Match;
use super::error::RegisterError;
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Neighbours, Point2, Point3, Vector2, median, point_at};
use crate::mesh::Mesh;
use crate::sfm::matching::{DescriptorMatch, UnitDescriptors, distance, product};
use crate::sfm::places::{match_places, unique_places};
use crate::sfm::random::Random;
use crate::sfm::{Features2d, SfmOptions, resect};
use crate::template::Features;
use rayon::prelude::*;

/// Fewest matches a found pose must rest on: below this, chance agreements of unrelated tissue
/// with some pose are likely.
pub const NEEDED: usize = 12;

/// Descriptors within this part of the largest side of the template are of one place, which
/// repeated tissue must not compete with.
const ONE_PLACE: f64 = 0.02;

/// Matches kept at most; more only repeat one another.
const MOST: usize = 600;

/// A template's descriptors, ready to be looked for in many frames.
pub struct Search<'a> {
    features: &'a Features,
    descriptors: UnitDescriptors,
    places: Vec<Point3>,
    radius: f64,
}

impl<'a> Search<'a> {
    /// For the descriptors on a rest shape.
    pub fn new(rest: &Mesh, features: &'a Features) -> Self {
        let places = features.faces.iter().zip(&features.barycentrics);
        Self {
            places: places.map(|(&f, &b)| point_at(rest.corners(f as usize), b)).collect(),
            descriptors: UnitDescriptors::new(&features.descriptors),
            radius: ONE_PLACE * extent(&rest.positions),
            features,
        }
    }

    /// Matches with the features of a frame.
    ///
    /// A rigid pose with a tolerance of `options.robust_px[0] / 2` finds the part of the frame that
    /// is this organ; after it, a match is kept when its displacement from the pose agrees with
    /// that of its neighbours, so that tissue that moved together is kept and a stray match is not.
    ///
    /// # Errors
    /// Fewer than [`NEEDED`] descriptor matches, or fewer than that in agreement with a pose.
    #[doc(alias = "feature matching")]
    pub fn matches(
        &self,
        camera: &CameraModel,
        seen: &Features2d,
        options: &RegisterOptions,
        seed: u64,
    ) -> Result<Vec<Match>, RegisterError> {
        let Self { features, descriptors, places, radius } = self;
        let sfm = SfmOptions::of_frames();
        let a = UnitDescriptors::new(&seen.descriptors);
        let pairs = match_places(&a, descriptors, places, *radius, sfm.ratio, sfm.max_distance);
        if pairs.len() < NEEDED {
            return Err(RegisterError::TooFewMatches { found: pairs.len(), needed: NEEDED });
        }
        let pixels: Vec<Point2> = pairs.iter().map(|m| seen.points[m.a as usize]).collect();
        let points: Vec<Point3> = pairs.iter().map(|m| places[m.b as usize]).collect();
        let tolerance = 0.5 * options.robust_px[0];
        let posed = resect(camera, &points, &pixels, tolerance, &mut Random::new(seed, 1));
        let inliers = posed.as_ref().map_or(0, |p| p.inliers.len());
        let posed = posed
            .filter(|_| inliers >= NEEDED)
            .ok_or(RegisterError::NoPose { inliers, found: pairs.len() })?;
        let offsets: Vec<Option<Vector2>> = points
            .iter()
            .zip(&pixels)
            .map(|(p, x)| Some(x - camera.project(&(posed.pose * p))?.pixel))
            .collect();
        let kept = agreeing(&pixels, &offsets, 2.0 * tolerance, SLACK_PX);
        let matches = kept.into_iter().take(MOST).map(|i| Match {
            face: features.faces[pairs[i].b as usize],
            barycentric: features.barycentrics[pairs[i].b as usize],
            pixel: pixels[i],
        });
        Ok(matches.collect())
    }
}

/// Largest ratio of the distances to the nearest and second nearest place near where it is
/// expected, and largest distance: fewer look-alikes compete there than in the whole template.
const GUIDED: (f32, f32) = (0.9, 0.7);

impl Search<'_> {
    /// Where on the rest shape each of the template's features lies.
    pub fn places(&self) -> &[Point3] {
        &self.places
    }

    /// Features closer than this on the rest shape are of one place.
    pub fn one_place(&self) -> f64 {
        0.25 * self.radius
    }

    /// A feature of the template in the frame.
    pub fn matched(&self, feature: u32, pixel: Point2) -> Match {
        let (face, barycentric) =
            (self.features.faces[feature as usize], self.features.barycentrics[feature as usize]);
        Match { face, barycentric, pixel }
    }

    /// Features of the template (indices of [`places`](Self::places)) that `shape` shows, with
    /// their pixels: those on faces all of whose corners are `visible`. `shape` holds the vertices
    /// of `rest` in camera axes.
    pub fn expected(
        &self,
        camera: &CameraModel,
        rest: &Mesh,
        shape: &[Point3],
        visible: &[bool],
    ) -> Vec<(u32, Point2)> {
        let one = |(i, (&face, &barycentric)): (usize, (&u32, &[f64; 3]))| {
            let corners = rest.topology.faces[face as usize].map(|v| v as usize);
            let place = point_at(corners.map(|v| &shape[v]), barycentric);
            let seen = corners.iter().all(|&v| visible[v]);
            seen.then(|| Some((i as u32, camera.project(&place)?.pixel)))?
        };
        let all = self.features.faces.iter().zip(&self.features.barycentrics);
        all.enumerate().filter_map(one).collect()
    }

    /// Matches with the features of a frame near where the template's are expected: `expected`
    /// holds some of them (indices of [`places`](Self::places)) with their pixels, `reach` is in
    /// px. A match differs from where it is expected as its neighbours do.
    pub fn near(&self, seen: &Features2d, expected: &[(u32, Point2)], reach: f64) -> Vec<Match> {
        let (ratio, most) = GUIDED;
        let a = UnitDescriptors::new(&seen.descriptors);
        let nearest = |i: usize| -> Option<DescriptorMatch> {
            let near = |e: &&(u32, Point2)| (e.1 - seen.points[i]).norm_squared() <= reach * reach;
            let within = expected.iter().filter(near);
            let of = |e: &(u32, Point2)| {
                (e.0, distance(product(a.row(i), self.descriptors.row(e.0 as usize))))
            };
            let all: Vec<(u32, f32)> = within.map(of).collect();
            let (best, own) = all.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1))?;
            let place = |feature: u32| self.places[feature as usize];
            let elsewhere = all.iter().filter(|o| (place(o.0) - place(best)).norm() > self.radius);
            let other = elsewhere.map(|o| o.1).fold(f32::INFINITY, f32::min);
            let clear = own <= most && own < ratio * other;
            clear.then_some(DescriptorMatch { a: i as u32, b: best, distance: own })
        };
        let found = (0..seen.len()).into_par_iter().filter_map(nearest).collect();
        let found = unique_places(found, &self.places, self.radius);
        let pixels: Vec<Point2> = found.iter().map(|m| seen.points[m.a as usize]).collect();
        let offset = |m: &DescriptorMatch| {
            let at = expected.iter().find(|e| e.0 == m.b)?;
            Some(seen.points[m.a as usize] - at.1)
        };
        let offsets: Vec<Option<Vector2>> = found.iter().map(offset).collect();
        let kept = agreeing(&pixels, &offsets, reach, SLACK_PX);
        kept.into_iter().map(|i| self.matched(found[i].b, pixels[i])).collect()
    }
}

/// Largest side of the bounding box.
fn extent(points: &[Point3]) -> f64 {
    (0..3)
        .map(|k| {
            let (low, high) =
                points.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p[k]), h.max(p[k])));
            high - low
        })
        .fold(0.0, f64::max)
}

/// Tolerance of [`agreeing`] for the noise of descriptors' places, px.
const SLACK_PX: f64 = 4.0;

/// Indices whose offset is below `limit` and within a tolerance of the median offset of the eight
/// nearest others; the tolerance, `slack` px plus a third of that median's length, allows for
/// strain.
pub fn agreeing(
    pixels: &[Point2],
    offsets: &[Option<Vector2>],
    limit: f64,
    slack: f64,
) -> Vec<usize> {
    let usable = |i: &usize| offsets[*i].is_some_and(|o| o.norm() < limit);
    let candidates: Vec<usize> = (0..pixels.len()).filter(usable).collect();
    let places = Neighbours::of(candidates.iter().map(|&i| pixels[i].coords.into()).collect());
    let agrees = |&at: &usize| {
        let others = places.nearest(at, 8);
        let component = |axis: usize| {
            let others = others.iter().filter_map(|&j| offsets[candidates[j]]);
            median(&mut others.map(|o| o[axis]).collect::<Vec<f64>>()).unwrap_or(0.0)
        };
        let typical = Vector2::new(component(0), component(1));
        let own = offsets[candidates[at]];
        own.is_some_and(|o| (o - typical).norm() < slack + typical.norm() / 3.0)
    };
    let all = (0..candidates.len()).into_par_iter();
    all.filter(agrees).map(|at| candidates[at]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stray_match_is_dropped_and_a_moving_patch_is_kept() {
        let pixels: Vec<_> =
            (0..40).map(|i| Point2::new((i % 8) as f64 * 10.0, (i / 8) as f64 * 10.0)).collect();
        // The right half moved by 12 px; one match there claims the opposite.
        let mut offsets: Vec<_> = pixels
            .iter()
            .map(|p| Some(Vector2::new(if p.x > 35.0 { 12.0 } else { 0.0 }, 0.0)))
            .collect();
        offsets[22] = Some(Vector2::new(-14.0, 3.0));
        let kept = agreeing(&pixels, &offsets, 60.0, SLACK_PX);
        assert!(!kept.contains(&22));
        assert!(kept.len() >= 36, "{}", kept.len());
    }
}
