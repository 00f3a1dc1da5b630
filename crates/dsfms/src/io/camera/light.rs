//! The light of a camera file: in fields (`docs/camera.schema.json`), or, in older files, in the words of
//! a description.

use super::super::error::InputError;
use super::REFERENCE_DISTANCE;
use super::fields::{Fields, flat_numbers, numbers_in};
use crate::geometry::Point3;
use crate::light::{LightModel, PointLight, Spot};
use serde_json::{Value, json};
use std::path::Path;

const DISTANT: [&str; 5] = ["collinear", "distant", "directional", "parallel", "infinite"];
const NEAR: [&str; 6] = ["offset", "point", "near", "ring", "spot", "several"];
const AT_CAMERA: [&str; 4] = ["colocated", "co-located", "coaxial", "camera"];

/// Fields that are read, besides those of places.
const KNOWN: [&str; 8] = [
    "kind",
    "type",
    "reference_distance",
    "reference_distance_mm",
    "spot",
    "falloff",
    "fall_off",
    "profile",
];

pub(super) fn read(path: &Path, value: &Value) -> Result<LightModel, InputError> {
    // A bare word: "light": "collinear".
    if let Some(word) = value.as_str() {
        return read(path, &json!({ "kind": word }));
    }
    let fields = Fields::new(path, "light", value)?;
    let places = fields.keys().map(|(key, _)| key.as_str()).filter(|key| is_place(key));
    let known: Vec<&str> = KNOWN.into_iter().chain(places).collect();
    fields.check_names(&known, true)?;
    let kind = match fields.get("kind").or(fields.get("type")) {
        Some(kind) => kind.as_str().unwrap_or_default().to_lowercase(),
        None if positions(&fields)?.is_some() => "point".into(),
        None => return Err(fields.error("kind", format!("is missing; expected {}", kinds()))),
    };
    let says = |words: &[&str]| words.iter().any(|word| kind.contains(word));
    let positions = positions(&fields)?;
    let positions = match positions {
        _ if says(&DISTANT) => return Ok(LightModel::Collinear),
        Some(positions) if says(&NEAR) || says(&AT_CAMERA) => positions,
        None if says(&AT_CAMERA) => vec![Point3::origin()],
        None if says(&NEAR) => {
            let problem = "is missing; expected a list of [x, y, z] in camera axes (offsets_mm_camera_frame does as well)";
            return Err(fields.error("positions", problem));
        }
        _ => {
            return Err(
                fields.error("kind", format!("{kind:?} is not known; expected {}", kinds()))
            );
        }
    };
    let distance = fields.first(&["reference_distance", "reference_distance_mm"]);
    let reference_distance = match distance {
        Some((key, _)) => fields.number(key)?,
        None => REFERENCE_DISTANCE,
    };
    Ok(LightModel::Point(PointLight { positions, reference_distance, spot: spot(&fields)? }))
}

fn kinds() -> &'static str {
    "\"point\" (with positions), \"colocated\" or \"collinear\""
}

fn is_place(key: &str) -> bool {
    key.starts_with("position") || key.starts_with("offset")
}

/// The field that begins like `position` or `offset`: one `[x, y, z]` or a list of them.
fn positions(fields: &Fields) -> Result<Option<Vec<Point3>>, InputError> {
    let Some((key, value)) = fields.keys().find(|(key, v)| is_place(key) && !v.is_null()) else {
        return Ok(None);
    };
    let expected = "expected a list of [x, y, z]";
    let triple = |value: &Value| {
        let numbers = flat_numbers(value).map_err(|problem| fields.error(key, problem))?;
        let [x, y, z] = numbers.as_slice() else { return Err(fields.error(key, expected)) };
        Ok(Point3::new(*x, *y, *z))
    };
    match value.as_array() {
        Some(items) if items.iter().any(Value::is_array) => {
            Ok(Some(items.iter().map(triple).collect::<Result<_, _>>()?))
        }
        Some(items) if !items.is_empty() => Ok(Some(vec![triple(value)?])),
        _ => Err(fields.error(key, expected)),
    }
}

fn spot(fields: &Fields) -> Result<Spot, InputError> {
    if let Some(value) = fields.get("spot") {
        return spot_of_value(fields, value);
    }
    let described = fields.first(&["falloff", "fall_off", "profile"]);
    let Some((key, value)) = described else { return Ok(Spot::Isotropic) };
    let Some(text) = value.as_str() else { return Err(fields.error(key, "expected a text")) };
    let text = text.to_lowercase();
    let decays = ["inverse", "1/r", "quadratic", "square"].iter().any(|word| text.contains(word));
    if !decays && ["none", "constant", "no fall"].iter().any(|word| text.contains(word)) {
        let problem = "a near light without inverse-square fall-off is not modelled; use kind \"collinear\" for a distant one";
        return Err(fields.error(key, problem));
    }
    spot_of_text(&text).ok_or_else(|| {
        fields.error(key, "the spot profile is not understood; give \"spot\": {\"inner_deg\": …, \"outer_deg\": …} or {\"exponent\": …}")
    })
}

/// Two angles in degrees are a linear profile, `cos^n` a power; no word of a profile is none.
fn spot_of_text(text: &str) -> Option<Spot> {
    let unit = |after: &str| {
        let after = after.trim_start_matches([' ', '-']);
        after.starts_with("deg") || after.starts_with('°')
    };
    let numbers = numbers_in(text);
    let angles: Vec<f64> = numbers.iter().filter(|(_, after)| unit(after)).map(|n| n.0).collect();
    if let Some(at) = text.find("cos") {
        let exponent = numbers_in(&text[at..]).first().map_or(1.0, |n| n.0);
        return angles.is_empty().then_some(Spot::CosinePower { exponent });
    }
    match angles.as_slice() {
        [a, b] => Some(Spot::Linear { inner_deg: a.min(*b), outer_deg: a.max(*b) }),
        [] if !text.contains("profile") && !text.contains("spot") => Some(Spot::Isotropic),
        [] if text.contains("no spot") || text.contains("isotropic") => Some(Spot::Isotropic),
        _ => None,
    }
}

/// Our own notation, or its fields without the name of the profile.
fn spot_of_value(fields: &Fields, value: &Value) -> Result<Spot, InputError> {
    let has = |key: &str| value.get(key).is_some();
    let wrapped = if has("inner_deg") || has("outer_deg") {
        json!({ "linear": value })
    } else if has("exponent") {
        json!({ "cosine_power": value })
    } else {
        value.clone()
    };
    serde_json::from_value(wrapped).map_err(|error| {
        fields.error("spot", format!("{error}; expected \"isotropic\", {{\"inner_deg\": …, \"outer_deg\": …}} or {{\"exponent\": …}}"))
    })
}

pub(super) fn write(light: &LightModel) -> Value {
    match light {
        LightModel::Collinear => json!({ "kind": "collinear" }),
        LightModel::Point(light) => json!({
            "kind": "point",
            "positions": light.positions.iter().map(|p| [p.x, p.y, p.z]).collect::<Vec<_>>(),
            "reference_distance": light.reference_distance,
            "spot": match light.spot {
                Spot::Isotropic => json!("isotropic"),
                Spot::Linear { inner_deg, outer_deg } => {
                    json!({ "inner_deg": inner_deg, "outer_deg": outer_deg })
                }
                Spot::CosinePower { exponent } => json!({ "exponent": exponent }),
            },
        }),
    }
}
