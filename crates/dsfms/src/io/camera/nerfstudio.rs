//! Intrinsics of nerfstudio's and instant-ngp's `transforms.json`: `w`, `h`, `fl_x`, `fl_y`, `cx`, `cy` and
//! OpenCV's coefficients, as its root says them. Pixel centres lie at halves, as in COLMAP.

use super::super::error::InputError;
use super::fields::Fields;
use super::{CameraFile, brown_conrady};
use crate::camera::{CameraModel, Lens};
use serde_json::Value;
use std::path::Path;

pub(super) fn is_nerfstudio(value: &Value) -> bool {
    value.get("fl_x").is_some() || value.get("camera_angle_x").is_some()
}

pub(super) fn read(path: &Path, value: &Value) -> Result<CameraFile, InputError> {
    let fields = Fields::new(path, "", value)?;
    let fx = fields.number("fl_x")?;
    let k = |key: &str| fields.number_or(key, 0.0);
    let model = fields.get("camera_model").and_then(Value::as_str).unwrap_or("OPENCV");
    let fisheye = model.to_uppercase().contains("FISHEYE")
        || fields.get("is_fisheye").and_then(Value::as_bool) == Some(true);
    let [k1, k2, k3, k4] = [k("k1")?, k("k2")?, k("k3")?, k("k4")?];
    let lens = match fisheye {
        true => Lens::KannalaBrandt { k: [k1, k2, k3, k4] },
        false if k4 != 0.0 => {
            let problem = format!("is {k4}, but the model {model} has no such coefficient");
            return Err(fields.error("k4", problem));
        }
        false => brown_conrady([k1, k2, k3], [k("p1")?, k("p2")?]),
    };
    let camera = CameraModel {
        size: [fields.count("w")?, fields.count("h")?],
        focal: [fx, fields.number_or("fl_y", fx)?],
        centre: [fields.number("cx")? - 0.5, fields.number("cy")? - 0.5],
        lens,
    };
    Ok(CameraFile { camera, tone: None, light: None, vignetting: None })
}
