//! `report.html`: one file with its viewer, its data and its pictures; nothing is loaded from
//! elsewhere, so it works offline, from a memory stick and as an attachment.

pub mod clip;
pub mod data;
pub mod embed;
pub mod experiment;
pub mod folder;
pub mod frames;
pub mod template;
pub mod track;

use crate::outputs::write_text;
use data::PageData;
use embed::escape;
use std::path::Path;

const PAGE: &str = include_str!("../../assets/report.html");
const STYLE: &str =
    concat!(include_str!("../../assets/report.css"), include_str!("../../assets/viewer.css"));
/// The parts of the viewer, as one function that starts after text and tables are painted.
const SCRIPT: &str = concat!(
    "\"use strict\";\nrequestAnimationFrame(() => setTimeout(() => {\n",
    include_str!("../../assets/viewer/data.js"),
    include_str!("../../assets/viewer/geometry.js"),
    include_str!("../../assets/viewer/layers.js"),
    include_str!("../../assets/viewer/materials.js"),
    include_str!("../../assets/viewer/scene.js"),
    include_str!("../../assets/viewer/paint.js"),
    include_str!("../../assets/viewer/rig.js"),
    include_str!("../../assets/viewer/points.js"),
    include_str!("../../assets/viewer/cut.js"),
    include_str!("../../assets/viewer/view.js"),
    include_str!("../../assets/viewer/matches.js"),
    include_str!("../../assets/viewer/film.js"),
    include_str!("../../assets/viewer/image.js"),
    include_str!("../../assets/viewer/uncertainty.js"),
    include_str!("../../assets/viewer/paths.js"),
    include_str!("../../assets/viewer/measure.js"),
    include_str!("../../assets/viewer/table.js"),
    include_str!("../../assets/viewer/flattening.js"),
    include_str!("../../assets/viewer/frames.js"),
    include_str!("../../assets/viewer/charts.js"),
    include_str!("../../assets/viewer/hover.js"),
    include_str!("../../assets/viewer/export.js"),
    include_str!("../../assets/viewer/link.js"),
    include_str!("../../assets/viewer/keys.js"),
    include_str!("../../assets/viewer/page.js"),
    "}));\n"
);
/// Bundled by `assets/README.md`.
const THREE: &str = include_str!("../../assets/three.min.js");

/// One report.
pub struct Page {
    pub title: String,
    /// Markup under the title.
    pub summary: String,
    /// Markup after the viewer.
    pub sections: String,
    /// Markup under the viewer in the first window: curves of a run that goes on; else empty.
    pub curves: String,
    pub data: PageData,
}

impl Page {
    /// The whole file.
    pub fn html(&self) -> anyhow::Result<String> {
        // Inside a script element nothing but its end tag is markup.
        let data = serde_json::to_string(&self.data)?.replace('<', "\\u003c");
        Ok(fill(
            PAGE,
            &[
                ("title", &escape(&self.title)),
                ("hidden", if self.data.frames.is_empty() { " hidden" } else { "" }),
                ("style", STYLE),
                ("summary", &self.summary),
                ("sections", &self.sections),
                ("curves", &self.curves),
                ("data", &data),
                ("three", THREE),
                ("script", SCRIPT),
            ],
        ))
    }

    /// Write the file.
    pub fn write(&self, path: &Path) -> anyhow::Result<()> {
        write_text(path, &self.html()?)
    }
}

/// Replace every `{{name}}` of the page; what is put in is not searched again.
pub fn fill(page: &str, parts: &[(&str, &str)]) -> String {
    let size = page.len() + parts.iter().map(|p| p.1.len()).sum::<usize>();
    let mut out = String::with_capacity(size);
    let mut rest = page;
    while let Some((before, after)) = rest.split_once("{{") {
        out += before;
        let (name, tail) = after.split_once("}}").unwrap_or((after, ""));
        out += parts.iter().find(|p| p.0 == name).map_or("", |p| p.1);
        rest = tail;
    }
    out + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_filled_in_is_not_searched() {
        assert_eq!(fill("a {{x}} b {{y}}.", &[("x", "{{y}}"), ("y", "2")]), "a {{y}} b 2.");
    }

    #[test]
    fn the_page_asks_for_nothing_from_elsewhere() {
        for (name, text) in [("html", PAGE), ("css", STYLE), ("js", SCRIPT)] {
            for word in ["http://", "https://", "@import", "fetch(", "src=\"/"] {
                assert!(!text.contains(word), "{name}: {word}");
            }
        }
        assert!(PAGE.contains("default-src 'none'"));
        assert!(!THREE.contains("</script") && !SCRIPT.contains("</script"));
    }
}
