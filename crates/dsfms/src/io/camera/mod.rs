//! Camera files: our JSON, OpenCV's YAML, XML or JSON, COLMAP's `cameras.txt` or `cameras.bin`,
//! nerfstudio's `transforms.json`, the strings of P2ILF's metadata.
//!
//! The JSON holds `width`, `height`, `fx`, `fy`, `cx`, `cy` (a complete file), and optionally
//! `distortion` (`k1 k2 p1 p2 k3`, `k1` to `k4` with a `distortion_model` that says fisheye, or
//! `k1 k2 p1 p2 k3 k4 k5 k6` with one that says rational),
//! `pixel_convention`, `tone_curve`, `light` and `vignetting` (`a` of `1 + a r²`, r in focal
//! lengths). A further field is a remark where it is a text, and an error where it is anything else
//! or nearly one of these names.

mod colmap;
mod fields;
mod file;
mod json;
mod lens;
mod light;
mod nerfstudio;
mod opencv;
mod tone;
mod xml;

use super::colmap::{file_in, is_binary};
use super::error::{InputError, parse_json, read_text, write_text};
use crate::light::vignetting;
use serde_json::Value;
use std::path::Path;

/// Most bytes of a camera file; its values take thirty times as much in memory.
const MOST_TEXT: usize = 16 << 20;

pub use colmap::{ImageCameras, read_image_cameras};
pub use file::CameraFile;

/// Read a camera file; the format is told from its content. A folder is taken for a COLMAP model.
/// Everything is validated.
///
/// ```
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("camera.json");
/// std::fs::write(&path, r#"{"width": 640, "height": 480, "fx": 600, "fy": 600, "cx": 319.5, "cy": 239.5}"#)?;
/// let file = dsfms::io::camera::read_camera(&path)?;
/// assert_eq!((file.camera.size, file.camera.focal), ([640, 480], [600.0, 600.0]));
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// A file that is missing, of no known format, or with a field that is missing or impossible.
pub fn read_camera(path: &Path) -> Result<CameraFile, InputError> {
    if path.is_dir() {
        return read_camera(&file_in(path, "cameras")?);
    }
    if is_binary(path) {
        return checked(path, colmap::read(path)?);
    }
    let text = read_text(path)?;
    if text.len() > MOST_TEXT {
        return Err(InputError::format(path, "larger than 16 MiB, which no camera file is"));
    }
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let file = if text.trim_start().starts_with('{') || extension == "json" {
        let value = parse_json(path, &text)?;
        if nerfstudio::is_nerfstudio(&value) {
            nerfstudio::read(path, &value)?
        } else if is_of_poses(&value) {
            return Err(InputError::PosesForCamera(path.into()));
        } else if opencv::is_opencv(&value) {
            opencv::read(path, &value)?
        } else {
            json::read(path, &value)?
        }
    } else if text.starts_with("%YAML") || ["yml", "yaml"].contains(&extension.as_str()) {
        let value = super::yaml::parse(&text)
            .map_err(|(line, problem)| InputError::line(path, line, problem))?;
        if opencv::is_opencv(&value) {
            opencv::read(path, &value)?
        } else {
            json::read(path, &value)?
        }
    } else if text.trim_start().starts_with('<') {
        let value =
            xml::parse(&text).map_err(|(line, problem)| InputError::line(path, line, problem))?;
        opencv::read(path, &value)?
    } else {
        colmap::read(path)?
    };
    checked(path, file)
}

/// Whether a document holds poses and says nothing of a camera's images.
fn is_of_poses(value: &Value) -> bool {
    let size = ["width", "image_width", "image_Width", "image_size"];
    super::poses::holds_poses(value) && size.iter().all(|key| value.get(key).is_none())
}

fn checked(path: &Path, file: CameraFile) -> Result<CameraFile, InputError> {
    let camera = |source| InputError::Camera { path: path.into(), source };
    file.camera.validate().map_err(camera)?;
    if let Some(light) = &file.light {
        light.validate().map_err(|source| InputError::Light { path: path.into(), source })?;
    }
    let [least, most] = vignetting::BOUNDS;
    if let Some(a) = file.vignetting.filter(|a| !(least..=most).contains(a)) {
        let problem =
            format!("is {a}; expected {least} (dark corners) to {most}, the a of 1 + a r^2");
        return Err(InputError::field(path, "vignetting", problem));
    }
    Ok(file)
}

/// Write a camera file as JSON; [`read_camera`] gives the same value back.
///
/// # Errors
/// A file that cannot be written.
pub fn write_camera(path: &Path, file: &CameraFile) -> Result<(), InputError> {
    let text = serde_json::to_string_pretty(&json::write(file))
        .map_err(|error| InputError::format(path, error.to_string()))?;
    write_text(path, &(text + "\n"))
}

#[cfg(test)]
mod tests;
