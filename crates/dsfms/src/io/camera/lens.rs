//! Names of lenses.

use super::super::error::InputError;
use crate::camera::{Lens, LensKind};
use serde_json::Value;
use std::path::Path;

/// The lens of coefficients that come without a name.
const USUAL_LENS: &str = "brown_conrady";

/// The kind of lens that a field such as `distortion_model` names; Brown-Conrady when there is
/// none.
pub(super) fn lens_kind(
    path: &Path,
    field: &str,
    value: Option<&Value>,
) -> Result<&'static LensKind, InputError> {
    let value = value.filter(|v| !v.is_null());
    let text = value.map_or(Some(USUAL_LENS), Value::as_str).unwrap_or_default();
    LensKind::told(text).ok_or_else(|| {
        let known: Vec<&str> = Lens::KINDS.iter().map(|kind| kind.name).collect();
        let problem = format!("{text:?} is not known; expected one of {}", known.join(", "));
        InputError::field(path, field, problem)
    })
}
