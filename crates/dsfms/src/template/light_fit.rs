//! The light estimated from the exploration itself.
//!
//! The same surface point seen by a camera in known motion changes its brightness only with the
//! light, which moves along: with the albedo eliminated, ratios of brightness over views give the
//! light's offset from the camera, its spot profile and the light reflected from all around, and
//! the vignetting of the lens. Several models are fitted and the one with the best Bayesian
//! information criterion is kept. Vignetting and the spot of a light at the camera do nearly the
//! same; which of them is named then matters to neither albedo nor prediction.

mod candidate;
mod options;
mod parametric;

use super::albedo::{AlbedoError, check_views};
use super::known_light::centred_gains;
use super::log_linear::{LogFit, LogLinear};
use super::photometric::{AlbedoView, SpotObservation};
use super::spots::{observe_spots, prepare, repeated, smoothed_normals};
use crate::geometry::median;
use crate::light::LightModel;
use crate::mesh::Mesh;
pub use candidate::LightCandidate;
pub use options::{LightFitOptions, Vignetting};
use parametric::{ParametricLight, models};

/// What [`fit_light`] found.
#[derive(Clone, Debug)]
pub struct LightFit {
    /// The best candidate's light.
    pub light: LightModel,
    /// The best candidate's ambient part, in units of the shading: `I = gain · α · (s + ambient)`.
    pub ambient: f64,
    /// The best candidate's vignetting `a` of the lens.
    pub vignetting: f64,
    /// Its robust relative residual.
    pub relative_residual: f64,
    /// Exposure gain of every view under it; geometric mean 1.
    pub gains: Vec<f64>,
    /// Surface spots and observations used.
    pub observations: [usize; 2],
    /// All that were tried, best first.
    pub candidates: Vec<LightCandidate>,
}

/// Fewer spots than this say nothing about a light.
const MIN_SPOTS: usize = 50;

/// Estimate the light. `mesh` in the template frame; `initial` (from a camera file) serves as one
/// candidate, as starting point and as centre of the prior on the offset.
///
/// A single view leaves light and albedo apart: the light is then `initial`, or one at the camera,
/// without candidates. The reference distance is that of `initial`, or else the median distance of
/// the observations.
///
/// # Errors
/// An option out of its bounds, no view, an image or mask of another size than its camera, or no
/// usable part of the surface in any.
#[doc(alias("photometric calibration", "light calibration"))]
pub fn fit_light(
    mesh: &Mesh,
    views: &[AlbedoView],
    initial: Option<&LightModel>,
    options: &LightFitOptions,
) -> Result<LightFit, AlbedoError> {
    options.validate()?;
    check_views(views)?;
    let normals = smoothed_normals(mesh, options.normal_smoothing);
    let prepared = prepare(mesh, views, &options.bounds);
    let at_camera = LightModel::at_origin(1.0);
    let gate = initial.unwrap_or(&at_camera);
    let seen = observe_spots(mesh, &normals, &prepared, gate, &options.bounds, options.spots);
    let spots = repeated(&seen);
    if spots.len() < MIN_SPOTS {
        let once: Vec<_> = seen.into_iter().map(|s| s.seen).filter(|s| !s.is_empty()).collect();
        if views.len() == 1 && once.len() >= MIN_SPOTS {
            return Ok(assumed(initial, &once, options));
        }
        return Err(AlbedoError::NothingObserved { views: views.len() });
    }
    let gain_priors: Vec<_> =
        views.iter().map(|v| (v.gain.max(1e-6).ln(), options.gain_sigma)).collect();
    let fits: Vec<_> = models(initial, median_distance(&spots), options)
        .into_iter()
        .map(|model| {
            let problem =
                LogLinear { model: &model, spots: &spots, gain_priors: gain_priors.clone() };
            let fit = problem.solve(&model.start());
            (model, fit)
        })
        .collect();
    Ok(choose(&fits, &spots))
}

/// The light of a single view: nothing is seen twice, so it cannot be told from the albedo. That of
/// the camera file, else one at the camera.
fn assumed(
    initial: Option<&LightModel>,
    spots: &[Vec<SpotObservation>],
    options: &LightFitOptions,
) -> LightFit {
    let at_camera = || LightModel::at_origin(median_distance(spots));
    LightFit {
        light: initial.cloned().unwrap_or_else(at_camera),
        ambient: 0.0,
        vignetting: match options.vignetting {
            Vignetting::Known(a) => a,
            _ => 0.0,
        },
        relative_residual: 0.0,
        gains: vec![1.0],
        observations: [spots.len(), spots.iter().map(Vec::len).sum()],
        candidates: Vec::new(),
    }
}

fn choose(fits: &[(ParametricLight, LogFit)], spots: &[Vec<SpotObservation>]) -> LightFit {
    // One noise for all, so that their losses can be compared.
    let scale = fits.iter().map(|(_, fit)| fit.scale).fold(f64::INFINITY, f64::min);
    let mut ranked: Vec<(LightCandidate, &LogFit)> = fits
        .iter()
        .map(|(model, fit)| {
            let problem = LogLinear { model, spots, gain_priors: Vec::new() };
            let (loss, count) = problem.loss(fit, scale);
            // Neighbouring views of a spot err alike: spots, not observations, are independent.
            let independent = spots.len() as f64;
            let bic = independent * (loss / count as f64).ln()
                + fit.theta.len() as f64 * independent.ln();
            (model.candidate(fit, bic), fit)
        })
        .collect();
    ranked.sort_by(|a, b| a.0.bic.total_cmp(&b.0.bic));
    let (best, fit) = &ranked[0];
    LightFit {
        light: best.light.clone(),
        ambient: best.ambient,
        vignetting: best.vignetting,
        relative_residual: best.relative_residual,
        gains: centred_gains(&fit.log_gains),
        observations: [spots.len(), spots.iter().map(Vec::len).sum()],
        candidates: ranked.into_iter().map(|(candidate, _)| candidate).collect(),
    }
}

fn median_distance(spots: &[Vec<SpotObservation>]) -> f64 {
    let mut distances: Vec<_> = spots.iter().flatten().map(|o| o.point.coords.norm()).collect();
    median(&mut distances).unwrap_or(0.0)
}

#[cfg(test)]
mod tests;
