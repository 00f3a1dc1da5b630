//! Whether a surface can be believed: one verdict for single frames and videos.
//!
//! Stages gather [`Evidence`], [`judge`] holds it against [`Thresholds`] and names every
//! [`Reason`]. What is not known (`None`) does not speak. The reasons are figures, and print as
//! sentences. Four questions: what the matches leave open ([`observability`]), whether the image
//! shows what the surface predicts (`look`), of which parts nothing is known ([`mod@regions`]),
//! and whether the camera is the template's ([`intrinsics`]).

pub mod evidence;
pub mod intrinsics;
pub(crate) mod look;
pub mod observability;
pub mod reason;
pub mod regions;
pub mod strain;
pub mod thresholds;

use crate::template::usual::Appearance;
pub use evidence::{Evidence, MatchCount};
pub(crate) use look::{Compared, ImageAgreement, TileVerdict, look};
pub use reason::{NoSurface, Part, Reason};
pub use regions::Region;
pub(crate) use regions::regions;
use serde::{Deserialize, Serialize};
pub use thresholds::Thresholds;

/// How far a surface can be believed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// Nothing speaks against it.
    #[default]
    Ok,
    /// A surface with named reservations.
    Degraded,
    /// No surface, or one that must not be shown.
    Lost,
}

impl Level {
    /// As written in files.
    pub fn label(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Degraded => "degraded",
            Self::Lost => "lost",
        }
    }
}

/// How far a surface can be believed, and why not further.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// The worst that any reason asks for.
    pub level: Level,
    /// Most serious first; empty where nothing speaks against the surface.
    pub reasons: Vec<Reason>,
}

/// All reasons in one line; empty where nothing speaks against the surface.
impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let reasons: Vec<String> = self.reasons.iter().map(Reason::to_string).collect();
        f.write_str(&reasons.join("; "))
    }
}

impl Verdict {
    /// Add a doubt.
    pub fn object(&mut self, level: Level, reason: Reason) {
        match level > self.level {
            true => self.reasons.insert(0, reason),
            false => self.reasons.push(reason),
        }
        self.level = self.level.max(level);
    }

    fn degrade_if(&mut self, doubt: bool, reason: Reason) {
        if doubt {
            self.object(Level::Degraded, reason);
        }
    }

    /// Degraded above a limit, and where either is NaN.
    fn degrade_above(&mut self, value: f64, limit: f64, reason: Reason) {
        self.degrade_if(value.is_nan() || limit.is_nan() || value > limit, reason);
    }

    /// Lost below the first limit, degraded below the second; NaN is below everything.
    fn least(&mut self, value: f64, [lost, degraded]: [f64; 2], reason: Reason) {
        let below = |limit: f64| value.is_nan() || value < limit;
        if below(lost.max(degraded)) {
            self.object(if below(lost) { Level::Lost } else { Level::Degraded }, reason);
        }
    }

    /// Lost above the first limit, degraded above the second.
    fn most(&mut self, value: f64, [lost, degraded]: [f64; 2], reason: Reason) {
        self.least(-value, [-lost, -degraded], reason);
    }
}

/// Hold evidence against thresholds.
pub fn judge(evidence: &Evidence, limits: &Thresholds) -> Verdict {
    let mut verdict = Verdict::default();
    if !evidence.finite {
        verdict.object(Level::Lost, Reason::NotFinite);
        return verdict;
    }
    if evidence.visible == 0 {
        verdict.object(Level::Lost, Reason::NothingVisible);
        return verdict;
    }
    matches(&mut verdict, evidence, limits);
    place(&mut verdict, evidence, limits);
    appearance(&mut verdict, evidence, limits);
    parts(&mut verdict, evidence, limits);
    shape(&mut verdict, evidence, limits);
    verdict
}

fn matches(verdict: &mut Verdict, evidence: &Evidence, limits: &Thresholds) {
    let MatchCount { total, kept, distinct, distinct_kept, given } = evidence.matches;
    let [lost, wanted] = if given { limits.given } else { limits.matches };
    let few = Reason::FewMatches { kept: distinct_kept, wanted };
    verdict.least(distinct_kept as f64, [lost as f64, wanted as f64], few);
    let repeated = given && (distinct as f64) < limits.distinct * total as f64;
    verdict.degrade_if(repeated, Reason::RepeatedMatches { distinct, total });
    let disagree = (kept as f64) < limits.kept[usize::from(given)] * total as f64;
    verdict.degrade_if(disagree, Reason::MatchesDisagree { kept, total });
    if let (Some(px), false) = (evidence.residual_px, given) {
        verdict.degrade_above(px, limits.residual_px, Reason::Residual { px });
    }
}

/// Pose, depth and camera.
fn place(verdict: &mut Verdict, evidence: &Evidence, limits: &Thresholds) {
    if let Some(pose) = evidence.pose {
        let share = pose.length / evidence.radius;
        let (length, degrees) = (pose.length, pose.degrees);
        verdict.most(share, limits.pose, Reason::PoseUncertain { length, degrees, share });
    }
    if let Some((depth, usual)) = evidence.depth {
        let beyond = (depth / usual[1]).max(usual[0] / depth.max(f64::MIN_POSITIVE));
        verdict.most(beyond, limits.depth, Reason::Depth { depth, usual });
    }
    if let Some([px, diagonal]) = evidence.extent_px {
        verdict.least(px / diagonal, limits.tiny, Reason::Tiny { px });
    }
    if let Some([px, width]) = evidence.rigid_px {
        verdict.degrade_above(px, limits.rigid * width, Reason::FarFromRigid { px });
    }
    if let Some(share) = evidence.depth_uncertainty {
        let reason = Reason::DepthUncertain { share };
        verdict.degrade_above(share, limits.depth_uncertainty, reason);
    }
    if let Some((apart_px, [given_px, own_px])) = evidence.camera {
        let [contradicted, confirmed] = limits.camera_fit;
        if own_px < contradicted * given_px {
            let reason = Reason::CameraContradicted { apart_px, given_px, own_px };
            verdict.object(Level::Lost, reason);
        } else {
            let reason = Reason::CameraUnconfirmed { apart_px };
            verdict.degrade_above(confirmed * given_px, own_px, reason);
        }
    }
}

/// What the frame shows where the surface is.
fn appearance(verdict: &mut Verdict, evidence: &Evidence, limits: &Thresholds) {
    if let Some([agreeing, places]) = evidence.places {
        let share = agreeing as f64 / places.max(1) as f64;
        if places < limits.matches[1] {
            let counts = limits.matches.map(|n| n as f64);
            verdict.least(places as f64, counts, Reason::FewPlaces { places });
        } else {
            verdict.least(share, limits.agreement, Reason::Unlike { share });
        }
    }
    if let Some(found) = evidence.appearance {
        let usual = evidence.usual;
        verdict.least(found.shown, limits.shown, Reason::Covered { shown: found.shown });
        let uncompared = Reason::Uncompared { share: found.compared };
        verdict.degrade_above(limits.compared, found.compared, uncompared);
        if let (Some(correlation), Some(usual)) = (found.correlation, usual.correlation) {
            let reason = Reason::Structure { correlation, usual };
            verdict.least(correlation / usual, limits.structure, reason);
        }
        if let (Some(contrast), Some(usual)) = (found.contrast, usual.contrast) {
            let reason = Reason::Faint { contrast, usual };
            verdict.degrade_above(limits.contrast * usual, contrast, reason);
        }
    }
    verdict.degrade_if(evidence.uncompared, Reason::Uncompared { share: 0.0 });
    let beside =
        |found: Appearance| found.residual / evidence.usual.residual.max(limits.least_residual);
    let seen = evidence.appearance.map_or(0.0, beside);
    let solved = evidence.photometric.unwrap_or(0.0);
    // `f64::max` would drop NaN.
    let times = if seen > solved || seen.is_nan() { seen } else { solved };
    verdict.degrade_above(times, limits.photometric, Reason::Brightness { times });
    verdict.degrade_if(evidence.no_shading, Reason::NoShading);
    if let Some(gain) = evidence.gain {
        let [least, most] = limits.gain;
        verdict.degrade_if(!(least..most).contains(&gain), Reason::Gain { gain });
    }
}

/// Parts of the surface.
fn parts(verdict: &mut Verdict, evidence: &Evidence, limits: &Thresholds) {
    if let Some(part) = evidence.contradicted {
        verdict.degrade_above(part.share, limits.contradicted, Reason::RegionContradicted(part));
    }
    if let Some(part) = evidence.unobserved {
        verdict.degrade_above(part.share, limits.unobserved, Reason::RegionUnobserved(part));
    }
    if let Some((faces, share)) = evidence.folded {
        verdict.degrade_above(share, limits.folded, Reason::Folded { faces, share });
    }
}

fn shape(verdict: &mut Verdict, evidence: &Evidence, limits: &Thresholds) {
    if let Some(share) = evidence.strain {
        let [degraded, lost] = limits.strain;
        verdict.most(share, [lost, degraded], Reason::Strain { share });
    }
    if let Some(share) = evidence.jump {
        verdict.degrade_above(share, limits.jump, Reason::Jump { share });
    }
}

#[cfg(test)]
mod tests;
