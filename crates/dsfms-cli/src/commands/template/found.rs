//! What is said of the exploration: models found, precision, the organ.

use dsfms::pipeline::{FoundOrgan, OrganGuess, SparsePrecision};
use dsfms::sfm::FoundModel;
use dsfms::template::statistics::MOST_UNMEASURED;
use dsfms::template::{LengthUnit, Template};
use std::path::Path;

/// `42 of 44 frames registered; fx 1012.3 px; 4503 points; 0.31 px median error; 195 s`.
pub fn summary_text(template: &Template, frames: usize, seconds: f64) -> String {
    let mut parts = vec![format!("{} of {frames} frames registered", template.views.len())];
    parts.extend(template.camera.as_ref().map(|c| format!("fx {:.1} px", c.focal[0])));
    if !template.points.is_empty() {
        parts.push(format!("{} points", template.points.len()));
        let mut errors: Vec<f64> = template.views.iter().map(|v| v.reprojection_px).collect();
        errors.sort_by(f64::total_cmp);
        parts.extend(errors.get(errors.len() / 2).map(|px| format!("{px:.2} px median error")));
    }
    parts.push(format!("{} vertices", template.mesh.positions.len()));
    parts.push(format!("{seconds:.0} s"));
    parts.join("; ")
}

/// `2 models that share too few points: frames 1-20 (5230 points, kept), 25-40 (812 points); ...`
pub fn models_text(models: &[FoundModel]) -> String {
    let each = models.iter().enumerate().map(|(i, model)| {
        let kept = if i == 0 { ", kept" } else { "" };
        format!("{} ({} points{kept})", runs_text(&model.frames), model.points)
    });
    format!(
        "{} models that share too few points: frames {}; numbered from 1 in the order given",
        models.len(),
        each.collect::<Vec<_>>().join(", ")
    )
}

/// Ascending indices as runs that count from 1: `1-3 5`.
fn runs_text(indices: &[usize]) -> String {
    let runs = indices.chunk_by(|a, b| a + 1 == *b).map(|run| match run {
        [first, .., last] => format!("{}-{}", first + 1, last + 1),
        _ => run.iter().map(|i| (i + 1).to_string()).collect(),
    });
    runs.collect::<Vec<_>>().join(" ")
}

/// A row below those of `inspect`.
pub fn precision_row(precision: &SparsePrecision, unit: LengthUnit) -> String {
    let (centre, rotation_deg) = precision.cameras();
    let (points, unit) = (precision.point_median, unit.label());
    format!(
        "{:<14}camera centres {centre:.4} {unit}, rotations {rotation_deg:.4} deg (rms), \
         sparse points {points:.4} {unit} (median): expected errors, see precision.json\n",
        "precision"
    )
}

/// What it means that much of the surface was not measured, and what to try.
pub fn unmeasured_text(share: f64) -> String {
    format!(
        "frames agree on no more than {:.0} % of the surface; at least {:.0} % are wanted. The rest is closed, not \
         measured, and may be off by much (red in pictures/measured.png): its texture is too faint, too few frames see \
         it, or highlights cover it. Explore it from nearer and from more sides, or give a surface from CT (--mesh \
         with --poses)",
        100.0 * (1.0 - share),
        100.0 * (1.0 - MOST_UNMEASURED)
    )
}

/// What it means that the frames do not look like the template, and what to try.
pub fn unlike_text(correlation: f64) -> String {
    format!(
        "the exploration frames do not look like the template (correlation {correlation:.2}; 0.85 and more where poses \
         and surface are right). Check the poses (camera_from_world, x right, y down, z forward), the frame and unit of \
         the mesh, and the camera; look at the overlay of a frame that is reconstructed with it"
    )
}

/// Where to see which part was taken for the organ, and how to tell otherwise; one line each.
pub fn organ_hint(organ: &FoundOrgan, template: &Path) -> Vec<String> {
    let picture = |name: &str| template.join("pictures").join(name).display().to_string();
    if !organ.open() {
        return vec![format!(
            "{} shows its outlines; dsfms view {} has a page to draw it on; --organ-click, --not-organ-click, \
             --organ-scribbles, --organ-masks or --organ-polygon tell otherwise, --whole keeps all",
            picture("organ.png"),
            template.display()
        )];
    }
    let guess = |(letter, guess): (char, &OrganGuess)| {
        let masks = template.join(format!("organ_masks_{letter}"));
        let click = guess.click.as_ref().map_or(String::new(), |click| {
            let frame = click.frame.as_ref().map_or(String::new(), |f| format!("@{f}"));
            format!("--organ-click {},{}{frame} or ", click.pixel.x, click.pixel.y)
        });
        format!(
            "{} ({:.0} % marked): if this is the organ, {click}--organ-masks {} into another template folder",
            picture(&format!("organ_{letter}.png")),
            100.0 * guess.marked,
            masks.display()
        )
    };
    let mut lines: Vec<String> = LETTERS.into_iter().zip(organ.guesses()).map(guess).collect();
    lines.push(format!(
        "if all that was seen is the organ, --whole; if none is right, draw it: dsfms view {}, then \
         --organ-scribbles",
        template.display()
    ));
    lines
}

/// Of what may be meant.
pub const LETTERS: [char; 3] = ['a', 'b', 'c'];

#[cfg(test)]
mod tests {
    use super::*;
    use dsfms::geometry::Point2;
    use dsfms::pipeline::OrganClick;

    #[test]
    fn an_open_outline_names_an_option_for_every_part() {
        let guess = |click: Option<OrganClick>| OrganGuess {
            masks: Vec::new(),
            borders: Vec::new(),
            stepping: 0.5,
            marked: 0.7,
            click,
        };
        let click = OrganClick { frame: Some("f_2".into()), pixel: Point2::new(12.0, 40.0) };
        let mut organ =
            FoundOrgan { guess: guess(Some(click)), taken: false, others: vec![guess(None)] };
        let lines = organ_hint(&organ, Path::new("t"));
        assert_eq!(lines.len(), 3);
        assert!(lines[0].contains("organ_a.png") && lines[0].contains("--organ-click 12,40@f_2"));
        assert!(lines[1].contains("organ_masks_b") && !lines[1].contains("--organ-click"));
        assert!(lines[2].contains("--whole"));
        (organ.taken, organ.others) = (true, Vec::new());
        let lines = organ_hint(&organ, Path::new("t"));
        assert!(lines.len() == 1 && lines[0].contains("organ.png"), "{lines:?}");
    }

    #[test]
    fn models_are_named_by_runs_of_frames() {
        let model = |frames: &[usize], points| FoundModel { frames: frames.to_vec(), points };
        let text = models_text(&[model(&[0, 1, 2, 4], 90), model(&[6, 7], 20)]);
        assert!(text.contains("frames 1-3 5 (90 points, kept), 7-8 (20 points)"), "{text}");
    }
}
