//! The tone curve of a camera file: free text, a number, or a table.

use super::super::error::InputError;
use super::fields::{flat_numbers, number, numbers_in};
use crate::image::ToneCurve;
use serde_json::{Value, json};
use std::path::Path;

pub(super) fn read(path: &Path, value: &Value) -> Result<ToneCurve, InputError> {
    let error = |problem: String| InputError::field(path, "tone_curve", problem);
    match value {
        Value::String(text) => from_text(text).ok_or_else(|| {
            error(format!("{text:?} is not understood; expected \"srgb\", \"linear\", \"gamma 2.2\" or a list of 256 linear values"))
        }),
        Value::Array(_) => table(value).map_err(error),
        Value::Object(map) => match (map.get("gamma"), map.get("table")) {
            (Some(gamma), _) => {
                let gamma = number(gamma).map_err(&error)?;
                from_gamma(gamma).ok_or_else(|| error(format!("gamma {gamma} is not positive")))
            }
            (None, Some(values)) => table(values).map_err(error),
            _ => Err(error("expected \"gamma\" or \"table\"".into())),
        },
        other => Err(error(format!("is {other}; expected a text"))),
    }
}

/// A description may mention linear light while it defines a curve, so `linear` comes last.
fn from_text(text: &str) -> Option<ToneCurve> {
    let text = text.to_lowercase();
    if text.contains("srgb") || text.contains("61966") {
        return Some(ToneCurve::Srgb);
    }
    if let Some(at) = text.find("gamma") {
        let numbers = numbers_in(&text[at..]);
        return match numbers.as_slice() {
            // "gamma 1/2.2" is the encoding exponent.
            [(one, after), (value, _), ..]
                if *one == 1.0 && after.trim_start().starts_with('/') =>
            {
                from_gamma(*value)
            }
            [(value, _), ..] => from_gamma(*value),
            [] => None,
        };
    }
    let linear = text.contains("linear") || ["none", "identity"].contains(&text.trim());
    linear.then_some(ToneCurve::Linear)
}

/// An exponent below one is that of the encoding.
fn from_gamma(gamma: f64) -> Option<ToneCurve> {
    match gamma {
        g if !(g > 0.0 && g.is_finite()) => None,
        g if g < 1.0 => Some(ToneCurve::Gamma(1.0 / g)),
        g => Some(ToneCurve::Gamma(g)),
    }
}

fn table(value: &Value) -> Result<ToneCurve, String> {
    let values = flat_numbers(value)?;
    if values.len() != 256 {
        return Err(format!("holds {} values, expected 256, one per encoded value", values.len()));
    }
    if values.windows(2).any(|w| w[1] < w[0]) || values[0] < 0.0 || values[255] > 1.0 {
        return Err("the 256 values must rise from 0 to 1".into());
    }
    Ok(ToneCurve::Table(values))
}

pub(super) fn write(tone: &ToneCurve) -> Value {
    match tone {
        ToneCurve::Linear => json!("linear"),
        ToneCurve::Srgb => json!("srgb"),
        // Below one it would be read as the exponent of the encoding.
        ToneCurve::Gamma(gamma) if *gamma < 1.0 => {
            let table: Vec<f64> = (0..256).map(|v| tone.decode(f64::from(v) / 255.0)).collect();
            json!({ "table": table })
        }
        ToneCurve::Gamma(gamma) => json!({ "gamma": gamma }),
        ToneCurve::Table(table) => json!({ "table": table }),
    }
}
