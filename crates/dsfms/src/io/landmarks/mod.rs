//! Landmarks picked on two surfaces: pairs in one file (CSV, JSON), or points in a file for each
//! surface (3D Slicer's `.mrk.json` and `.fcsv`, MeshLab's `.pp`, CSV) that belong together by
//! name, else by order.
//!
//! Numbers are those of the mesh file they were picked on. A pair says where its points are on the
//! preoperative mesh (`ct`) and on the template, each as `x, y, z` or as a vertex counted from 0:
//!
//! ```text
//! name,ct_x,ct_y,ct_z,template_vertex
//! fundus,12.5,-3.0,40.1,1822
//! ```
//!
//! ```json
//! {"pairs": [{"name": "fundus", "ct": [12.5, -3.0, 40.1], "template": 1822}]}
//! ```

mod mark;
mod points;
mod table;

use super::error::{InputError, parse_json, read_text};
use crate::geometry::Point3;
pub use mark::{Mark, MarkPlace, PickedPair};
pub use points::{Axes, read_points};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

/// Read pairs from one file.
///
/// # Errors
/// [`InputError`] names file, line or field.
pub fn read_pairs(path: &Path) -> Result<Vec<PickedPair>, InputError> {
    let text = read_text(path)?;
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let pairs = match extension.as_str() {
        "csv" => table::pairs(path, &text),
        "json" => pairs_of_json(path, &parse_json(path, &text)?),
        _ => Err(InputError::format(
            path,
            "expected pairs as .csv or .json; points of one surface (.mrk.json, .fcsv, .pp) need the file of the \
             other surface beside them",
        )),
    }?;
    match pairs.is_empty() {
        true => Err(InputError::format(path, "it holds no pair; three or more are needed")),
        false => Ok(pairs),
    }
}

fn pairs_of_json(path: &Path, value: &Value) -> Result<Vec<PickedPair>, InputError> {
    if value.get("markups").is_some() {
        return Err(InputError::format(
            path,
            "holds markups of one surface; give those of the other surface as a second file",
        ));
    }
    let list = value.get("pairs").and_then(Value::as_array);
    let list = list.ok_or_else(|| InputError::field(path, "pairs", "expected a list of pairs"))?;
    let pair = |(k, entry): (usize, &Value)| {
        let place = |name: &str| {
            let field = format!("pairs[{k}].{name}");
            let value =
                entry.get(name).ok_or_else(|| InputError::field(path, &field, "is missing"))?;
            place_of_json(value).map_err(|problem| InputError::field(path, &field, problem))
        };
        let name = entry.get("name").and_then(Value::as_str);
        Ok(PickedPair {
            name: name.map_or_else(|| (k + 1).to_string(), str::to_owned),
            ct: place("ct")?,
            template: place("template")?,
        })
    };
    list.iter().enumerate().map(pair).collect()
}

fn place_of_json(value: &Value) -> Result<MarkPlace, String> {
    let wrong = || format!("is {value}; expected [x, y, z] or a vertex number");
    if let Some(vertex) = value.as_u64() {
        return usize::try_from(vertex).map(MarkPlace::Vertex).map_err(|_| wrong());
    }
    let list = value.as_array().filter(|l| l.len() == 3).ok_or_else(wrong)?;
    let numbers: Option<Vec<f64>> = list.iter().map(Value::as_f64).collect();
    let numbers = numbers.filter(|n| n.iter().all(|x| x.is_finite())).ok_or_else(wrong)?;
    Ok(MarkPlace::Point(Point3::new(numbers[0], numbers[1], numbers[2])))
}

/// Pairs of the landmarks of two files: by name where each name stands once in its file and at
/// least three stand in both, else by order. Second: names that have no partner.
///
/// # Errors
/// Lists of different lengths without common names; `paths` are named.
pub fn pair_up(
    paths: [&Path; 2],
    ct: Vec<Mark>,
    template: Vec<Mark>,
) -> Result<(Vec<PickedPair>, Vec<String>), InputError> {
    let names = |marks: &[Mark]| marks.iter().map(|m| m.name.clone()).collect::<BTreeSet<_>>();
    let (of_ct, of_template) = (names(&ct), names(&template));
    let common: BTreeSet<&String> = of_ct.intersection(&of_template).collect();
    let unique = of_ct.len() == ct.len() && of_template.len() == template.len();
    let pair =
        |a: &Mark, b: &Mark| PickedPair { name: a.name.clone(), ct: a.place, template: b.place };
    if unique && common.len() >= 3 {
        let partner = |a: &Mark| Some(pair(a, template.iter().find(|b| b.name == a.name)?));
        let alone = of_ct.symmetric_difference(&of_template).cloned().collect();
        return Ok((ct.iter().filter_map(partner).collect(), alone));
    }
    if ct.len() != template.len() {
        let problem = format!(
            "{} landmarks, but {} holds {}, and fewer than three names stand in both",
            ct.len(),
            paths[1].display(),
            template.len()
        );
        return Err(InputError::format(paths[0], problem));
    }
    Ok((ct.iter().zip(&template).map(|(a, b)| pair(a, b)).collect(), Vec::new()))
}

#[cfg(test)]
mod tests;
