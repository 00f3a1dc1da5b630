//! `dsfms template`: frames, or a mesh, to a template.

use crate::args::Global;
use crate::exit::{Outcome, Usage};
use crate::inputs::{self, CameraInput, Source};
use crate::outputs::prepare_folder;
use crate::progress::Reporter;
use crate::report::template::template_page;
use anyhow::Context;
use clap::Args;
use dsfms::image::{Frame, Mask};
use dsfms::io::InputError;
use dsfms::io::images::read_frame;
use dsfms::io::masks::MaskKind;
use dsfms::io::mesh::{MeshFile, MeshUnit, read_mesh};
use dsfms::io::poses::{PoseList, match_poses, read_poses};
use dsfms::io::template::write_template;
use dsfms::mesh::Mesh;
use dsfms::pipeline::{
    BuiltTemplate, Exploration, Progress, TemplateOptions, template_from_frames,
    template_from_mesh, template_from_posed_frames,
};
use dsfms::sfm::RefineIntrinsics;
use dsfms::template::bake::choose_resolution;
use dsfms::template::{LengthUnit, SurfaceTexels};
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  # From frames (PNG, JPEG or TIFF in name order) of the organ at rest, seen by a moving camera
  dsfms template exploration/ --camera camera.json -o organ.template
  # Only inside the organ's outline: white = organ
  dsfms template exploration/ --camera camera.json --organ-masks masks/ -o organ.template
  # From a video; the intrinsics are a guess to be refined
  dsfms template endo.mp4 --camera guess.json --self-calibrate -o organ.template
  # On a mesh of your own, in the world of known camera poses
  dsfms template exploration/ --camera camera.json --mesh organ.ply --poses poses.json -o organ.template
  # A mesh whose albedo is known: an image in its UV, or a CSV with one value (or r,g,b) a vertex
  dsfms template --mesh organ.obj --albedo albedo.png -o organ.template

Masks: white (above 127) = valid for --masks, = organ for --organ-masks. A mask belongs to the frame
of the same name or number. A mask that covers nearly all or nothing draws a warning.

The result is a folder: template.toml, template.glb, template.ply and more. Without --mesh its
lengths are in template units, similar to the truth at an unknown scale.";

/// Build a template (rest shape, albedo, descriptors) from exploration frames or a mesh.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct TemplateArgs {
    /// Folder of frames, image files, or one video.
    #[arg(value_name = "FRAMES_DIR_OR_VIDEO")]
    frames: Vec<PathBuf>,
    /// Intrinsics: camera.json, OpenCV YAML or JSON, or COLMAP cameras.txt.
    #[arg(long, value_name = "FILE")]
    camera: Option<PathBuf>,
    /// Masks of the frames, white = valid image content (no instrument, inside the viewport).
    #[arg(long, value_name = "DIR")]
    masks: Option<PathBuf>,
    /// Outlines of the organ in the frames, white = organ.
    #[arg(long, value_name = "DIR")]
    organ_masks: Option<PathBuf>,
    /// Vertices of the template mesh, 100 to 50000.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    vertices: usize,
    /// Surface to use: PLY, OBJ, STL or glTF; its vertex order and faces are kept.
    #[arg(long, value_name = "FILE")]
    mesh: Option<PathBuf>,
    /// Camera poses of the frames in the mesh's frame: poses.json or COLMAP images.txt.
    #[arg(long, value_name = "FILE", requires = "mesh")]
    poses: Option<PathBuf>,
    /// Albedo of the mesh: an image in its UV, or a CSV with one value (or r,g,b) per vertex.
    #[arg(long, value_name = "FILE", requires = "mesh", conflicts_with = "poses")]
    albedo: Option<PathBuf>,
    /// Refine focal length, principal point and radial distortion along with the poses.
    #[arg(long, conflicts_with = "mesh")]
    self_calibrate: bool,
    /// Leave out TEMPLATE/report.html.
    #[arg(long)]
    no_report: bool,
    /// Template folder to write.
    #[arg(short, long, value_name = "TEMPLATE")]
    output: PathBuf,
}

/// Run the command.
pub fn run(args: &TemplateArgs, global: &Global, reporter: &Reporter) -> anyhow::Result<Outcome> {
    check(args)?;
    let parent = args.output.parent().filter(|p| !p.as_os_str().is_empty());
    prepare_folder(parent.unwrap_or(Path::new(".")))?;
    let options = options(args, global);
    let (built, frames, complete) = match (args.frames.is_empty(), &args.mesh) {
        (true, Some(mesh)) => {
            let mesh = open_mesh(mesh, reporter)?;
            let albedo =
                args.albedo.as_deref().map(|p| read_albedo(p, &mesh, global)).transpose()?;
            let unit = unit(&mesh);
            let template = template_from_mesh(mesh.mesh, unit, albedo, &options, reporter);
            let built = BuiltTemplate { template, rejected: vec![], light: None, points: vec![] };
            (built, Vec::new(), true)
        }
        _ => from_frames(args, global, &options, reporter)?,
    };
    let template = &built.template;
    write_template(&args.output, template)?;
    if !args.no_report {
        let name = args.output.file_name().unwrap_or_default().to_string_lossy();
        template_page(&name, template, &frames, &built.points)?
            .write(&args.output.join("report.html"))?;
    }
    reporter.finish();
    if !global.quiet {
        super::inspect::print(template)?;
    }
    Ok(if complete { Outcome::Ok } else { Outcome::Degraded })
}

/// Combinations that clap cannot name well.
fn check(args: &TemplateArgs) -> anyhow::Result<()> {
    let wrong = |text: &str| Err(Usage(text.into()).into());
    match (args.frames.is_empty(), &args.mesh, &args.poses, &args.camera) {
        (true, None, ..) => {
            wrong("give exploration frames (a folder, files or a video), or --mesh")
        }
        (true, Some(_), Some(_), _) => wrong("--poses belongs to frames; give the frames too"),
        (false, Some(_), None, _) => wrong("frames on a given --mesh need --poses"),
        (false, _, _, None) => wrong("frames need --camera"),
        _ if !(100..=50_000).contains(&args.vertices) => {
            wrong(&format!("--vertices {}: expected 100 to 50000", args.vertices))
        }
        _ if !args.frames.is_empty() && args.albedo.is_some() => {
            wrong("--albedo is for a mesh without frames; with frames the albedo is measured")
        }
        _ => Ok(()),
    }
}

fn options(args: &TemplateArgs, global: &Global) -> TemplateOptions {
    let mut options = TemplateOptions { vertices: args.vertices, ..Default::default() };
    options.sfm.seed = global.seed;
    options.dense.seed = global.seed;
    if args.self_calibrate {
        options.sfm.refine = RefineIntrinsics {
            focal: true,
            centre: true,
            distortion: true,
            second_distortion: false,
        };
    }
    options
}

fn from_frames(
    args: &TemplateArgs,
    global: &Global,
    options: &TemplateOptions,
    reporter: &Reporter,
) -> anyhow::Result<(BuiltTemplate, Vec<Frame>, bool)> {
    let Some(camera_path) = &args.camera else {
        return Err(Usage("frames need --camera".into()).into());
    };
    let camera = inputs::camera(camera_path, global)?;
    let loaded = load(args, &camera, camera_path, reporter)?;
    let exploration = Exploration {
        frames: &loaded.frames,
        valid: &loaded.valid,
        organ: &loaded.organ,
        camera: &camera.file.camera,
        tone: &camera.tone,
        light: camera.file.light.as_ref(),
    };
    let built = match (&args.mesh, &args.poses) {
        (Some(mesh), Some(poses)) => {
            let mesh = open_mesh(mesh, reporter)?;
            let poses = read_poses(poses, PoseList::Exploration)?;
            let names: Vec<&str> = loaded.frames.iter().map(|f| f.name.as_str()).collect();
            let poses = match_poses(&poses, &names);
            let unit = unit(&mesh);
            template_from_posed_frames(&exploration, mesh.mesh, unit, &poses, options, reporter)?
        }
        _ => template_from_frames(&exploration, options, reporter)?,
    };
    for (name, why) in &built.rejected {
        reporter.warn(&format!("frame {name} is left out: {why}"));
    }
    let complete = built.rejected.is_empty() && loaded.complete;
    Ok((built, loaded.frames, complete))
}

/// Frames and their masks; a list of masks is empty where none were given.
struct Loaded {
    frames: Vec<Frame>,
    valid: Vec<Option<Mask>>,
    organ: Vec<Option<Mask>>,
    /// No frame had to be left out.
    complete: bool,
}

/// Decode frames and masks. A frame that cannot be read or has another size than the camera is left
/// out with a warning; it is an error if that leaves fewer than two.
fn load(
    args: &TemplateArgs,
    camera: &CameraInput,
    camera_path: &Path,
    reporter: &Reporter,
) -> anyhow::Result<Loaded> {
    let options = [(&args.masks, "--masks"), (&args.organ_masks, "--organ-masks")];
    for (path, option) in options.iter().filter_map(|(p, o)| Some((p.as_ref()?, o))) {
        inputs::must_exist(path, option)?;
    }
    let sources = inputs::sources(&args.frames, inputs::Purpose::Template, reporter)?;
    let mut loaded =
        Loaded { frames: Vec::new(), valid: Vec::new(), organ: Vec::new(), complete: true };
    let mut first_error = None;
    for source in &sources {
        match load_frame(source, camera, camera_path) {
            Ok(frame) => {
                let masks = masks(args, source, &frame, reporter)?;
                loaded.valid.push(masks.0);
                loaded.organ.push(masks.1);
                loaded.frames.push(frame);
            }
            Err(error) => {
                reporter.warn(&format!("{error}; the frame is left out"));
                loaded.complete = false;
                first_error.get_or_insert(error);
            }
        }
    }
    match first_error {
        Some(error) if loaded.frames.len() < 2 => Err(error).with_context(|| {
            format!("{} of {} frames can be used", loaded.frames.len(), sources.len())
        }),
        _ => Ok(loaded),
    }
}

fn load_frame(source: &Source, camera: &CameraInput, path: &Path) -> Result<Frame, InputError> {
    let frame = source.frame()?;
    inputs::check_size(&frame, &camera.file.camera, path)?;
    Ok(frame)
}

fn masks(
    args: &TemplateArgs,
    source: &Source,
    frame: &Frame,
    reporter: &Reporter,
) -> Result<(Option<Mask>, Option<Mask>), InputError> {
    let read = |option: &Option<PathBuf>, kind| {
        option
            .as_deref()
            .map(|path| inputs::mask_of(frame, source.path(), path, kind, reporter))
            .transpose()
    };
    Ok((read(&args.masks, MaskKind::Valid)?, read(&args.organ_masks, MaskKind::Organ)?))
}

fn open_mesh(path: &Path, reporter: &Reporter) -> anyhow::Result<MeshFile> {
    let mesh = read_mesh(path)?;
    for warning in &mesh.warnings {
        reporter.warn(&format!("{}: {warning}", path.display()));
    }
    if let Some(unit @ (MeshUnit::Centimetre | MeshUnit::Metre)) = mesh.unit {
        reporter.warn(&format!(
            "{}: the file is in {unit:?}; its numbers are taken for mm, rescale it if that is wrong",
            path.display()
        ));
    }
    Ok(mesh)
}

fn unit(mesh: &MeshFile) -> LengthUnit {
    match mesh.unit {
        Some(MeshUnit::TemplateUnit) => LengthUnit::TemplateUnit,
        _ => LengthUnit::Millimetre,
    }
}

/// Texels of about this fraction of the mean edge for an albedo image.
const TEXELS_PER_EDGE: f64 = 12.0;

fn read_albedo(path: &Path, file: &MeshFile, global: &Global) -> anyhow::Result<SurfaceTexels> {
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
    let resolution = choose_resolution(&file.mesh, mean_edge(&file.mesh) / TEXELS_PER_EDGE);
    Ok(SurfaceTexels::from_uv_image(uv, &image, resolution)?)
}

fn mean_edge(mesh: &Mesh) -> f64 {
    let length =
        |&[a, b]: &[u32; 2]| (mesh.positions[a as usize] - mesh.positions[b as usize]).norm();
    mesh.topology.edges.iter().map(length).sum::<f64>() / mesh.topology.edges.len() as f64
}

/// One linear value, or three, per line; a first line without numbers is a header.
fn read_vertex_values(path: &Path, vertices: usize) -> Result<Vec<[f32; 3]>, InputError> {
    let text = std::fs::read_to_string(path)
        .map_err(|source| InputError::Read { path: path.into(), source })?;
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
