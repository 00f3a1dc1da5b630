//! Weights of eq. 3, and of what the surface keeps of its rest shape in every solve.

use crate::options::{OptionError, check, from_zero, positive};
use serde::{Deserialize, Serialize};

/// What the surface is expected to keep of its rest shape.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Prior {
    /// Angles (the paper): shearing and anisotropy, with the weak stretch prior for scale.
    #[default]
    Conformal,
    /// Lengths: the metric of every face.
    Isometric,
    /// Lengths and the shape of every vertex's ring: as rigid as possible.
    Arap,
}

/// Where the camera is, beside what the matches say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraMotion {
    /// Its pose is that of the matches.
    Moving,
    /// Where a quarter of the matches does not move from a view of the exploration, or from where
    /// what lies around the organ shows the camera, while others do, the camera is there; else its
    /// pose is that of the matches.
    #[default]
    Auto,
    /// It stands where it stood in one of the views of the exploration.
    AtRest,
}

/// What the surface keeps of its rest shape, and how firmly. A weight is `1/s²`: a strain `s` of
/// all that is seen costs as much as one match that is off by its noise. Chosen on the synthetic
/// series and the `choose` scenes (`docs/results/ablation`, `docs/results/scenes.md`); other values
/// of `hidden` are not measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PriorWeights {
    /// What is kept: conformal (angles, the paper), isometric (lengths), or arap (as rigid as
    /// possible).
    pub kind: Prior,
    /// λ₁ and λ₂ of eq. 3: weight of shearing and anisotropy per visible area. The isometric and
    /// as-rigid-as-possible priors take it for all their strain: at small strain they are the
    /// conformal prior with `stretch` raised to this weight.
    pub conformal: f64,
    /// Weight of the log area ratio per visible area; fixes the scale, which conformality does not.
    /// Unused by the other priors, which fix it themselves.
    pub stretch: f64,
    /// λ₃ of eq. 3: weight of the Laplacian of the displacement from the posed template; in eq. 3
    /// less where matches tell that the surface bends as a whole.
    pub smoothing: f64,
    /// Weight that holds vertices that are not seen to the rigid pose, per visible area, within a
    /// twenty-fifth of the visible radius.
    pub hidden: f64,
}

impl Default for PriorWeights {
    fn default() -> Self {
        let kind = Prior::Conformal;
        Self { kind, conformal: 3e4, stretch: 3e3, smoothing: 100.0, hidden: 3.0 }
    }
}

impl PriorWeights {
    /// The weight of strain where a prior is the one asked for, else 0.
    pub fn of(&self, kind: Prior) -> f64 {
        if self.kind == kind { self.conformal } else { 0.0 }
    }

    /// The weight of stretch: the conformal prior's alone.
    pub fn stretch(&self) -> f64 {
        if self.kind == Prior::Conformal { self.stretch } else { 0.0 }
    }

    /// Whether every weight is a number from 0.
    pub(crate) fn is_valid(&self) -> bool {
        from_zero(&[self.conformal, self.stretch, self.smoothing, self.hidden])
    }
}

/// Options of the rigid pose and of eq. 3. Lengths are relative, so they hold in any unit.
///
/// Measured: no annealing of `robust_px` and no `depth_hold` at all (`docs/results/ablation`),
/// `anchor` (`docs/results/choices.md`). Other values of `match_sigma_px`, `robust_px`,
/// `depth_hold` and `depth_hold_motion` are not measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RegisterOptions {
    /// What the surface keeps.
    pub prior: PriorWeights,
    /// Where the camera is ([`posed_from`](super::posed_from)).
    pub camera_motion: CameraMotion,
    /// Noise of the matches, px.
    pub match_sigma_px: f64,
    /// Geman-McClure scale at the start and at the end of the annealing, px.
    pub robust_px: [f64; 2],
    /// Depth of the matches is held to the rigid pose within this fraction of the radius of the
    /// visible surface (the radius of a disc of its area), when the pose explains them perfectly.
    pub depth_hold: f64,
    /// Expected motion in depth for the motion that neighbouring matches share in the image and the
    /// pose does not explain: bending is seen foreshortened.
    pub depth_hold_motion: f64,
    /// How firmly the hidden side hangs on its surroundings, of the stiffness of
    /// tissue as thick as the organ; what is seen carries it along. Bends ask for less, pushes for
    /// more; 0.03 lies between (figures: `docs/results/choices.md`).
    pub anchor: f64,
}

impl Default for RegisterOptions {
    fn default() -> Self {
        Self {
            prior: PriorWeights::default(),
            camera_motion: CameraMotion::default(),
            match_sigma_px: 1.0,
            robust_px: [60.0, 4.0],
            depth_hold: 0.04,
            depth_hold_motion: 3.0,
            anchor: 0.03,
        }
    }
}

impl RegisterOptions {
    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), OptionError> {
        let [coarse, fine] = self.robust_px;
        check(&[
            (
                "register.prior.conformal, stretch, smoothing, hidden",
                self.prior.is_valid(),
                "0 or more",
            ),
            ("register.match_sigma_px", positive(&[self.match_sigma_px]), "positive"),
            (
                "register.robust_px",
                positive(&[coarse, fine]) && fine <= coarse,
                "two positive numbers, the second no larger than the first",
            ),
            ("register.depth_hold", positive(&[self.depth_hold]), "positive"),
            (
                "register.depth_hold_motion, anchor",
                from_zero(&[self.depth_hold_motion, self.anchor]),
                "0 or more",
            ),
        ])
    }
}
