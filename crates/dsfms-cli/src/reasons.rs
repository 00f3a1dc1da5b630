//! Reasons of the library, with what a user of the command line can do about them.

use dsfms::verdict::Reason;

/// One sentence, without a full stop.
pub fn sentence(reason: &Reason) -> String {
    match hint(reason) {
        Some(hint) => format!("{reason}; {hint}"),
        None => reason.to_string(),
    }
}

/// Of all.
pub fn sentences(reasons: &[Reason]) -> Vec<String> {
    reasons.iter().map(sentence).collect()
}

/// Of all in one line.
pub fn joined(reasons: &[Reason]) -> String {
    sentences(reasons).join("; ")
}

fn hint(reason: &Reason) -> Option<&'static str> {
    match reason {
        Reason::RepeatedMatches { .. } => Some("give every match once"),
        Reason::PoseUncertain { .. } => Some("give matches all over the organ"),
        Reason::RegionUnobserved(_) => Some(
            "that part is held by its prior alone; matches there help, as does --method joint where shading sees it",
        ),
        Reason::RegionContradicted(_) => {
            Some("it is covered, or deformed as the surface does not follow")
        }
        Reason::CameraUnconfirmed { .. } | Reason::CameraContradicted { .. } => {
            Some("check --camera, or leave it out to use the template's")
        }
        Reason::Depth { .. } | Reason::Tiny { .. } => {
            Some("check the camera file and that the matches belong to this template")
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dsfms::verdict::Part;

    #[test]
    fn a_part_is_named_with_what_to_do() {
        let part = Part { share: 0.31, centre_px: [412.3, 200.0], radius_px: 55.2 };
        let text = sentence(&Reason::RegionUnobserved(part));
        assert!(text.contains("31 %") && text.contains("matches there help"), "{text}");
    }
}
