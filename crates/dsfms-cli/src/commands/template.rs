//! `dsfms template`: frames, or a mesh, to a template.

pub mod args;
mod found;
mod load;
pub mod mesh;
mod organ;
mod resume;
pub mod scene;

use crate::args::Global;
use crate::exit::{Outcome, Usage};
use crate::inputs;
use crate::memory::peak_mb;
use crate::outputs::{check_folder, prepare_folder, write_json};
use crate::pictures::measured::write_measured;
use crate::pictures::organ::write_organ;
use crate::pictures::template::{write_pictures, write_textures};
use crate::place;
use crate::progress::Reporter;
use crate::report::template::template_page;
use crate::stdout::to_stdout;
pub use args::TemplateArgs;
use dsfms::geometry::Isometry;
use dsfms::io::mesh::MeshFile;
use dsfms::io::poses::{PoseList, match_poses, read_poses};
use dsfms::io::template::{check_target, write_template};
use dsfms::pipeline::{
    BuiltTemplate, FoundOrgan, OrganScene, Progress, SparsePrecision, TemplateOptions,
    template_from_frames, template_from_mesh, template_from_posed_frames, template_from_poses,
};
use dsfms::sfm::RefineIntrinsics;
use dsfms::template::light_fit::Vignetting;
use dsfms::template::statistics::{MOST_UNMEASURED, unmeasured};
use dsfms::template::{LengthUnit, Template};
pub use found::LETTERS;
use found::{models_text, organ_hint, precision_row, summary_text, unlike_text, unmeasured_text};
use load::{Cameras, Loaded, load, load_also};
use mesh::{MeshReading, open_mesh, read_albedo, unit};
use resume::Resumable;
use scene::{Drawn, SCENE, with_photos};
use std::path::{Path, PathBuf};
use std::time::Instant;

impl TemplateArgs {
    fn reading(&self) -> MeshReading {
        MeshReading { unit: self.mesh_unit.map(Into::into), repair: self.repair }
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
    let files = [&args.camera, &args.mesh, &args.albedo, &args.scale_mesh].into_iter().flatten();
    let files: Vec<&Path> = args.frames.iter().chain(files).map(PathBuf::as_path).collect();
    place::keep_outside(&args.output, &files)?;
    let options = options(args, global)?;
    let pictures = args.output.join("pictures");
    let stages = Resumable::new(&args.output, reporter);
    let Made { template, precision, organ, scene, loaded, complete } =
        make(args, global, &options, &stages)?;
    prepare_folder(parent)?;
    let drawn = Drawn::of(&args.output);
    write_template(&args.output, &template)?;
    drawn.keep(&options, reporter)?;
    if let Some(precision) = &precision {
        write_json(&args.output.join("precision.json"), precision)?;
    }
    write_pictures(&template, &pictures)?;
    if let Some(loaded) = &loaded {
        write_textures(&template, &loaded.frames, &loaded.valid, &pictures)?;
        write_measured(&template, &loaded.frames, &pictures)?;
        if let Some(scene) = scene {
            with_photos(scene, &loaded.frames)?.write(&args.output.join(SCENE))?;
        }
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
    stages.done();
    reporter.finish();
    if !global.quiet {
        super::inspect::print(&template)?;
        if let Some(precision) = &precision {
            to_stdout(&precision_row(precision, template.unit))?;
        }
        if let Some(peak) = peak_mb() {
            to_stdout(&format!("{:<14}{peak:.0} MB\n", "peak memory"))?;
        }
    }
    Ok(if complete { Outcome::Ok } else { Outcome::Degraded })
}

/// A template, and what came about with it where it is of frames.
struct Made {
    template: Template,
    precision: Option<SparsePrecision>,
    organ: Option<FoundOrgan>,
    scene: Option<OrganScene>,
    loaded: Option<Loaded>,
    complete: bool,
}

fn make(
    args: &TemplateArgs,
    global: &Global,
    options: &TemplateOptions,
    stages: &Resumable,
) -> anyhow::Result<Made> {
    let reporter = stages.reporter;
    if let (true, Some(mesh)) = (args.frames.is_empty(), &args.mesh) {
        let mesh = open_mesh(mesh, args.reading(), reporter)?;
        let albedo = args.albedo.as_deref().map(|p| read_albedo(p, &mesh, global)).transpose()?;
        let unit = unit(&mesh);
        let template = template_from_mesh(mesh.mesh, unit, albedo, options, reporter);
        let (precision, organ, scene, loaded) = (None, None, None, None);
        return Ok(Made { template, precision, organ, scene, loaded, complete: true });
    }
    let (built, loaded, complete) = from_frames(args, global, options, stages)?;
    Ok(Made {
        template: built.template,
        precision: built.precision,
        organ: built.organ,
        scene: built.organ_scene,
        loaded: Some(loaded),
        complete,
    })
}

/// Combinations that clap cannot name well.
fn check(args: &TemplateArgs) -> anyhow::Result<()> {
    let wrong = |text: &str| Err(Usage(text.into()).into());
    if let (true, true, Some(option)) =
        (args.frames.is_empty(), args.mesh.is_some(), args.of_frames())
    {
        return wrong(&format!("{option} belongs to frames; give the frames too, or leave it out"));
    }
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
    if let Some(seed) = global.seed {
        (options.sfm.seed, options.dense.seed) = (seed, seed);
    }
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
    stages: &Resumable,
) -> anyhow::Result<(BuiltTemplate, Loaded, bool)> {
    let (start, reporter) = (Instant::now(), stages.reporter);
    let Some(camera_path) = &args.camera else {
        return Err(Usage("frames need --camera".into()).into());
    };
    let cameras = Cameras::open(camera_path, args, global)?;
    // The small files first: a mistake in them is told before frames are decoded.
    let metric = args.scale_mesh.as_deref().map(|p| metric_mesh(p, args, reporter)).transpose()?;
    let given = args.mesh.as_deref().map(|p| open_mesh(p, args.reading(), reporter)).transpose()?;
    let listed = args.poses.as_deref().map(|p| read_poses(p, PoseList::Exploration)).transpose()?;
    let loaded = load(args, &options.video, &cameras, camera_path, reporter)?;
    let also = load_also(args, &cameras, camera_path, reporter)?;
    let camera = &cameras.common;
    let exploration = camera.exploration(&loaded.frames).valid(&loaded.valid).organ(&loaded.organ);
    let exploration = exploration.metric(metric.as_ref().map(|m| &m.mesh)).also(&also);
    let names: Vec<&str> = loaded.frames.iter().map(|f| f.name.as_str()).collect();
    let poses = listed.map(|list| match_poses(&list, &names));
    if let (Some(path), Some(poses)) = (&args.poses, &poses) {
        some_pose(path, poses, &names)?;
    }
    let exploration = exploration.keep(stages);
    let built = match (given, poses) {
        (Some(mesh), Some(poses)) => {
            let unit = unit(&mesh);
            template_from_posed_frames(&exploration, mesh.mesh, unit, &poses, options, reporter)
        }
        (None, Some(poses)) => template_from_poses(&exploration, &poses, options, stages),
        _ => template_from_frames(&exploration, options, stages),
    };
    let built = built.inspect_err(|_| stages.failed())?;
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
    let unscaled = built.scale.is_none() && (!options.scale.is_empty() || metric.is_some());
    let complete = whole(&built, args.mesh.is_some(), reporter) && loaded.complete && !unscaled;
    Ok((built, loaded, complete))
}

/// Whether every frame is in a template, and looks like it where its surface was given, it is of
/// the organ alone, and frames agree on nearly all of it; says where they do not.
fn whole(built: &BuiltTemplate, given: bool, reporter: &Reporter) -> bool {
    let holes = unmeasured(&built.template).filter(|&share| share > MOST_UNMEASURED);
    if let Some(share) = holes {
        reporter.warn(&unmeasured_text(share));
    }
    // Poses and surface that were found agree with the frames by themselves.
    let usual = built.template.usual.filter(|_| given);
    let unlike = usual.and_then(|usual| usual.unlike());
    if let Some(correlation) = unlike {
        reporter.warn(&unlike_text(correlation));
    }
    let parted = built.organ.as_ref().is_none_or(|organ| !organ.open());
    built.rejected.is_empty() && parted && holes.is_none() && unlike.is_none()
}

/// Poses of other frames are named with their file.
fn some_pose(path: &Path, poses: &[Option<Isometry>], names: &[&str]) -> anyhow::Result<()> {
    if let (true, Some(first)) = (poses.iter().all(Option::is_none), names.first()) {
        anyhow::bail!(
            "{}: none of its poses is of one of the {} frames; expected image names or numbers as in {first}",
            path.display(),
            names.len()
        );
    }
    Ok(())
}
