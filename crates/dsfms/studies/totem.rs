//! Eq. 3 on tracks of real surfaces with 3D truth: the first view is the template, the matches in a
//! disc of a quarter of the points are hidden, and every method says where they are.
//!
//!     python3 scripts/convert_totem.py DATA_DIR SETS
//!     cargo run --release --example totem -- SETS [OUT [OPTIONS.toml]]
//!
//! Prints the table as Markdown ("every match": none is hidden; matches that agree with no pose are
//! named and left out); OUT gets totem.csv (a row per view, disc and method) and the shapes of the
//! first disc as PLY, for looking at. OPTIONS.toml: as for `dsfms reconstruct --options`.

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
        "| set | method | every match | every match, aligned | all | disc | outside | all, aligned | disc, aligned | \
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
    let mut discs: Vec<Vec<Errors>> = vec![Vec::new(); METHODS.len()];
    let mut every: Vec<Vec<[f64; 2]>> = vec![Vec::new(); METHODS.len()];
    for view in &read_views(folder, &rest, &camera)? {
        let told = format!("{set} {}", view.name);
        if let Some(shapes) = shapes(&camera, &rest, &view.matches, options, &told) {
            for (shape, errors) in shapes.iter().zip(&mut every) {
                errors.push(whole_errors(shape, &view.truth)?);
            }
        }
        for disc in 0..DISCS {
            let hidden = disc_of(&rest, disc);
            let matches = outside(&rest, view, &hidden);
            let told = format!("{told}, disc {disc}");
            let Some(shapes) = shapes(&camera, &rest, &matches, options, &told) else { continue };
            for (((name, _), shape), rows) in METHODS.iter().zip(&shapes).zip(&mut discs) {
                let errors = measure(shape, &view.truth, &hidden)?;
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
    for (((name, _), discs), every) in METHODS.iter().zip(&discs).zip(&every) {
        let cells = [means(every), means(discs)].concat().join(" | ");
        let mut discs: Vec<f64> = discs.iter().map(|r| r[1]).collect();
        discs.sort_unstable_by(f64::total_cmp);
        let worse = discs.get(discs.len() * 9 / 10).copied().unwrap_or(f64::NAN);
        println!("| {set} | {name} | {cells} | {worse:.2} |");
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

/// Mean of every column, as cells.
fn means<const N: usize>(rows: &[[f64; N]]) -> Vec<String> {
    let mean = |k: usize| rows.iter().map(|row| row[k]).sum::<f64>() / rows.len() as f64;
    (0..N).map(|k| format!("{:.2}", mean(k))).collect()
}

/// The matches at vertices that are not hidden.
fn outside(rest: &Mesh, view: &View, hidden: &[bool]) -> Vec<Match> {
    let vertex = |m: &Match| {
        let corner = (0..3).find(|&k| m.barycentric[k] > 0.5).unwrap_or(0);
        rest.topology.faces[m.face as usize][corner] as usize
    };
    view.matches.iter().filter(|m| !hidden[vertex(m)]).copied().collect()
}

/// The shape by every method; `None`, and a line that says why, where the matches agree with no
/// pose.
fn shapes(
    camera: &CameraModel,
    rest: &Mesh,
    matches: &[Match],
    options: &RegisterOptions,
    told: &str,
) -> Option<Vec<Mesh>> {
    let posed = pose(camera, rest, matches, options, 0)
        .inspect_err(|error| eprintln!("{told} left out: {error}"))
        .ok()?;
    let rigid = rest.positions.iter().map(|p| posed.pose * p).collect();
    let scene = Scene::new(camera, rest, rigid);
    let shape = |prior: Option<Prior>| match prior {
        None => scene.posed.clone(),
        Some(kind) => {
            let prior = PriorWeights { kind, ..options.prior };
            let options = RegisterOptions { prior, ..options.clone() };
            register(&scene, matches, &posed, &options).vertices
        }
    };
    Some(METHODS.iter().map(|(_, prior)| rest.with_positions(shape(*prior))).collect())
}

/// Mean error of all vertices, mm: absolute, and after a rigid alignment.
fn whole_errors(shape: &Mesh, truth: &Mesh) -> Result<[f64; 2], Box<dyn Error>> {
    let error = |alignment| -> Result<f64, Box<dyn Error>> {
        let found = evaluate(shape, &Truth::new(truth), &EvaluateOptions { alignment })?;
        Ok(found.vertices.ok_or("template and truth have different faces")?.all.mean)
    };
    Ok([error(Alignment::None)?, error(Alignment::Rigid)?])
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
