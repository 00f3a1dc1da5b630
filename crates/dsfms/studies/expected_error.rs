//! Fits the weights of the expected error, and checks them on cases of another seed and scenes of
//! another half.
//!
//!     cargo run --release --example expected_error -- cases 30 OUT/cases.csv
//!     cargo run --release --example expected_error -- scenes SCENES OUT/scenes.csv
//!     cargo run --release --example expected_error -- clips OUT/clips.csv CLIP...
//!     cargo run --release --example expected_error -- fit OUT OUT/*.csv
//!     dsfms figure OUT/held.csv --x predicted --y actual --by model --log x,y -o reliability.svg
//!
//! The first three solve and write a row a vertex (model, set, case, seen, observed, error / R,
//! features); SCENES are finished scenes of `studies/scenes`, a CLIP is a folder of `dsfms synth
//! --video` named by its seed. The fourth takes the sets of [`FIT`], prints the weights for
//! `expected_error/model.rs` and, as Markdown, rank correlation, coverage and reliability on the
//! others; OUT gets a table of each (mean errors of every tenth by prediction).

#[path = "expected_error/clips.rs"]
mod clips;
#[path = "expected_error/fit.rs"]
mod fit;
#[path = "expected_error/scenes.rs"]
mod scenes;

use dsfms::expected_error::{COUNT, Model, NAMES, Solved, features};
use dsfms::experiment::SeriesOrgan;
use dsfms::geometry::Point3;
use dsfms::image::{Picture, usable, viewport};
use dsfms::pipeline::{Method, Observation, Reconstruction, reconstruct};
use dsfms::refine::{Photograph, RefineOptions};
use dsfms::register::Scene;
use dsfms::template::Template;
use fit::{FitReport, regress};
use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Write;
use std::path::Path;

#[path = "expected_error/cases.rs"]
mod cases;

/// Seeds of the fit and of the test, used nowhere else.
const SEEDS: [u64; 2] = [0xF17, 0x7E57];

/// Head of such a table, and where a prediction is right.
const EQUAL: &str = "model,predicted,actual\nequal,0.002,0.002\nequal,0.2,0.2\n";

/// Sets that are fitted on; the others are reported on.
const FIT: [&str; 4] = ["fit", "choose", "drawn", "clips"];

/// Whether a set has the scene of an index.
type OfIndex = fn(usize) -> bool;

/// Sets of scenes.
const SCENES: [(&str, OfIndex); 4] = [
    ("choose", |i| i < 300 && i % 2 == 0),
    ("held", |i| i < 300 && i % 2 == 1),
    ("drawn", |i| (300..FRESH).contains(&i)),
    ("fresh", |i| i >= FRESH),
];

/// Scenes drawn from this seed on, and clips from [`VERDICT`] on, take no part in the fit.
const FRESH: usize = 355;
const VERDICT: usize = 200;

const METHODS: [Method; 3] = [Method::Dsfm, Method::Dsfms, Method::Joint];

/// One vertex of one case under one model.
struct Row {
    case: usize,
    observed: bool,
    visible: bool,
    /// Error over the visible radius.
    error: f64,
    features: [f64; COUNT],
}

/// Rows of every model; those of one case lie side by side.
type ModelRows = [Vec<Row>; 4];

fn append(all: &mut ModelRows, more: ModelRows) {
    more.into_iter().zip(all).for_each(|(rows, all)| all.extend(rows));
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match &arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["cases", count, out] => {
            let organs = ["patch", "uterus", "liver"].map(SeriesOrgan::named);
            let [patch, uterus, liver] = organs;
            let organs = [patch?, uterus?, liver?];
            let count = count.parse()?;
            let [fit, test] = SEEDS.map(|seed| cases::rows(&organs, seed, count));
            write_rows(Path::new(out), &[("fit", fit), ("test", test)])
        }
        ["scenes", folder, out, only @ ..] => {
            let asked = |set: &str| only.is_empty() || only.contains(&set);
            let sets = SCENES.iter().filter(|(set, _)| asked(set));
            let of = |(set, of): &(&'static str, OfIndex)| {
                Ok((*set, scenes::rows(Path::new(folder), of)?))
            };
            write_rows(Path::new(out), &sets.map(of).collect::<scenes::Result<Vec<_>>>()?)
        }
        ["clips", out, clips @ ..] => {
            let (fit, kept): (Vec<&str>, Vec<&str>) =
                clips.iter().partition(|clip| number(Path::new(clip)).is_some_and(|n| n < VERDICT));
            let sets = [("clips", fit), ("verdict", kept)];
            let sets = sets.map(|(set, clips)| Ok((set, clips::rows(&clips)?)));
            write_rows(Path::new(out), &sets.into_iter().collect::<scenes::Result<Vec<_>>>()?)
        }
        ["fit", out, files @ ..] if !files.is_empty() => fit_and_test(Path::new(out), files),
        _ => Err("usage: cases N FILE | scenes FOLDER FILE [SET...] | clips FILE CLIP... | fit OUT FILE..."
            .into()),
    }
}

/// Number in the name of a scene (`NN-...`) or a clip.
fn number(folder: &Path) -> Option<usize> {
    folder.file_name()?.to_str()?.split('-').next()?.parse().ok()
}

/// Fit on some sets and report on the others.
fn fit_and_test(out: &Path, files: &[&str]) -> Result<(), Box<dyn Error>> {
    let mut sets: BTreeMap<String, ModelRows> = BTreeMap::new();
    let mut cases = 0;
    for file in files {
        cases = read_rows(Path::new(file), cases, &mut sets)?;
    }
    let mut fit = ModelRows::default();
    FIT.iter().filter_map(|set| sets.remove(*set)).for_each(|rows| append(&mut fit, rows));
    let fitted: Vec<([f64; COUNT], [f64; 2])> = fit.iter().map(|rows| regress(rows)).collect();
    println!("    // {}", NAMES.join(", "));
    for (w, [vertices, zones]) in &fitted {
        let w = w.map(|w| format!("{w:.3}")).join(", ");
        println!("    [{w}], // vertices {vertices:.2}, zones {zones:.2}");
    }
    let errors = fit.iter().flatten().map(|row| row.error);
    println!("largest error of the fit: {:.3} R", errors.fold(0.0, f64::max));
    std::fs::create_dir_all(out)?;
    for (set, test) in &sets {
        let mut reliability = EQUAL.to_owned();
        println!("\n{set}\n\n{}", FitReport::HEAD);
        for ((model, rows), (w, [vertices, zones])) in Model::ALL.iter().zip(test).zip(&fitted) {
            let report = FitReport::of(rows, w, vertices.max(*zones));
            println!("| {model:?} | {} |", report.line());
            for [predicted, actual] in &report.deciles {
                writeln!(reliability, "{model:?},{predicted:.6},{actual:.6}")?;
            }
        }
        std::fs::write(out.join(format!("{set}.csv")), reliability)?;
    }
    Ok(())
}

fn write_rows(path: &Path, sets: &[(&str, ModelRows)]) -> Result<(), Box<dyn Error>> {
    let mut csv = format!("model,set,case,seen,observed,error,{}\n", NAMES.join(","));
    for (set, rows) in sets {
        for (model, rows) in Model::ALL.iter().zip(rows) {
            for row in rows {
                let f = row.features.map(|f| format!("{f:.5}")).join(",");
                let (seen, observed) = (u8::from(row.visible), u8::from(row.observed));
                let Row { case, error, .. } = row;
                writeln!(csv, "{model:?},{set},{case},{seen},{observed},{error:.6},{f}")?;
            }
        }
    }
    Ok(std::fs::write(path, csv)?)
}

/// Add the rows of a file; its cases are counted on from `first`. Returns the first free number.
fn read_rows(
    path: &Path,
    first: usize,
    sets: &mut BTreeMap<String, ModelRows>,
) -> Result<usize, Box<dyn Error>> {
    let text = std::fs::read_to_string(path)?;
    let mut next = first;
    for line in text.lines().skip(1) {
        let mut words = line.split(',');
        let mut word = || words.next().ok_or("a row is cut off");
        let (model, set) = (word()?, word()?);
        let case = first + word()?.parse::<usize>()?;
        let (visible, observed, error) = (word()? == "1", word()? == "1", word()?.parse()?);
        let mut features = [0.0; COUNT];
        for f in &mut features {
            *f = word()?.parse()?;
        }
        let names = Model::ALL.map(|model| format!("{model:?}"));
        let model = names.iter().position(|name| name == model).ok_or("an unknown model")?;
        let rows = &mut sets.entry(set.to_owned()).or_default()[model];
        rows.push(Row { case, observed, visible, error, features });
        next = next.max(case + 1);
    }
    Ok(next)
}

/// The rows that a method gives on a frame, of at most so many vertices.
fn judged(
    template: &Template,
    observation: &Observation,
    truth: &[Point3],
    method: Method,
    case: usize,
    most: usize,
) -> ModelRows {
    let mut all = ModelRows::default();
    let found = reconstruct(template, observation, method, &Default::default());
    let Ok(found) = Reconstruction::even_refused(found) else { return all };
    let models: &[Model] = match method {
        Method::Dsfm => &[Model::Motion, Model::MotionSeen],
        Method::Dsfms => &[Model::Shading],
        _ => &[Model::Joint],
    };
    for &model in models {
        let seen = look(template, observation, &found, model != Model::Motion);
        let row = |v: usize| Row {
            case,
            observed: seen.observed[v],
            visible: found.visible[v],
            error: (found.vertices[v] - truth[v]).norm() / seen.radius,
            features: seen.values[v],
        };
        let step = truth.len().div_ceil(most);
        all[model as usize] = (0..truth.len()).step_by(step).map(row).collect();
    }
    all
}

fn look(
    template: &Template,
    observation: &Observation,
    found: &Reconstruction,
    photographed: bool,
) -> dsfms::expected_error::ErrorFeatures {
    let Observation { frame, camera, tone, instrument, .. } = *observation;
    let lit = viewport(std::slice::from_ref(frame));
    let usable = usable(frame.size, lit, instrument, None);
    let mesh = &template.mesh;
    let posed = mesh.positions.iter().map(|p| found.pose * p).collect();
    let photo = Photograph {
        camera,
        picture: &Picture::of(frame, tone),
        usable: &usable,
        outline: None,
        light: &template.lighting(),
        albedo: &template.albedo.clone().unwrap_or_default(),
        exposure: None,
    };
    features(&Solved {
        scene: &Scene::new(camera, mesh, posed),
        vertices: &found.vertices,
        visible: &found.visible,
        matches: &found.matches,
        photo: photographed.then_some(&photo),
        refine: &RefineOptions::default(),
    })
}
