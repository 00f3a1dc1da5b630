//! The light of a camera file: in fields (`docs/camera.schema.json`), or, in older files, in the
//! words of a description.

use super::super::error::InputError;
use super::fields::{Fields, flat_numbers, number, numbers_in};
use crate::geometry::Point3;
use crate::light::{LightModel, Spot};
use serde_json::{Map, Value, json};
use std::path::Path;

const DISTANT: [&str; 5] = ["collinear", "distant", "directional", "parallel", "infinite"];
const NEAR: [&str; 6] = ["offset", "point", "near", "ring", "spot", "several"];
const AT_CAMERA: [&str; 4] = ["colocated", "co-located", "coaxial", "camera"];

/// The kind that a place makes of a light.
const POINT: &str = "point";

/// How an error about the kind begins.
const UNKNOWN: &str = "unknown variant";

/// Fields that are read of any light, besides those of places.
const KNOWN: [&str; 7] =
    ["kind", "type", "reference_distance", "spot", "falloff", "fall_off", "profile"];

/// A light by its kind and the parameters that the kind itself tells ([`LightModel`]), once words
/// and names of older files are put into ours.
pub(super) fn read(path: &Path, value: &Value) -> Result<LightModel, InputError> {
    // A bare word: "light": "collinear".
    if let Some(word) = value.as_str() {
        return read(path, &json!({ "kind": word }));
    }
    let fields = Fields::new(path, "light", value)?;
    fields.check_names(&KNOWN, false)?;
    let positions = positions(&fields)?;
    let kind = match fields.get("kind").or(fields.get("type")) {
        Some(kind) => kind.as_str().unwrap_or_default().to_lowercase(),
        None if positions.is_some() => "point".into(),
        None => return Err(fields.error("kind", "is missing; expected the name of a light")),
    };
    let says = |words: &[&str]| words.iter().any(|word| kind.contains(word));
    if says(&DISTANT) {
        return Ok(LightModel::default());
    }
    let mut parameters = parameters(&fields)?;
    let near = says(&NEAR) || says(&AT_CAMERA);
    let places = positions.or_else(|| says(&AT_CAMERA).then(|| vec![Point3::origin()]));
    let placed = places.is_some() && near;
    if let Some(places) = places {
        parameters.insert("positions".into(), json!(places));
    }
    let of_kind = |kind: &str| {
        let tagged = [(kind.to_owned(), Value::from(parameters.clone()))];
        serde_json::from_value(Value::Object(tagged.into_iter().collect()))
    };
    let light = of_kind(if placed { POINT } else { &kind });
    let unknown = |error: &serde_json::Error| error.to_string().starts_with(UNKNOWN);
    let light =
        light.or_else(|error| if near && unknown(&error) { of_kind(POINT) } else { Err(error) });
    light.map_err(|error| explained(&fields, &error.to_string()))
}

/// The error at the field that it names, which stands between back ticks.
fn explained(fields: &Fields, error: &str) -> InputError {
    match error.split('`').nth(1) {
        Some(_) if error.starts_with(UNKNOWN) => fields.error("kind", error),
        Some("positions") if error.starts_with("missing") => {
            let problem = "is missing; expected a list of [x, y, z] in camera axes (offsets_mm_camera_frame does as well)";
            fields.error("positions", problem)
        }
        Some(field) => fields.error(field, error),
        None => fields.error("kind", format!("{error} in its parameters")),
    }
}

/// What is neither kind nor place: the spot in our notation, numbers under their names without a
/// unit. A text that is no number is a remark.
fn parameters(fields: &Fields) -> Result<Map<String, Value>, InputError> {
    let mut out = Map::new();
    if let Some(spot) = spot(fields)? {
        out.insert("spot".into(), json!(spot));
    }
    for (key, value) in fields.keys() {
        if KNOWN.contains(&key.as_str()) && key != "reference_distance" || is_place(key) {
            continue;
        }
        let value = match number(value) {
            Ok(number) => json!(number),
            Err(_) if value.is_string() || value.is_null() => continue,
            Err(_) => value.clone(),
        };
        out.insert(key.strip_suffix("_mm").unwrap_or(key).into(), value);
    }
    Ok(out)
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

fn spot(fields: &Fields) -> Result<Option<Spot>, InputError> {
    if let Some(value) = fields.get("spot") {
        return spot_of_value(fields, value).map(Some);
    }
    let described = fields.first(&["falloff", "fall_off", "profile"]);
    let Some((key, value)) = described else { return Ok(None) };
    let Some(text) = value.as_str() else { return Err(fields.error(key, "expected a text")) };
    let text = text.to_lowercase();
    let decays = ["inverse", "1/r", "quadratic", "square"].iter().any(|word| text.contains(word));
    if !decays && ["none", "constant", "no fall"].iter().any(|word| text.contains(word)) {
        let problem = "a near light without inverse-square fall-off is not modelled; use kind \"collinear\" for a distant one";
        return Err(fields.error(key, problem));
    }
    spot_of_text(&text).map(Some).ok_or_else(|| {
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

/// Kind and parameters side by side, the spot without the name of its profile; [`read`] takes it
/// back.
pub(super) fn write(light: &LightModel) -> Value {
    let Ok(Value::Object(tagged)) = serde_json::to_value(light) else {
        return json!({ "kind": light });
    };
    let mut out = Map::new();
    for (kind, parameters) in tagged {
        out.insert("kind".into(), kind.into());
        out.extend(parameters.as_object().cloned().unwrap_or_default());
    }
    let spot = out.get("spot").and_then(Value::as_object);
    if let Some(bare) = spot.and_then(|s| s.values().next()).cloned() {
        out.insert("spot".into(), bare);
    }
    out.into()
}
