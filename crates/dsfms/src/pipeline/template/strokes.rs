//! The organ, and what is not, as drawn on frames.

use super::click::{OrganClick, frame_named, shown_at};
use super::error::TemplateError;
use crate::camera::CameraModel;
use crate::dense::{DepthMap, Seeds};
use crate::geometry::{Isometry, Point2};
use crate::guard;
use crate::io::atomic::write_atomic;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A stroke over pixels that show the organ, or something else.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OrganStroke {
    /// Name of the frame; `None` = the first registered one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<String>,
    /// Whether it shows the organ.
    pub organ: bool,
    /// Corners of the stroke, px, centres at integers; one is a click.
    pub px: Vec<Point2>,
}

/// Way between two places of a stroke that are looked at, px.
const EVERY_PX: f64 = 4.0;
/// Most strokes and corners of a file.
const MOST_STROKES: usize = 1000;
const MOST_CORNERS: usize = 10_000;

impl OrganStroke {
    /// Whether it has places, not too many, near a frame.
    pub(super) fn is_sound(&self) -> bool {
        let near = |p: &Point2| p.x.abs() < 1e5 && p.y.abs() < 1e5;
        (1..=MOST_CORNERS).contains(&self.px.len()) && self.px.iter().all(near)
    }

    /// Pixels along it.
    pub(super) fn pixels(&self) -> Vec<Point2> {
        let last = self.px.last().copied();
        let legs = self.px.windows(2).flat_map(|leg| {
            let steps = ((leg[1] - leg[0]).norm() / EVERY_PX).ceil().max(1.0) as usize;
            let (from, to) = (leg[0], leg[1]);
            (0..steps).map(move |k| from + (to - from) * (k as f64 / steps as f64))
        });
        legs.take(MOST_CORNERS).chain(last).collect()
    }

    /// Name and pose of its frame, of those registered.
    pub(super) fn frame_of<'a>(
        &self,
        poses: &[(&'a str, Isometry)],
    ) -> Result<(&'a str, Isometry), TemplateError> {
        frame_named(self.frame.as_deref(), poses)
    }
}

impl From<&OrganClick> for OrganStroke {
    fn from(click: &OrganClick) -> Self {
        Self { frame: click.frame.clone(), organ: true, px: vec![click.pixel] }
    }
}

/// What was drawn on frames, as places of the surface. `registered`: name and `camera_from_world`.
pub(super) fn seeds(
    strokes: &[OrganStroke],
    registered: &[(&str, Isometry)],
    maps: &[DepthMap],
    camera: &CameraModel,
) -> Result<Seeds, TemplateError> {
    let mut seeds = Seeds::default();
    for stroke in strokes {
        let (name, pose) = stroke.frame_of(registered)?;
        let pixels = stroke.pixels();
        let places = shown_at(maps, camera, &pose, &pixels);
        if let (true, Some(&pixel)) = (places.is_empty(), pixels.first()) {
            return Err(TemplateError::ClickBeside { frame: name.to_string(), pixel });
        }
        if stroke.organ { &mut seeds.organ } else { &mut seeds.other }.extend(places);
    }
    Ok(seeds)
}

/// Why strokes could not be read.
#[derive(Debug, thiserror::Error)]
#[error("strokes {}: {reason}", path.display())]
pub struct StrokeError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong.
    pub reason: String,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    strokes: Vec<OrganStroke>,
}

/// Strokes of a JSON file:
/// `{"strokes": [{"frame": "frame_003", "organ": true, "px": [[120, 80], [130, 90]]}]}`.
///
/// ```
/// use dsfms::geometry::Point2;
/// use dsfms::pipeline::{OrganStroke, read_strokes, write_strokes};
///
/// let path = tempfile::tempdir()?.keep().join("strokes.json");
/// let px = vec![Point2::new(120.0, 80.0), Point2::new(130.0, 90.0)];
/// let strokes = [OrganStroke { frame: Some("frame_003".into()), organ: true, px }];
/// write_strokes(&path, &strokes)?;
/// assert_eq!(read_strokes(&path)?, strokes);
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// A file that cannot be read, is no such JSON, or holds a stroke without a place.
pub fn read_strokes(path: &Path) -> Result<Vec<OrganStroke>, StrokeError> {
    let text = guard::read_text_at_most(path, guard::MOST_JSON_BYTES)
        .map_err(|e| wrong(path, e.to_string()))?;
    strokes_from(&text).map_err(|reason| wrong(path, reason))
}

/// The strokes of a file's text; see [`read_strokes`].
///
/// # Errors
/// What is wrong with it.
pub fn strokes_from(text: &str) -> Result<Vec<OrganStroke>, String> {
    match drawn_from(text)? {
        strokes if strokes.is_empty() => {
            Err(format!("expected 1 to {MOST_STROKES} strokes, found 0"))
        }
        strokes => Ok(strokes),
    }
}

/// The strokes of a text like that of a file, which may be none.
///
/// # Errors
/// What is wrong with it.
pub fn drawn_from(text: &str) -> Result<Vec<OrganStroke>, String> {
    let file: File = serde_json::from_str(text).map_err(|e| {
        format!(
            "{e}; expected {{\"strokes\": [{{\"frame\": NAME, \"organ\": true, \"px\": [[x, y], ...]}}]}}"
        )
    })?;
    if file.strokes.len() > MOST_STROKES {
        return Err(format!("expected 1 to {MOST_STROKES} strokes, found {}", file.strokes.len()));
    }
    for (i, stroke) in file.strokes.iter().enumerate() {
        if !stroke.is_sound() {
            return Err(format!(
                "stroke {i}: expected 1 to {MOST_CORNERS} places px [x, y] near the frame"
            ));
        }
    }
    Ok(file.strokes)
}

/// Write strokes as [`read_strokes`] reads them; an older file of that name is replaced whole.
///
/// # Errors
/// A file that cannot be written, or would be too long to be read.
pub fn write_strokes(path: &Path, strokes: &[OrganStroke]) -> Result<(), StrokeError> {
    let file = File { strokes: strokes.to_vec() };
    let text = serde_json::to_string_pretty(&file).map_err(|e| wrong(path, e.to_string()))?;
    if text.len() as u64 > guard::MOST_JSON_BYTES {
        return Err(wrong(path, format!("more than {} MiB", guard::MOST_JSON_BYTES >> 20)));
    }
    let write = write_atomic(path, |w| w.write_all(text.as_bytes()));
    write.map_err(|e| wrong(path, e.to_string()))
}

fn wrong(path: &Path, reason: String) -> StrokeError {
    StrokeError { path: path.to_path_buf(), reason }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stroke_is_looked_at_every_few_pixels_and_at_its_end() {
        let px = [[0.0, 0.0], [10.0, 0.0], [10.0, 1.0]].map(Point2::from).to_vec();
        let stroke = OrganStroke { frame: None, organ: true, px };
        let xs: Vec<f64> = stroke.pixels().iter().map(|p| p.x).collect();
        assert_eq!(xs.len(), 5, "{xs:?}");
        assert!((xs[1] - 10.0 / 3.0).abs() < 1e-12 && xs[3] == 10.0);
        let click = OrganStroke { px: vec![Point2::new(3.0, 4.0)], ..stroke };
        assert_eq!(click.pixels(), click.px);
    }

    #[test]
    fn strokes_of_more_than_their_bound_are_not_parsed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("strokes.json");
        let file = std::fs::File::create(&path).unwrap();
        file.set_len(guard::MOST_JSON_BYTES + 1).unwrap();
        let error = read_strokes(&path).unwrap_err().to_string();
        assert!(error.contains("strokes.json") && error.contains("32 MiB"), "{error}");
        let px = vec![Point2::new(1.25, 2.25); MOST_CORNERS];
        let stroke = OrganStroke { frame: None, organ: true, px };
        assert!(write_strokes(&path, &vec![stroke; 100]).is_err());
    }

    #[test]
    fn files_that_are_no_strokes_are_told() {
        for (text, told) in [
            ("", "strokes"),
            ("{}", "strokes"),
            (r#"{"strokes": []}"#, "1 to 1000"),
            (r#"{"strokes": [{"organ": true, "px": []}]}"#, "stroke 0"),
            (r#"{"strokes": [{"organ": true, "px": [[1e9, 0]]}]}"#, "stroke 0"),
            (r#"{"strokes": [{"organ": 1, "px": [[1, 0]]}]}"#, "boolean"),
            (r#"{"strokes": [{"organ": true, "px": [[1, 0]], "wide": 3}]}"#, "wide"),
        ] {
            let found = strokes_from(text).unwrap_err();
            assert!(found.contains(told), "{text}: {found}");
        }
    }
}
