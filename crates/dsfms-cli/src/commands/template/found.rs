//! What is said of the exploration: models found, precision, the organ.

use dsfms::pipeline::{FoundOrgan, SparsePrecision};
use dsfms::sfm::FoundModel;
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

/// Where to see which part was taken for the organ, and how to tell otherwise.
pub fn organ_hint(organ: &FoundOrgan, pictures: &Path) -> String {
    let picture = pictures.join("organ.png");
    let picture = picture.display();
    match organ.taken {
        true => format!(
            "{picture} shows its outlines; --organ-click, --organ-masks or --organ-polygon tell otherwise, --whole \
             keeps all"
        ),
        false => format!(
            "{picture} shows the outlines found; if they are right, say --organ-click or --organ-masks; if all is \
             the organ, --whole"
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_are_named_by_runs_of_frames() {
        let model = |frames: &[usize], points| FoundModel { frames: frames.to_vec(), points };
        let text = models_text(&[model(&[0, 1, 2, 4], 90), model(&[6, 7], 20)]);
        assert!(text.contains("frames 1-3 5 (90 points, kept), 7-8 (20 points)"), "{text}");
    }
}
