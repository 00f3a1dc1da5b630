//! Eq. 3 on tracks of real surfaces with 3D truth: the first view is the template, the matches in a
//! disc of a quarter of the points are hidden, and every method says where they are.
//!
//!     python3 scripts/convert_totem.py DATA_DIR SETS
//!     cargo run --release --example totem -- SETS [OUT [OPTIONS.toml]]
//!
//! "Every match" hides none. Prints the table as Markdown; OUT gets totem.csv (a row per view, disc and method) and the shapes
//! of the first disc as PLY, for looking at. OPTIONS.toml: as for `dsfms reconstruct --options`.

use dsfms::camera::CameraModel;
use dsfms::eval::{Alignment, EvaluateOptions, Truth, evaluate};
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::io::{camera::read_camera, matches::read_matches, mesh::read_mesh};
use dsfms::mesh::Mesh;
use dsfms::pipeline::ReconstructOptions;
use dsfms::register::{Match, Prior, PriorWeights, RegisterOptions, Scene, pose, register};
use dsfms::synth::random::Random;
use dsfms::template::LengthUnit;
use std::error::Error;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Discs per view.
const DISCS: u64 = 10;

const METHODS: [(&str, Option<Prior>); 4] = [
    ("rigid", None),
    ("conformal", Some(Prior::Conformal)),
    ("isometric", Some(Prior::Isometric)),
    ("arap", Some(Prior::Arap)),
];

struct View {
    name: String,
    truth: Mesh,
    matches: Vec<Match>,
}

/// Mean errors of one method on one view and disc, mm: overall, in the disc and outside it without
/// alignment, then overall and in the disc after a rigid one.
type Errors = [f64; 5];

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let sets = arguments.next().ok_or("usage: totem SETS [OUT]")?;
    let out = arguments.next();
    let options = match arguments.next() {
        Some(path) => ReconstructOptions::from_toml(&std::fs::read_to_string(path)?)?.register,
        None => RegisterOptions::default(),
    };
    let mut csv =
        String::from("set,view,disc,method,all,disc_mm,outside,aligned_all,aligned_disc\n");
    println!(
        "| set | method | every match | aligned | all | disc | outside | all, aligned | disc, aligned | \
         disc, p90 of means |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    let mut folders: Vec<PathBuf> =
        std::fs::read_dir(&sets)?.map(|entry| Ok(entry?.path())).collect::<std::io::Result<_>>()?;
    folders.sort();
    for folder in folders.iter().filter(|f| f.join("rest.ply").is_file()) {
        run_set(folder, &options, out.as_deref(), &mut csv)?;
    }
    if let Some(out) = out {
        std::fs::create_dir_all(&out)?;
        std::fs::write(out.join("totem.csv"), csv)?;
    }
    Ok(())
}

fn run_set(
    folder: &Path,
    options: &RegisterOptions,
    out: Option<&Path>,
    csv: &mut String,
) -> Result<(), Box<dyn Error>> {
    let set = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let camera = read_camera(&folder.join("camera.json"))?.camera;
    let rest = read_mesh(&folder.join("rest.ply"))?.mesh;
    let mut views = read_views(folder, &rest, &camera)?;
    views.retain(|view| match pose(&camera, &rest, &view.matches, options, 0) {
        Ok(_) => true,
        Err(error) => {
            eprintln!("{set} {} left out: {error}", view.name);
            false
        }
    });
    let mut rows: Vec<Vec<Errors>> = vec![Vec::new(); METHODS.len()];
    let mut whole = vec![[0.0; 2]; METHODS.len()];
    let none = vec![false; rest.positions.len()];
    for view in &views {
        for ((_, prior), sums) in METHODS.iter().zip(&mut whole) {
            let shape = solve(&camera, &rest, view, &none, *prior, options)?;
            let errors =
                [Alignment::None, Alignment::Rigid].map(|a| whole_error(&shape, &view.truth, a));
            sums.iter_mut().zip(errors).try_for_each(|(sum, error)| error.map(|e| *sum += e))?;
        }
        for disc in 0..DISCS {
            let hidden = disc_of(&rest, disc);
            for ((name, prior), rows) in METHODS.iter().zip(&mut rows) {
                let shape = solve(&camera, &rest, view, &hidden, *prior, options)?;
                let errors = measure(&shape, &view.truth, &hidden)?;
                let numbers = errors.map(|e| format!("{e:.3}")).join(",");
                writeln!(csv, "{set},{},{disc},{name},{numbers}", view.name)?;
                if let Some(out) = out.filter(|_| disc == 0) {
                    std::fs::create_dir_all(out)?;
                    let path = out.join(format!("{set}_{}_{name}.ply", view.name));
                    let (positions, unit) = (&shape.positions, LengthUnit::Millimetre);
                    write_ply(&path, &shape.topology, positions, unit, &PlyExtras::default())?;
                }
                rows.push(errors);
            }
        }
    }
    for (((name, _), rows), whole) in METHODS.iter().zip(&rows).zip(&whole) {
        let [every, aligned] = whole.map(|sum| sum / views.len() as f64);
        let mean = |k: usize| rows.iter().map(|r| r[k]).sum::<f64>() / rows.len() as f64;
        let means = [0, 1, 2, 3, 4].map(|k| format!("{:.2}", mean(k))).join(" | ");
        let mut discs: Vec<f64> = rows.iter().map(|r| r[1]).collect();
        discs.sort_unstable_by(f64::total_cmp);
        println!(
            "| {set} | {name} | {every:.2} | {aligned:.2} | {means} | {:.2} |",
            discs[discs.len() * 9 / 10]
        );
    }
    Ok(())
}

fn read_views(
    folder: &Path,
    rest: &Mesh,
    camera: &CameraModel,
) -> Result<Vec<View>, Box<dyn Error>> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder.join("truth"))?
        .map(|entry| Ok(entry?.path()))
        .collect::<std::io::Result<_>>()?;
    files.sort();
    let read = |file: &PathBuf| -> Result<View, Box<dyn Error>> {
        let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let matches = folder.join("matches").join(format!("{name}.csv"));
        let matches = read_matches(&matches, rest.topology.faces.len(), camera.size)?;
        Ok(View { name, truth: read_mesh(file)?.mesh, matches })
    };
    files.iter().map(read).collect()
}

/// The quarter of the vertices nearest to a random one on the rest surface.
fn disc_of(rest: &Mesh, seed: u64) -> Vec<bool> {
    let count = rest.positions.len();
    let centre = rest.positions[Random::new(seed, 0xD15C).below(count)];
    let mut order: Vec<usize> = (0..count).collect();
    let distance = |v: usize| (rest.positions[v] - centre).norm();
    order.sort_by(|&a, &b| distance(a).total_cmp(&distance(b)));
    let mut hidden = vec![false; count];
    order[..count.div_ceil(4)].iter().for_each(|&v| hidden[v] = true);
    hidden
}

fn solve(
    camera: &CameraModel,
    rest: &Mesh,
    view: &View,
    hidden: &[bool],
    prior: Option<Prior>,
    options: &RegisterOptions,
) -> Result<Mesh, Box<dyn Error>> {
    let vertex = |m: &Match| {
        let corner = (0..3).find(|&k| m.barycentric[k] > 0.5).unwrap_or(0);
        rest.topology.faces[m.face as usize][corner] as usize
    };
    let matches: Vec<Match> = view.matches.iter().filter(|m| !hidden[vertex(m)]).copied().collect();
    let options = {
        let weights = PriorWeights { kind: prior.unwrap_or_default(), ..options.prior };
        RegisterOptions { prior: weights, ..options.clone() }
    };
    let posed = pose(camera, rest, &matches, &options, 0)?;
    let rigid = rest.positions.iter().map(|p| posed.pose * p).collect();
    let scene = Scene::new(camera, rest, rigid);
    Ok(match prior {
        None => rest.with_positions(scene.posed.clone()),
        Some(_) => rest.with_positions(register(&scene, &matches, &posed, &options).vertices),
    })
}

/// Mean error of all vertices, mm.
fn whole_error(shape: &Mesh, truth: &Mesh, alignment: Alignment) -> Result<f64, Box<dyn Error>> {
    let found = evaluate(shape, &Truth::new(truth), &EvaluateOptions { alignment })?;
    Ok(found.vertices.ok_or("template and truth have different faces")?.all.mean)
}

fn measure(shape: &Mesh, truth: &Mesh, hidden: &[bool]) -> Result<Errors, Box<dyn Error>> {
    let mut errors = [0.0; 5];
    for (alignment, at) in [(Alignment::None, 0), (Alignment::Rigid, 3)] {
        let truth = Truth { zone: Some(hidden), ..Truth::new(truth) };
        let found = evaluate(shape, &truth, &EvaluateOptions { alignment })?;
        let vertices = found.vertices.ok_or("template and truth have different faces")?;
        let disc = vertices.zone.ok_or("the disc is empty")?.mean;
        (errors[at], errors[at + 1]) = (vertices.all.mean, disc);
    }
    let share = hidden.iter().filter(|h| **h).count() as f64 / hidden.len() as f64;
    errors[2] = (errors[0] - share * errors[1]) / (1.0 - share);
    Ok(errors)
}
