//! Landmarks of one surface as other programs save them.

use super::super::error::{InputError, parse_json, read_text};
use super::mark::{Mark, MarkPlace};
use super::table::{finite, marks};
use crate::geometry::Point3;
use serde_json::Value;
use std::path::Path;

/// Axes of a patient: x to the left and y to the back (LPS, DICOM; what 3D Slicer writes into mesh
/// files), or to the right and the front (RAS).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Axes {
    /// Left, posterior, superior.
    #[default]
    Lps,
    /// Right, anterior, superior.
    Ras,
}

impl Axes {
    fn named(word: &str) -> Option<Self> {
        match word.trim() {
            "LPS" | "1" => Some(Self::Lps),
            "RAS" | "0" => Some(Self::Ras),
            _ => None,
        }
    }

    /// A point of these axes in others.
    fn to(self, other: Self, p: Point3) -> Point3 {
        if self == other { p } else { Point3::new(-p.x, -p.y, p.z) }
    }
}

/// Read the landmarks of one surface; `axes`: those of the mesh file, for formats that state their
/// own.
///
/// # Errors
/// [`InputError`] names file, line or field.
pub fn read_points(path: &Path, axes: Axes) -> Result<Vec<Mark>, InputError> {
    let text = read_text(path)?;
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let found = match extension.as_str() {
        "json" => markups(path, &parse_json(path, &text)?, axes),
        "fcsv" => fcsv(path, &text, axes),
        "pp" => picked_points(path, &text),
        "csv" => marks(path, &text),
        _ => Err(InputError::format(path, "expected .mrk.json, .fcsv, .pp or .csv")),
    }?;
    if found.is_empty() {
        return Err(InputError::format(path, "holds no landmark"));
    }
    Ok(found)
}

/// 3D Slicer, from 4.11 on.
fn markups(path: &Path, value: &Value, axes: Axes) -> Result<Vec<Mark>, InputError> {
    let lists = value.get("markups").and_then(Value::as_array);
    let lists = lists.ok_or_else(|| InputError::field(path, "markups", "expected a list"))?;
    let mut found = Vec::new();
    for (k, list) in lists.iter().enumerate() {
        let field = |name: &str| format!("markups[{k}].{name}");
        let own = list.get("coordinateSystem").and_then(Value::as_str).unwrap_or("LPS");
        let own = Axes::named(own).ok_or_else(|| {
            let problem = format!("is {own:?}; expected LPS or RAS");
            InputError::field(path, field("coordinateSystem"), problem)
        })?;
        let points = list.get("controlPoints").and_then(Value::as_array);
        for (i, point) in points.into_iter().flatten().enumerate() {
            if point.get("positionStatus").and_then(Value::as_str) == Some("undefined") {
                continue;
            }
            let position = point.get("position").map(super::place_of_json);
            let Some(Ok(MarkPlace::Point(at))) = position else {
                let field = field(&format!("controlPoints[{i}].position"));
                return Err(InputError::field(path, field, "expected three numbers"));
            };
            let name = point.get("label").and_then(Value::as_str).filter(|n| !n.is_empty());
            let name = name.map_or_else(|| (found.len() + 1).to_string(), str::to_owned);
            found.push(Mark { name, place: MarkPlace::Point(own.to(axes, at)) });
        }
    }
    Ok(found)
}

/// 3D Slicer before 4.11: `id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,…`.
fn fcsv(path: &Path, text: &str, axes: Axes) -> Result<Vec<Mark>, InputError> {
    let stated = text.lines().find_map(|l| l.strip_prefix("# CoordinateSystem ="));
    let own = stated.map_or(Some(Axes::Ras), Axes::named).ok_or_else(|| {
        let problem = format!("is {:?}; expected LPS or RAS", stated.unwrap_or_default().trim());
        InputError::field(path, "CoordinateSystem", problem)
    })?;
    let mut found = Vec::new();
    for (k, line) in
        text.lines().enumerate().filter(|(_, l)| !l.starts_with('#') && !l.trim().is_empty())
    {
        let words: Vec<&str> = line.split(',').map(str::trim).collect();
        let [_, x, y, z, rest @ ..] = &words[..] else {
            return Err(InputError::line(path, k + 1, "expected id,x,y,z,…"));
        };
        let number = |word: &str| finite(word).map_err(|p| InputError::line(path, k + 1, p));
        let at = Point3::new(number(x)?, number(y)?, number(z)?);
        let name = rest.get(7).filter(|n| !n.is_empty());
        let name = name.map_or_else(|| (found.len() + 1).to_string(), |n| (*n).to_owned());
        found.push(Mark { name, place: MarkPlace::Point(own.to(axes, at)) });
    }
    Ok(found)
}

/// MeshLab: `<point x="…" y="…" z="…" name="…" active="1"/>`.
fn picked_points(path: &Path, text: &str) -> Result<Vec<Mark>, InputError> {
    let mut found = Vec::new();
    for (k, tag) in text.split("<point ").skip(1).enumerate() {
        let tag = tag.split('>').next().unwrap_or_default();
        let attribute = |name: &str| {
            let start = format!("{name}=\"");
            let words = tag.split_whitespace().find_map(|w| w.strip_prefix(&start))?;
            words.split('"').next()
        };
        if attribute("active") == Some("0") {
            continue;
        }
        let number = |axis: &str| {
            finite(attribute(axis).unwrap_or_default())
                .map_err(|p| InputError::field(path, format!("point {k}, {axis}"), p))
        };
        let at = Point3::new(number("x")?, number("y")?, number("z")?);
        let name = attribute("name").filter(|n| !n.is_empty());
        let name = name.map_or_else(|| (k + 1).to_string(), str::to_owned);
        found.push(Mark { name, place: MarkPlace::Point(at) });
    }
    Ok(found)
}
