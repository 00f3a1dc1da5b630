//! `dsfms register-ct`: a preoperative mesh and what lies in it, onto a template.

mod args;
pub mod carried;
mod input;
mod record;

use crate::args::Global;
use crate::exit::{Outcome, Usage};
use crate::outputs::{check_folder, write_json, write_png};
use crate::pictures::preoperative::{ShownRegistration, draw};
use crate::place;
use crate::progress::Reporter;
use crate::stdout::to_stdout;
use crate::volume::ORIGINAL;
pub use args::RegisterCtArgs;
use args::ScaleName;
use carried::Carried;
use dsfms::geometry::Point3;
use dsfms::io::folder::{check_folder_target, write_folder};
use dsfms::io::ply::{PlyExtras, Precision, write_ply};
use dsfms::io::template::read_template;
use dsfms::mesh::Mesh;
use dsfms::pipeline::Progress;
use dsfms::preoperative::{
    Doubt, Preoperative, PreoperativeOptions, ScaleRule, register_preoperative,
};
use dsfms::template::{LengthUnit, Template};
use input::{LoadedCt, load};
use record::{failed, record};
use std::path::{Path, PathBuf};

/// What the folder holds; the first name tells that it is one.
const CONTENT: [&str; 5] =
    ["registration.json", "ct.ply", ORIGINAL, "structures", "registration.png"];
/// How far mm of the template may be from mm.
const METRIC: f64 = 0.05;

/// Run the command.
pub fn run(args: &RegisterCtArgs, global: &Global, reporter: &Reporter) -> anyhow::Result<Outcome> {
    let inputs = [&args.template, &args.ct].into_iter().chain(&args.structures);
    place::keep_outside(&args.output, &inputs.map(PathBuf::as_path).collect::<Vec<_>>())?;
    check_folder_target(&args.output, &CONTENT)?;
    check_folder(&args.output)?;
    let template = read_template(&args.template)?;
    let rule = scale_rule(args, template.unit)?;
    let loaded = load(args, &template, reporter)?;
    let options = PreoperativeOptions {
        scale: rule,
        landmark_sigma: args.landmark_error,
        deform: !args.rigid,
        max_deformation: args.max_deformation,
        max_target_error: args.max_error,
        seed: global.seed(),
        ..Default::default()
    };
    let step = |stage: &str, done: usize, total: usize| reporter.step(stage, done, total);
    let surface = (&template.mesh, template.sigma.as_slice());
    let found = register_preoperative(surface, &loaded.ct, &loaded.landmarks, &options, &step);
    reporter.finish();
    let mut found = match found {
        Ok(found) => found,
        Err(error) => {
            let report = failed(&error, args, &loaded);
            write_folder::<anyhow::Error>(&args.output, &CONTENT, |folder| {
                write_json(&folder.join(CONTENT[0]), &report)
            })?;
            reporter.error(&format!("refused: {error}"));
            return Ok(Outcome::Nothing);
        }
    };
    let carried = carry(&found, &loaded, &template)?;
    found.doubts.extend(uncertain(&carried, &options));
    write(args, &template, &loaded, &found, &carried)?;
    tell(&found, &carried, global, reporter, args)?;
    Ok(if found.doubts.is_empty() { Outcome::Ok } else { Outcome::Degraded })
}

fn scale_rule(args: &RegisterCtArgs, unit: LengthUnit) -> Result<ScaleRule, Usage> {
    match (args.scale, unit) {
        (Some(ScaleName::Free), _) | (None, LengthUnit::TemplateUnit) => Ok(ScaleRule::Free),
        (Some(ScaleName::Bounded) | None, LengthUnit::Millimetre) => Ok(ScaleRule::Within(METRIC)),
        (Some(ScaleName::Fixed), LengthUnit::Millimetre) => Ok(ScaleRule::Fixed),
        (Some(_), LengthUnit::TemplateUnit) => Err(Usage(
            "--scale: the template is in template units, whose scale is not known; leave --scale out".into(),
        )),
    }
}

fn carry(
    found: &Preoperative,
    loaded: &LoadedCt,
    template: &Template,
) -> anyhow::Result<Vec<Carried>> {
    let of = |(name, mesh): &(String, Mesh)| {
        let points = found.carry(&mesh.positions)?;
        let expected = found.expected(&mesh.positions, &points, &template.mesh)?;
        Ok(Carried { name: name.clone(), mesh: mesh.with_positions(points), expected })
    };
    loaded.structures.iter().map(of).collect()
}

fn uncertain(carried: &[Carried], options: &PreoperativeOptions) -> Vec<Doubt> {
    let bound_mm = options.max_target_error;
    let far = carried.iter().filter(|c| c.error() > bound_mm);
    far.map(|c| Doubt::Uncertain { name: c.name.clone(), expected_mm: c.error(), bound_mm })
        .collect()
}

fn write(
    args: &RegisterCtArgs,
    template: &Template,
    loaded: &LoadedCt,
    found: &Preoperative,
    carried: &[Carried],
) -> anyhow::Result<()> {
    let scale = found.similarity.scaling();
    write_folder(&args.output, &CONTENT, |folder: &Path| -> anyhow::Result<()> {
        let comments = [format!("template frame, registered from {}", loaded.name)];
        let extras = PlyExtras { comments: &comments, ..Default::default() };
        let topology = &loaded.ct.topology;
        write_ply(&folder.join("ct.ply"), topology, &found.vertices, template.unit, &extras)?;
        let extras = PlyExtras { precision: Precision::Double, ..Default::default() };
        let own = &loaded.ct.positions;
        write_ply(&folder.join(ORIGINAL), topology, own, LengthUnit::Millimetre, &extras)?;
        for item in carried {
            let own: Vec<f64> = item.expected.iter().map(|e| e / scale).collect();
            let extras =
                PlyExtras { comments: &comments, expected_error: Some(&own), ..Default::default() };
            let path = folder.join(format!("structures/{}.ply", item.name));
            let points: &[Point3] = &item.mesh.positions;
            write_ply(&path, &item.mesh.topology, points, template.unit, &extras)?;
        }
        let shown = ShownRegistration { template: &template.mesh, ct: &loaded.ct, found, carried };
        write_png(&folder.join("registration.png"), &draw(&shown))?;
        write_json(&folder.join(CONTENT[0]), &record(args, template, loaded, found, carried))
    })
}

/// A short table, and the doubts.
fn tell(
    found: &Preoperative,
    carried: &[Carried],
    global: &Global,
    reporter: &Reporter,
    args: &RegisterCtArgs,
) -> anyhow::Result<()> {
    found.doubts.iter().for_each(|doubt| reporter.warn(&doubt.to_string()));
    if global.quiet {
        return Ok(());
    }
    let residual = found.bent.unwrap_or(found.rigid);
    let mut text = format!(
        "{}\n  {:.4} mm per unit of the template\n  residual {:.2} mm rms, {:.2} mm p95 over {:.0} % of the template \
         (similarity alone {:.2} mm rms)\n",
        args.output.display(),
        found.similarity.scaling(),
        residual.rms,
        residual.p95,
        100.0 * residual.overlap,
        found.rigid.rms
    );
    if let Some(fit) = &found.landmarks {
        let agree = fit.agree.iter().filter(|a| **a).count();
        text += &format!("  {agree} of {} landmark pairs agree\n", fit.agree.len());
    }
    for item in carried {
        text += &format!("  {}: expected error {:.1} mm\n", item.name, item.error());
    }
    to_stdout(&text)
}
