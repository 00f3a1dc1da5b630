//! What a run leaves for the viewer.

use super::job::Job;
use crate::inputs::Source;
use crate::outputs::FrameReport;
use crate::report::data::ShownFrame;
use crate::report::frames::frames_page;
use crate::structures::{Placed, Structures};
use dsfms::image::Frame;
use dsfms::pipeline::Reconstruction;

/// What becomes of a frame for the viewer.
#[derive(Clone, Copy)]
pub struct Paged {
    /// It is in report.html.
    pub holds: bool,
    /// Also in a file beside it, for `dsfms view`.
    pub beside: bool,
}

impl Paged {
    pub fn wants(self) -> bool {
        self.holds || self.beside
    }
}

impl Job<'_> {
    /// What the page's viewer shows of a frame.
    pub fn shown(
        &self,
        name: &str,
        frame: &Frame,
        (report, result): (&FrameReport, &Reconstruction),
        places: &[Placed],
    ) -> anyhow::Result<ShownFrame> {
        let mut shown = ShownFrame::new(name, frame)?;
        let faces = &self.template.mesh.topology.faces;
        shown.add(report, Some(result), (self.lens(), faces), 1.0);
        let structures = self.structures.as_ref();
        shown.add_structures(structures.map_or(vec![], |s| s.places(self.lens(), places)));
        Ok(shown)
    }

    pub fn write_page(
        &self,
        rows: &[(String, FrameReport)],
        frames: Vec<ShownFrame>,
    ) -> anyhow::Result<()> {
        let template = self.args.template.file_name().unwrap_or_default().to_string_lossy();
        let method = self.method.name();
        let mut page = frames_page((&template, &self.template), self.lens(), method, rows, frames)?;
        page.data.structures = self.structures.as_ref().map_or(Vec::new(), Structures::shown);
        page.write(&self.args.output.join("report.html"))
    }
}

/// A frame without surface: its image, where it can be read.
pub fn failed_frame(
    name: &str,
    source: &Source,
    report: &FrameReport,
) -> anyhow::Result<ShownFrame> {
    let mut frame = match source.frame() {
        Ok(frame) => ShownFrame::new(name, &frame)?,
        Err(_) => ShownFrame::with(name, None, [640, 480]),
    };
    frame.surfaces.push(None);
    frame.status.push(report.status);
    frame.reasons.push(report.reasons.clone());
    Ok(frame)
}
