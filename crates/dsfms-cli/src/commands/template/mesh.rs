//! A mesh of the user, and its albedo.

use crate::args::Global;
use crate::progress::Reporter;
use anyhow::Context;
use dsfms::eval::zone::extent;
use dsfms::guard;
use dsfms::io::InputError;
use dsfms::io::images::read_frame;
use dsfms::io::mesh::{MeshFile, MeshUnit, read_mesh, read_repaired};
use dsfms::pipeline::Progress;
use dsfms::template::bake::choose_resolution;
use dsfms::template::{LengthUnit, SurfaceTexels};
use std::path::Path;

/// How meshes of the user are read.
#[derive(Clone, Copy, Debug, Default)]
pub struct MeshReading {
    /// Unit of the numbers, whatever the file says.
    pub unit: Option<MeshUnit>,
    /// Mend what can be mended.
    pub repair: bool,
}

/// A mesh in mm, or in template units where its file says so; what a user should know of it is
/// said.
pub fn open_mesh(path: &Path, how: MeshReading, reporter: &Reporter) -> anyhow::Result<MeshFile> {
    let mut mesh = if how.repair { read_repaired(path)? } else { read_mesh(path)? };
    for warning in &mesh.warnings {
        reporter.warn(&format!("{}: {warning}", path.display()));
    }
    mesh.unit = how.unit.or(mesh.unit);
    if mesh.unit == Some(MeshUnit::TemplateUnit) {
        return Ok(mesh);
    }
    let stated = mesh.unit;
    let mesh = mesh.in_unit(MeshUnit::Millimetre)?;
    let size = extent(&mesh.mesh.positions);
    let said = match stated {
        None => "states no unit, and is taken to be in mm".to_string(),
        Some(unit) => format!("is in {}", unit.label()),
    };
    if !ORGAN_MM.contains(&size) {
        reporter.warn(&format!(
            "{} {said}: {size:.3} mm across, which no organ is; give its unit with --mesh-unit",
            path.display()
        ));
    } else if stated.is_none() || matches!(stated, Some(MeshUnit::Metre | MeshUnit::Centimetre)) {
        reporter.say(&format!("{} {said}: {size:.1} mm across", path.display()));
    }
    Ok(mesh)
}

/// Diagonals that an organ may have, mm.
const ORGAN_MM: std::ops::RangeInclusive<f64> = 2.0..=800.0;

/// The unit of a mesh's numbers once it is opened.
pub fn unit(mesh: &MeshFile) -> LengthUnit {
    match mesh.unit {
        Some(MeshUnit::TemplateUnit) => LengthUnit::TemplateUnit,
        _ => LengthUnit::Millimetre,
    }
}

/// Texels of about this fraction of the mean edge for an albedo image.
const TEXELS_PER_EDGE: f64 = 12.0;

/// An image in the mesh's UV, or a CSV with values per vertex.
pub fn read_albedo(path: &Path, file: &MeshFile, global: &Global) -> anyhow::Result<SurfaceTexels> {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if extension == "csv" {
        let values = read_vertex_values(path, file.mesh.positions.len())?;
        let resolution = vec![8; file.mesh.topology.faces.len()];
        return Ok(SurfaceTexels::from_vertex_values(&file.mesh, &values, resolution)?);
    }
    let uv = file.uv.as_ref().with_context(|| {
        format!("{}: an albedo image needs a mesh with UV on every face; give a CSV with one value per vertex", path.display())
    })?;
    let image = read_frame(path)?.linear(&global.tone.map(Into::into).unwrap_or_default());
    let resolution = choose_resolution(&file.mesh, file.mesh.mean_edge_length() / TEXELS_PER_EDGE);
    Ok(SurfaceTexels::from_uv_image(uv, &image, resolution)?)
}

/// One linear value, or three, per line; a first line without numbers is a header.
fn read_vertex_values(path: &Path, vertices: usize) -> Result<Vec<[f32; 3]>, InputError> {
    let text =
        guard::read_text(path).map_err(|source| InputError::Read { path: path.into(), source })?;
    let mut values = Vec::new();
    for (i, line) in text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty()) {
        match vertex_value(line) {
            Ok(value) => values.push(value),
            Err(_) if values.is_empty() && line.contains(char::is_alphabetic) && i == 0 => {}
            Err(problem) => {
                return Err(InputError::Line { path: path.into(), line: i + 1, problem });
            }
        }
    }
    if values.len() != vertices {
        let problem =
            format!("{} albedo values, but the mesh has {vertices} vertices", values.len());
        return Err(InputError::Format { path: path.into(), reason: problem });
    }
    Ok(values)
}

fn vertex_value(line: &str) -> Result<[f32; 3], String> {
    let numbers: Result<Vec<f32>, _> = line.split(',').map(|w| w.trim().parse::<f32>()).collect();
    let numbers = numbers.map_err(|_| format!("{line:?} is no number"))?;
    let value = match numbers.as_slice() {
        [grey] => [*grey; 3],
        [r, g, b] => [*r, *g, *b],
        other => return Err(format!("{} columns; expected 1 (grey) or 3 (r,g,b)", other.len())),
    };
    match value.iter().all(|v| v.is_finite() && *v >= 0.0) {
        true => Ok(value),
        false => Err(format!("{line:?}: an albedo is a finite number of at least 0")),
    }
}
