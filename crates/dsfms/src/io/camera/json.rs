//! The camera JSON of this program.

use super::super::error::InputError;
use super::fields::{Fields, flat_numbers};
use super::file::CameraFile;
use super::lens::lens_kind;
use super::{light, tone};
use crate::camera::{CameraModel, Lens, LensKind};
use serde_json::{Map, Value, json};
use std::path::Path;

/// Every field that is read.
const KNOWN: [&str; 23] = [
    "width",
    "height",
    "fx",
    "fy",
    "cx",
    "cy",
    "skew",
    "distortion_model",
    "camera_model",
    "distortion",
    "k1",
    "k2",
    "p1",
    "p2",
    "k3",
    "k4",
    "k5",
    "k6",
    "pixel_convention",
    "tone_curve",
    "tone",
    "light",
    "vignetting",
];

/// Coefficients of any lens.
const COEFFICIENTS: [&str; 8] = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"];

/// Coefficients by name.
type Named = Vec<(&'static str, f64)>;

pub(super) fn read(path: &Path, value: &Value) -> Result<CameraFile, InputError> {
    let fields = Fields::new(path, "", value)?;
    let size = [fields.count("width")?, fields.count("height")?];
    let shift = pixel_shift(&fields)?;
    let camera = CameraModel {
        size,
        focal: [fields.number("fx")?, fields.number("fy")?],
        centre: [fields.number("cx")? - shift, fields.number("cy")? - shift],
        lens: lens(&fields)?,
    };
    if fields.get("skew").is_some() && fields.number("skew")? != 0.0 {
        return Err(fields.error("skew", "is not 0, which no camera model here has"));
    }
    // A missing field is named first, with what was found in its place.
    fields.check_names(&KNOWN, true)?;
    let tone = fields.get("tone_curve").or(fields.get("tone"));
    Ok(CameraFile {
        camera,
        tone: tone.map(|value| tone::read(path, value)).transpose()?,
        light: fields.get("light").map(|value| light::read(path, value)).transpose()?,
        vignetting: fields.get("vignetting").map(|_| fields.number("vignetting")).transpose()?,
    })
}

/// What to subtract from cx and cy so that pixel centres lie at integers.
fn pixel_shift(fields: &Fields) -> Result<f64, InputError> {
    let Some(value) = fields.get("pixel_convention") else { return Ok(0.0) };
    let Some(text) = value.as_str() else {
        return Err(fields.error("pixel_convention", "expected a text"));
    };
    let text = text.to_lowercase().replace(char::is_whitespace, "");
    let half = text.contains("0.5") || (text.contains("colmap") && !text.contains("opencv"));
    let corner = text.contains("corner") && !text.contains("cent");
    Ok(if half || corner { 0.5 } else { 0.0 })
}

fn lens(fields: &Fields) -> Result<Lens, InputError> {
    let key = fields.first(&["distortion_model", "camera_model"]);
    let kind = lens_kind(fields.path, "distortion_model", key.map(|(_, value)| value))?;
    let named = match fields.get("distortion") {
        Some(Value::Array(_)) => return listed(fields, kind),
        Some(value) => named(fields.path, value)?,
        None => coefficients(fields)?,
    };
    let unused = named.iter().find(|c| c.1 != 0.0 && !kind.coefficients.contains(&c.0));
    if let Some((name, value)) = unused {
        let kinds: Vec<String> = Lens::KINDS.iter().map(LensKind::expected).collect();
        let problem = format!(
            "is {value} but the distortion model {} has no such coefficient ({})",
            kind.name,
            kinds.join("; ")
        );
        return Err(InputError::field(fields.path, format!("distortion.{name}"), problem));
    }
    Ok(kind.named_coefficients(&named).simplest())
}

/// `"distortion": { "k1": …, … }`: a name that is no coefficient is an error unless it is a text.
fn named(path: &Path, value: &Value) -> Result<Named, InputError> {
    let fields = Fields::new(path, "distortion", value)?;
    for (key, value) in fields.keys() {
        if !COEFFICIENTS.contains(&key.as_str()) && !value.is_string() {
            let known = COEFFICIENTS.join(", ");
            return Err(fields.error(key, format!("is no coefficient; expected {known}")));
        }
    }
    coefficients(&fields)
}

fn coefficients(fields: &Fields) -> Result<Named, InputError> {
    COEFFICIENTS.iter().map(|&key| Ok((key, fields.number_or(key, 0.0)?))).collect()
}

/// `"distortion": [k1, k2, p1, p2, k3]`, or what else the model has, in OpenCV's order; what is
/// left out at its end is 0.
fn listed(fields: &Fields, kind: &LensKind) -> Result<Lens, InputError> {
    let value = fields.get("distortion").unwrap_or(&Value::Null);
    let mut list = flat_numbers(value).map_err(|problem| fields.error("distortion", problem))?;
    list.resize(list.len().max(kind.coefficients.len()), 0.0);
    kind.listed_coefficients(&list).map_err(|problem| fields.error("distortion", problem))
}

pub(super) fn write(file: &CameraFile) -> Value {
    let camera = &file.camera;
    let coefficients = camera.lens.coefficients().into_iter();
    let distortion: Map<_, _> = coefficients.map(|(key, v)| (key.to_owned(), json!(v))).collect();
    let mut out = json!({
        "width": camera.size[0],
        "height": camera.size[1],
        "fx": camera.focal[0],
        "fy": camera.focal[1],
        "cx": camera.centre[0],
        "cy": camera.centre[1],
        "distortion_model": camera.lens.kind().name,
        "distortion": distortion,
        "pixel_convention": "opencv",
    });
    if let Some(tone) = &file.tone {
        out["tone_curve"] = tone::write(tone);
    }
    if let Some(light) = &file.light {
        out["light"] = light::write(light);
    }
    if let Some(a) = file.vignetting {
        out["vignetting"] = json!(a);
    }
    out
}
