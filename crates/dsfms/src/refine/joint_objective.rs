//! Beyond the paper: motion and shading in one problem.
//!
//! ```text
//! min   Σᵢ ρ_m(‖π(xᵢ) − wᵢ‖²)                     motion             matches i: surface point xᵢ, pixel wᵢ
//!  V, g + λ₁ Σ_f A_f/A ρ_s(b_f²)                  shearing           faces f: b = C₁₂ / √det C
//!      + λ₁ Σ_f A_f/A ρ_s(a_f²)                   anisotropy         a = (C₁₁ − C₂₂) / (2 √det C)
//!      + λₛ Σ_f A_f/A ρ_s(s_f²)                   stretch            s = ½ ln det C
//!      + λ_c/c Σₖ H(dₖ² / σ_c²)                   silhouette         c points of the contour, dₖ from the outline, px
//!      + λ_h/n Σᵥ ρ_h(‖L × N‖² / σ_l²)            highlights         saturated vertices; n vertices are seen
//!      + λ₃ R² Σᵥ Aᵥ/A ‖Lap(x − x₀)ᵥ‖²            smoothing
//!      + λ_p/p Σⱼ ρ_p(rⱼ²)                        shading            p samples: r = (w·I − (γ g w·α (L·N + s₀) + w·a)) / σ
//!      + Σᵢ H((zᵢ − z₀ᵢ)² / σᵢ²)                  depth prior        σᵢ: `depth_prior.rs`
//!      + λₕ Σᵥ Aᵥ/A ‖xᵥ − hᵥ‖² / σₕ²              hidden side        vertices that are not seen of x₀; h: `x₀`, or where
//!                                                                 the volume behind the surface carries them
//!      + (ln g − ln g₀)² / σ_g² + a² / σ_a²       gain and ambient light of the frame
//!      + Σₖ γₖ² / σ_γ²                            smooth gain        nodes k of the field γ: `field.rs`
//! ```
//!
//! `x₀` is the rest shape posed by the matches, and again by the shape found under a near light;
//! `A`, `R`, `A_f`, `Aᵥ`, `C` and `Lap` are those of eq. 3 ([`register`](crate::register)). `I` is
//! the linear image and `α` the albedo, both smoothed by the blur of the stage, `s₀` what the blur
//! adds to the shading in the fine stages, `w` weights of the channels in which glare cancels.
//! Losses: ρ Geman-McClure of the scales `match_px`, `strain`, 2, and `robust`; H Huber's from 2
//! (silhouette) and 1.
//!
//! A match that is off by 1 px costs 1 (at 640 × 480 px), and so does a strain `1/√λ₁` of all that
//! is seen, a depth off by its tolerance, a gain off by its spread. λ_p, λ_c and λ_h count samples,
//! contour points and vertices of an image as one, whatever the mesh: samples that are all off by
//! their noise σ cost like λ_p matches that are off by 1 px.
//!
//! λ₁ = `prior.conformal`, λₛ = `prior.stretch`, λ₃ = `prior.smoothing`, λₕ = `prior.hidden`, λ_c =
//! `outline`, λ_h = `highlights`, λ_p = `shading`.
//! The isometric and as-rigid-as-possible priors take the place of shearing, anisotropy and
//! stretch.

use super::cues::Cues;
use super::gain::GainPrior;
use super::joint_options::JointOptions;
use crate::camera::CameraModel;
use crate::energy::{
    Anisotropy, Boundary, EnergyTerm, GlobalsPrior, Isometric, Objective, Photometric, Shearing,
    Smoothing, Stretch,
};
use crate::geometry::Point3;
use crate::light::Coated;
use crate::register::{Match, Prior, Scene};
use crate::solver::Loss::{GemanMcClure, Huber, Squared};

/// Scale of Huber's loss of the silhouette, in standard deviations of the outline: what lies
/// further is a mask drawn elsewhere.
const OUTLINE_SCALE: f64 = 2.0;

/// Scale of the loss of highlights, in widths of the lobe: a saturated vertex further from the
/// mirror direction shines for another reason.
const HIGHLIGHT_SCALE: f64 = 2.0;

/// What one stage of the joint solve knows.
#[derive(Clone, Copy)]
pub(super) struct JointProblem<'a, 'p> {
    pub(super) scene: &'a Scene<'a>,
    pub(super) matches: &'p [Match],
    /// Scale of the loss of the matches, px.
    pub(super) match_px: f64,
    /// The depth of the matches.
    pub(super) depth: &'p Boundary,
    pub(super) shading: &'p Photometric<'a, CameraModel, Coated>,
    /// Where what is not seen is expected.
    pub(super) hidden: &'p [Point3],
    /// Outline and highlights, where they are looked at.
    pub(super) cues: Option<&'p Cues<'a>>,
    pub(super) gain: GainPrior,
    /// Nodes of the field of smooth gain.
    pub(super) nodes: usize,
    pub(super) options: &'p JointOptions,
}

impl<'a> JointProblem<'a, '_> {
    /// All rows of the joint cost; the globals are the log gain, the ambient light, and the nodes
    /// of the smooth gain.
    pub(super) fn objective(&self) -> Objective<'a> {
        let Self { scene, matches, match_px, gain, options, .. } = *self;
        let (rest, posed) = (scene.faces(), &scene.posed);
        let strain = GemanMcClure(options.strain);
        let prior = &options.prior;
        let smoothing = Smoothing::of_displacement(&scene.laplacian, posed, scene.visible_area);
        let contour = self.cues.and_then(|cues| cues.contour.clone());
        let highlights = self.cues.and_then(|cues| cues.highlights.clone());
        let [points, seen] = self.cues.map_or([0, 0], |cues| cues.counts());
        let of = |weight: f64, count: usize| weight / count.max(1) as f64;
        let lambda_c = of(options.outline, points);
        let lambda_h = of(options.highlights, seen);
        let lambda_p = of(options.shading, self.shading.count());
        let log_gain = GlobalsPrior::of(0, gain.expected, gain.sigma);
        let ambient = GlobalsPrior::of(1, 0.0, gain.ambient_sigma);
        let nodes = (2..2 + self.nodes).map(|k| [k]).collect();
        let smooth_gain = GlobalsPrior { indices: nodes, mean: 0.0, sigma: options.smooth_gain };
        Objective::over(posed.len(), 2 + self.nodes)
            .plus("motion", 1.0, GemanMcClure(match_px), scene.motion(matches, 1.0))
            .plus("shearing", prior.of(Prior::Conformal), strain, Shearing { rest })
            .plus("anisotropy", prior.of(Prior::Conformal), strain, Anisotropy { rest })
            .plus("stretch", prior.stretch(), strain, Stretch { rest })
            .plus("isometric prior", prior.of(Prior::Isometric), strain, Isometric { rest })
            .plus_if(
                "as-rigid-as-possible prior",
                prior.of(Prior::Arap),
                strain,
                scene.arap(prior.kind),
            )
            .plus_if("silhouette", lambda_c, Huber(OUTLINE_SCALE), contour)
            .plus_if("highlights", lambda_h, GemanMcClure(HIGHLIGHT_SCALE), highlights)
            .plus("smoothing", prior.smoothing, Squared, smoothing)
            .plus("shading", lambda_p, GemanMcClure(options.robust), self.shading.clone())
            .plus("depth prior", 1.0, Huber(1.0), self.depth.clone())
            .plus("hidden side", prior.hidden, Squared, scene.hidden(&scene.visible, self.hidden))
            .plus("gain prior", 1.0, Squared, log_gain)
            .plus("ambient light prior", 1.0, Squared, ambient)
            .plus("smooth gain prior", 1.0, Squared, smooth_gain)
    }
}
