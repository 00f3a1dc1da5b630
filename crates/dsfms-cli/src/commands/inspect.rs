//! `dsfms inspect`: what is inside a template.

use crate::exit::Outcome;
use crate::stdout::to_stdout;
use clap::Args;
use dsfms::io::template::read_template;
use dsfms::template::Template;
use dsfms::template::statistics::{
    AlbedoStatistics, FlatteningStatistics, TemplateStatistics, template_statistics,
};
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  dsfms inspect organ.template
  dsfms inspect organ.template --json > organ.json";

/// Show what is inside a template: unit, vertices, flattening distortion, frames, albedo.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct InspectArgs {
    /// Template folder.
    #[arg(value_name = "TEMPLATE")]
    template: PathBuf,
    /// Print JSON instead of a table.
    #[arg(long)]
    json: bool,
}

/// Run the command.
pub fn run(args: &InspectArgs) -> anyhow::Result<Outcome> {
    let template = read_template(&args.template)?;
    if args.json {
        let text = serde_json::to_string_pretty(&template_statistics(&template))?;
        to_stdout(&format!("{text}\n"))?;
    } else {
        print(&template)?;
    }
    Ok(Outcome::Ok)
}

/// The row that [`unobserved`] explains.
const ALBEDO: &str = "albedo";

/// The table on stdout.
pub fn print(template: &Template) -> anyhow::Result<()> {
    let mut text = String::new();
    let statistics = template_statistics(template);
    for (name, value) in rows(template, &statistics) {
        text += &format!("{name:<14}{value}\n");
        if let (ALBEDO, Some(albedo)) = (name, &statistics.albedo) {
            let explained = unobserved(albedo.observed).map(|why| format!("unobserved    {why}\n"));
            text += &explained.unwrap_or_default();
        }
    }
    to_stdout(&text)
}

fn rows(template: &Template, s: &TemplateStatistics) -> Vec<(&'static str, String)> {
    let unit = s.unit.label();
    let [x, y, z] = s.extent;
    let frames = match s.median_reprojection_px {
        Some(px) => format!("{}, median reprojection error {px:.2} px", s.frames),
        None => s.frames.to_string(),
    };
    let vignetting = match template.coat.vignetting {
        0.0 => String::new(),
        a => format!("; vignetting 1 {a:+.3} r²"),
    };
    let light = template
        .light
        .as_ref()
        .map_or("none".into(), |l| format!("{}{vignetting}", l.describe(unit)));
    let seen = s.seen_vertices.map_or("not known".into(), |n| format!("{n} vertices"));
    let sigma = s
        .median_sigma
        .map_or("not known".into(), |sigma| format!("median {sigma:.3} {unit} expected"));
    let sigma = match s.unmeasured {
        Some(share) => format!("{sigma}; {:.0} % of the area unmeasured", 100.0 * share),
        None => sigma,
    };
    let around = template.surroundings.as_ref().map_or("none".into(), |around| {
        let (vertices, faces) = (around.mesh.positions.len(), around.mesh.topology.faces.len());
        let descriptors = around.features.descriptors.len();
        format!("{vertices} vertices, {faces} faces, {descriptors} descriptors around the organ")
    });
    vec![
        ("unit", unit.to_string()),
        (
            "vertices",
            format!("{}, {} faces, mean edge {:.3} {unit}", s.vertices, s.faces, s.mean_edge),
        ),
        (
            "topology",
            format!(
                "{} piece(s), {} boundary loop(s), Euler characteristic {}",
                s.components, s.boundary_loops, s.euler_characteristic
            ),
        ),
        ("extent", format!("{x:.2} x {y:.2} x {z:.2} {unit}, area {:.1} {unit}²", s.area)),
        ("min angle", format!("{:.1} deg", s.min_angle_deg)),
        ("seen", seen),
        ("error", sigma),
        ("flattening", s.flattening.as_ref().map_or("none".into(), flattening)),
        ("frames", frames),
        (ALBEDO, s.albedo.as_ref().map_or("none".into(), albedo)),
        ("light", light),
        ("descriptors", s.features.to_string()),
        ("surroundings", around),
    ]
}

fn flattening(f: &FlatteningStatistics) -> String {
    format!(
        "quasi-conformal ratio median {:.3}, p95 {:.3}; area ratio {:.2}; {} flipped, {} seam edges",
        f.quasi_conformal_median, f.quasi_conformal_p95, f.area_ratio, f.flipped, f.seam_edges
    )
}

fn albedo(a: &AlbedoStatistics) -> String {
    format!(
        "{} texels, {:.1} % observed; mean {:.3}, p5 {:.3}, p95 {:.3}; median spread {:.4}",
        a.texels,
        100.0 * a.observed,
        a.mean,
        a.p5,
        a.p95,
        a.median_spread
    )
}

/// What it means that few texels were observed.
fn unobserved(observed: f64) -> Option<String> {
    (observed < FEW).then(|| {
        format!(
            "{:.1} % of the texels: out of sight, too oblique, saturated, or so pale that they may be glare; there \
             shading says nothing, matches and prior alone move the surface",
            100.0 * (1.0 - observed)
        )
    })
}

/// A share of observed texels that needs no explanation.
const FEW: f64 = 0.9;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_that_no_frame_showed_are_explained() {
        assert_eq!(unobserved(0.95), None);
        let text = unobserved(0.14).unwrap();
        assert!(text.starts_with("86.0 % of the texels: ") && text.contains("glare"), "{text}");
    }
}
