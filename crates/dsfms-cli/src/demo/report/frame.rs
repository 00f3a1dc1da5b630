//! The sections of the template and of every frame.

use super::super::scene::DeformedFrame;
use super::results::{FrameResult, Report};
use super::tables::error_table;
use crate::demo::METHODS;
use crate::draw::{self, SideView};
use crate::report::embed::{escape, jpeg};
use dsfms::pipeline::Method;
use dsfms::template::statistics::template_statistics;

/// Error at which the colour ramp ends, mm.
const RAMP_MM: f64 = 3.0;
const SIDE_SIZE: [usize; 2] = [360, 320];

/// The template beside the true surface.
pub fn template_section(report: &Report) -> anyhow::Result<String> {
    let template = &report.built.template;
    let s = template_statistics(template);
    let mut html = String::from("<h2 id=\"template\">Template</h2><p>");
    html += &format!(
        "{} of {} exploration frames registered; camera centres {:.3} mm rms (at most {:.3}) from the \
         truth after similarity alignment; {} vertices, {:.2} mm rms (median {:.2}, at most {:.2}) from \
         the true surface.",
        s.frames,
        report.scene.exploration.len(),
        report.tie.centres.rms,
        report.tie.centres.max,
        s.vertices,
        report.tie.surface.rms,
        report.tie.surface.median,
        report.tie.surface.max
    );
    if let Some(f) = &s.flattening {
        html += &format!(
            " Conformal flattening: quasi-conformal ratio {:.3} (median), {:.3} (95th percentile).",
            f.quasi_conformal_median, f.quasi_conformal_p95
        );
    }
    html += " <a href=\"organ.template/report.html\">The template in 3D among its cameras</a>.";
    html += "</p><div class=\"grid\">";
    if let Some(frame) = report.scene.exploration.first() {
        let photo = jpeg(&draw::picture(frame))?;
        html += &card("Exploration frame 0", &photo, "First exploration frame");
    }
    let mm = report.tie.in_mm(&in_first_camera(report));
    let colour: Vec<[u8; 3]> =
        report.tie.distances().iter().map(|&d| draw::error_colour(d, RAMP_MM)).collect();
    let side = SideView::of(&mm, SIDE_SIZE).render(&template.mesh.topology, &mm, Some(&colour));
    html += &card(
        "Side view, coloured by the distance from the true surface",
        &jpeg(&side)?,
        "Template from the side",
    );
    html += "</div><p class=\"dim\">Colours of all side views: 0 to 3 mm</p><div class=\"ramp\" role=\"img\" aria-label=\"Colour ramp from dark blue, 0 mm, to yellow, 3 mm\"></div>";
    Ok(html)
}

/// Template vertices in the axes of its first view.
fn in_first_camera(report: &Report) -> Vec<dsfms::geometry::Point3> {
    let template = &report.built.template;
    let pose = template.views.first().map(|v| v.camera_from_template).unwrap_or_default();
    template.mesh.positions.iter().map(|p| pose * p).collect()
}

/// One frame: errors, image and every method.
pub fn frame_section(report: &Report, i: usize, frame: &FrameResult) -> anyhow::Result<String> {
    let deformed = &report.scene.deformed[i];
    let topology = &report.built.template.mesh.topology;
    let view = SideView::of(&frame.truth.mesh.positions, SIDE_SIZE);
    let name = escape(&frame.name);
    let mut html = format!("<h2 id=\"{name}\">{name}</h2>");
    html += &error_table("3D error in mm; best in bold", |k, part, value| {
        part.of(&frame.methods[k].surface.as_ref()?.1).map(|s| value(&s))
    });
    html += &format!(
        "<p class=\"dim\">{} of {} matches lie on the template. Overlays: visible edges of the mesh; \
         green dots are matches that were kept, red ones were refused.</p><div class=\"grid\">",
        frame.matches.len(),
        frame.given_matches
    );
    html += "<div class=\"card\"><h3>Image and truth</h3>";
    html += &figure(
        &jpeg(&draw::picture(&deformed.frame))?,
        &format!("{name}, the image"),
        "The image",
    );
    let truth = view.render(topology, &frame.truth.mesh.positions, None);
    html += &figure(
        &jpeg(&truth)?,
        &format!("{name}, true shape from the side"),
        "True shape from the side",
    );
    html += "</div>";
    for (k, method) in METHODS.into_iter().enumerate() {
        html += &method_card(report, frame, deformed, &view, k, method)?;
    }
    Ok(html + "</div>")
}

fn method_card(
    report: &Report,
    frame: &FrameResult,
    deformed: &DeformedFrame,
    view: &SideView,
    k: usize,
    method: Method,
) -> anyhow::Result<String> {
    let result = &frame.methods[k];
    let status = result.report.status;
    let (name, method) = (escape(&frame.name), method.name());
    let mut html =
        format!("<div class=\"card\"><h3>{method} <span class=\"{status}\">{status}</span></h3>");
    if let Some((surface, _)) = &result.surface {
        let topology = &report.built.template.mesh.topology;
        let camera = &report.scene.camera.file.camera;
        let overlay = draw::overlay::overlay(
            &deformed.frame,
            camera,
            topology,
            &surface.vertices,
            &surface.visible,
            &surface.matches,
        );
        html += &figure(
            &jpeg(&overlay)?,
            &format!("{name}, mesh of {method} over the image"),
            "Mesh over the image",
        );
        let mm = report.tie.in_mm(&surface.vertices);
        let error = |(a, b): (&dsfms::geometry::Point3, &dsfms::geometry::Point3)| {
            draw::error_colour((a - b).norm(), RAMP_MM)
        };
        let colour: Vec<[u8; 3]> = mm.iter().zip(&frame.truth.mesh.positions).map(error).collect();
        let side = view.render(topology, &mm, Some(&colour));
        html += &figure(
            &jpeg(&side)?,
            &format!("{name}, shape by {method} from the side, coloured by its error"),
            "From the side, coloured by error",
        );
    }
    for reason in &result.report.reasons {
        html += &format!("<p class=\"dim\">{}</p>", escape(reason));
    }
    Ok(html + "</div>")
}

fn card(caption: &str, source: &str, alt: &str) -> String {
    format!("<div class=\"card\">{}</div>", figure(source, alt, caption))
}

fn figure(source: &str, alt: &str, caption: &str) -> String {
    format!(
        "<figure><img loading=\"lazy\" src=\"{source}\" alt=\"{alt}\"><figcaption>{caption}</figcaption></figure>"
    )
}
