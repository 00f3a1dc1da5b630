//! Rows of the generated scenes (`studies/scenes`): a template on the true mesh, every deformed
//! frame on two roads, with 25 matches and instrument masks, and with nothing given.

use super::{METHODS, ModelRows, append, judged, number};
use dsfms::Observation;
use dsfms::image::Frame;
use dsfms::io::images::{find_frames, read_frame};
use dsfms::io::masks::{MaskKind, read_masks};
use dsfms::io::matches::read_matches;
use dsfms::io::mesh::read_mesh;
use dsfms::io::poses::{PoseList, match_poses, read_poses};
use dsfms::pipeline::inputs::CameraInput;
use dsfms::pipeline::{Silent, TemplateOptions, template_from_posed_frames};
use dsfms::template::{LengthUnit, Template};
use std::error::Error;
use std::path::{Path, PathBuf};

/// Vertices of a frame that count; more of one frame tell the same.
pub const ROWS: usize = 400;

pub type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// The rows of the finished scenes of a folder whose number is one of these.
pub fn rows(folder: &Path, numbers: &dyn Fn(usize) -> bool) -> Result<ModelRows> {
    let entries: std::io::Result<Vec<_>> = std::fs::read_dir(folder)?.collect();
    let mut scenes: Vec<PathBuf> = entries?.iter().map(std::fs::DirEntry::path).collect();
    scenes.retain(|p| p.join("DONE").exists() && number(p).is_some_and(numbers));
    scenes.sort();
    let (mut all, mut case) = (ModelRows::default(), 0);
    for scene in &scenes {
        let camera = CameraInput::read(&scene.join("camera.json"), None)?;
        let template = template(scene, &camera)?;
        for frame in frames(scene, "deformed/frame_*")? {
            eprintln!("{} {}", scene.display(), frame.name);
            judge(scene, &camera, &template, &frame, case, &mut all)?;
            case += 2;
        }
    }
    Ok(all)
}

/// The pictures of a pattern in a folder.
pub fn frames(scene: &Path, pattern: &str) -> Result<Vec<Frame>> {
    let files = find_frames(&[scene.join(pattern)])?;
    Ok(files.iter().map(|file| read_frame(file)).collect::<std::result::Result<_, _>>()?)
}

fn template(scene: &Path, camera: &CameraInput) -> Result<Template> {
    let poses = read_poses(&scene.join("ground_truth/poses.json"), PoseList::Exploration)?;
    let mesh = read_mesh(&scene.join("ground_truth/rest_world.ply"))?.mesh;
    let frames = frames(scene, "exploration/frame_*")?;
    let names: Vec<&str> = frames.iter().map(|f| f.name.as_str()).collect();
    let poses = match_poses(&poses, &names);
    let options = TemplateOptions::default();
    let (exploration, unit) = (camera.exploration(&frames), LengthUnit::Millimetre);
    Ok(template_from_posed_frames(&exploration, mesh, unit, &poses, &options, &Silent)?.template)
}

/// Both roads of a frame; their cases are `case` and the next.
fn judge(
    scene: &Path,
    camera: &CameraInput,
    template: &Template,
    frame: &Frame,
    case: usize,
    all: &mut ModelRows,
) -> Result<()> {
    let number = frame.name.rsplit('_').next().unwrap_or_default();
    let truth = scene.join(format!("ground_truth/deformed_meshes_cam/frame_{number}.ply"));
    let truth = read_mesh(&truth)?.mesh.positions;
    let mask = scene.join(format!("deformed/instrument_mask_{number}.png"));
    let (masks, _) = read_masks(std::slice::from_ref(frame), &[], &mask, MaskKind::Instrument)?;
    let matches = scene.join(format!("ground_truth/correspondences/frame_{number}_sparse25.csv"));
    let matches = read_matches(&matches, template.mesh.topology.faces.len(), frame.size)?;
    let nothing = camera.observation(frame);
    let given: Observation = nothing.matches(&matches).instrument(masks.first());
    for (road, observation) in [given, nothing].iter().enumerate() {
        for method in METHODS {
            append(all, judged(template, observation, &truth, method, case + road, ROWS));
        }
    }
    Ok(())
}
