//! The demo's report: five methods against the truth.

mod frame;
mod results;
mod tables;

use super::truth::FrameTruth;
use crate::demo::METHODS;
use crate::report::Page;
use crate::report::data::{PageData, ShownFrame, ShownSurface, pixels};
use crate::report::embed::{self, Cloud, escape};
use dsfms::camera::CameraModel;
use frame::{frame_section, template_section};
pub use results::{FrameResult, Report};
use tables::{Part, comparison};

impl Report<'_> {
    /// The table for the terminal.
    pub fn text(&self) -> String {
        let mut text = format!(
            "camera centres {:.3} mm rms from the truth ({} of {} frames), template surface {:.3} mm rms\n",
            self.tie.centres.rms,
            self.tie.centres.count,
            self.scene.exploration.len(),
            self.tie.surface.rms
        );
        text += "3D error in mm, mean over frames (rms / mean)\n";
        text += &format!("{:<8}", "");
        for part in Part::ALL {
            text += &format!("{:>24}", part.name());
        }
        text += &format!("{:>24}\n", "ok, degraded, failed");
        for (k, method) in METHODS.into_iter().enumerate() {
            text += &format!("{:<8}", method.name());
            for part in Part::ALL {
                let cell = match (self.mean(k, part, |s| s.rms), self.mean(k, part, |s| s.mean)) {
                    (Some((rms, _)), Some((mean, _))) => format!("{rms:.2} / {mean:.2}"),
                    _ => "-".into(),
                };
                text += &format!("{cell:>24}");
            }
            let of = |status| {
                self.frames.iter().filter(|f| f.methods[k].report.status == status).count()
            };
            let verdicts = ["ok", "degraded", "failed"].map(|s| of(s).to_string()).join(", ");
            text += &format!("{verdicts:>24}\n");
        }
        text += &format!(
            "{:.0} s in all, of which template {:.0} s\n",
            self.seconds, self.template_seconds
        );
        text
    }
}

/// The page.
pub fn page(report: &Report) -> anyhow::Result<Page> {
    let mut sections = comparison(report);
    sections += &template_section(report)?;
    for (i, frame) in report.frames.iter().enumerate() {
        sections += &frame_section(report, i, frame)?;
    }
    let title = "A deforming organ from one laparoscope".into();
    let (summary, curves) = (overview(report), String::new());
    Ok(Page { title, summary, sections, curves, data: data(report)? })
}

/// Everything in mm, the truth beside the methods.
fn data(report: &Report) -> anyhow::Result<PageData> {
    let camera = &report.scene.camera.file.camera;
    let scale = report.tie.mm;
    let faces = &report.built.template.mesh.topology.faces;
    let mut data = PageData::of_template(&report.built.template, scale, "mm")?;
    data.methods = METHODS.into_iter().map(|m| m.name().to_string()).collect();
    data.truth = Some(data.methods.len());
    data.methods.push("truth".into());
    data.chosen = METHODS.len() - 1;
    for (frame, deformed) in report.frames.iter().zip(&report.scene.deformed) {
        let mut shown = ShownFrame::new(&frame.name, &deformed.frame)?;
        for method in &frame.methods {
            let surface = method.surface.as_ref().map(|s| &s.0);
            shown.add(&method.report, surface, (camera, faces), scale);
        }
        shown.surfaces.push(Some(true_surface(&frame.truth, camera)));
        shown.status.push("ok");
        data.frames.push(shown);
    }
    Ok(data)
}

fn true_surface(truth: &FrameTruth, camera: &CameraModel) -> ShownSurface {
    ShownSurface {
        positions: Some(Cloud::of(&truth.mesh.positions)),
        pixels: Some(pixels(camera, &truth.mesh.positions)),
        visible: Some(embed::flags(&truth.visible)),
        ..Default::default()
    }
}

fn overview(report: &Report) -> String {
    let links: String = report
        .frames
        .iter()
        .map(|f| format!("<a href=\"#{0}\">{0}</a>", escape(&f.name)))
        .collect();
    format!(
        "<p>The template was built from {} exploration frames of an organ-like body at rest. Every \
         deformed frame was then reconstructed by rigid pose, shape from shading (sfs), motion \
         (dsfm, eq. 3), motion with shading (dsfms, eq. 4) and both in one problem (joint), and \
         compared with the truth of this path-traced scene. Errors are distances between every template vertex and its true place, \
         in mm, without any alignment of the deformed shapes: the way of the camera, as a tracked \
         laparoscope would tell it, gives the template its scale. <code>dsfms evaluate</code> on the \
         files of a method and of <code>truth</code> gives the same figures.</p>\
         <nav aria-label=\"Sections\"><a href=\"#viewer\">viewer</a><a href=\"#methods\">methods</a>\
         <a href=\"#template\">template</a>{links}</nav>",
        report.scene.exploration.len()
    )
}
