//! What `track` follows: a template, or a mesh that frames of known pose give the organ's look.

use super::args::TrackArgs;
use crate::args::Global;
use crate::commands::template::mesh::{MeshReading, open_mesh, unit};
use crate::exit::Usage;
use crate::inputs::{self, Source, mask_of};
use crate::progress::Reporter;
use dsfms::geometry::Isometry;
use dsfms::image::{Frame, Mask};
use dsfms::io::images::find_frames;
use dsfms::io::masks::MaskKind;
use dsfms::io::poses::{NamedPose, PoseList, match_poses, read_poses};
use dsfms::io::template::read_template;
use dsfms::mesh::Mesh;
use dsfms::pipeline::{TemplateOptions, template_from_posed_frames};
use dsfms::template::{LengthUnit, Template};
use dsfms::video::{VideoFrame, each_frame, frame_name, is_video};
use std::path::{Path, PathBuf};

/// The template that the arguments name; with `--poses` made of a mesh and the frames that they
/// pose.
pub fn template(
    args: &TrackArgs,
    global: &Global,
    reporter: &Reporter,
) -> anyhow::Result<Template> {
    let path = &args.template;
    if path.is_dir() {
        let template = read_template(path)?;
        return match (&args.poses, &template.features) {
            (Some(_), Some(_)) => wrong("--poses gives a mesh its look; this template has one"),
            (None, Some(_)) => Ok(template),
            (None, None) => wrong(&no_look(path)),
            (Some(poses), None) => {
                seen_in(args, global, poses, template.mesh, template.unit, reporter)
            }
        };
    }
    if !path.exists() {
        // Its reader says what is missing.
        return Ok(read_template(path)?);
    }
    let Some(poses) = &args.poses else { return wrong(&no_look(path)) };
    let file = open_mesh(path, MeshReading::default(), reporter)?;
    let unit = unit(&file);
    seen_in(args, global, poses, file.mesh, unit, reporter)
}

fn wrong<T>(text: &str) -> anyhow::Result<T> {
    Err(Usage(text.into()).into())
}

fn no_look(path: &Path) -> String {
    format!(
        "{} is a surface without the organ's look, by which it would be found in a video; give the pose of one \
         frame or more with --poses, or build a template of exploration frames (dsfms template)",
        path.display()
    )
}

/// A surface with the look that posed frames of the input show.
fn seen_in(
    args: &TrackArgs,
    global: &Global,
    path: &Path,
    mesh: Mesh,
    unit: LengthUnit,
    reporter: &Reporter,
) -> anyhow::Result<Template> {
    let Some(camera_path) = &args.frames.camera else {
        return wrong("a mesh with --poses needs --camera");
    };
    if !args.takes_files() {
        return wrong(
            "--poses names frames of files; a live source needs a template (dsfms template)",
        );
    }
    let camera = inputs::camera(camera_path, global)?;
    let posed = posed_frames(args, path, reporter)?;
    for frame in &posed.frames {
        inputs::check_size(frame, &camera.file.camera, camera_path)?;
    }
    let mut options = TemplateOptions::default();
    options.sfm.seed = global.seed();
    let exploration = camera.exploration(&posed.frames).valid(&posed.valid).organ(&posed.organ);
    let built =
        template_from_posed_frames(&exploration, mesh, unit, &posed.poses, &options, reporter)?;
    reporter.say(&format!("the surface has its look from {} posed frame(s)", posed.frames.len()));
    Ok(built.template)
}

/// Frames of known pose with their masks.
#[derive(Default)]
struct Posed {
    frames: Vec<Frame>,
    poses: Vec<Option<Isometry>>,
    valid: Vec<Option<Mask>>,
    organ: Vec<Option<Mask>>,
}

/// The frames of the input that a list of poses names, with their masks.
fn posed_frames(args: &TrackArgs, path: &Path, reporter: &Reporter) -> anyhow::Result<Posed> {
    let list = read_poses(path, PoseList::Exploration)?;
    let (sources, names) = posed_sources(&args.input, &list)?;
    anyhow::ensure!(
        !sources.is_empty(),
        "{}: none of its {} poses is of one of the {} frames of the input; expected names or numbers as in {}",
        path.display(),
        list.len(),
        names.len(),
        names.first().map_or("frame_000", String::as_str)
    );
    let mut posed = Posed::default();
    for (source, pose) in sources {
        let frame = source.frame()?;
        let mask = |of: &Option<PathBuf>, kind| {
            let read = |masks: &PathBuf| mask_of(&frame, source.path(), masks, kind, reporter);
            of.as_ref().map(read).transpose()
        };
        let valid = mask(&args.masks, MaskKind::Valid)?;
        let instrument = mask(&args.frames.instrument_masks, MaskKind::Instrument)?;
        let free = instrument.map(|instrument| instrument.complement());
        posed.organ.push(mask(&args.frames.organ_masks, MaskKind::Organ)?);
        posed.valid.push(match (valid, free) {
            (Some(valid), Some(free)) => Some(valid.and(&free)),
            (valid, free) => valid.or(free),
        });
        posed.frames.push(frame);
        posed.poses.push(Some(pose));
    }
    Ok(posed)
}

/// A frame and `camera_from_template`.
type PosedSource = (Source, Isometry);

/// The frames that have a pose, and the names of all that were looked at. A video is read up to the
/// last of them, and no other of its frames is kept.
fn posed_sources(
    inputs: &[PathBuf],
    list: &[NamedPose],
) -> anyhow::Result<(Vec<PosedSource>, Vec<String>)> {
    let pose_of = |name: &str| match_poses(list, &[name])[0];
    let (mut found, mut names) = (Vec::new(), Vec::new());
    for input in inputs {
        if input.is_file() && is_video(input) {
            each_frame(input, &mut |VideoFrame { number, content, .. }| {
                let name = frame_name(number);
                if let Some(pose) = pose_of(&name) {
                    let source = match content {
                        Ok(frame) => Source::Decoded(frame, None),
                        Err(reason) => Source::Lost(name.clone(), reason),
                    };
                    found.push((source, pose));
                }
                names.push(name);
                found.len() < list.len()
            })?;
            continue;
        }
        for source in find_frames(std::slice::from_ref(input))?.into_iter().map(Source::File) {
            let name = source.name();
            found.extend(pose_of(&name).map(|pose| (source, pose)));
            names.push(name);
        }
    }
    Ok((found, names))
}
