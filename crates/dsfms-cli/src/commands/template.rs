//! `dsfms template`: frames, or a mesh, to a template.

mod found;
mod load;
pub mod mesh;
mod organ;

use super::scale::ScaleArgs;
use crate::args::Global;
use crate::exit::{Outcome, Usage};
use crate::inputs;
use crate::memory::peak_mb;
use crate::outputs::{check_folder, prepare_folder, write_json};
use crate::pictures::organ::write_organ;
use crate::pictures::template::{write_pictures, write_textures};
use crate::place;
use crate::progress::Reporter;
use crate::report::template::template_page;
use clap::{Args, ValueEnum};
use dsfms::io::mesh::{MeshFile, MeshUnit};
use dsfms::io::poses::{PoseList, match_poses, read_poses};
use dsfms::io::template::{check_target, write_template};
use dsfms::pipeline::{
    BuiltTemplate, Progress, TemplateOptions, template_from_frames, template_from_mesh,
    template_from_posed_frames, template_from_poses,
};
use dsfms::sfm::RefineIntrinsics;
use dsfms::template::LengthUnit;
use dsfms::template::albedo::Combine;
use dsfms::template::flatten::FlattenMethod;
use dsfms::template::light_fit::Vignetting;
pub use found::LETTERS;
use found::{models_text, organ_hint, precision_row, summary_text};
use load::{Cameras, Loaded, load, load_also};
use mesh::{Reading, open_mesh, read_albedo, unit};
use organ::OrganArgs;
use std::path::{Path, PathBuf};
use std::time::Instant;

const EXAMPLES: &str = "\
Examples:
  # From frames (PNG, JPEG or TIFF in name order) of the organ at rest, seen by
  # a moving camera
  dsfms template exploration/ --camera camera.json -o organ.template
  # Only inside the organ's outline: white = organ
  dsfms template exploration/ --camera camera.json --organ-masks masks/ \\
      -o organ.template
  # From a video; the intrinsics are a guess to be refined
  dsfms template endo.mp4 --camera guess.json --self-calibrate \\
      -o organ.template
  # The organ outlined by hand on one frame
  dsfms template exploration/ --camera camera.json \\
      --organ-polygon frame_004:120,80,560,90,600,400,90,420 \\
      -o organ.template
  # In mm: two points of the tissue, picked in the frames, are 35 mm apart
  dsfms template exploration/ --camera camera.json \\
      --scale-reference frame_003:812,440 frame_003:1020,610 35mm \\
      -o organ.template
  # The organ is what this pixel shows, as far as the surface goes on without a
  # step
  dsfms template exploration/ --camera camera.json \\
      --organ-click 320,240@frame_004 -o organ.template
  # It went the wrong way: this pixel is not the organ, and what was drawn
  dsfms template exploration/ --camera camera.json \\
      --not-organ-click 60,400@frame_004 --organ-scribbles strokes.json \\
      -o organ.template
  # What moves apart in frames of the deformed organ is apart
  dsfms template exploration/ --camera camera.json --also deformed/ \\
      -o organ.template
  # In mm: a surface of the organ from CT, in any place
  dsfms template exploration/ --camera camera.json --organ-masks masks/ \\
      --scale-mesh liver.stl -o organ.template
  # On a mesh of your own, in the world of known camera poses
  dsfms template exploration/ --camera camera.json --mesh organ.ply \\
      --poses poses.json -o organ.template
  # The camera poses are known (a tracked laparoscope, COLMAP), the surface is
  # not
  dsfms template exploration/ --camera camera.json --poses poses.json \\
      -o organ.template
  # A mesh whose albedo is known: an image in its UV, or a CSV with one value
  # (or r,g,b) a vertex
  dsfms template --mesh organ.obj --albedo albedo.png -o organ.template

Masks: white (above 127) = valid for --masks, = organ for --organ-masks. A mask
belongs to the frame of the same name or number. A mask that covers nearly all
or nothing draws a warning.

The result is a folder: template.toml, template.glb, template.ply and more.
Without --mesh its lengths are in template units, similar to the truth at an
unknown scale; a known distance (--scale-reference, --camera-step) or a metric
mesh (--scale-mesh) makes them mm. pictures/ shows the flattening and the
albedo, and which part of the frames was taken for the organ where no mask said
it (organ.png; as masks in organ_masks/: copy, mend, and give them back with
--organ-masks). Where the organ ends is open, all is kept, the exit code is 2,
and pictures/organ_a.png, organ_b.png ... show what may be meant, outlines from
green, clearly marked, to red, a guess, with an option for each.
surroundings.ply is what lies around the organ. Strokes (--organ-scribbles):
  {\"strokes\": [{\"frame\": \"frame_004\", \"organ\": true,
                \"px\": [[120, 80], [310, 95]]}]}
precision.json says how far camera poses and sparse points may
be off (expected errors and covariances).";

/// Build a template (rest shape, albedo, descriptors) from exploration frames or a mesh.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct TemplateArgs {
    /// Folder of frames, image files, or one video.
    #[arg(value_name = "FRAMES_DIR_OR_VIDEO")]
    frames: Vec<PathBuf>,
    /// Intrinsics: camera.json, OpenCV YAML or JSON, or COLMAP's cameras.txt, cameras.bin
    /// or model folder; where the cameras of a model's images differ, frames are brought to
    /// that of most.
    #[arg(help_heading = "Input", long, value_name = "FILE")]
    camera: Option<PathBuf>,
    /// Masks of the frames, white = valid image content (no instrument, inside the viewport).
    #[arg(help_heading = "Input", long, value_name = "DIR")]
    masks: Option<PathBuf>,
    #[command(flatten)]
    organ: OrganArgs,
    /// Leave the surface as stereo saw it; else the shading of all frames refines it within its expected
    /// error.
    #[arg(help_heading = "Surface", long, conflicts_with = "mesh")]
    no_shading_refinement: bool,
    /// Vertices of the template mesh, 100 to 50000; default 1000.
    #[arg(help_heading = "Surface", long, value_name = "N")]
    vertices: Option<usize>,
    /// Shorter edges where the surface bends, longer ones where it is flat, 0.5 to 2 of the mean:
    /// STRENGTH from 0 (one length) to 1 (the same distance from the surface everywhere).
    #[arg(help_heading = "Surface", long, value_name = "STRENGTH", num_args = 0..=1, require_equals = true, default_missing_value = "1", conflicts_with = "mesh")]
    adaptive: Option<f64>,
    /// Peel off the rim what the surface itself hides from every frame, or what faces away from all.
    #[arg(help_heading = "Surface", long, conflicts_with = "mesh")]
    peel_hidden: bool,
    /// Surface to use: PLY, OBJ, STL, glTF, OFF or VTK (.vtk, .vtp); its vertex order and faces are kept.
    #[arg(help_heading = "Input", long, value_name = "FILE")]
    mesh: Option<PathBuf>,
    /// Unit of the numbers in --mesh or --scale-mesh; default what the file says (glTF is in metres),
    /// else mm.
    #[arg(help_heading = "Input", long, value_enum, value_name = "UNIT")]
    mesh_unit: Option<UnitName>,
    /// Mend --mesh or --scale-mesh: merge vertices at the same place, remove repeated faces and those
    /// without area, turn faces that run against their neighbours. What was done is said.
    #[arg(help_heading = "Input", long)]
    repair: bool,
    /// Known camera poses of the frames, in the mesh's frame if there is one: poses.json, or COLMAP's
    /// images.txt, images.bin or model folder. Without --mesh the surface is in their world and
    /// unit, called template units unless a known distance makes them mm.
    #[arg(help_heading = "Input", long, value_name = "FILE")]
    poses: Option<PathBuf>,
    /// Albedo of the mesh: an image in its UV, or a CSV with one value (or r,g,b) per vertex.
    #[arg(
        help_heading = "Input",
        long,
        value_name = "FILE",
        requires = "mesh",
        conflicts_with = "poses"
    )]
    albedo: Option<PathBuf>,
    /// Estimate the lens's vignetting along with the light, where the camera file does not say.
    #[arg(help_heading = "Light and albedo", long, conflicts_with = "albedo")]
    estimate_vignetting: bool,
    /// What the albedos of single frames become; default robust.
    #[arg(help_heading = "Light and albedo", long, value_enum, conflicts_with = "albedo")]
    albedo_rule: Option<AlbedoRule>,
    /// Refine focal length, principal point and radial distortion along with the poses.
    #[arg(help_heading = "Scale and calibration", long, conflicts_with_all = ["mesh", "poses"])]
    self_calibrate: bool,
    #[command(flatten)]
    scale: ScaleArgs,
    /// Surface of the same organ in mm (PLY, OBJ, STL or glTF), in any place: the template takes its
    /// scale from the placement that fits best.
    #[arg(help_heading = "Scale and calibration", long, value_name = "MESH", conflicts_with_all = ["mesh", "scale_reference", "camera_step"])]
    scale_mesh: Option<PathBuf>,
    /// How charts are flattened; default bff.
    #[arg(help_heading = "Surface", long, value_enum)]
    flatten: Option<Flatten>,
    /// Sizes and thresholds as TOML, as `dsfms options template` prints them; what it does not name
    /// keeps its default, and what the command line names counts.
    #[arg(help_heading = "Method", long, value_name = "FILE")]
    options: Option<PathBuf>,
    /// Leave out TEMPLATE/report.html.
    #[arg(help_heading = "Output", long)]
    no_report: bool,
    /// Template folder to write.
    #[arg(help_heading = "Output", short, long, value_name = "TEMPLATE")]
    output: PathBuf,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Flatten {
    /// Conformal with constant boundary scale: the least area distortion.
    Bff,
    /// Least-squares conformal map, two vertices held.
    Lscm,
    /// Spectral conformal map.
    Spectral,
}

impl From<Flatten> for FlattenMethod {
    fn from(method: Flatten) -> Self {
        match method {
            Flatten::Bff => Self::Bff,
            Flatten::Lscm => Self::Lscm,
            Flatten::Spectral => Self::Spectral,
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum UnitName {
    /// Millimetres.
    Mm,
    /// Centimetres.
    Cm,
    /// Metres.
    M,
}

impl From<UnitName> for MeshUnit {
    fn from(name: UnitName) -> Self {
        match name {
            UnitName::Mm => Self::Millimetre,
            UnitName::Cm => Self::Centimetre,
            UnitName::M => Self::Metre,
        }
    }
}

impl TemplateArgs {
    fn reading(&self) -> Reading {
        Reading { unit: self.mesh_unit.map(Into::into), repair: self.repair }
    }
}

/// `--scale-mesh`: a mesh that tells lengths.
fn metric_mesh(path: &Path, args: &TemplateArgs, reporter: &Reporter) -> anyhow::Result<MeshFile> {
    let mesh = open_mesh(path, args.reading(), reporter)?;
    if unit(&mesh) == LengthUnit::TemplateUnit {
        let problem = format!(
            "--scale-mesh {}: the file is in template units, which tell no scale; give a mesh in mm, cm or m",
            path.display()
        );
        return Err(Usage(problem).into());
    }
    Ok(mesh)
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum AlbedoRule {
    /// Mean that leaves outliers out, weighted by how squarely each frame sees the place.
    Robust,
    /// The smallest (the paper's eq. 2): no highlight gets in, noise and shadows do.
    Minimum,
}

impl From<AlbedoRule> for Combine {
    fn from(rule: AlbedoRule) -> Self {
        match rule {
            AlbedoRule::Robust => Self::Robust,
            AlbedoRule::Minimum => Self::Minimum,
        }
    }
}

/// Run the command.
pub fn run(args: &TemplateArgs, global: &Global, reporter: &Reporter) -> anyhow::Result<Outcome> {
    check(args)?;
    let parent = args.output.parent().filter(|p| !p.as_os_str().is_empty());
    let parent = parent.unwrap_or(Path::new("."));
    check_folder(parent)?;
    check_target(&args.output)?;
    let optional = [&args.masks, &args.organ.organ_masks].into_iter().flatten();
    let inputs: Vec<&Path> =
        args.frames.iter().chain(optional).chain(&args.organ.also).map(PathBuf::as_path).collect();
    place::check_apart(&args.output, &inputs)?;
    let options = options(args, global)?;
    let pictures = args.output.join("pictures");
    let (template, told, loaded, complete) = match (args.frames.is_empty(), &args.mesh) {
        (true, Some(mesh)) => {
            let mesh = open_mesh(mesh, args.reading(), reporter)?;
            let albedo =
                args.albedo.as_deref().map(|p| read_albedo(p, &mesh, global)).transpose()?;
            let unit = unit(&mesh);
            (template_from_mesh(mesh.mesh, unit, albedo, &options, reporter), None, None, true)
        }
        _ => {
            let (built, loaded, complete) = from_frames(args, global, &options, reporter)?;
            (built.template, Some((built.precision, built.organ)), Some(loaded), complete)
        }
    };
    let (precision, organ) = told.unwrap_or_default();
    prepare_folder(parent)?;
    write_template(&args.output, &template)?;
    if let Some(precision) = &precision {
        write_json(&args.output.join("precision.json"), precision)?;
    }
    write_pictures(&template, &pictures)?;
    if let Some(loaded) = &loaded {
        write_textures(&template, &loaded.frames, &loaded.valid, &pictures)?;
        if let Some(organ) = &organ {
            write_organ(organ, &loaded.frames, &args.output)?;
            if organ.open() || !args.organ.said(&options) {
                organ_hint(organ, &args.output).iter().for_each(|line| reporter.warn(line));
            }
        }
    }
    if !args.no_report {
        let name = args.output.file_name().unwrap_or_default().to_string_lossy();
        let frames = loaded.as_ref().map_or(&[][..], |l| &l.frames);
        template_page(&name, &template, frames)?.write(&args.output.join("report.html"))?;
    }
    reporter.finish();
    if !global.quiet {
        super::inspect::print(&template)?;
        if let Some(precision) = &precision {
            super::to_stdout(&precision_row(precision, template.unit))?;
        }
        if let Some(peak) = peak_mb() {
            super::to_stdout(&format!("{:<14}{peak:.0} MB\n", "peak memory"))?;
        }
    }
    Ok(if complete { Outcome::Ok } else { Outcome::Degraded })
}

/// Combinations that clap cannot name well.
fn check(args: &TemplateArgs) -> anyhow::Result<()> {
    let wrong = |text: &str| Err(Usage(text.into()).into());
    match (args.frames.is_empty(), &args.mesh, &args.poses, &args.camera) {
        (true, _, Some(_), _) => wrong("--poses belongs to frames; give the frames too"),
        (true, None, ..) => {
            wrong("give exploration frames (a folder, files or a video), or --mesh")
        }
        (false, Some(_), None, _) => wrong("frames on a given --mesh need --poses"),
        (false, _, _, None) => wrong("frames need --camera"),
        _ if (args.repair || args.mesh_unit.is_some())
            && args.mesh.is_none()
            && args.scale_mesh.is_none() =>
        {
            wrong("--mesh-unit and --repair belong to --mesh or --scale-mesh")
        }
        _ if args.vertices.is_some_and(|n| !(100..=50_000).contains(&n)) => wrong(&format!(
            "--vertices {}: expected 100 to 50000",
            args.vertices.unwrap_or_default()
        )),
        _ if args.adaptive.is_some_and(|strength| !(0.0..=1.0).contains(&strength)) => {
            wrong("--adaptive: expected a strength from 0 to 1, as --adaptive=0.5")
        }
        _ if !args.frames.is_empty() && args.albedo.is_some() => {
            wrong("--albedo is for a mesh without frames; with frames the albedo is measured")
        }
        _ => Ok(()),
    }
}

fn options(args: &TemplateArgs, global: &Global) -> anyhow::Result<TemplateOptions> {
    let mut options = match &args.options {
        Some(path) => inputs::options(path, TemplateOptions::from_toml)?,
        None => TemplateOptions::default(),
    };
    options.vertices = args.vertices.unwrap_or(options.vertices);
    args.organ.apply(&mut options)?;
    options.refine_by_shading &= !args.no_shading_refinement;
    let references = args.scale.references()?;
    if !references.is_empty() {
        options.scale = references;
    }
    options.remesh.adaptive = args.adaptive.unwrap_or(options.remesh.adaptive);
    if let Some(method) = args.flatten {
        options.flatten.method = method.into();
    }
    if let Some(rule) = args.albedo_rule {
        options.albedo.combine = rule.into();
    }
    if args.estimate_vignetting {
        options.light.vignetting = Vignetting::Estimated;
    }
    options.sfm.seed = global.seed;
    options.dense.seed = global.seed;
    options.dense.peel_hidden |= args.peel_hidden;
    if args.self_calibrate {
        options.sfm.refine = RefineIntrinsics {
            focal: true,
            centre: true,
            distortion: true,
            second_distortion: false,
        };
    }
    Ok(options)
}

fn from_frames(
    args: &TemplateArgs,
    global: &Global,
    options: &TemplateOptions,
    reporter: &Reporter,
) -> anyhow::Result<(BuiltTemplate, Loaded, bool)> {
    let start = Instant::now();
    let Some(camera_path) = &args.camera else {
        return Err(Usage("frames need --camera".into()).into());
    };
    let cameras = Cameras::open(camera_path, args, global)?;
    // The small files first: a mistake in them is told before frames are decoded.
    let metric = args.scale_mesh.as_deref().map(|p| metric_mesh(p, args, reporter)).transpose()?;
    let given = args.mesh.as_deref().map(|p| open_mesh(p, args.reading(), reporter)).transpose()?;
    let listed = args.poses.as_deref().map(|p| read_poses(p, PoseList::Exploration)).transpose()?;
    let loaded = load(args, &cameras, camera_path, reporter)?;
    let also = load_also(args, &cameras, camera_path, reporter)?;
    let camera = &cameras.common;
    let mut options = options.clone();
    camera.tell_options(&mut options);
    let options = &options;
    let exploration = camera.exploration(&loaded.frames).valid(&loaded.valid).organ(&loaded.organ);
    let exploration = exploration.metric(metric.as_ref().map(|m| &m.mesh)).also(&also);
    let names: Vec<&str> = loaded.frames.iter().map(|f| f.name.as_str()).collect();
    let poses = listed.map(|list| match_poses(&list, &names));
    let built = match (given, poses) {
        (Some(mesh), Some(poses)) => {
            let unit = unit(&mesh);
            template_from_posed_frames(&exploration, mesh.mesh, unit, &poses, options, reporter)?
        }
        (None, Some(poses)) => template_from_poses(&exploration, &poses, options, reporter)?,
        _ => template_from_frames(&exploration, options, reporter)?,
    };
    let seconds = start.elapsed().as_secs_f64();
    reporter.say(&summary_text(&built.template, exploration.frames.len(), seconds));
    if let Some(scale) = &built.scale {
        super::scale::report(scale, reporter);
    }
    if built.models.len() > 1 {
        reporter.warn(&models_text(&built.models));
    }
    for (name, why) in &built.rejected {
        reporter.warn(&format!("frame {name} is left out: {why}"));
    }
    let asked = !options.scale.is_empty() || metric.is_some();
    let scaled = built.scale.is_some() || !asked;
    // What may not be the organ alone is no template of it.
    let parted = built.organ.as_ref().is_none_or(|organ| !organ.open());
    let complete = built.rejected.is_empty() && loaded.complete && scaled && parted;
    Ok((built, loaded, complete))
}
