//! COLMAP's `cameras.txt`: `CAMERA_ID MODEL WIDTH HEIGHT PARAMS…`, pixel centres at half integers.

use super::super::error::InputError;
use super::{CameraFile, brown_conrady};
use crate::camera::{CameraModel, Lens};
use std::path::Path;

/// The first camera of the file; several must be equal.
pub(super) fn read(path: &Path, text: &str) -> Result<CameraFile, InputError> {
    let mut found: Option<CameraModel> = None;
    for (i, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let camera = camera(line).map_err(|problem| InputError::line(path, i + 1, problem))?;
        match &found {
            Some(first) if *first != camera => {
                let problem = "a second, different camera; all frames must come from one camera, so keep one line";
                return Err(InputError::line(path, i + 1, problem));
            }
            _ => found = Some(camera),
        }
    }
    match found {
        Some(camera) => Ok(CameraFile { camera, tone: None, light: None }),
        None => Err(InputError::format(
            path,
            "no camera in the file; expected JSON, OpenCV YAML, or COLMAP's CAMERA_ID MODEL WIDTH HEIGHT PARAMS",
        )),
    }
}

fn camera(line: &str) -> Result<CameraModel, String> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let [_, model, width, height, parameters @ ..] = words.as_slice() else {
        return Err(
            "expected JSON, OpenCV YAML, or COLMAP's CAMERA_ID MODEL WIDTH HEIGHT PARAMS".into()
        );
    };
    let pixels = |word: &str, name: &str| {
        word.parse::<usize>()
            .map_err(|_| format!("{name} is {word:?}; expected a whole number of px"))
    };
    let size = [pixels(width, "WIDTH")?, pixels(height, "HEIGHT")?];
    let number = |word: &&str| match word.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(format!("parameter {word:?} is no finite number")),
    };
    let parameters = parameters.iter().map(number).collect::<Result<Vec<_>, _>>()?;
    let (focal, centre, lens) = intrinsics(model, &parameters)?;
    Ok(CameraModel { size, focal, centre: centre.map(|c| c - 0.5), lens })
}

type Intrinsics = ([f64; 2], [f64; 2], Lens);

fn intrinsics(model: &str, parameters: &[f64]) -> Result<Intrinsics, String> {
    match (model, parameters) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => Ok(([f, f], [cx, cy], Lens::Pinhole)),
        ("PINHOLE", &[fx, fy, cx, cy]) => Ok(([fx, fy], [cx, cy], Lens::Pinhole)),
        ("SIMPLE_RADIAL", &[f, cx, cy, k]) => {
            Ok(([f, f], [cx, cy], brown_conrady([k, 0.0, 0.0], [0.0; 2])))
        }
        ("RADIAL", &[f, cx, cy, k1, k2]) => {
            Ok(([f, f], [cx, cy], brown_conrady([k1, k2, 0.0], [0.0; 2])))
        }
        ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => {
            Ok(([fx, fy], [cx, cy], brown_conrady([k1, k2, 0.0], [p1, p2])))
        }
        ("OPENCV_FISHEYE", &[fx, fy, cx, cy, k1, k2, k3, k4]) => {
            Ok(([fx, fy], [cx, cy], Lens::KannalaBrandt { k: [k1, k2, k3, k4] }))
        }
        (
            "SIMPLE_PINHOLE" | "PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "OPENCV" | "OPENCV_FISHEYE",
            p,
        ) => Err(format!("{} parameters do not fit the model {model}", p.len())),
        _ => Err(format!(
            "camera model {model:?} is not supported; expected PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV or OPENCV_FISHEYE"
        )),
    }
}
