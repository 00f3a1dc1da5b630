//! Eq. 4 as the paper prints it:
//!
//! ```text
//! min  Σᵢ ‖(0 0 1) v″(fᵢ) bᵢ − (0 0 1) v′(fᵢ) bᵢ‖    (boundary condition)   over the matches
//!  V″  + λ₄ Σᵥ ‖Π(K v″ᵥ) − Π(K v′ᵥ)‖²                (reprojection)         over the vertices
//!      + λ₅ Σᵥ ‖I′(W″(uᵥ)) − α(uᵥ) L·N″(uᵥ)‖²        (diffuse vertices)
//!      + λ₆ Σᵥ ‖L × N″(uᵥ)‖²                         (specular vertices)
//!      + λ₇ ‖Δ V″‖²                                  (smoothing)
//! ```
//!
//! The paper leaves open the units, which weights of any organ need: depth in tolerances of the
//! visible radius, brightness in noise of the image, λ₄ to λ₆ shared by the vertices that are seen.
//! It has no exposure: gain 1 and no ambient light.

use super::RefineOptions;
use super::evidence::{ShadingEvidence, gather_on};
use super::photograph::Photograph;
use super::solve::{Refined, solver};
use crate::energy::{
    Diffuse, GlobalsPrior, Objective, Reprojection, Smoothing, Specular, Unknowns,
};
use crate::geometry::Point3;
use crate::register::{Body, Match, Scene};
use crate::solver::Loss::{Norm, Squared};

/// Spread that holds gain and ambient light at 1 and 0.
const FIXED: f64 = 1e-6;

/// The five lines of eq. 4.
fn objective<'a>(
    scene: &'a Scene,
    coarse: &[Point3],
    matches: &[Match],
    photo: &Photograph<'a>,
    evidence: &'a ShadingEvidence,
    options: &RefineOptions,
) -> Objective<'a> {
    let (topology, laplacian) = (&scene.rest.topology, &*scene.laplacian);
    let depth_sigma = options.depth_hold * scene.radius();
    let boundary = scene.depth_of(matches, coarse, vec![depth_sigma; matches.len()]);
    let reprojection = Reprojection::at(scene.camera, coarse, evidence.seen());
    let diffuse =
        Diffuse::new(photo.camera, photo.light, &evidence.image, topology, &evidence.diffuse);
    let specular = Specular::new(topology, &evidence.specular, 1.0);
    let smoothing = Smoothing::of_position(laplacian, scene.visible_area);
    let [lambda_4, lambda_5, lambda_6] = [options.lambda_4, options.lambda_5, options.lambda_6]
        .map(|lambda| lambda / evidence.seen_count() as f64);
    Objective::over(coarse.len(), 2)
        .plus("boundary condition (eq. 4)", 1.0, Norm, boundary)
        .plus("reprojection (eq. 4)", lambda_4, Squared, reprojection)
        .plus("diffuse (eq. 4)", lambda_5, Squared, diffuse)
        .plus("specular (eq. 4)", lambda_6, Squared, specular)
        .plus("smoothing (eq. 4)", options.lambda_7, Squared, smoothing)
        .plus("gain = 1", 1.0, Squared, GlobalsPrior::of(0, 0.0, FIXED))
        .plus("ambient light = 0", 1.0, Squared, GlobalsPrior::of(1, 0.0, FIXED))
}

/// Solve eq. 4 as printed, from the coarse shape V′; nothing but saturated vertices is left out of
/// the diffuse ones.
#[doc(alias("eq. 4", "literal"))]
pub fn refine_printed(
    body: &Body,
    coarse: &[Point3],
    matches: &[Match],
    photo: &Photograph,
    options: &RefineOptions,
) -> Refined {
    let evidence = gather_on(body, coarse, photo, &options.as_printed());
    let objective = objective(body.scene(), coarse, matches, photo, &evidence, options);
    let start = Unknowns { vertices: coarse.to_vec(), globals: vec![0.0, 0.0] };
    let (found, summary) = objective.minimise(start, &solver());
    Refined::of(found, &evidence, summary)
}
