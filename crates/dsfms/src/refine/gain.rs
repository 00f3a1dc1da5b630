//! What is expected of the exposure gain and the ambient light of a frame.
//!
//! A near light tells the distance of a surface as well as the exposure is known: a log gain that is
//! wrong by `g` moves everything by `g/2` of its distance. The exploration shows how constant the
//! exposure is; where the frame's own differs from it, at the tissue that the matches hold, it has
//! changed and nothing is known of it.

use super::look::Look;
use crate::geometry::{Point3, Vector3};
use crate::mesh::normals::vertex_normals;
use crate::register::{Match, Scene};
use crate::template::Exposure;

/// Spreads of the exploration's log gains that a frame may be off: a new shape throws light in a new
/// way. On three generated scenes the gain at the true shape is within 0.8 %, of a spread of 0.3 %.
const SPREADS: f64 = 2.0;

/// Least spread of the log gain: what the few frames of an exploration can tell.
const LEAST: f64 = 0.004;

/// An exposure that differs by more than this from the exploration's, in the log, has changed: a shape
/// whose distance alone were off would be a seventh nearer or farther. An organ that bends as a whole
/// shows up to 0.18 at the rigid pose of generated scenes.
const CHANGED: f64 = 0.3;

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
}

impl GainPrior {
    /// Where nothing is known of the exposure but its expected log gain.
    pub(super) fn free(expected: f64, sigma: f64, ambient_sigma: f64) -> Self {
        Self { expected, sigma, ambient_sigma }
    }

    /// Of a frame whose log gain is `seen` over the whole coarse shape and `at_matches` where the
    /// matches hold it, after an exploration of `exposure`; `sigma` and `ambient_sigma` are the spreads where nothing is known.
    pub(super) fn of(
        exposure: Option<Exposure>,
        seen: f64,
        at_matches: Option<f64>,
        sigma: f64,
        ambient_sigma: f64,
    ) -> Self {
        let Some(Exposure { log_gain: expected, spread }) = exposure else {
            return Self::free(seen, sigma, ambient_sigma);
        };
        let changed = (at_matches.unwrap_or(seen) - expected).abs() > CHANGED;
        let told = (SPREADS * spread).max(LEAST);
        if changed || told >= sigma {
            return Self::free(expected, sigma, ambient_sigma);
        }
        Self { expected, sigma: told, ambient_sigma: ambient_sigma.min(SAME_AMBIENT) }
    }

    /// How much better than a spread of `sigma` the exposure is known.
    pub(super) fn slack(&self, sigma: f64) -> f64 {
        sigma / self.sigma
    }
}

/// Median log ratio of image and prediction at the matches; `shape` is that of the mesh they lie on.
/// `None` where too few of them are seen.
pub(super) fn log_gain_at(
    look: &Look,
    scene: &Scene,
    matches: &[Match],
    shape: &[Point3],
) -> Option<f64> {
    let normals = vertex_normals(&scene.rest.topology, shape);
    let one = |m: &Match| {
        let corners = scene.face(m).into_iter().zip(m.barycentric);
        let normal: Vector3 = corners.map(|(v, b)| normals[v as usize] * b).sum();
        let seen = look.at(&scene.point(m, shape), &m.pixel, &normal.try_normalize(0.0)?)?;
        let log = seen.log_ratio();
        log.is_finite().then_some(log)
    };
    let mut logs: Vec<f64> = matches.iter().filter_map(one).collect();
    logs.sort_unstable_by(f64::total_cmp);
    (logs.len() >= TELLING).then(|| logs[logs.len() / 2])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exposure_is_held_as_the_exploration_shows_it() {
        let of = |spread: f64, seen: f64, at: Option<f64>| {
            let exposure = Some(Exposure { log_gain: 0.0, spread });
            GainPrior::of(exposure, seen, at, 0.1, 0.02)
        };
        let told = of(0.003, 0.1, Some(0.1));
        assert_eq!((told.expected, told.sigma, told.ambient_sigma), (0.0, 0.006, SAME_AMBIENT));
        assert!((told.slack(0.1) - 0.1 / 0.006).abs() < 1e-12);
        assert_eq!(of(0.0, 0.0, None).sigma, LEAST);
        // The matches tell that it changed, or that only the shape did.
        assert_eq!(of(0.003, 0.0, Some(0.4)), GainPrior::free(0.0, 0.1, 0.02));
        assert_eq!(of(0.003, 0.4, Some(0.0)).sigma, 0.006);
        // An exposure that varies, frames too few to tell, and no exploration.
        assert_eq!(of(0.2, 0.0, None), GainPrior::free(0.0, 0.1, 0.02));
        assert_eq!(of(f64::INFINITY, 0.0, None), GainPrior::free(0.0, 0.1, 0.02));
        assert_eq!(GainPrior::of(None, 0.7, None, 0.1, 0.02), GainPrior::free(0.7, 0.1, 0.02));
    }
}
