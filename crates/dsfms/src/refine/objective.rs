//! Eq. 4 as it is solved: the five lines of the paper, repaired, and three that it lacks.
//!
//! ```text
//! min  Σᵢ ((zᵢ − z′ᵢ) / σ_z)²                     boundary condition   matches i; ′: on V′
//!  V″  + λ₄/n Σᵥ ‖π(xᵥ) − π(x′ᵥ)‖²                reprojection         the n vertices v that are seen, px²
//!      + λ₅/n Σᵥ H(rᵥ²)                           diffuse              r = (w·I − (g w·α L·N + w·a)) / σ
//!      + λ₆/n Σᵥ ‖L × N‖²                         specular             saturated vertices
//!      + λ₇ R² Σᵥ Aᵥ/A ‖Lap(x − x′)ᵥ‖²            smoothing
//!      + λₕ Σᵥ Aᵥ/A ‖xᵥ − x′ᵥ‖² / σₕ²             hidden side          vertices that are not seen
//!      + (ln g − ln g₀)² / σ_g² + a² / σ_a²       gain and ambient light of the frame
//! ```
//!
//! `A`, `R`, `Aᵥ` and `Lap` as in eq. 3 ([`register`](crate::register)). `I` is the linear image
//! smoothed, `α` the albedo of the template smoothed alike, `w` weights of the channels in which
//! glare cancels, `g` the gain and `a` the ambient light; σ is measured on V′. A depth that is off
//! by its tolerance σ_z costs 1; λ₄, λ₅ and λ₆ weigh a mean over what is seen, whatever the mesh;
//! λₕ = `hidden`.

use super::RefineOptions;
use super::evidence::ShadingEvidence;
use super::gain::GainPrior;
use super::photograph::Photograph;
use crate::energy::{Diffuse, GlobalsPrior, Objective, Reprojection, Smoothing, Specular};
use crate::geometry::Point3;
use crate::register::{Match, Scene};
use crate::solver::Loss::{Huber, Squared};

/// The lines of eq. 4; the globals are the log gain and the ambient light.
pub(super) fn objective<'a>(
    scene: &'a Scene,
    coarse: &[Point3],
    matches: &[Match],
    photo: &Photograph<'a>,
    evidence: &'a ShadingEvidence,
    gain: GainPrior,
    options: &RefineOptions,
) -> Objective<'a> {
    let (topology, visible) = (&scene.rest.topology, &evidence.visible);
    let of_seen = |lambda: f64| lambda / evidence.seen_count() as f64;
    // Brightness tells the distance from a near light as well as the exposure is known.
    let near = photo.light.light.tells_distance();
    let slack = if near { gain.slack(options.image.gain_sigma) } else { 1.0 };
    let depth_sigma = slack * options.depth_hold * scene.radius();
    let boundary = scene.depth_of(matches, coarse, vec![depth_sigma; matches.len()]);
    let reprojection = Reprojection::at(scene.camera, coarse, evidence.seen());
    let diffuse =
        Diffuse::new(photo.camera, photo.light, &evidence.image, topology, &evidence.diffuse);
    let specular = Specular::new(topology, &evidence.specular, 1.0);
    let smoothing = Smoothing::of_displacement(&scene.laplacian, coarse, scene.visible_area);
    let log_gain = GlobalsPrior::of(0, gain.expected, gain.sigma);
    let ambient = GlobalsPrior::of(1, 0.0, gain.ambient_sigma);
    Objective::over(coarse.len(), 2)
        .plus("boundary condition (eq. 4)", 1.0, Squared, boundary)
        .plus("reprojection (eq. 4)", of_seen(options.lambda_4), Squared, reprojection)
        .plus("diffuse (eq. 4)", of_seen(options.lambda_5), Huber(options.huber), diffuse)
        .plus("specular (eq. 4)", of_seen(options.lambda_6), Squared, specular)
        .plus("smoothing (eq. 4)", options.lambda_7, Squared, smoothing)
        .plus("hidden side", options.hidden, Squared, scene.hidden(visible, coarse))
        .plus("gain prior", 1.0, Squared, log_gain)
        .plus("ambient light prior", 1.0, Squared, ambient)
}
