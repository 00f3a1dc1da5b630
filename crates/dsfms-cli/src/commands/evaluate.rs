//! `dsfms evaluate`: reconstructions against the truth.

mod told;

use crate::exit::{Outcome, Usage};
use crate::outputs::{prepare_for, write_json};
use crate::place;
use crate::stdout::to_stdout;
use anyhow::Context;
use clap::{Args, ValueEnum};
use dsfms::camera::CameraModel;
use dsfms::eval::zone::extent;
use dsfms::eval::{
    Alignment, EvaluateOptions, Truth, deformed_zone, displacement_from_rest, evaluate,
};
use dsfms::io::InputError;
use dsfms::io::camera::read_camera;
use dsfms::io::mesh::{MeshFile, MeshUnit, read_mesh};
use dsfms::io::vertex_truth::{read_vertex_truth, vertex_truth_path};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use told::{Gaps, Told, table};

const EXAMPLES: &str = "\
Examples:
  # Every frame_NNN.ply of a folder against the file of the same name
  dsfms evaluate out/ truth/ --rest rest.ply --camera camera.json
  # The demo's own figures
  dsfms evaluate dsfms-demo/joint dsfms-demo/truth \\
      --camera dsfms-demo/scene/camera.json
  # Scale and pose taken out first, for a template of unknown scale
  dsfms evaluate out/frame_004.ply truth/frame_004.ply --align similarity

Errors are per vertex where both meshes have the same faces in the same order,
and distances between the surfaces otherwise. Lengths are in the unit of the
truth, and the output says in which: cm and m are converted, template units (of
a template without a known distance) cannot be compared with mm and need
--align similarity. The deformed zone is made of the vertices that moved by at
least half of the largest displacement of a visible vertex. Visibility and
displacement come from <truth>_vertices.npz (arrays `visible`, `displacement`)
beside the true mesh; without it visibility is taken from the reconstruction's
`visible` and displacement from --rest. What could not be measured is said, and
why.";

/// Measure reconstructions against true meshes.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct EvaluateArgs {
    /// Reconstructed mesh, or a folder of them.
    #[arg(value_name = "FOUND")]
    found: PathBuf,
    /// True mesh, or a folder with files of the same names.
    #[arg(value_name = "TRUTH")]
    truth: PathBuf,
    /// True mesh at rest: tells the deformed zone where no displacement is given.
    #[arg(long, value_name = "FILE")]
    rest: Option<PathBuf>,
    /// Camera of the frames, for reprojection errors.
    #[arg(long, value_name = "FILE")]
    camera: Option<PathBuf>,
    /// What is fitted and taken out before anything is measured.
    #[arg(long, value_enum, default_value_t = Align::None)]
    align: Align,
    /// Write all figures to this JSON file too.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Align {
    /// Nothing: absolute errors.
    None,
    /// Rotation and translation.
    Rigid,
    /// Rotation, translation and scale.
    Similarity,
}

impl From<Align> for Alignment {
    fn from(align: Align) -> Self {
        match align {
            Align::None => Self::None,
            Align::Rigid => Self::Rigid,
            Align::Similarity => Self::Similarity,
        }
    }
}

/// Run the command.
pub fn run(args: &EvaluateArgs) -> anyhow::Result<Outcome> {
    let pairs = pairs(&args.found, &args.truth)?;
    if let Some(path) = &args.json {
        let files = pairs.iter().flat_map(|(_, found, truth)| [Some(found), truth.as_ref()]);
        let given = [args.rest.as_ref(), args.camera.as_ref()];
        place::keep_inputs(path, files.chain(given).flatten().map(PathBuf::as_path))?;
    }
    let given = Given {
        rest: args.rest.as_deref().map(read_mesh).transpose()?,
        camera: args.camera.as_deref().map(read_camera).transpose()?.map(|file| file.camera),
        alignment: args.align.into(),
    };
    let mut results = BTreeMap::new();
    let mut missing = 0;
    for (name, found, truth) in pairs {
        match truth {
            Some(truth) => {
                results.insert(name, given.compare(&found, &truth)?);
            }
            None => {
                eprintln!("warning: {name}: no true mesh of this name");
                missing += 1;
            }
        }
    }
    to_stdout(&table(&results))?;
    if let Some(path) = args.json.as_ref().filter(|_| !results.is_empty()) {
        prepare_for(path)?;
        write_json(path, &results)?;
    }
    Ok(match (results.is_empty(), missing) {
        (true, _) => Outcome::Nothing,
        (false, 0) => Outcome::Ok,
        (false, _) => Outcome::Degraded,
    })
}

/// The unit of a mesh beside another one: where it states none, mm as everywhere, or that of a
/// template of unknown scale.
fn unit_of(stated: Option<MeshUnit>, other: Option<MeshUnit>) -> Option<MeshUnit> {
    let taken = |other| match other {
        MeshUnit::TemplateUnit => MeshUnit::TemplateUnit,
        _ => MeshUnit::Millimetre,
    };
    stated.or(other.map(taken))
}

/// Name, reconstructed file, true file.
type Pair = (String, PathBuf, Option<PathBuf>);

fn pairs(found: &Path, truth: &Path) -> anyhow::Result<Vec<Pair>> {
    for path in [found, truth] {
        if !path.exists() {
            return Err(InputError::Missing(path.into()).into());
        }
    }
    let name = |p: &Path| p.file_name().unwrap_or_default().to_string_lossy().into_owned();
    match (found.is_dir(), truth.is_dir()) {
        (false, false) => Ok(vec![(name(found), found.into(), Some(truth.into()))]),
        (true, true) => {
            let mut files: Vec<PathBuf> = std::fs::read_dir(found)
                .and_then(|entries| entries.map(|e| e.map(|e| e.path())).collect())
                .with_context(|| format!("{}: cannot be read", found.display()))?;
            files.retain(|p| p.extension().is_some_and(|e| e == "ply"));
            files.sort();
            if files.is_empty() {
                let expected = "expected meshes (frame_NNN.ply)".into();
                return Err(InputError::Empty { path: found.into(), expected }.into());
            }
            let partner = |p: &PathBuf| Some(truth.join(name(p))).filter(|t| t.is_file());
            Ok(files.into_iter().map(|p| (name(&p), p.clone(), partner(&p))).collect())
        }
        _ => Err(Usage("FOUND and TRUTH must both be files or both be folders".into()).into()),
    }
}

/// What all meshes are compared with, and how.
struct Given {
    rest: Option<MeshFile>,
    camera: Option<CameraModel>,
    alignment: Alignment,
}

impl Given {
    fn compare(&self, found: &Path, truth: &Path) -> anyhow::Result<Told> {
        let truth_file = read_mesh(truth)?;
        let (found_file, unit) = self.in_unit_of(read_mesh(found)?, found, &truth_file, truth)?;
        let positions = &truth_file.mesh.positions;
        let side = vertex_truth_path(truth);
        let known = side.is_file().then(|| read_vertex_truth(&side)).transpose()?;
        let (visible, displacement) = match known {
            Some(known) => (Some(known.visible), Some(known.displacement)),
            None => {
                let seen = found_file.attributes.get("visible");
                let seen = seen.filter(|s| s.len() == positions.len());
                let seen = seen.map(|s| s.iter().map(|&v| v > 0.0).collect::<Vec<_>>());
                (seen, self.displacement(&truth_file, unit)?)
            }
        };
        let zone = displacement.map(|d| deformed_zone(&d, visible.as_deref(), extent(positions)));
        let reference = Truth {
            mesh: &truth_file.mesh,
            visible: visible.as_deref(),
            zone: zone.as_deref(),
            camera: self.camera.as_ref(),
        };
        let options = EvaluateOptions { alignment: self.alignment };
        let errors = evaluate(&found_file.mesh, &reference, &options)
            .with_context(|| format!("{} against {}", found.display(), truth.display()))?;
        let not_computed = Gaps {
            found: &found_file.mesh,
            truth: &truth_file.mesh,
            visible: visible.is_some(),
            zone: zone.as_deref(),
            rest: self.rest.is_some(),
            camera: self.camera.is_some(),
        }
        .reasons();
        let unit = unit.map_or("not stated", MeshUnit::label);
        Ok(Told { unit, errors, not_computed })
    }

    /// The reconstruction in the unit of the truth, and that unit.
    fn in_unit_of(
        &self,
        found: MeshFile,
        path: &Path,
        truth: &MeshFile,
        truth_path: &Path,
    ) -> anyhow::Result<(MeshFile, Option<MeshUnit>)> {
        let Some(unit) = unit_of(truth.unit, found.unit) else { return Ok((found, None)) };
        let stated = unit_of(found.unit, Some(unit)).unwrap_or(unit);
        let usual = [stated, unit] == [MeshUnit::Millimetre; 2];
        for (path, said, taken) in [(path, found.unit, stated), (truth_path, truth.unit, unit)] {
            if said.is_none() && !usual {
                let (path, taken) = (path.display(), taken.label());
                eprintln!("warning: {path}: states no unit, and is taken to be in {taken}");
            }
        }
        let found = MeshFile { unit: Some(stated), ..found };
        if stated.factor_to(unit).is_none() && self.alignment == Alignment::Similarity {
            return Ok((MeshFile { unit: Some(unit), ..found }, Some(unit)));
        }
        let found = found.in_unit(unit).map_err(|_| {
            Usage(format!(
                "{} is in {}, {} in {}: no factor between the two is known; give --align similarity, which \
                 fits the scale too, or a template of known scale (`dsfms template --scale-reference`, \
                 --camera-step or --scale-mesh)",
                path.display(),
                stated.label(),
                truth_path.display(),
                unit.label()
            ))
        })?;
        Ok((found, Some(unit)))
    }

    /// How far the vertices of the truth are from `--rest`, in the unit of the truth.
    fn displacement(
        &self,
        truth: &MeshFile,
        unit: Option<MeshUnit>,
    ) -> anyhow::Result<Option<Vec<f64>>> {
        let Some(rest) = self.rest.clone() else { return Ok(None) };
        let rest =
            match unit {
                Some(unit) => MeshFile { unit: unit_of(rest.unit, Some(unit)), ..rest }
                    .in_unit(unit)
                    .map_err(|mismatch| Usage(format!("--rest and the true mesh: {mismatch}")))?,
                None => rest,
            };
        Ok(displacement_from_rest(&rest.mesh.positions, &truth.mesh.positions))
    }
}
