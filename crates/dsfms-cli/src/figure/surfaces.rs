//! The surfaces of a plate, in their order.

use super::panel::Surface;
use crate::report::folder::{Column, columns};
use crate::sheet::colours::round_up;
use anyhow::Context;
use dsfms::io::mesh::{MeshFile, read_mesh};
use dsfms::io::names::frame_number;
use dsfms::mesh::Mesh;
use std::path::{Path, PathBuf};

/// What is read.
pub struct Wanted<'a> {
    /// Output folders, folders of them, or mesh files.
    pub paths: &'a [PathBuf],
    /// Names of folders, in order; empty = all.
    pub methods: &'a [String],
    pub frame: Option<u64>,
    pub truth: Option<&'a Path>,
    pub structures: bool,
    /// The largest mean error first.
    pub by_error: bool,
}

/// The surfaces, the truth last; and what was left out, since one folder of several lacks the
/// frame.
pub fn read(wanted: &Wanted) -> anyhow::Result<(Vec<Surface>, Vec<String>)> {
    let truth = wanted.truth.map(read_mesh).transpose()?;
    let mut unit = truth.as_ref().and_then(|truth| truth.unit);
    let reference = if unit.is_some() { "the truth" } else { "the first mesh" };
    let mut surfaces = Vec::new();
    let mut lacking = Vec::new();
    for (column, path) in named(all_columns(wanted.paths)?, wanted.methods)? {
        let chosen = match choose(&column, &path, wanted.frame) {
            Ok(chosen) => chosen,
            // One of several in a folder: a method may have lost the frame.
            Err(error) if column.paths[0].parent() != Some(path.as_path()) => {
                lacking.push(error.to_string());
                continue;
            }
            Err(error) => return Err(error),
        };
        let mut file = read_mesh(chosen)?;
        // One colour bar for all surfaces: one unit, that of the truth or of the first one.
        unit = unit.or(file.unit);
        if let Some(unit) = unit {
            let of = || format!("{}: its unit and that of {reference}", chosen.display());
            file = file.in_unit(unit).with_context(of)?;
        }
        let values = match &truth {
            Some(truth) => Some(errors(&file, truth, &column.name)?),
            None => file.attributes.get("expected_error").cloned(),
        };
        let structures = if wanted.structures { buried(chosen)? } else { Vec::new() };
        surfaces.push(Surface { name: column.name, file, values, structures, is_truth: false });
    }
    if let Some(file) = truth {
        // A folder of the truth among the others is the truth.
        let exact = |s: &Surface| s.values.iter().flatten().all(|v| *v == 0.0);
        surfaces.retain(|s| !exact(s) || s.values.is_none());
        if wanted.by_error {
            surfaces.sort_by(|a, b| mean(b).total_cmp(&mean(a)));
        }
        let name = "truth".into();
        surfaces.push(Surface { name, file, values: None, structures: Vec::new(), is_truth: true });
    }
    if surfaces.iter().all(|s| s.is_truth) {
        anyhow::bail!("{}", lacking.join("; "));
    }
    Ok((surfaces, lacking))
}

/// Mean of what is coloured.
pub fn mean(surface: &Surface) -> f64 {
    let values = surface.values.as_deref().unwrap_or_default();
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// The end of the colour scale: a round number that covers 98 % of the middle surface, so that one
/// bad method does not darken the others; and whether a value lies beyond it.
pub fn limit(surfaces: &[Surface], given: Option<f64>) -> (f64, bool) {
    let values = surfaces.iter().filter_map(|s| s.values.as_deref());
    limit_of(&values.collect::<Vec<_>>(), given)
}

fn limit_of(surfaces: &[&[f64]], given: Option<f64>) -> (f64, bool) {
    let sorted = |values: &&[f64]| {
        let mut all: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        all.sort_by(f64::total_cmp);
        all
    };
    let all: Vec<Vec<f64>> = surfaces.iter().map(sorted).filter(|v| !v.is_empty()).collect();
    let mut high: Vec<f64> = all.iter().map(|v| v[(v.len() - 1) * 98 / 100]).collect();
    high.sort_by(f64::total_cmp);
    let middle = high.get(high.len().saturating_sub(1) / 2).copied().unwrap_or(1.0);
    let limit = given.unwrap_or_else(|| round_up(middle.max(1e-9)));
    let beyond = all.iter().filter_map(|v| v.last()).any(|v| *v > limit);
    (limit, beyond)
}

/// The columns of every path, with the path that they come from.
fn all_columns(paths: &[PathBuf]) -> anyhow::Result<Vec<(Column, PathBuf)>> {
    let mut all = Vec::new();
    for path in paths {
        let label = || path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let found = match path.is_dir() {
            true => columns(path)?,
            false => vec![Column { name: label(), paths: vec![path.clone()] }],
        };
        if found.is_empty() {
            anyhow::bail!("{} holds no frame_NNN.ply", path.display());
        }
        all.extend(found.into_iter().map(|c| (c, path.clone())));
    }
    Ok(all)
}

/// Those of these names, in this order.
fn named(
    mut all: Vec<(Column, PathBuf)>,
    names: &[String],
) -> anyhow::Result<Vec<(Column, PathBuf)>> {
    if names.is_empty() {
        return Ok(all);
    }
    let mut found = Vec::new();
    for name in names {
        let at = all.iter().position(|(c, _)| c.name == *name).with_context(|| {
            let held: Vec<&str> = all.iter().map(|(c, _)| c.name.as_str()).collect();
            format!("--methods: there is no folder {name}; expected some of {}", held.join(", "))
        })?;
        found.push(all.remove(at));
    }
    Ok(found)
}

fn choose<'a>(column: &'a Column, path: &Path, frame: Option<u64>) -> anyhow::Result<&'a PathBuf> {
    let number = |p: &PathBuf| frame_number(&p.file_stem().unwrap_or_default().to_string_lossy());
    match frame {
        Some(n) if path.is_dir() => {
            column.paths.iter().find(|p| number(p) == Some(n)).with_context(|| {
                let held: Vec<u64> = column.paths.iter().filter_map(number).collect();
                format!("{} holds no frame {n}; it holds {}", column.name, runs(&held))
            })
        }
        _ => Ok(&column.paths[0]),
    }
}

/// Ascending numbers as runs: `0-3, 7`.
fn runs(numbers: &[u64]) -> String {
    let runs = numbers.chunk_by(|a, b| a + 1 == *b).map(|run| match run {
        [first, .., last] => format!("{first}-{last}"),
        _ => run.iter().map(u64::to_string).collect(),
    });
    runs.collect::<Vec<_>>().join(", ")
}

/// `structures/frame_NNN_*.ply` beside a frame.
fn buried(frame: &Path) -> anyhow::Result<Vec<Mesh>> {
    let stem = frame.file_stem().unwrap_or_default().to_string_lossy();
    let Ok(entries) = std::fs::read_dir(frame.with_file_name("structures")) else {
        return Ok(Vec::new());
    };
    let own = |p: &PathBuf| {
        let name = p.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with(&format!("{stem}_")) && name.ends_with(".ply")
    };
    let mut paths: Vec<PathBuf> = entries.flatten().map(|e| e.path()).filter(own).collect();
    paths.sort();
    paths.iter().map(|p| Ok(read_mesh(p)?.mesh)).collect()
}

fn errors(file: &MeshFile, truth: &MeshFile, name: &str) -> anyhow::Result<Vec<f64>> {
    let (found, known) = (&file.mesh.positions, &truth.mesh.positions);
    if found.len() != known.len() {
        anyhow::bail!(
            "{name} has {} vertices and the truth {}; both must have the same, in the same order",
            found.len(),
            known.len()
        );
    }
    Ok(found.iter().zip(known).map(|(a, b)| (a - b).norm()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_bad_method_does_not_set_the_scale() {
        let values =
            |high: f64| -> Vec<f64> { (0..=100).map(|i| high * f64::from(i) / 98.0).collect() };
        let [one, two, fifty] = [1.0, 2.0, 50.0].map(values);
        assert_eq!(limit_of(&[&two, &one, &fifty], None), (2.0, true));
        assert_eq!(limit_of(&[&two, &fifty], None), (2.0, true));
        assert_eq!(limit_of(&[&two], Some(4.0)), (4.0, false));
    }

    #[test]
    fn frames_are_told_as_runs() {
        assert_eq!(runs(&[0, 1, 2, 3, 7]), "0-3, 7");
    }
}
