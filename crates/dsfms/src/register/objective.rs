//! Eq. 3 as it is solved: the four lines of the paper, repaired, and three that it lacks.
//!
//! ```text
//! min  Σᵢ ρ(‖π(xᵢ) − wᵢ‖² / σ²)                motion        matches i: surface point xᵢ, pixel wᵢ
//!  V′  + λ₁ Σ_f A_f/A b_f²                     shearing      faces f: b = C₁₂ / √det C
//!      + λ₂ Σ_f A_f/A a_f²                     anisotropy    a = (C₁₁ − C₂₂) / (2 √det C)
//!      + λₛ Σ_f A_f/A s_f²                     stretch       s = ½ ln det C: the scale
//!      + λ₃′ R² Σᵥ Aᵥ/A ‖Lap(x − x₀)ᵥ‖²        smoothing     1/λ₃′ = 1/λ₃ + (8 d/R)²
//!      + Σᵢ H((zᵢ − z₀ᵢ)² / σ_z²)              depth prior   σ_z² = (h R)² + d²
//!      + λₕ Σᵥ Aᵥ/A ‖xᵥ − x₀ᵥ‖² / σₕ²          hidden side   vertices that are not seen of x₀
//! ```
//!
//! `x₀` is the rest shape posed by the matches, `A` its visible area, `R = √(A/π)`, `A_f` and `Aᵥ`
//! the areas of a face and of a vertex, `C = FᵀF` the metric of a face against rest, `d` the
//! displacement that matches share and the pose does not explain (length; 0 before a camera at
//! rest). ρ is the Geman-McClure loss, annealed; H Huber's.
//!
//! A match that is off by its noise σ costs 1, so `λ = 1/s²` says that a strain `s` of all that is
//! seen costs as much. λ₁ = λ₂ = `prior.conformal`, λₛ = `prior.stretch`, λ₃ = `prior.smoothing`,
//! λₕ = `prior.hidden`, h = `depth_hold`. The
//! isometric and as-rigid-as-possible priors take the place of shearing, anisotropy and stretch.

use super::correspondence::Match;
use super::{Prior, RegisterOptions, Scene};
use crate::energy::{Anisotropy, Isometric, Objective, Shearing, Smoothing, Stretch, Unknowns};
use crate::geometry::Point3;
use crate::solver::Loss::{self, GemanMcClure, Huber, Squared};
use crate::solver::Problem;

/// Eq. 3 on one mesh.
pub(super) struct MotionProblem<'a> {
    pub(super) scene: &'a Scene<'a>,
    pub(super) matches: &'a [Match],
    /// `d`: how far the surface is expected to move, length units.
    pub(super) displacement: f64,
    pub(super) options: &'a RegisterOptions,
}

impl MotionProblem<'_> {
    /// The lines of eq. 3, with a loss of the annealing.
    pub(super) fn objective(&self, loss: Loss) -> Objective<'_> {
        let Self { scene, matches, displacement, options } = *self;
        let posed = &scene.posed;
        let smoothing = Smoothing::of_displacement(&scene.laplacian, posed, scene.visible_area);
        let depth_sigma = hold(scene, options).hypot(displacement);
        let depth = scene.depth_of(matches, posed, vec![depth_sigma; matches.len()]);
        let hidden = scene.hidden(&scene.visible, posed);
        self.motion_and_strain(loss)
            .plus("smoothing (eq. 3)", self.smoothing_weight(), Squared, smoothing)
            .plus("depth prior", 1.0, Huber(1.0), depth)
            .plus("hidden side", options.prior.hidden, Squared, hidden)
    }

    /// The lines that know nothing of a pose.
    fn motion_and_strain(&self, loss: Loss) -> Objective<'_> {
        let Self { scene, matches, options, .. } = *self;
        let (rest, prior) = (scene.faces(), &options.prior);
        let motion = scene.motion(matches, options.match_sigma_px);
        Objective::over(scene.posed.len(), 0)
            .plus("motion (eq. 3)", 1.0, loss, motion)
            .plus("shearing (eq. 3)", prior.of(Prior::Conformal), Squared, Shearing { rest })
            .plus("anisotropy (eq. 3)", prior.of(Prior::Conformal), Squared, Anisotropy { rest })
            .plus("stretch", prior.stretch(), Squared, Stretch { rest })
            .plus("isometric prior", prior.of(Prior::Isometric), Squared, Isometric { rest })
            .plus_if(
                "as-rigid-as-possible prior",
                prior.of(Prior::Arap),
                Squared,
                scene.arap(prior.kind),
            )
    }

    /// What a shape leaves of matches and strain, by which shapes from different starts are
    /// compared.
    pub(super) fn left(&self, shape: &[Point3]) -> f64 {
        let loss = GemanMcClure(self.options.robust_px[1] / self.options.match_sigma_px);
        let state = Unknowns { vertices: shape.to_vec(), globals: Vec::new() };
        let costs = self.motion_and_strain(loss).costs(&state);
        costs.map_or(f64::INFINITY, |costs| costs.iter().sum())
    }

    /// λ₃′: a disc of radius 1 that bulges by `d` has a Laplacian of `8 d` (up to its profile),
    /// whose expectation the weight should not contradict.
    fn smoothing_weight(&self) -> f64 {
        let Self { scene, displacement, options, .. } = self;
        let contradiction = (8.0 * (displacement / scene.radius())).powi(2);
        let smoothing = options.prior.smoothing;
        smoothing / (1.0 + smoothing * contradiction)
    }
}

/// `h R`: the tolerance of the depth prior where the pose explains the matches, length units.
pub(super) fn hold(scene: &Scene, options: &RegisterOptions) -> f64 {
    options.depth_hold * scene.radius()
}
