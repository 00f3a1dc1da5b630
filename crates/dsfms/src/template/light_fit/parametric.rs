//! The lights that are tried: families with their free parameters.

use super::super::log_linear::{LogFit, ShadingModel};
use super::super::photometric::SpotObservation;
use super::candidate::LightCandidate;
use super::options::{LightFitOptions, Vignetting};
use crate::geometry::Point3;
use crate::light::{Coat, LightModel, PointLight, Spot, vignetting};

/// Prior standard deviation of the vignetting.
const VIGNETTING_SIGMA: f64 = 0.5;

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
pub(super) struct ParametricLight {
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

pub(super) fn models(
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
    pub(super) fn start(&self) -> Vec<f64> {
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

    pub(super) fn candidate(&self, fit: &LogFit, bic: f64) -> LightCandidate {
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

    fn log_shading(&self, o: &SpotObservation, (light, coat): &Self::At) -> f64 {
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
