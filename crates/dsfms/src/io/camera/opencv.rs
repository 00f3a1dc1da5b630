//! OpenCV calibrations, from YAML or JSON: `camera_matrix`, `distortion_coefficients`,
//! `image_width`, `image_height`, under the names that OpenCV's sample, ROS and common scripts use.

use super::super::error::InputError;
use super::fields::{Fields, flat_numbers};
use super::file::CameraFile;
use super::lens::lens_kind;
use crate::camera::{CameraModel, Lens, LensKind};
use serde_json::Value;
use std::path::Path;

const MATRIX: [&str; 9] = [
    "camera_matrix",
    "cameraMatrix",
    "Camera_Matrix",
    "intrinsic_matrix",
    "intrinsics",
    "intrinsic",
    "mtx",
    "K",
    "M1",
];
const DISTORTION: [&str; 10] = [
    "distortion_coefficients",
    "Distortion_Coefficients",
    "dist_coeffs",
    "distCoeffs",
    "dist_coeff",
    "distortion_coeffs",
    "distortion",
    "dist",
    "D",
    "D1",
];
const WIDTH: [&str; 3] = ["image_width", "image_Width", "width"];
const HEIGHT: [&str; 3] = ["image_height", "image_Height", "height"];
const SIZE: [&str; 3] = ["image_size", "imageSize", "resolution"];
const FISHEYE: [&str; 2] = ["fisheye_model", "fisheye"];
const MODEL: [&str; 3] = ["distortion_model", "camera_model", "model"];

/// Whether a document has a matrix of intrinsics instead of fx and fy.
pub(super) fn is_opencv(value: &Value) -> bool {
    value.get("fx").is_none() && MATRIX.iter().any(|key| value.get(key).is_some())
}

pub(super) fn read(path: &Path, value: &Value) -> Result<CameraFile, InputError> {
    let fields = Fields::new(path, "", value)?;
    let known = [&MATRIX[..], &DISTORTION, &WIDTH, &HEIGHT, &MODEL, &SIZE, &FISHEYE].concat();
    fields.check_names(&known, false)?;
    let Some((key, _)) = fields.first(&MATRIX) else {
        return Err(fields.error(MATRIX[0], "is missing"));
    };
    let k = numbers(&fields, key)?;
    let [fx, skew, cx, zero, fy, cy, zero2, zero3, one] = k.as_slice() else {
        return Err(fields.error(key, format!("holds {} numbers, expected 3x3", k.len())));
    };
    if *skew != 0.0 || [*zero, *zero2, *zero3] != [0.0; 3] || *one != 1.0 {
        let problem = "expected [fx 0 cx; 0 fy cy; 0 0 1], without skew, row by row";
        return Err(fields.error(key, problem));
    }
    let camera = CameraModel {
        size: size(&fields)?,
        focal: [*fx, *fy],
        centre: [*cx, *cy],
        lens: lens(&fields)?,
    };
    Ok(CameraFile { camera, tone: None, light: None, vignetting: None })
}

fn size(fields: &Fields) -> Result<[usize; 2], InputError> {
    if let Some((key, value)) = fields.first(&SIZE) {
        let numbers = flat_numbers(value).map_err(|problem| fields.error(key, problem))?;
        if let [w, h] = numbers.as_slice()
            && [w, h].iter().all(|v| **v >= 1.0 && v.fract() == 0.0)
        {
            return Ok([*w as usize, *h as usize]);
        }
        return Err(fields.error(key, "expected [width, height] in px"));
    }
    let key = |keys: &[&'static str]| fields.first(keys).map_or(keys[0], |(key, _)| key);
    Ok([fields.count(key(&WIDTH))?, fields.count(key(&HEIGHT))?])
}

fn lens(fields: &Fields) -> Result<Lens, InputError> {
    let told = match fields.first(&MODEL) {
        Some((key, value)) => Some(lens_kind(fields.path, key, Some(value))?),
        None if flagged_fisheye(fields) => LensKind::told("fisheye"),
        None => None,
    };
    let Some((key, _)) = fields.first(&DISTORTION) else {
        return match told.filter(|kind| !kind.perspective) {
            Some(kind) => {
                Err(fields.error(DISTORTION[0], format!("is missing; {}", kind.expected())))
            }
            None => Ok(Lens::default()),
        };
    };
    let c = numbers(fields, key)?;
    // OpenCV tells its own models apart by the number of their coefficients.
    let told = told.or_else(|| LensKind::told("rational").filter(|_| c.len() >= 8));
    let kind = told.map_or_else(|| lens_kind(fields.path, key, None), Ok)?;
    kind.listed_coefficients(&c).map_err(|problem| {
        let more =
            if c.len() > 8 { "; thin-prism and tilted models are not supported" } else { "" };
        fields.error(key, problem + more)
    })
}

/// OpenCV's sample writes `fisheye_model: 1`; others `fisheye: true`.
fn flagged_fisheye(fields: &Fields) -> bool {
    fields.first(&FISHEYE).is_some_and(|(_, value)| {
        value.as_bool().unwrap_or_else(|| value.as_f64().is_some_and(|v| v != 0.0))
    })
}

/// A matrix as nested lists, a flat list, or `{ rows, cols, data }`.
fn numbers(fields: &Fields, key: &str) -> Result<Vec<f64>, InputError> {
    let value = fields.get(key).unwrap_or(&Value::Null);
    let value = value.get("data").unwrap_or(value);
    if !value.is_array() {
        return Err(fields.error(key, "expected a list of numbers, or rows, cols and data"));
    }
    flat_numbers(value).map_err(|problem| fields.error(key, problem))
}
