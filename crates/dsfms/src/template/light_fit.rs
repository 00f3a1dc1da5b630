//! The light estimated from the exploration itself.
//!
//! The same surface point seen by a camera in known motion changes its brightness only with the
//! light, which moves along: with the albedo eliminated, ratios of brightness over views give the
//! light's offset from the camera, its spot profile and the light reflected from all around, and the
//! vignetting of the lens. Several models are fitted and the one with the best Bayesian information
//! criterion is kept. Vignetting and the spot of a light at the camera do nearly the same; which of them
//! is named then matters to neither albedo nor prediction.

use super::albedo::{AlbedoError, check_views};
use super::known_light::centred_gains;
use super::log_linear::{LogFit, LogLinear, ShadingModel};
use super::photometric::{AlbedoView, Observation, ObservationBounds};
use super::spots::{observe_spots, prepare, repeated, smoothed_normals};
use crate::geometry::{Point3, median};
use crate::light::{Coat, LightModel, PointLight, Spot, coat, vignetting};
use crate::mesh::Mesh;
use serde::{Deserialize, Serialize};

/// Options of [`fit_light`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LightFitOptions {
    /// Which observations count.
    pub bounds: ObservationBounds,
    /// Rounds of one-ring averaging of the vertex normals.
    pub normal_smoothing: usize,
    /// Number of surface spots tried, at least 100.
    pub spots: usize,
    /// Prior standard deviation of a frame's log gain; small where the exposure is fixed.
    pub gain_sigma: f64,
    /// Whether light reflected from all around is estimated too.
    pub ambient: bool,
    /// Prior standard deviation of the light's offset from its initial place, relative to the
    /// median distance of the surface.
    pub offset_sigma: f64,
    /// Refractive index of the wet film on the organ, at least 1 (1 = Lambert without a film);
    /// default that of wet tissue.
    pub refractive_index: f64,
    /// Vignetting of the lens.
    pub vignetting: Vignetting,
}

/// What is known of the vignetting `1 + a r²`, r in focal lengths from the principal point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Vignetting {
    /// `a`, e.g. of a picture of an evenly lit wall; 0 = none.
    Known(f64),
    /// Nothing: every light is tried without it and with an `a` of its own.
    Estimated,
}

impl Default for Vignetting {
    fn default() -> Self {
        Self::Known(0.0)
    }
}

impl Default for LightFitOptions {
    fn default() -> Self {
        Self {
            bounds: ObservationBounds::default(),
            normal_smoothing: 1,
            spots: 3000,
            gain_sigma: 0.3,
            ambient: true,
            offset_sigma: 0.1,
            refractive_index: coat::WET_TISSUE,
            vignetting: Vignetting::default(),
        }
    }
}

/// One model that was tried.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightCandidate {
    /// What was free: `given`, `collinear`, `offset + linear spot`, ...
    pub name: String,
    /// The light at its optimum.
    pub light: LightModel,
    /// Light from all around that the surface reflects, in units of the shading.
    pub ambient: f64,
    /// Vignetting `a` of the lens.
    pub vignetting: f64,
    /// Robust relative standard deviation of one observation.
    pub relative_residual: f64,
    /// Free parameters, gains not counted.
    pub parameters: usize,
    /// Bayesian information criterion up to a constant; smaller is better.
    pub bic: f64,
}

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

/// Prior standard deviation of the vignetting.
const VIGNETTING_SIGMA: f64 = 0.5;

/// Estimate the light. `mesh` in the template frame; `initial` (from a camera file) serves as one
/// candidate, as starting point and as centre of the prior on the offset.
///
/// A single view leaves light and albedo apart: the light is then `initial`, or one at the camera, without
/// candidates. The reference distance is that of `initial`, or else the median distance of the observations.
#[doc(alias("photometric calibration", "light calibration"))]
pub fn fit_light(
    mesh: &Mesh,
    views: &[AlbedoView],
    initial: Option<&LightModel>,
    options: &LightFitOptions,
) -> Result<LightFit, AlbedoError> {
    check_views(views)?;
    let normals = smoothed_normals(mesh, options.normal_smoothing);
    let prepared = prepare(mesh, views, &options.bounds);
    let at_camera = LightModel::at_origin(1.0);
    let gate = initial.unwrap_or(&at_camera);
    let count = options.spots.max(100);
    let seen = observe_spots(mesh, &normals, &prepared, gate, &options.bounds, count);
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

/// The light of a single view: nothing is seen twice, so it cannot be told from the albedo. That of the
/// camera file, else one at the camera.
fn assumed(
    initial: Option<&LightModel>,
    spots: &[Vec<Observation>],
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

fn choose(fits: &[(ParametricLight, LogFit)], spots: &[Vec<Observation>]) -> LightFit {
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

fn median_distance(spots: &[Vec<Observation>]) -> f64 {
    let mut distances: Vec<_> = spots.iter().flatten().map(|o| o.point.coords.norm()).collect();
    median(&mut distances).unwrap_or(0.0)
}

/// Which family of lights.
#[derive(Clone, Debug)]
enum Family {
    /// As it is, e.g. given or collinear.
    Fixed(&'static str, LightModel),
    /// A near point light; its position and its spot profile free or not.
    Near { offset: bool, spot: SpotFamily },
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum SpotFamily {
    Isotropic,
    Cosine,
    Linear,
}

/// A family with its free parameters: `[x, y, z] / distance`, then those of the spot (exponent/2;
/// or inner angle and width in rad), then ambient, then vignetting.
struct ParametricLight {
    family: Family,
    ambient: bool,
    vignetting: Vignetting,
    /// Positions are in units of this; also the reference distance.
    distance: f64,
    /// Start and prior mean of the offset, over `distance`.
    origin: [f64; 3],
    /// Start of the spot profile.
    spot: Spot,
    offset_sigma: f64,
    refractive_index: f64,
}

fn models(
    initial: Option<&LightModel>,
    median: f64,
    options: &LightFitOptions,
) -> Vec<ParametricLight> {
    use SpotFamily::{Cosine, Isotropic, Linear};
    let distance = initial.and_then(LightModel::reference_distance).unwrap_or(median);
    let origin = initial.and_then(LightModel::centre).unwrap_or_default() / distance;
    let origin = origin.coords.into();
    let spot = initial.map_or(Spot::Isotropic, LightModel::spot);
    let mut families = vec![Family::Fixed("collinear", LightModel::default())];
    families.extend(initial.map(|light| Family::Fixed("given", light.clone())));
    for offset in [false, true] {
        families.extend([Isotropic, Cosine, Linear].map(|spot| Family::Near { offset, spot }));
    }
    let vignettings = match options.vignetting {
        Vignetting::Estimated => vec![Vignetting::Known(0.0), Vignetting::Estimated],
        known => vec![known],
    };
    families
        .into_iter()
        .flat_map(|family| vignettings.iter().map(move |v| (family.clone(), *v)))
        .map(|(family, vignetting)| ParametricLight {
            family,
            ambient: options.ambient,
            vignetting,
            distance,
            origin,
            spot,
            offset_sigma: options.offset_sigma,
            refractive_index: options.refractive_index,
        })
        .collect()
}

impl ParametricLight {
    fn start(&self) -> Vec<f64> {
        let mut theta = Vec::new();
        if let Family::Near { offset, spot } = self.family {
            if offset {
                theta.extend(self.origin);
            }
            match (spot, self.spot) {
                (SpotFamily::Isotropic, _) => {}
                (SpotFamily::Cosine, Spot::CosinePower { exponent }) => theta.push(exponent / 2.0),
                (SpotFamily::Cosine, _) => theta.push(1.0),
                (SpotFamily::Linear, Spot::Linear { inner_deg, outer_deg }) => {
                    theta.extend([inner_deg.to_radians(), (outer_deg - inner_deg).to_radians()])
                }
                (SpotFamily::Linear, _) => theta.extend([0.2, 0.8]),
            }
        }
        if self.ambient {
            theta.push(0.02);
        }
        if self.vignetting == Vignetting::Estimated {
            theta.push(0.0);
        }
        theta
    }

    /// Light and coat at `theta`.
    fn decode(&self, theta: &[f64]) -> (LightModel, Coat) {
        let after = self.spot_range().end;
        let ambient = if self.ambient { theta[after] } else { 0.0 };
        let vignetting = match self.vignetting {
            Vignetting::Known(a) => a,
            Vignetting::Estimated => theta[theta.len() - 1],
        };
        let light = match &self.family {
            Family::Fixed(_, light) => light.clone(),
            Family::Near { offset, spot } => {
                let (position, rest) = if *offset { theta.split_at(3) } else { (&[][..], theta) };
                let place = match position {
                    [x, y, z] => Point3::new(*x, *y, *z) * self.distance,
                    _ => Point3::origin(),
                };
                let (positions, spot) = (vec![place], decode_spot(*spot, rest));
                PointLight { positions, reference_distance: self.distance, spot }.into()
            }
        };
        (light, Coat { refractive_index: self.refractive_index, ambient, vignetting })
    }

    fn name(&self) -> String {
        let free = self.vignetting == Vignetting::Estimated;
        let vignetting = if free { " + vignetting" } else { "" };
        let (place, spot) = match &self.family {
            Family::Fixed(name, _) => return format!("{name}{vignetting}"),
            Family::Near { offset: false, spot } => ("at the camera", spot),
            Family::Near { offset: true, spot } => ("offset", spot),
        };
        let profile = match spot {
            SpotFamily::Isotropic => "",
            SpotFamily::Cosine => " + cosine spot",
            SpotFamily::Linear => " + linear spot",
        };
        format!("{place}{profile}{vignetting}")
    }

    fn candidate(&self, fit: &LogFit, bic: f64) -> LightCandidate {
        let (light, coat) = self.decode(&fit.theta);
        LightCandidate {
            name: self.name(),
            light,
            ambient: coat.ambient,
            vignetting: coat.vignetting,
            relative_residual: fit.scale,
            parameters: fit.theta.len(),
            bic,
        }
    }

    fn spot_range(&self) -> std::ops::Range<usize> {
        let Family::Near { offset, spot } = self.family else { return 0..0 };
        let first = if offset { 3 } else { 0 };
        first..first + [0, 1, 2][spot as usize]
    }
}

fn decode_spot(family: SpotFamily, theta: &[f64]) -> Spot {
    match family {
        SpotFamily::Isotropic => Spot::Isotropic,
        SpotFamily::Cosine => Spot::CosinePower { exponent: 2.0 * theta[0] },
        SpotFamily::Linear => Spot::Linear {
            inner_deg: theta[0].to_degrees(),
            outer_deg: (theta[0] + theta[1]).to_degrees(),
        },
    }
}

impl ShadingModel for ParametricLight {
    type At = (LightModel, Coat);

    fn at(&self, theta: &[f64]) -> Self::At {
        self.decode(theta)
    }

    fn log_shading(&self, o: &Observation, (light, coat): &Self::At) -> f64 {
        coat.shade(light, &o.point, &o.normal).value.max(1e-4).ln()
    }

    fn steps(&self) -> Vec<f64> {
        vec![1e-4; self.start().len()]
    }

    fn priors(&self) -> Vec<(f64, f64)> {
        let start = self.start();
        let spot = self.spot_range();
        let ambient = self.ambient.then_some(spot.end);
        let sigma = |i: usize| match i {
            _ if spot.contains(&i) => 1.0,
            _ if i < spot.start => self.offset_sigma,
            _ if ambient == Some(i) => 0.05,
            _ => VIGNETTING_SIGMA,
        };
        let mean = |i: usize, s: f64| if ambient == Some(i) { 0.0 } else { s };
        start.iter().enumerate().map(|(i, &s)| (mean(i, s), sigma(i))).collect()
    }

    fn clamp(&self, theta: &mut [f64]) {
        let spot = self.spot_range();
        match spot.len() {
            1 => theta[spot.start] = theta[spot.start].clamp(0.0, 10.0),
            2 => {
                theta[spot.start] = theta[spot.start].clamp(0.0, 1.4);
                let widest = std::f64::consts::PI - theta[spot.start];
                theta[spot.start + 1] = theta[spot.start + 1].clamp(0.05, widest.min(2.5));
            }
            _ => {}
        }
        if self.ambient {
            theta[spot.end] = theta[spot.end].clamp(0.0, 1.0);
        }
        if let (Vignetting::Estimated, Some(a)) = (self.vignetting, theta.last_mut()) {
            *a = a.clamp(vignetting::BOUNDS[0], vignetting::BOUNDS[1]);
        }
    }
}

#[cfg(test)]
mod tests;
