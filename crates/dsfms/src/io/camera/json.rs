//! The camera JSON of this program.

use super::super::error::InputError;
use super::fields::{Fields, flat_numbers};
use super::{CameraFile, Family, brown_conrady, family, light, tone};
use crate::camera::{CameraModel, Lens};
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

const COEFFICIENTS: [&str; 8] = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"];

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
    let family = family(fields.path, "distortion_model", key.map(|(_, value)| value))?;
    let c = match fields.get("distortion") {
        Some(Value::Array(_)) => listed(fields)?,
        Some(value) => named(fields.path, value)?,
        None => coefficients(fields)?,
    };
    from_coefficients(fields.path, family, &c)
}

/// The lens of k1 k2 p1 p2 k3 k4 k5 k6.
fn from_coefficients(path: &Path, family: Family, c: &[f64; 8]) -> Result<Lens, InputError> {
    let [k1, k2, p1, p2, k3, k4, ..] = *c;
    let unused = |used: &[usize]| {
        (0..8).find(|i| c[*i] != 0.0 && !used.contains(i)).map(|i| {
            let problem = format!("is {} but the distortion model has no such coefficient (brown_conrady: k1 k2 p1 p2 k3, rational models are not supported; fisheye: k1 to k4)", c[i]);
            InputError::field(path, format!("distortion.{}", COEFFICIENTS[i]), problem)
        })
    };
    let (lens, used): (_, &[usize]) = match family {
        Family::Pinhole => (Lens::Pinhole, &[]),
        Family::BrownConrady => (brown_conrady([k1, k2, k3], [p1, p2]), &[0, 1, 2, 3, 4]),
        Family::Fisheye => (Lens::KannalaBrandt { k: [k1, k2, k3, k4] }, &[0, 1, 4, 5]),
    };
    unused(used).map_or(Ok(lens), Err)
}

/// `"distortion": { "k1": …, … }`: a name that is no coefficient is an error unless it is a text.
fn named(path: &Path, value: &Value) -> Result<[f64; 8], InputError> {
    let fields = Fields::new(path, "distortion", value)?;
    for (key, value) in fields.keys() {
        if !COEFFICIENTS.contains(&key.as_str()) && !value.is_string() {
            let known = COEFFICIENTS.join(", ");
            return Err(fields.error(key, format!("is no coefficient; expected {known}")));
        }
    }
    coefficients(&fields)
}

fn coefficients(fields: &Fields) -> Result<[f64; 8], InputError> {
    let mut out = [0.0; 8];
    for (out, key) in out.iter_mut().zip(COEFFICIENTS) {
        *out = fields.number_or(key, 0.0)?;
    }
    Ok(out)
}

/// `"distortion": [k1, k2, p1, p2, k3]`, or `[k1, k2, k3, k4]` of a fisheye.
fn listed(fields: &Fields) -> Result<[f64; 8], InputError> {
    let value = fields.get("distortion").unwrap_or(&Value::Null);
    let list = flat_numbers(value).map_err(|problem| fields.error("distortion", problem))?;
    let key = fields.first(&["distortion_model", "camera_model"]);
    let fisheye =
        family(fields.path, "distortion_model", key.map(|(_, value)| value))? == Family::Fisheye;
    // Where each entry of the list belongs among k1 k2 p1 p2 k3 k4 k5 k6.
    let places: &[usize] = if fisheye { &[0, 1, 4, 5] } else { &[0, 1, 2, 3, 4, 5, 6, 7] };
    if list.len() > places.len() {
        let problem = format!("holds {} numbers, at most {} are known", list.len(), places.len());
        return Err(fields.error("distortion", problem));
    }
    let mut out = [0.0; 8];
    places.iter().zip(list).for_each(|(&place, value)| out[place] = value);
    Ok(out)
}

pub(super) fn write(file: &CameraFile) -> Value {
    let camera = &file.camera;
    let model = match camera.lens {
        Lens::Pinhole => "none",
        Lens::BrownConrady { .. } => "brown_conrady",
        Lens::KannalaBrandt { .. } => "kannala_brandt",
    };
    let coefficients = camera.lens.coefficients().into_iter();
    let distortion: Map<_, _> = coefficients.map(|(key, v)| (key.to_owned(), json!(v))).collect();
    let mut out = json!({
        "width": camera.size[0],
        "height": camera.size[1],
        "fx": camera.focal[0],
        "fy": camera.focal[1],
        "cx": camera.centre[0],
        "cy": camera.centre[1],
        "distortion_model": model,
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
