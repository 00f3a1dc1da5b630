//! `dsfms demo`: the whole road on an embedded scene, compared with its truth.

use crate::args::Global;
use crate::demo::METHODS;
use crate::demo::report::{FrameResult, Report, page};
use crate::demo::scene::{DeformedFrame, Scene, frame_names, unpack};
use crate::demo::truth::{FrameTruth, Tie, steps};
use crate::exit::Outcome;
use crate::outputs::{FrameFiles, FrameMasks, FrameReport, check_folder, summary_csv, write_text};
use crate::place::mark;
use crate::progress::Reporter;
use crate::report::template::template_page;
use crate::stdout::to_stdout;
use clap::Args;
use dsfms::geometry::Point3;
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::io::template::{check_target, write_template};
use dsfms::io::vertex_truth::{VertexTruth, vertex_truth_path, write_vertex_truth};
use dsfms::pipeline::{
    BuiltTemplate, Method, Observation, Progress, ReconstructOptions, Reconstruction,
    TemplateOptions, reconstruct_with, template_from_frames,
};
use dsfms::register::Deformable;
use dsfms::template::Template;
use dsfms::verdict::Level;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

const EXAMPLES: &str = "\
Examples:
  dsfms demo
  dsfms demo -o /tmp/demo --vertices 500

Writes OUT/report.html (one self-contained page), OUT/organ.template,
OUT/<method>/frame_NNN.* as `dsfms reconstruct` does, all in mm (the way of the
camera is given), OUT/truth/frame_NNN.ply on the same vertices, and OUT/scene:
the embedded frames, masks, camera and truth, on which every other command can
be tried. The exit code is 0 when `joint` gave a believable surface for every
frame, else 2. The other methods are there to be compared: their surfaces are
measured and shown whatever is thought of them, with their verdict, but leave
no files where they are not believed. A folder that holds files of these names
is refused, unless its dsfms.json says that they are of an older demo.";

/// What lies in OUT beside the folders of the methods.
const OWN: [&str; 4] = ["scene", "truth", "organ.template", "report.html"];
/// What a method leaves of a frame.
const ENDINGS: [&str; 3] = [".ply", ".json", "_overlay.png"];

/// Reconstruct an embedded scene by five methods and compare with the truth.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct DemoArgs {
    /// Folder for the results.
    #[arg(short, long, value_name = "OUT", default_value = "dsfms-demo")]
    output: PathBuf,
    /// Vertices of the template mesh, 100 to 50000.
    #[arg(long, value_name = "N", default_value_t = 1000)]
    vertices: usize,
}

/// Run the command.
pub fn run(args: &DemoArgs, global: &Global, reporter: &Reporter) -> anyhow::Result<Outcome> {
    let start = Instant::now();
    take(&args.output)?;
    unpack(&args.output.join("scene"))?;
    let scene = Scene::read(&args.output.join("scene"), global)?;
    let built = build(&scene, args, global, reporter)?;
    let template_seconds = start.elapsed().as_secs_f64();
    let folder = args.output.join("organ.template");
    write_template(&folder, &built.template)?;
    template_page("organ", &built.template, &scene.exploration)?
        .write(&folder.join("report.html"))?;
    let tie = Tie::new(&built.template, &scene)?;
    let frames = reconstruct_all(&scene, &built.template, &tie, args, global, reporter)?;
    let report = Report {
        scene: &scene,
        built: &built,
        tie: &tie,
        frames: &frames,
        template_seconds,
        seconds: start.elapsed().as_secs_f64(),
    };
    let path = args.output.join("report.html");
    page(&report)?.write(&path)?;
    reporter.finish();
    to_stdout(&report.text())?;
    let shown = path.canonicalize().unwrap_or(path);
    to_stdout(&format!("report: {}\n", shown.display()))?;
    let joint = METHODS.iter().position(|&m| m == Method::Joint);
    let believed =
        joint.is_some_and(|k| frames.iter().all(|f| f.methods[k].report.status != "failed"));
    Ok(if believed { Outcome::Ok } else { Outcome::Degraded })
}

/// Refuse a folder with files or folders of others that the demo would replace; else mark it, and
/// remove what an older demo found in it.
fn take(output: &Path) -> anyhow::Result<()> {
    let methods = METHODS.map(Method::name);
    let ours = |name: &str| OWN.contains(&name) || methods.contains(&name);
    mark::check_names(output, &["demo"], "-o", ours)?;
    check_target(&output.join("organ.template"))?;
    check_folder(output)?;
    mark::claim(output, "demo")?;
    mark::remove(output, |name| name == "report.html")?;
    let left = |name: &str| {
        let ending = |frame| name.strip_prefix(frame).is_some_and(|end| ENDINGS.contains(&end));
        name == "summary.csv" || frame_names().any(ending)
    };
    methods.iter().try_for_each(|method| mark::remove(&output.join(method), left))?;
    Ok(())
}

fn build(
    scene: &Scene,
    args: &DemoArgs,
    global: &Global,
    reporter: &Reporter,
) -> anyhow::Result<BuiltTemplate> {
    let mut options =
        TemplateOptions { vertices: args.vertices, scale: steps(scene), ..Default::default() };
    options.sfm.seed = global.seed();
    options.dense.seed = global.seed();
    let exploration = scene.camera.exploration(&scene.exploration).organ(&scene.exploration_organ);
    let built = template_from_frames(&exploration, &options, reporter)?;
    for (name, why) in &built.rejected {
        reporter.warn(&format!("frame {name} is left out: {why}"));
    }
    Ok(built)
}

fn reconstruct_all(
    scene: &Scene,
    template: &Template,
    tie: &Tie,
    args: &DemoArgs,
    global: &Global,
    reporter: &Reporter,
) -> anyhow::Result<Vec<FrameResult>> {
    let options = ReconstructOptions { seed: global.seed(), ..Default::default() };
    let mut frames: Vec<FrameResult> = scene
        .deformed
        .iter()
        .map(|d| {
            FrameResult::new(d, tie.matches(template, scene, &d.matches), tie.carry(template, d))
        })
        .collect();
    let jobs: Vec<(usize, Method)> =
        METHODS.iter().flat_map(|&m| (0..frames.len()).map(move |i| (i, m))).collect();
    let deformable = Deformable::of(&template.mesh);
    let done = AtomicUsize::new(0);
    reporter.step("deformed frames", 0, jobs.len());
    let results: Vec<_> = jobs
        .par_iter()
        .map(|&(i, method)| {
            let observation = observation(scene, &scene.deformed[i], &frames[i]);
            let result = reconstruct_with(template, &deformable, &observation, method, &options);
            let count = done.fetch_add(1, Ordering::Relaxed) + 1;
            reporter.step("deformed frames", count, jobs.len());
            result
        })
        .collect();
    for ((i, method), result) in jobs.into_iter().zip(results) {
        let input = scene.deformed[i].frame.name.clone();
        // A comparison that left out what is refused would flatter its method.
        let outcome = match Reconstruction::even_refused(result) {
            Ok(surface) => {
                let truth: &FrameTruth = &frames[i].truth;
                let errors = tie.evaluate(template, &surface.vertices, truth, scene)?;
                let report = FrameReport::of(&input, method, template.unit, &surface);
                (report, Some((surface, errors)))
            }
            Err(error) => {
                reporter.error(&format!("{input}, {}: {error}", method.name()));
                let why = error.to_string();
                (FrameReport::failed(&input, method, template.unit, why), None)
            }
        };
        frames[i].add(method, outcome);
    }
    write_files(scene, template, &args.output, &frames)?;
    write_truth(template, tie, &args.output, &frames)?;
    Ok(frames)
}

fn observation<'a>(
    scene: &'a Scene,
    deformed: &'a DeformedFrame,
    frame: &'a FrameResult,
) -> Observation<'a> {
    let observation = scene.camera.observation(&deformed.frame).matches(&frame.matches);
    observation.instrument(&deformed.instrument).organ(&deformed.organ)
}

/// `OUT/truth/frame_NNN.ply`: the true places of the template's vertices, in its unit, and what
/// `evaluate` reads beside them.
fn write_truth(
    template: &Template,
    tie: &Tie,
    output: &Path,
    frames: &[FrameResult],
) -> anyhow::Result<()> {
    let scale = 1.0 / tie.mm;
    for frame in frames {
        let truth = &frame.truth;
        let positions: Vec<Point3> = truth.mesh.positions.iter().map(|p| p * scale).collect();
        let extras = PlyExtras { visible: Some(&truth.visible), ..Default::default() };
        let path = output.join(format!("truth/{}.ply", frame.name));
        write_ply(&path, &template.mesh.topology, &positions, template.unit, &extras)?;
        let known = VertexTruth {
            visible: truth.visible.clone(),
            displacement: truth.displacement.iter().map(|d| d * scale).collect(),
        };
        write_vertex_truth(&vertex_truth_path(&path), &known)?;
    }
    Ok(())
}

/// `OUT/<method>/frame_NNN.*` and a summary each.
fn write_files(
    scene: &Scene,
    template: &Template,
    output: &Path,
    frames: &[FrameResult],
) -> anyhow::Result<()> {
    for (k, method) in METHODS.into_iter().enumerate() {
        let folder = output.join(method.name());
        let mut rows = Vec::new();
        for (frame, deformed) in frames.iter().zip(&scene.deformed) {
            let name = deformed.frame.name.clone();
            let files = FrameFiles { folder: &folder, name: &name };
            let result = &frame.methods[k];
            let shown = |s: &&(Reconstruction, _)| s.0.verdict.level != Level::Lost;
            if let Some((surface, _)) = result.surface.as_ref().filter(shown) {
                let camera = &scene.camera.file.camera;
                let masks = FrameMasks {
                    instrument: Some(deformed.instrument.clone()),
                    organ: Some(deformed.organ.clone()),
                };
                files.write_surface(template, &deformed.frame, camera, surface, &masks)?;
            }
            files.write_report(&result.report)?;
            rows.push((name, result.report.clone()));
        }
        write_text(&folder.join("summary.csv"), &summary_csv(&rows))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::{create_dir_all, write};

    #[test]
    fn an_older_demo_goes_and_what_is_the_user_s_stays() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        take(&out).unwrap();
        create_dir_all(out.join("joint")).unwrap();
        let ours = ["report.html", "joint/summary.csv", "joint/frame_002.ply"];
        let users = ["notes.txt", "joint/frame_002.txt", "joint/frame_900.ply", "joint/notes.txt"];
        ours.iter().chain(&users).for_each(|name| write(out.join(name), "x").unwrap());
        take(&out).unwrap();
        assert!(ours.iter().all(|name| !out.join(name).exists()));
        assert!(users.iter().all(|name| out.join(name).exists()));
        // A template with a file of the user is found before the work.
        create_dir_all(out.join("organ.template")).unwrap();
        write(out.join("organ.template/notes.txt"), "x").unwrap();
        assert!(take(&out).is_err());
    }
}
