//! Eq. 3 as the paper prints it:
//!
//! ```text
//! min  Σᵢ ‖Π(K v′(fᵢ) bᵢ) − W(uᵢ, vᵢ)‖     (motion)        over the matches
//!  V′  + λ₁ Σ_f ‖S_f − S⁰_f‖²              (shearing)      over the faces
//!      + λ₂ Σ_f ‖A_f − A⁰_f‖²              (anisotropy)    over the faces
//!      + λ₃ ‖Δ V′‖²                        (smoothing)
//! ```
//!
//! The paper leaves open: what `S` and `A` are ([`Shearing`], [`Anisotropy`]), with `S⁰ = A⁰ = 0`
//! for the rest shape; that λ₁ = λ₂ (`prior.conformal`); and the units, which weights of any organ
//! need: motion in standard deviations of a match, faces and vertices by their share of the visible
//! area.

use super::correspondence::Match;
use super::objective::hold;
use super::solve::{STEPS, TOLERANCE, expected_displacement};
use super::{Posed, RegisterOptions, Registered, Scene};
use crate::energy::{Anisotropy, Objective, Shearing, Smoothing, Unknowns};
use crate::solver::Loss::{Norm, Squared};
use crate::solver::Options;

/// The four lines of eq. 3.
fn objective<'a>(scene: &'a Scene, matches: &[Match], options: &RegisterOptions) -> Objective<'a> {
    let (rest, laplacian, area) = (scene.faces(), &*scene.laplacian, scene.visible_area);
    let motion = scene.motion(matches, options.match_sigma_px);
    let (lambda_1, lambda_2) = (options.prior.conformal, options.prior.conformal);
    let lambda_3 = options.prior.smoothing;
    Objective::over(scene.posed.len(), 0)
        .plus("motion (eq. 3)", 1.0, Norm, motion)
        .plus("shearing (eq. 3)", lambda_1, Squared, Shearing { rest })
        .plus("anisotropy (eq. 3)", lambda_2, Squared, Anisotropy { rest })
        .plus("smoothing (eq. 3)", lambda_3, Squared, Smoothing::of_position(laplacian, area))
}

/// Solve eq. 3 as printed, from the rigid pose.
#[doc(alias("eq. 3", "literal"))]
pub fn register_printed(
    scene: &Scene,
    matches: &[Match],
    posed: &Posed,
    options: &RegisterOptions,
) -> Registered {
    let start = Unknowns { vertices: scene.posed.clone(), globals: Vec::new() };
    let solver = Options { max_steps: STEPS, cost_tolerance: TOLERANCE, ..Options::default() };
    let (found, summary) = objective(scene, matches, options).minimise(start, &solver);
    // Of no use to the printed forms, but a surface comes with it.
    let depth_sigma = hold(scene, options).hypot(expected_displacement(scene, posed, options));
    Registered::of(scene, matches, found.vertices, depth_sigma, summary, options)
}
