//! Exposure gains under a known light.

use super::albedo_options::AlbedoOptions;
use super::log_linear::{LogLinear, ShadingModel};
use super::photometric::{AlbedoView, SpotObservation};
use super::spots::{SurfaceSpot, repeated};
use crate::geometry::{Point3, Vector3};
use crate::light::{LightModel, Shade};

/// A known light: nothing but gains to solve for.
#[derive(Clone, Copy)]
pub(super) struct KnownLight<'a> {
    pub light: &'a LightModel,
    pub options: &'a AlbedoOptions,
}

impl KnownLight<'_> {
    pub(super) fn shade(&self, o: &SpotObservation) -> f64 {
        self.shade_of(&o.point, &o.normal).value
    }

    /// Point and normal in camera axes.
    pub(super) fn shade_of(&self, point: &Point3, normal: &Vector3) -> Shade {
        self.options.coat().shade(self.light, point, normal)
    }
}

impl ShadingModel for KnownLight<'_> {
    type At = ();

    fn at(&self, _: &[f64]) -> Self::At {}

    fn log_shading(&self, o: &SpotObservation, (): &Self::At) -> f64 {
        self.shade(o).max(1e-6).ln()
    }

    fn steps(&self) -> Vec<f64> {
        Vec::new()
    }

    fn priors(&self) -> Vec<(f64, f64)> {
        Vec::new()
    }
}

/// What a known light leaves open.
pub(super) struct FittedExposure {
    /// One a view, geometric mean 1.
    pub gains: Vec<f64>,
    /// Robust relative standard deviation of one observation.
    pub noise: f64,
}

impl FittedExposure {
    pub(super) fn solve(spots: &[SurfaceSpot], views: &[AlbedoView], model: &KnownLight) -> Self {
        let sigma = model.options.gain_sigma;
        let gain_priors = views.iter().map(|v| (v.gain.max(1e-6).ln(), sigma)).collect();
        let fit = LogLinear { model, spots: &repeated(spots), gain_priors }.solve(&[]);
        Self { gains: centred_gains(&fit.log_gains), noise: fit.scale }
    }
}

/// Gains of geometric mean 1.
pub(super) fn centred_gains(log_gains: &[f64]) -> Vec<f64> {
    let mean = log_gains.iter().sum::<f64>() / log_gains.len().max(1) as f64;
    log_gains.iter().map(|g| (g - mean).exp()).collect()
}
