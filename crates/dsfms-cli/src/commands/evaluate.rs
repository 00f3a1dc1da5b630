//! `dsfms evaluate`: reconstructions against the truth.

use crate::exit::{Outcome, Usage};
use crate::outputs::write_json;
use anyhow::Context;
use clap::{Args, ValueEnum};
use dsfms::camera::CameraModel;
use dsfms::eval::zone::extent;
use dsfms::eval::{
    Alignment, ErrorStats, EvaluateOptions, Evaluation, Truth, deformed_zone,
    displacement_from_rest, evaluate,
};
use dsfms::io::InputError;
use dsfms::io::camera::read_camera;
use dsfms::io::mesh::{MeshFile, read_mesh};
use dsfms::io::vertex_truth::{read_vertex_truth, vertex_truth_path};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  # Every frame_NNN.ply of a folder against the file of the same name
  dsfms evaluate out/ truth/ --rest rest.ply --camera camera.json
  # Scale and pose taken out first, for a template of unknown scale
  dsfms evaluate out/frame_004.ply truth/frame_004.ply --align similarity

Errors are per vertex where both meshes have the same faces in the same order, and distances between
the surfaces otherwise; lengths are in the unit of the files. The deformed zone is made of the
vertices that moved by at least half of the largest displacement of a visible vertex. Visibility and
displacement come from <truth>_vertices.npz (arrays `visible`, `displacement`) beside the true mesh;
without it visibility is taken from the reconstruction's `visible` and displacement from --rest.";

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
    let rest = args.rest.as_deref().map(read_mesh).transpose()?;
    let camera = args.camera.as_deref().map(read_camera).transpose()?.map(|file| file.camera);
    let options = EvaluateOptions { alignment: args.align.into() };
    let mut results = BTreeMap::new();
    let mut missing = 0;
    for (name, found, truth) in pairs {
        match truth {
            Some(truth) => {
                let result = compare(&found, &truth, rest.as_ref(), camera.as_ref(), &options)?;
                results.insert(name, result);
            }
            None => {
                eprintln!("warning: {name}: no true mesh of this name");
                missing += 1;
            }
        }
    }
    super::to_stdout(&table(&results))?;
    if let Some(path) = &args.json {
        write_json(path, &results)?;
    }
    Ok(match (results.is_empty(), missing) {
        (true, _) => Outcome::Nothing,
        (false, 0) => Outcome::Ok,
        (false, _) => Outcome::Degraded,
    })
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

fn compare(
    found: &Path,
    truth: &Path,
    rest: Option<&MeshFile>,
    camera: Option<&CameraModel>,
    options: &EvaluateOptions,
) -> anyhow::Result<Evaluation> {
    let (found_file, truth_file) = (read_mesh(found)?, read_mesh(truth)?);
    let side = vertex_truth_path(truth);
    let given = side.is_file().then(|| read_vertex_truth(&side)).transpose()?;
    let positions = &truth_file.mesh.positions;
    let (visible, displacement) = match given {
        Some(known) => (Some(known.visible), Some(known.displacement)),
        None => {
            let seen = found_file.attributes.get("visible");
            let seen = seen.filter(|s| s.len() == positions.len());
            let rest = rest.and_then(|r| displacement_from_rest(&r.mesh.positions, positions));
            (seen.map(|s| s.iter().map(|&v| v > 0.0).collect()), rest)
        }
    };
    let zone = displacement.map(|d| deformed_zone(&d, visible.as_deref(), extent(positions)));
    let reference = Truth {
        mesh: &truth_file.mesh,
        visible: visible.as_deref(),
        zone: zone.as_deref(),
        camera,
    };
    let name = || format!("{} against {}", found.display(), truth.display());
    evaluate(&found_file.mesh, &reference, options).with_context(name)
}

fn table(results: &BTreeMap<String, Evaluation>) -> String {
    let mut text = format!("{:<22}{:<20}", "mesh", "part");
    for column in ["count", "rms", "mean", "median", "p90", "max"] {
        text += &format!("{column:>9}");
    }
    text.push('\n');
    for (name, e) in results {
        for (part, stats) in parts(e) {
            text += &format!("{name:<22}{part:<20}{:>9}", stats.count);
            for value in [stats.rms, stats.mean, stats.median, stats.p90, stats.max] {
                text += &format!("{value:>9.3}");
            }
            text.push('\n');
        }
        if let Some(rms) = e.edge_length_rms {
            text += &format!("{name:<22}{:<20}{:>9}{rms:>9.3}\n", "edge length", "");
        }
    }
    text
}

/// The rows that are known of a mesh.
fn parts(e: &Evaluation) -> Vec<(&'static str, ErrorStats)> {
    let v = e.vertices.as_ref();
    [
        ("all", v.map(|v| v.all)),
        ("visible", v.and_then(|v| v.visible)),
        ("hidden", v.and_then(|v| v.hidden)),
        ("zone", v.and_then(|v| v.zone)),
        ("visible zone", v.and_then(|v| v.visible_zone)),
        ("reprojection px", e.reprojection_px),
        ("to true surface", Some(e.found_to_truth)),
        ("from true surface", Some(e.truth_to_found)),
    ]
    .into_iter()
    .filter_map(|(name, stats)| Some((name, stats?)))
    .collect()
}
