//! What a reconstruction leaves on disk. Every file appears under its final name only when it is
//! complete.

use crate::draw::overlay::{INSTRUMENT, ORGAN, found_outline, outline, overlay};
use crate::poses::rows;
use crate::reasons::sentences;
use anyhow::Context;
use dsfms::camera::CameraModel;
use dsfms::image::{Frame, Mask};
use dsfms::io::atomic::{remove_stale, write_atomic};
use dsfms::io::names::frame_number;
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::pipeline::{Method, Reconstruction, StageReport};
use dsfms::template::{LengthUnit, Template};
use dsfms::verdict::Level;
use dsfms::verdict::{Evidence, Reason};
use image::{ImageEncoder, RgbImage};
use serde::Serialize;
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Make sure, before any work, that results can be written; nothing is made yet, so that a command
/// that is refused leaves nothing behind.
pub fn check_folder(folder: &Path) -> anyhow::Result<()> {
    let full = std::path::absolute(folder).with_context(|| unwritable(folder))?;
    let standing = full.ancestors().find(|path| path.exists()).unwrap_or(&full);
    // In a file no other can be made: the system says so.
    tempfile::tempfile_in(standing).with_context(|| unwritable(folder))?;
    Ok(())
}

fn unwritable(folder: &Path) -> String {
    format!("the output folder {} cannot be written; choose another", folder.display())
}

/// Make the folder of the results.
pub fn prepare_folder(folder: &Path) -> anyhow::Result<()> {
    let refuse = || unwritable(folder);
    std::fs::create_dir_all(folder).with_context(refuse)?;
    tempfile::tempfile_in(folder).with_context(refuse)?;
    // What a killed run was in the middle of; what cannot be removed is in nobody's way.
    let _ = remove_stale(folder);
    Ok(())
}

/// [`prepare_folder`] for the folder of a file.
///
/// # Errors
/// A folder that cannot be made or written to.
pub fn prepare_for(file: &Path) -> anyhow::Result<()> {
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
    prepare_folder(folder.unwrap_or(Path::new(".")))
}

/// `frame_NNN` for every input: NNN is the last number in its name where all have one and no two
/// the same, else its place in the sequence.
pub fn output_names(inputs: &[String]) -> Vec<String> {
    let numbers: Option<Vec<u64>> = inputs.iter().map(|name| frame_number(name)).collect();
    let unique = numbers.filter(|n| n.iter().collect::<BTreeSet<_>>().len() == inputs.len());
    let numbers = unique.unwrap_or_else(|| (0..inputs.len() as u64).collect());
    numbers.iter().map(|n| format!("frame_{n:03}")).collect()
}

/// `OUT/frame_NNN.json`.
#[derive(Clone, Debug, Serialize)]
pub struct FrameReport {
    /// `ok`, `degraded` or `failed`.
    pub status: &'static str,
    /// Why it is not `ok`.
    pub reasons: Vec<String>,
    /// The same as figures, where the surface was judged.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub doubts: Vec<Reason>,
    /// What they were judged by.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub evidence: Option<Evidence>,
    /// Name of the input.
    pub input: String,
    pub method: Method,
    /// `mm` or `template_units`.
    pub unit: &'static str,
    /// `camera_from_template`, 4 x 4, row by row.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pose: Option<[[f64; 4]; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gain: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ambient: Option<f64>,
    pub matches: usize,
    pub matches_kept: usize,
    pub visible_vertices: usize,
    /// Where the method predicts its error.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub expected_error: Option<ExpectedError>,
    /// Name, seconds and, where the stage solves, the cost of each term before and after.
    pub stages: Vec<StageReport>,
    pub seconds: f64,
}

/// The predicted error of one frame, length units.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ExpectedError {
    /// Median over the visible vertices.
    pub visible_median: f64,
    /// 90th percentile over the visible vertices.
    pub visible_p90: f64,
    /// Nine vertices of ten are off by less than this multiple of their expected error.
    pub bound: f64,
    /// Vertices that nothing in the frame spoke of.
    pub unobserved_vertices: usize,
}

impl ExpectedError {
    fn of(result: &Reconstruction) -> Option<Self> {
        let (errors, observed) = result.expected_error.as_ref().zip(result.observed.as_ref())?;
        let seen = errors.iter().zip(&result.visible).filter(|(_, seen)| **seen);
        let mut seen: Vec<f64> = seen.map(|(error, _)| *error).collect();
        seen.sort_unstable_by(f64::total_cmp);
        Some(Self {
            visible_median: *seen.get(seen.len() / 2)?,
            visible_p90: *seen.get(seen.len() * 9 / 10)?,
            bound: result.error_bound?,
            unobserved_vertices: observed.iter().filter(|&&o| !o).count(),
        })
    }
}

impl FrameReport {
    /// The report of a frame that gave a surface: only the verdict of one that must not be shown.
    pub fn of(input: &str, method: Method, unit: LengthUnit, result: &Reconstruction) -> Self {
        let judged = Self {
            reasons: sentences(&result.verdict.reasons),
            doubts: result.verdict.reasons.clone(),
            evidence: Some(result.evidence.clone()),
            ..Self::failed(input, method, unit, String::new())
        };
        if result.verdict.level == Level::Lost {
            return judged;
        }
        Self {
            status: result.verdict.level.label(),
            pose: Some(rows(&result.pose)),
            gain: Some(result.gain),
            ambient: Some(result.ambient),
            matches: result.matches.len(),
            matches_kept: result.matches.iter().filter(|m| m.1).count(),
            visible_vertices: result.visible.iter().filter(|&&v| v).count(),
            expected_error: ExpectedError::of(result),
            stages: result.stages.clone(),
            seconds: result.stages.iter().map(|s| s.seconds).sum(),
            ..judged
        }
    }

    /// The report of a frame that gave none.
    pub fn failed(input: &str, method: Method, unit: LengthUnit, why: String) -> Self {
        Self {
            status: "failed",
            reasons: vec![why],
            doubts: Vec::new(),
            evidence: None,
            input: input.to_string(),
            method,
            unit: unit.label(),
            pose: None,
            gain: None,
            ambient: None,
            matches: 0,
            matches_kept: 0,
            visible_vertices: 0,
            expected_error: None,
            stages: Vec::new(),
            seconds: 0.0,
        }
    }

    fn cost(&self, which: fn((f64, f64)) -> f64) -> String {
        let last = self.stages.iter().rev().find_map(|s| s.summary.as_ref());
        last.map_or(String::new(), |s| format!("{:.6e}", which(s.cost())))
    }
}

/// The masks of a frame, where it has any.
#[derive(Default)]
pub struct FrameMasks {
    pub instrument: Option<Mask>,
    pub organ: Option<Mask>,
}

impl FrameMasks {
    /// Draw their outlines.
    pub fn outline(&self, picture: &mut RgbImage) {
        for (mask, colour) in [(&self.organ, ORGAN), (&self.instrument, INSTRUMENT)] {
            if let Some(mask) = mask {
                outline(picture, mask, colour);
            }
        }
    }
}

/// Where the files of one frame go.
pub struct FrameFiles<'a> {
    pub folder: &'a Path,
    /// `frame_NNN`.
    pub name: &'a str,
}

impl FrameFiles<'_> {
    fn path(&self, ending: &str) -> PathBuf {
        self.folder.join(format!("{}{ending}", self.name))
    }

    /// Mesh and overlay.
    pub fn write_surface(
        &self,
        template: &Template,
        frame: &Frame,
        camera: &CameraModel,
        result: &Reconstruction,
        masks: &FrameMasks,
    ) -> anyhow::Result<()> {
        let comments = ["camera axes of the frame: x right, y down, z forward".to_string()];
        let extras = PlyExtras {
            comments: &comments,
            visible: Some(&result.visible),
            expected_error: result.expected_error.as_deref(),
            observed: result.observed.as_deref(),
            region: Some(&result.regions),
            ..Default::default()
        };
        let topology = &template.mesh.topology;
        write_ply(&self.path(".ply"), topology, &result.vertices, template.unit, &extras)?;
        let mut picture =
            overlay(frame, camera, topology, &result.vertices, &result.visible, &result.matches);
        masks.outline(&mut picture);
        if let Some(outline) = &result.outline {
            found_outline(&mut picture, outline, ORGAN);
        }
        write_png(&self.path("_overlay.png"), &picture)
    }

    /// The report.
    pub fn write_report(&self, report: &FrameReport) -> anyhow::Result<()> {
        write_json(&self.path(".json"), report)
    }
}

/// Pretty JSON with a final line end.
pub fn write_json(path: &Path, value: &impl Serialize) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(value)?;
    Ok(write_atomic(path, |w| writeln!(w, "{text}"))?)
}

/// A whole text.
pub fn write_text(path: &Path, text: &str) -> anyhow::Result<()> {
    Ok(write_atomic(path, |w| w.write_all(text.as_bytes()))?)
}

/// A picture as PNG.
pub fn write_png(path: &Path, picture: &RgbImage) -> anyhow::Result<()> {
    write_bytes(path, &encode_png(picture)?)
}

/// A file of these bytes.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    Ok(write_atomic(path, |file| file.write_all(bytes))?)
}

/// The bytes of a PNG file.
pub fn encode_png(picture: &RgbImage) -> anyhow::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let (w, h) = picture.dimensions();
    image::codecs::png::PngEncoder::new(&mut bytes).write_image(
        picture,
        w,
        h,
        image::ExtendedColorType::Rgb8,
    )?;
    Ok(bytes)
}

/// The bytes of a PNG file that says how many pixels an inch of paper has.
pub fn encode_png_at(picture: &RgbImage, dpi: f64) -> anyhow::Result<Vec<u8>> {
    let bytes = encode_png(picture)?;
    // Signature and header come first, 8 and 25 bytes.
    let (head, rest) = bytes.split_at(33);
    let per_metre = ((dpi / 0.0254).round() as u32).to_be_bytes();
    let chunk = [&b"pHYs"[..], &per_metre, &per_metre, &[1]].concat();
    let mut sum = flate2::Crc::new();
    sum.update(&chunk);
    Ok([head, &9u32.to_be_bytes(), &chunk, &sum.sum().to_be_bytes(), rest].concat())
}

/// `OUT/summary.csv`: one row a frame.
pub fn summary_csv(rows: &[(String, FrameReport)]) -> String {
    let mut text = String::from(
        "frame,input,status,reasons,method,seconds,gain,ambient,matches,matches_kept,\
         visible_vertices,cost_before,cost_after,expected_error_median,\
         expected_error_p90,unobserved_vertices\n",
    );
    let number = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:.6}"));
    for (name, r) in rows {
        let method = r.method.name();
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{name},{},{},{},{method},{:.3},{},{},{},{},{},{},{},{},{},{}",
            quoted(&r.input),
            r.status,
            quoted(&r.reasons.join("; ")),
            r.seconds,
            number(r.gain),
            number(r.ambient),
            r.matches,
            r.matches_kept,
            r.visible_vertices,
            r.cost(|c| c.0),
            r.cost(|c| c.1),
            number(r.expected_error.map(|e| e.visible_median)),
            number(r.expected_error.map(|e| e.visible_p90)),
            r.expected_error.map_or(String::new(), |e| e.unobserved_vertices.to_string()),
        );
    }
    text
}

/// A CSV field: quoted where it holds a comma, a quote or a line end.
pub fn quoted(text: &str) -> String {
    match text.contains([',', '"', '\n']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_come_from_the_names_where_they_can() {
        let names = |inputs: &[&str]| {
            output_names(&inputs.iter().map(|s| s.to_string()).collect::<Vec<_>>())
        };
        assert_eq!(names(&["frame_007", "frame_012"]), ["frame_007", "frame_012"]);
        assert_eq!(names(&["a7", "b7"]), ["frame_000", "frame_001"]);
        assert_eq!(names(&["left", "b7"]), ["frame_000", "frame_001"]);
    }

    #[test]
    fn csv_fields_with_commas_are_quoted() {
        assert_eq!(quoted("a, \"b\""), "\"a, \"\"b\"\"\"");
        assert_eq!(quoted("plain"), "plain");
    }
}
