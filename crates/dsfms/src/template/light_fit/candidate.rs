//! One light that was tried.

use crate::light::LightModel;
use serde::{Deserialize, Serialize};

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
