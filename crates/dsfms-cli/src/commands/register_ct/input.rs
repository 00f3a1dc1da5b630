//! What `register-ct` reads, all lengths of the CT in mm.

use super::args::RegisterCtArgs;
use crate::commands::template::mesh::{MeshReading, open_mesh};
use crate::exit::Usage;
use crate::progress::Reporter;
use crate::structures::own_name;
use anyhow::Context;
use dsfms::eval::zone::extent;
use dsfms::geometry::{Point3, Vector3};
use dsfms::io::landmarks::{Axes, PickedPair, pair_up, read_pairs, read_points};
use dsfms::io::mesh::{MeshUnit, read_mesh, read_repaired};
use dsfms::mesh::Mesh;
use dsfms::mesh::surface_points::ClosestPoints;
use dsfms::pipeline::Progress;
use dsfms::preoperative::LandmarkPair;
use dsfms::template::Template;
use std::path::Path;

/// The input in memory.
pub struct LoadedCt {
    /// File name of the CT mesh.
    pub name: String,
    pub ct: Mesh,
    pub landmarks: Vec<LandmarkPair>,
    /// Name and mesh.
    pub structures: Vec<(String, Mesh)>,
}

/// A landmark farther from its surface than this share of the surface's size lies nowhere on it.
const BESIDE: f64 = 0.15;

pub fn load(
    args: &RegisterCtArgs,
    template: &Template,
    reporter: &Reporter,
) -> anyhow::Result<LoadedCt> {
    let how = MeshReading { unit: args.mesh_unit.map(Into::into), repair: args.repair };
    let stated = if args.repair { read_repaired(&args.ct)? } else { read_mesh(&args.ct)? }.unit;
    let unit = how.unit.or(stated).unwrap_or(MeshUnit::Millimetre);
    let factor = unit.in_millimetres().ok_or_else(|| {
        let text = "is in template units; expected a metric mesh (give its unit with --mesh-unit)";
        Usage(format!("{} {text}", args.ct.display()))
    })?;
    let ct = open_mesh(&args.ct, how, reporter)?.mesh;
    let structures = structures(args, how, unit, &ct, reporter)?;
    let landmarks = landmarks(args, &ct, factor, template, reporter)?;
    let name = args.ct.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(LoadedCt { name, ct, landmarks, structures })
}

/// Structures; a file that states no unit is in that of the CT mesh.
fn structures(
    args: &RegisterCtArgs,
    how: MeshReading,
    unit: MeshUnit,
    ct: &Mesh,
    reporter: &Reporter,
) -> anyhow::Result<Vec<(String, Mesh)>> {
    let size = extent(&ct.positions);
    let mut found: Vec<(String, Mesh)> = Vec::new();
    for path in &args.structures {
        let mut file = if how.repair { read_repaired(path)? } else { read_mesh(path)? };
        file.unit = how.unit.or(file.unit).or(Some(unit));
        let file = file
            .in_unit(MeshUnit::Millimetre)
            .map_err(|mismatch| Usage(format!("--structures {}: {mismatch}", path.display())))?;
        let name = own_name(path, found.iter().map(|f| f.0.as_str()))?;
        let surface = ClosestPoints::new(ct);
        let away = |p: &Point3| surface.closest(p).map_or(f64::INFINITY, |s| s.distance);
        let middle = file.mesh.positions.iter().map(|p| p.coords).sum::<Vector3>()
            / file.mesh.positions.len().max(1) as f64;
        let far = away(&Point3::from(middle));
        if far > size {
            let text = format!(
                "--structures {}: its middle lies {far:.0} mm from the CT mesh, which is {size:.0} mm across; both must \
                 be in one frame and unit",
                path.display()
            );
            return Err(Usage(text).into());
        }
        if 2 * file.mesh.positions.iter().filter(|p| away(p) > 0.5 * size).count()
            > file.mesh.positions.len()
        {
            reporter.warn(&format!("{}: most of it lies far from the CT mesh", path.display()));
        }
        found.push((name, file.mesh));
    }
    Ok(found)
}

fn landmarks(
    args: &RegisterCtArgs,
    ct: &Mesh,
    factor: f64,
    template: &Template,
    reporter: &Reporter,
) -> anyhow::Result<Vec<LandmarkPair>> {
    let picked: Vec<PickedPair> = match &args.landmarks[..] {
        [] => return Ok(Vec::new()),
        [pairs] => read_pairs(pairs).context("--landmarks")?,
        [of_ct, of_template, ..] => {
            let axes = Axes::from(args.mesh_axes);
            let marks = read_points(of_ct, axes).context("--landmarks")?;
            // A template has no patient's axes: 3D Slicer takes its file for LPS.
            let others = read_points(of_template, Axes::Lps).context("--landmarks")?;
            let (pairs, alone) = pair_up([of_ct, of_template], marks, others)?;
            if !alone.is_empty() {
                reporter.warn(&format!("landmarks without a partner: {}", alone.join(", ")));
            }
            pairs
        }
    };
    let path = &args.landmarks[0];
    let mut found = Vec::new();
    for pair in picked {
        let wrong = |surface: &str, problem: String| {
            anyhow::anyhow!(
                "{}, landmark {:?} on the {surface}: {problem}",
                path.display(),
                pair.name
            )
        };
        let on_ct = pair.ct.on(&ct.positions, factor).map_err(|p| wrong("CT mesh", p))?;
        let on_template =
            pair.template.on(&template.mesh.positions, 1.0).map_err(|p| wrong("template", p))?;
        found.push(LandmarkPair { name: pair.name, ct: on_ct, template: on_template });
    }
    near(path, "CT mesh", ct, found.iter().map(|l| (l.name.as_str(), l.ct)))?;
    near(path, "template", &template.mesh, found.iter().map(|l| (l.name.as_str(), l.template)))?;
    Ok(found)
}

/// Refuse landmarks of which most lie beside their surface: another frame, unit or axes.
fn near<'a>(
    path: &Path,
    what: &str,
    mesh: &Mesh,
    marks: impl Iterator<Item = (&'a str, Point3)> + Clone,
) -> anyhow::Result<()> {
    let surface = ClosestPoints::new(mesh);
    let size = extent(&mesh.positions);
    let away = |p: &Point3| surface.closest(p).map_or(f64::INFINITY, |s| s.distance);
    let beside: Vec<(&str, Point3)> =
        marks.clone().filter(|(_, p)| away(p) > BESIDE * size).collect();
    let Some((name, first)) = beside.first() else { return Ok(()) };
    if 2 * beside.len() <= marks.clone().count() {
        return Ok(());
    }
    let turned = |p: Point3| Point3::new(-p.x, -p.y, p.z);
    let flipped = beside.iter().all(|(_, p)| away(&turned(*p)) <= BESIDE * size);
    let hint = if flipped {
        "with x and y negated they lie on it: try the other --mesh-axes (LPS, RAS)"
    } else {
        "are they picked on this mesh, and in its unit?"
    };
    Err(Usage(format!(
        "--landmarks {}: {} of {} lie beside the {what} ({name:?} by {:.1} of {size:.1} across); {hint}",
        path.display(),
        beside.len(),
        marks.count(),
        away(first)
    ))
    .into())
}
