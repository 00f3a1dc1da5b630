//! Reasons as sentences of plain English.

use super::{Part, Reason, Verdict};
use std::fmt::{Display, Formatter, Result};

/// One sentence, without a full stop; what a user of some program can do about it is that program's to say.
impl Display for Reason {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        f.write_str(&statement(self))
    }
}

/// All reasons in one line; empty where nothing speaks against the surface.
impl Display for Verdict {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let reasons: Vec<String> = self.reasons.iter().map(statement).collect();
        f.write_str(&reasons.join("; "))
    }
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

fn statement(reason: &Reason) -> String {
    match reason {
        Reason::NoSurface { why } | Reason::Input { why } => why.clone(),
        Reason::NotFinite => "some vertices are not finite".into(),
        Reason::Black { brightest } => {
            format!("the frame is black (brightest pixel {brightest} of 255)")
        }
        Reason::NothingVisible => "no vertex is visible in this frame".into(),
        Reason::FewMatches { kept, wanted } => {
            format!("only {kept} different matches carry the surface, {wanted} or more are wanted")
        }
        Reason::RepeatedMatches { distinct, total } => {
            format!("the {total} matches are {distinct} different ones repeated")
        }
        Reason::MatchesDisagree { kept, total } => {
            format!("only {kept} of {total} matches agree with the surface")
        }
        Reason::Residual { px } => format!("median residual {px:.1} px"),
        Reason::PoseUncertain { length, degrees, share } if length.is_finite() => format!(
            "the matches leave the pose open by {length:.1} length units and {degrees:.1} degrees \
             ({} of the visible radius): they lie on a line or in one small place",
            percent(*share)
        ),
        Reason::PoseUncertain { .. } => {
            "the matches do not fix the pose: they lie on a line or in one place".into()
        }
        Reason::Depth { depth, usual: [near, far] } => format!(
            "the surface would lie at a depth of {depth:.1}, the exploration was at {near:.1} to {far:.1}"
        ),
        Reason::Tiny { px } => format!("the visible surface would be {px:.0} px wide"),
        Reason::FarFromRigid { px } => {
            format!("the organ moved far from any rigid pose (median {px:.0} px)")
        }
        Reason::DepthUncertain { share } => format!(
            "bent so far from any rigid pose that depth is uncertain by {} of the radius",
            percent(*share)
        ),
        Reason::FewPlaces { places } => {
            format!("only {places} textured places of the template can be compared")
        }
        Reason::Unlike { share } => {
            format!("only {} of the surface looks like the template", percent(*share))
        }
        Reason::Structure { correlation, usual } => format!(
            "the texture does not lie where the surface predicts it (correlation {correlation:.2}, \
             in the exploration {usual:.2})"
        ),
        Reason::Faint { contrast, usual } => format!(
            "the texture has {} of its usual contrast (blur, smoke, a film on the lens?)",
            percent(contrast / usual)
        ),
        Reason::Brightness { times } => {
            format!("brightness {times:.1} times as far off as usual (smoke, blur, glare?)")
        }
        Reason::Covered { shown } => {
            format!("only {} of the predicted outline shows the organ", percent(*shown))
        }
        Reason::Uncompared { share } => {
            format!("only {} of the predicted outline can be compared", percent(*share))
        }
        Reason::RegionContradicted(part) => {
            format!("the image shows something else than the template on {}", place(part))
        }
        Reason::RegionUnobserved(part) => {
            format!("nothing in the frame speaks of {}", place(part))
        }
        Reason::NoShading => "nothing could be used for shading: the result is motion's".into(),
        Reason::Gain { gain } => format!("exposure gain {gain:.2} is far from the template's"),
        Reason::Strain { share } => format!("edges change their length by {}", percent(*share)),
        Reason::Folded { faces, share } => {
            format!("{faces} faces are folded over ({} of the visible surface)", percent(*share))
        }
        Reason::Jump { share } => format!("the shape jumped by {} of its radius", percent(*share)),
        Reason::CameraUnconfirmed { apart_px } => format!(
            "the camera is not the template's (sightlines up to {apart_px:.0} px apart), and the \
             matches do not tell which is right"
        ),
        Reason::CameraContradicted { apart_px, given_px, own_px } => format!(
            "the matches fit the template's camera ({own_px:.1} px) and not the one given \
             ({given_px:.1} px; sightlines up to {apart_px:.0} px apart)"
        ),
    }
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
    fn an_open_pose_has_no_infinite_figures() {
        let (length, degrees) = (f64::INFINITY, f64::INFINITY);
        let reason = Reason::PoseUncertain { length, degrees, share: f64::INFINITY };
        assert!(!reason.to_string().contains("inf"), "{reason}");
    }
}
