//! What speaks against a surface, with the figures it rests on and as a sentence of plain English.

use crate::register::RegisterError;
use serde::{Deserialize, Serialize};

/// A doubt. Lengths in the template's unit, shares in `[0, 1]`, pixels of the frame. As text it is
/// one sentence, without a full stop; what a user of some program can do about it is that program's
/// to say.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
#[serde(tag = "reason", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Reason {
    /// No surface could be made.
    #[error("{why}")]
    NoSurface {
        /// Why.
        why: NoSurface,
    },
    /// The frame is not as it was taken: damaged, or predicted from one that is.
    #[error("{why}")]
    Input {
        /// What is known of it.
        why: String,
    },
    /// A coordinate is NaN or infinite.
    #[error("some vertices are not finite")]
    NotFinite,
    /// The frame is black: `brightest` is its brightest value, of 255.
    #[error("the frame is black (brightest pixel {brightest} of 255)")]
    Black {
        /// That value.
        brightest: u8,
    },
    /// No vertex is seen.
    #[error("no vertex is visible in this frame")]
    NothingVisible,
    /// Few matches carry the surface.
    #[error("only {kept} different matches carry the surface, {wanted} or more are wanted")]
    FewMatches {
        /// Distinct ones that it explains.
        kept: usize,
        /// How many are wanted.
        wanted: usize,
    },
    /// Rows that repeat one another.
    #[error("the {total} matches are {distinct} different ones repeated")]
    RepeatedMatches {
        /// Different places among them.
        distinct: usize,
        /// All.
        total: usize,
    },
    /// The surface explains too few of the matches.
    #[error("only {kept} of {total} matches agree with the surface")]
    MatchesDisagree {
        /// Explained.
        kept: usize,
        /// All.
        total: usize,
    },
    /// The kept matches lie far from the surface.
    #[error("median residual {px:.1} px")]
    Residual {
        /// Median distance, px.
        px: f64,
    },
    /// The matches do not fix the pose: on a line, in one small place.
    #[error("{}", pose_uncertain(*.length, *.degrees, *.share))]
    PoseUncertain {
        /// Standard deviation of the position of nine visible vertices in ten, at most.
        length: f64,
        /// Largest standard deviation of the orientation, degrees.
        degrees: f64,
        /// `length` over the visible radius.
        share: f64,
    },
    /// The surface lies nearer or farther than any exploration frame makes plausible.
    #[error("the surface would lie at a depth of {depth:.1}, the exploration was at {:.1} to {:.1}", .usual[0], .usual[1])]
    Depth {
        /// Median depth of what is seen.
        depth: f64,
        /// Least and largest of the exploration.
        usual: [f64; 2],
    },
    /// What is seen of the organ would be next to a point in the frame.
    #[error("the visible surface would be {px:.0} px wide")]
    Tiny {
        /// Radius of the visible surface, px.
        px: f64,
    },
    /// No rigid pose comes near the matches.
    #[error("the organ moved far from any rigid pose (median {px:.0} px)")]
    FarFromRigid {
        /// Median distance, px.
        px: f64,
    },
    /// Bent so far from any rigid pose that its depth is uncertain.
    #[error("bent so far from any rigid pose that depth is uncertain by {} of the radius", percent(*.share))]
    DepthUncertain {
        /// Of the visible radius.
        share: f64,
    },
    /// Few textured places can be compared.
    #[error("only {places} textured places of the template can be compared")]
    FewPlaces {
        /// Their number.
        places: usize,
    },
    /// Few of the textured places look like the template.
    #[error("only {} of the surface looks like the template", percent(*.share))]
    Unlike {
        /// Share of them that do.
        share: f64,
    },
    /// The texture is not the template's, or lies elsewhere.
    #[error(
        "the texture does not lie where the surface predicts it (correlation {correlation:.2}, in the exploration {usual:.2})"
    )]
    Structure {
        /// Median correlation with the prediction.
        correlation: f64,
        /// That of the exploration frames, or what is expected without any.
        usual: f64,
    },
    /// The texture is fainter than predicted: blur, smoke, a film on the lens.
    #[error("the texture has {} of its usual contrast (blur, smoke, a film on the lens?)", percent(.contrast / .usual))]
    Faint {
        /// Strength of the texture.
        contrast: f64,
        /// That of the exploration frames.
        usual: f64,
    },
    /// Brightness is farther from the prediction than usual.
    #[error("brightness {times:.1} times as far off as usual (smoke, blur, glare?)")]
    Brightness {
        /// Residual over the usual one.
        times: f64,
    },
    /// Little of the predicted silhouette shows the organ.
    #[error("only {} of the predicted outline shows the organ", percent(*.shown))]
    Covered {
        /// Share that does.
        shown: f64,
    },
    /// Little of the predicted silhouette can be compared with the frame at all.
    #[error("only {} of the predicted outline can be compared", percent(*.share))]
    Uncompared {
        /// Share that can.
        share: f64,
    },
    /// A part of the visible surface where the image shows something else than the template there.
    #[error("the image shows something else than the template on {}", place(.0))]
    RegionContradicted(Part),
    /// A part of the visible surface that no observation of the frame supports.
    #[error("no observation supports {}", place(.0))]
    RegionUnobserved(Part),
    /// Nothing could be used for shading; the surface is motion's.
    #[error("nothing could be used for shading: the result is motion's")]
    NoShading,
    /// The exposure is far from the template's.
    #[error("exposure gain {gain:.2} is far from the template's")]
    Gain {
        /// Relative to the template's.
        gain: f64,
    },
    /// Edges change their length much.
    #[error("edges change their length by {}", percent(*.share))]
    Strain {
        /// Change that one edge in twenty exceeds.
        share: f64,
    },
    /// Faces are turned over.
    #[error("{faces} faces are folded over ({} of the visible surface)", percent(*.share))]
    Folded {
        /// Their number.
        faces: usize,
        /// Share of the visible area.
        share: f64,
    },
    /// The shape jumped from one frame to the next.
    #[error("the shape jumped by {} of its radius", percent(*.share))]
    Jump {
        /// Of its radius.
        share: f64,
    },
    /// The camera is not the template's, and the matches do not tell which is right.
    #[error(
        "the camera is not the template's (sightlines up to {apart_px:.0} px apart), and the matches do not tell which is right"
    )]
    CameraUnconfirmed {
        /// Largest difference of their sightlines, px.
        apart_px: f64,
    },
    /// The matches fit the template's camera and not the one given.
    #[error(
        "the matches fit the template's camera ({own_px:.1} px) and not the one given ({given_px:.1} px; sightlines up to {apart_px:.0} px apart)"
    )]
    CameraContradicted {
        /// Largest difference of their sightlines, px.
        apart_px: f64,
        /// Median distance of the matches from the pose under the given camera, px.
        given_px: f64,
        /// The same under the template's.
        own_px: f64,
    },
}

/// A connected part of the visible surface, as it lies in the frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Of the visible area.
    pub share: f64,
    /// Centre in the frame, px.
    pub centre_px: [f64; 2],
    /// Radius in the frame, px (root mean square distance from the centre).
    pub radius_px: f64,
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share)
}

fn place(part: &Part) -> String {
    let ([x, y], radius) = (part.centre_px, part.radius_px);
    format!(
        "{} of the visible surface, about pixel ({x:.0}, {y:.0}), radius {radius:.0} px",
        percent(part.share)
    )
}

/// Why a frame has no surface; in files its sentence.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[serde(into = "String", from = "String")]
#[non_exhaustive]
pub enum NoSurface {
    /// No frame showed the template yet.
    #[error("not found yet")]
    NotFound,
    /// No shape to begin from.
    #[error("nothing to follow")]
    NothingToFollow,
    /// It waits for the answer about another.
    #[error("an earlier frame is being searched")]
    SearchedElsewhere,
    /// Too few matches to believe any surface.
    #[error("only {found} matches, at least {needed} are needed")]
    FewMatches {
        /// Matches.
        found: usize,
        /// The least that are believed.
        needed: usize,
    },
    /// No pose.
    #[error(transparent)]
    Register(#[from] RegisterError),
    /// What another stage says, or a file.
    #[error("{0}")]
    Told(String),
}

impl From<NoSurface> for String {
    fn from(why: NoSurface) -> Self {
        why.to_string()
    }
}

impl From<String> for NoSurface {
    fn from(said: String) -> Self {
        Self::Told(said)
    }
}

fn pose_uncertain(length: f64, degrees: f64, share: f64) -> String {
    if !length.is_finite() {
        return "the matches do not fix the pose: they lie on a line or in one place".into();
    }
    format!(
        "the matches leave the pose open by {length:.1} length units and {degrees:.1} degrees \
         ({} of the visible radius): they lie on a line or in one small place",
        percent(share)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_named_with_its_place() {
        let part = Part { share: 0.31, centre_px: [412.3, 200.0], radius_px: 55.2 };
        let text = Reason::RegionUnobserved(part).to_string();
        assert!(text.contains("31 %") && text.contains("(412, 200)"), "{text}");
    }

    #[test]
    fn a_reason_is_read_back_from_its_sentence() {
        let why = NoSurface::FewMatches { found: 3, needed: 12 };
        let text = serde_json::to_string(&Reason::NoSurface { why }).unwrap();
        assert!(text.contains("\"why\":\"only 3 matches"), "{text}");
        let read: Reason = serde_json::from_str(&text).unwrap();
        assert_eq!(serde_json::to_string(&read).unwrap(), text);
    }

    #[test]
    fn an_open_pose_has_no_infinite_figures() {
        let (length, degrees) = (f64::INFINITY, f64::INFINITY);
        let reason = Reason::PoseUncertain { length, degrees, share: f64::INFINITY };
        assert!(!reason.to_string().contains("inf"), "{reason}");
    }
}
