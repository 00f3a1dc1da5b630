//! Intrinsics of nerfstudio's and instant-ngp's `transforms.json`: `w`, `h`, `fl_x`, `fl_y`, `cx`,
//! `cy` and OpenCV's coefficients, as its root says them. Pixel centres lie at halves, as in
//! COLMAP.

use super::super::error::InputError;
use super::fields::Fields;
use super::file::CameraFile;
use super::lens::lens_kind;
use crate::camera::CameraModel;
use serde_json::Value;
use std::path::Path;

/// What the model of a fisheye says.
const FISHEYE: &str = "FISHEYE";

pub(super) fn is_nerfstudio(value: &Value) -> bool {
    value.get("fl_x").is_some() || value.get("camera_angle_x").is_some()
}

pub(super) fn read(path: &Path, value: &Value) -> Result<CameraFile, InputError> {
    let fields = Fields::new(path, "", value)?;
    let fx = fields.number("fl_x")?;
    let model = fields.get("camera_model").and_then(Value::as_str).unwrap_or("OPENCV");
    let fisheye = model.to_uppercase().contains(FISHEYE)
        || fields.get("is_fisheye").and_then(Value::as_bool) == Some(true);
    let kind = lens_kind(path, "camera_model", fisheye.then_some(&FISHEYE.into()))?;
    let mut named = Vec::new();
    for name in ["k1", "k2", "k3", "k4", "p1", "p2"] {
        let value = fields.number_or(name, 0.0)?;
        // Of a fisheye nerfstudio writes p1 and p2 as well, and does not use them.
        if value != 0.0 && kind.perspective && !kind.coefficients.contains(&name) {
            let problem = format!("is {value}, but the model {model} has no such coefficient");
            return Err(fields.error(name, problem));
        }
        named.push((name, value));
    }
    let lens = kind.named_coefficients(&named).simplest();
    let camera = CameraModel {
        size: [fields.count("w")?, fields.count("h")?],
        focal: [fx, fields.number_or("fl_y", fx)?],
        centre: [fields.number("cx")? - 0.5, fields.number("cy")? - 0.5],
        lens,
    };
    Ok(CameraFile { camera, tone: None, light: None, vignetting: None })
}
