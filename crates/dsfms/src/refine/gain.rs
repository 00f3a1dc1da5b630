//! What is expected of the exposure gain and the ambient light of a frame.
//!
//! A near light tells the distance of a surface as well as the exposure is known: a log gain that
//! is wrong by `g` moves everything by `g/2` of its distance. The exploration shows how constant
//! the exposure is. It has changed, and nothing is known of it, where the tissue that the matches
//! hold shows another ([`AtMatches`]), or where holding it makes the surface larger or smaller than
//! tissue gets that moves as little as the matches do ([`scaled`]).

use super::PhotometricModel;
use super::depth_prior::shared_motions;
use super::look::FrameLook;
use crate::geometry::robust::weighted_median;
use crate::geometry::triangle::area;
use crate::geometry::{Point3, Vector3, median};
use crate::light::LightModel;
use crate::mesh::normals::vertex_normals;
use crate::register::{Match, Scene};
use crate::template::Exposure;

/// Spreads of the exploration's log gains that a frame may be off: a new shape throws light in a
/// new way. On three generated scenes the gain at the true shape is within 0.8 %, of a spread of
/// 0.3 %.
const SPREADS: f64 = 2.0;

/// Least spread of the log gain: what the few frames of an exploration can tell.
const LEAST: f64 = 0.004;

/// What the log gain at many matches on tissue that did not move may be off from that of the
/// exploration: on seven generated scenes up to 0.02.
const CALM: f64 = 0.03;

/// And of one match, for it falls with the root of their number; of 13 on these scenes up to 0.037
/// off.
const ALONE: f64 = 0.1;

/// And for every visible radius that they moved as no rigid pose explains: surfaces that bend turn
/// and come nearer. With these three none of 128 frames is off by more, with given matches or with
/// found ones.
const BEND: f64 = 20.0;

/// What it may be off at most: a shape whose distance alone were off would be a quarter nearer or
/// farther. An organ that bends as a whole shows up to 0.33.
const CHANGED: f64 = 0.5;

/// Median log stretch, at least, of a surface that a wrong exposure has scaled: of less is 0.15 mm
/// of 75, and not worth a second solve. Chosen with what follows on eight generated scenes and six
/// clips (`docs/results/exposure.md`).
const REST_STRETCH: f64 = 2e-3;

/// And for every visible radius that the calmest half of the matches moved: on 68 frames of
/// deformed tissue under the exploration's exposure it is at most 6.6, and of 7, 7.5 and 9 the
/// clips ask for 7.5 (`docs/results/exposure.md`).
const STRETCHED: f64 = 7.5;

/// Tissue that moved by no more than this part of the visible radius tells the exposure to 0.02: on
/// the same scenes, with found matches, -0.02 to 0.00.
const STILL: f64 = 1e-3;

/// Spread of the ambient light where the exposure is the exploration's, which had it in the albedo:
/// 0.003 of ambient light move a surface by 0.3 mm of 80.
const SAME_AMBIENT: f64 = 5e-4;

/// Matches that tell the exposure.
const TELLING: usize = 6;

/// Gaussian priors of log gain and ambient light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GainPrior {
    pub(super) expected: f64,
    pub(super) sigma: f64,
    /// About 0, linear light.
    pub(super) ambient_sigma: f64,
    /// The matches show another exposure than the exploration.
    pub(super) changed: bool,
}

impl GainPrior {
    /// Where nothing is known of the exposure but its expected log gain.
    pub(super) fn free(expected: f64, sigma: f64, ambient_sigma: f64) -> Self {
        Self { expected, sigma, ambient_sigma, changed: false }
    }

    /// Of a frame whose log gain is `seen` over the whole coarse shape, after an exploration of
    /// `exposure`; the spreads where nothing is known are those of `image`.
    pub(super) fn of(
        exposure: Option<Exposure>,
        seen: f64,
        at_matches: Option<AtMatches>,
        image: &PhotometricModel,
    ) -> Self {
        let (sigma, ambient_sigma) = (image.gain_sigma, image.ambient_sigma);
        let Some(Exposure { log_gain: expected, spread }) = exposure else {
            return Self::free(seen, sigma, ambient_sigma);
        };
        let told = (SPREADS * spread).max(LEAST);
        if told >= sigma {
            return Self::free(expected, sigma, ambient_sigma);
        }
        let at = at_matches.unwrap_or(AtMatches { log_gain: seen, moved: f64::INFINITY, count: 1 });
        if at.differs(expected) {
            return Self { changed: true, ..Self::free(at.log_gain, sigma, ambient_sigma) };
        }
        let ambient_sigma = ambient_sigma.min(SAME_AMBIENT);
        Self { expected, sigma: told, ambient_sigma, changed: false }
    }

    /// How much better than a spread of `sigma` the exposure is known.
    pub(super) fn slack(&self, sigma: f64) -> f64 {
        sigma / self.sigma
    }

    /// Whether the exposure is known better than by a spread of `sigma`.
    pub(super) fn is_told(&self, sigma: f64) -> bool {
        self.sigma < sigma
    }

    /// Whether brightness tells distance: a near light, and its exposure known.
    pub(super) fn tells_distance(&self, light: &LightModel, image: &PhotometricModel) -> bool {
        light.tells_distance() && self.is_told(image.gain_sigma)
    }
}

/// What the tissue that the matches hold tells of a frame's exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AtMatches {
    /// Median log ratio of image and prediction there.
    pub log_gain: f64,
    /// How far it moved as no rigid pose explains, of the visible radius.
    pub moved: f64,
    /// Number of matches that tell it.
    pub count: usize,
}

impl AtMatches {
    /// Whether this tissue is at rest, so that its log gain is the exposure's.
    pub fn calm(&self) -> bool {
        self.moved <= STILL
    }

    fn differs(&self, expected: f64) -> bool {
        let tolerance = CALM + ALONE / (self.count as f64).sqrt() + BEND * self.moved;
        (self.log_gain - expected).abs() > tolerance.min(CHANGED)
    }

    /// Of the half of the matches that moved least; `shape` is that of the mesh they lie on, and
    /// `posed` its rest shape where they pose it. `None` where too few of them are seen.
    pub(super) fn of(
        look: &FrameLook,
        scene: &Scene,
        matches: &[Match],
        [shape, posed]: [&[Point3]; 2],
    ) -> Option<Self> {
        let normals = vertex_normals(&scene.rest.topology, shape);
        let one = |(m, motion): (&Match, f64)| {
            let corners = scene.face(m).into_iter().zip(m.barycentric);
            let normal: Vector3 = corners.map(|(v, b)| normals[v as usize] * b).sum();
            let pixel = look.of_frame(scene.camera, m.pixel)?;
            let seen = look.at(&scene.point(m, shape), &pixel, &normal.try_normalize(0.0)?)?;
            let log = seen.log_ratio();
            log.is_finite().then_some((motion, log))
        };
        let motions = shared_motions(scene, matches, posed);
        let mut told: Vec<(f64, f64)> = matches.iter().zip(motions).filter_map(one).collect();
        if told.len() < TELLING {
            return None;
        }
        told.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        told.truncate(told.len().div_ceil(2).max(TELLING));
        let squares: f64 = told.iter().map(|t| t.0 * t.0).sum();
        let moved = (squares / told.len() as f64).sqrt() / scene.radius();
        let log_gain = median(&mut told.iter().map(|t| t.1).collect::<Vec<_>>())?;
        Some(Self { log_gain, moved, count: told.len() })
    }
}

/// Whether what a scene shows is larger or smaller at `shape` (camera axes) than tissue gets that
/// moved as the matches did: a wrong exposure under a near light scales everything, and leaves the
/// matches where they are.
pub(super) fn scaled(scene: &Scene, shape: &[Point3], at_matches: Option<AtMatches>) -> bool {
    let Some(at) = at_matches else { return false };
    median_stretch(scene, shape).abs() > REST_STRETCH + STRETCHED * at.moved
}

/// Half the log of the area of a face over that at rest: its median by area over the faces that are
/// seen; NaN for none.
fn median_stretch(scene: &Scene, shape: &[Point3]) -> f64 {
    let rest = &scene.rest.positions;
    let one = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|v| v as usize);
        let before = area(&rest[a], &rest[b], &rest[c]);
        let seen = scene.visible[a] && scene.visible[b] && scene.visible[c] && before > 0.0;
        seen.then(|| (0.5 * (area(&shape[a], &shape[b], &shape[c]) / before).ln(), before))
    };
    let mut stretches: Vec<(f64, f64)> = scene.rest.topology.faces.iter().filter_map(one).collect();
    weighted_median(&mut stretches)
}

#[cfg(test)]
mod tests {
    use super::super::samples::look;
    use super::super::{JointOptions, Photograph};
    use super::*;
    use crate::camera::CameraModel;
    use crate::camera::resample::resampled;
    use crate::image::Picture;
    use crate::synth::Case;

    fn of(spread: f64, seen: f64, at: Option<[f64; 2]>) -> GainPrior {
        let exposure = Some(Exposure { log_gain: 0.0, spread });
        let at = at.map(|[log_gain, moved]| AtMatches { log_gain, moved, count: 100 });
        GainPrior::of(exposure, seen, at, &PhotometricModel::default())
    }

    #[test]
    fn the_exposure_is_held_as_the_exploration_shows_it() {
        let told = of(0.003, 0.1, Some([0.1, 0.01]));
        assert_eq!((told.expected, told.sigma, told.ambient_sigma), (0.0, 0.006, SAME_AMBIENT));
        assert!((told.slack(0.1) - 0.1 / 0.006).abs() < 1e-12);
        assert!(told.is_told(0.1) && !GainPrior::free(0.0, 0.1, 0.02).is_told(0.1));
        assert_eq!(of(0.0, 0.0, None).sigma, LEAST);
        // The matches tell that it changed, or that only the shape did.
        let other = |gain| GainPrior { changed: true, ..GainPrior::free(gain, 0.1, 0.02) };
        assert_eq!(of(0.003, 0.0, Some([0.1, 0.0])), other(0.1));
        assert_eq!(of(0.003, 0.4, Some([0.0, 0.0])).sigma, 0.006);
        assert_eq!(of(0.003, 0.6, None), other(0.6));
        // An exposure that varies, frames too few to tell, and no exploration.
        assert_eq!(of(0.2, 0.0, None), GainPrior::free(0.0, 0.1, 0.02));
        assert_eq!(of(f64::INFINITY, 0.0, None), GainPrior::free(0.0, 0.1, 0.02));
        let unknown = GainPrior::of(None, 0.7, None, &PhotometricModel::default());
        assert_eq!(unknown, GainPrior::free(0.7, 0.1, 0.02));
    }

    /// The log gain at the matches, at the true shape, in a picture of the size of a camera at the
    /// same place.
    fn gain_in(case: &Case, camera: &CameraModel) -> AtMatches {
        let (frame, usable) = resampled(&case.frame, &case.camera, camera);
        let photo = &Photograph {
            camera,
            picture: &Picture::of(&frame, &case.template.tone),
            usable: &usable,
            outline: None,
            light: &case.template.lighting(),
            albedo: case.template.albedo.as_ref().unwrap(),
            exposure: None,
        };
        let rest = &case.template.mesh;
        let scene = Scene::new(&case.camera, rest, case.truth.clone());
        let look = look(photo, rest, &case.truth, 0.0045, &JointOptions::default());
        AtMatches::of(&look, &scene, &case.matches, [&case.truth; 2]).unwrap()
    }

    #[test]
    fn matches_are_pixels_of_the_frame_in_a_picture_of_any_size() {
        let case = Case::example(1);
        let whole = gain_in(&case, &case.camera);
        let half = gain_in(&case, &case.camera.halved());
        assert!((half.log_gain - whole.log_gain).abs() < 0.01, "{half:?}, whole {whole:?}");
        assert!(half.count.abs_diff(whole.count) <= 1, "{half:?}, whole {whole:?}");
    }

    #[test]
    fn a_surface_is_scaled_where_it_is_larger_than_the_matches_that_moved_let_it_be() {
        let case = Case::example(1);
        let rest = &case.template.mesh;
        let posed: Vec<Point3> = rest.positions.iter().map(|p| p + Vector3::z() * 75.0).collect();
        let scene = Scene::new(&case.camera, rest, posed.clone());
        let by = |scale: f64, of: &dyn Fn(&Point3) -> bool| -> Vec<Point3> {
            let scaled = |p: &Point3| if of(p) { (p.coords * scale).into() } else { *p };
            posed.iter().map(scaled).collect()
        };
        let at = |moved| Some(AtMatches { log_gain: 0.0, moved, count: 100 });
        let scaled = |shape: &[Point3], moved| scaled(&scene, shape, at(moved));
        let all = |_: &Point3| true;
        assert!((median_stretch(&scene, &by(1.01, &all)) - 1.01_f64.ln()).abs() < 1e-9);
        assert!(!scaled(&posed, 0.0) && !scaled(&by(1.001, &all), 0.0));
        assert!(scaled(&by(1.01, &all), 1e-3) && scaled(&by(0.99, &all), 1e-3));
        assert!(!scaled(&by(1.01, &all), 2e-3) && !scaled(&by(1.5, &all), f64::INFINITY));
        // A part of it may stretch as it likes, and without matches nothing tells.
        let few = |p: &Point3| p.x > posed.iter().map(|p| p.x).fold(f64::MIN, f64::max) - 5.0;
        assert!(!scaled(&by(1.1, &few), 0.0));
        assert!(!super::scaled(&scene, &by(1.1, &all), None));
    }
}
