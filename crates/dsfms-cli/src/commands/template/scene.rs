//! What a template keeps so that its organ can be drawn: by what it was told, and the strokes.

use crate::draw::picture;
use crate::outputs::write_text;
use crate::progress::Reporter;
use crate::report::embed::jpeg_bytes;
use anyhow::Context;
use dsfms::guard;
use dsfms::image::Frame;
use dsfms::pipeline::{OrganScene, Progress, TemplateOptions, write_strokes};
use std::path::{Path, PathBuf};

/// By what the organ was told.
pub const SCENE: &str = "organ.scene";
/// Strokes, as `--organ-scribbles` reads them.
pub const SCRIBBLES: &str = "organ_scribbles.json";
/// Of the frames: edges must stay where they are.
const JPEG_QUALITY: u8 = 92;

/// With the frames as pictures.
pub fn with_photos(scene: OrganScene, frames: &[Frame]) -> anyhow::Result<OrganScene> {
    scene.with_photos(|name| {
        let frame = frames.iter().find(|frame| frame.name == name);
        let frame = frame.with_context(|| format!("no frame is called {name:?}"))?;
        jpeg_bytes(&picture(frame), JPEG_QUALITY)
    })
}

/// Strokes of an older template of this name, which the new one takes the place of.
pub struct Drawn {
    path: PathBuf,
    text: Option<String>,
}

impl Drawn {
    /// To be asked before the template is written.
    pub fn of(template: &Path) -> Self {
        let path = template.join(SCRIBBLES);
        Self { text: guard::read_text_at_most(&path, guard::MOST_JSON_BYTES).ok(), path }
    }

    /// Write the strokes that the template is built with; without any, those that were drawn on its
    /// predecessor stay.
    pub fn keep(self, options: &TemplateOptions, reporter: &Reporter) -> anyhow::Result<()> {
        let strokes = options.organ.strokes();
        if !strokes.is_empty() {
            return Ok(write_strokes(&self.path, strokes)?);
        }
        let Some(text) = &self.text else { return Ok(()) };
        let place = self.path.display();
        reporter.warn(&format!(
            "{place} was drawn on the template that this one replaces and is kept, but not used; --organ-scribbles \
             {place} uses it"
        ));
        write_text(&self.path, text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dsfms::geometry::Point2;
    use dsfms::pipeline::{Organ, OrganStroke, read_strokes};

    #[test]
    fn strokes_outlive_the_template_that_they_were_drawn_on() {
        let folder = tempfile::tempdir().unwrap();
        let reporter = Reporter::new(true, crate::progress::ProgressKind::Lines, false);
        let path = folder.path().join(SCRIBBLES);
        let none = TemplateOptions::default();
        Drawn::of(folder.path()).keep(&none, &reporter).unwrap();
        assert!(!path.exists());
        let stroke = |x: f64| OrganStroke {
            frame: Some("f_1".into()),
            organ: x > 1.0,
            px: vec![Point2::new(x, 2.0)],
        };
        write_strokes(&path, &[stroke(1.0)]).unwrap();
        let drawn = Drawn::of(folder.path());
        std::fs::remove_file(&path).unwrap();
        drawn.keep(&none, &reporter).unwrap();
        assert_eq!(read_strokes(&path).unwrap(), [stroke(1.0)]);
        let given = TemplateOptions { organ: Organ::Shown(None, vec![stroke(5.0)]), ..none };
        Drawn::of(folder.path()).keep(&given, &reporter).unwrap();
        assert_eq!(read_strokes(&path).unwrap(), [stroke(5.0)]);
    }
}
