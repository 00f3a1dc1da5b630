//! Fits the weights of the expected error and checks them on cases of another seed.
//!
//!     cargo run --release --example expected_error [-- CASES [OUT]]
//!     dsfms figure OUT/reliability.csv --x predicted --y actual --by model --log x,y -o reliability.svg
//!
//! Prints the table for `expected_error/model.rs` and, as Markdown, rank correlation and reliability on
//! the cases of the test seed. OUT gets reliability.csv (mean errors of every tenth by prediction) and vertices.csv (every vertex: model, set,
//! case, seen, observed, error / R, features).

use dsfms::expected_error::model::LARGEST;
use dsfms::expected_error::{COUNT, ErrorFeatures, Model, NAMES, Solved, features};
use dsfms::experiment::SeriesOrgan;
use dsfms::geometry::{Point2, Point3};
use dsfms::image::{Frame, Mask, Picture, ToneCurve, usable, viewport};
use dsfms::mesh::remesh::{RemeshOptions, remesh};
use dsfms::mesh::{Mesh, normals::vertex_normals};
use dsfms::pipeline::{Method, Observation, Reconstruction, reconstruct};
use dsfms::refine::{Photograph, RefineOptions};
use dsfms::register::Scene;
use dsfms::synth::random::{Random, uniform};
use dsfms::synth::{
    Admitted, Attraction, Case, CaseOptions, Cell, Draw, ExtensionOf, LightKind, Protocol,
    deform_to, patch::textured,
};
use nalgebra::Rotation3;
use rayon::prelude::*;
use std::error::Error;
use std::fmt::Write;

/// Seeds of the fit and of the test, used nowhere else.
const SEEDS: [u64; 2] = [0xF17, 0x7E57];

/// Distances to evidence never count for less than this, whatever the cases say.
const LEAST: f64 = 0.05;

/// Head of reliability.csv, and where a prediction is right.
const EQUAL: &str = "model,predicted,actual\nequal,0.002,0.002\nequal,0.2,0.2\n";

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

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let cases: usize = arguments.next().map_or(Ok(30), |a| a.parse())?;
    let out = arguments.next();
    let organs =
        [SeriesOrgan::named("patch")?, SeriesOrgan::named("uterus")?, SeriesOrgan::named("liver")?];
    let [fit, test] = SEEDS.map(|seed| rows(&organs, seed, cases));
    let mut reliability = EQUAL.to_owned();
    let mut csv = format!("model,set,case,seen,observed,error,{}\n", NAMES.join(","));
    println!("    // {}", NAMES.join(", "));
    let weights: Vec<[f64; COUNT]> = fit.iter().map(|rows| regress(rows)).collect();
    for w in &weights {
        println!("    [{}],", w.map(|w| format!("{w:.3}")).join(", "));
    }
    println!(
        "\n| model | Spearman, all | within a frame | seen, all | seen, within a frame | mean error / R | predicted / R | predicted / actual by decile |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- |");
    for (k, model) in Model::ALL.iter().enumerate() {
        let report = Report::of(&test[k], &weights[k]);
        println!("| {model:?} | {} |", report.line());
        for [predicted, actual] in &report.deciles {
            writeln!(reliability, "{model:?},{predicted:.6},{actual:.6}")?;
        }
        for (set, rows) in [("fit", &fit[k]), ("test", &test[k])] {
            for r in rows.iter().filter(|_| out.is_some()) {
                let f = r.features.map(|f| format!("{f:.5}")).join(",");
                let (seen, observed) = (u8::from(r.visible), u8::from(r.observed));
                writeln!(csv, "{model:?},{set},{},{seen},{observed},{:.6},{f}", r.case, r.error)?;
            }
        }
    }
    if let Some(out) = out {
        std::fs::create_dir_all(&out)?;
        std::fs::write(format!("{out}/reliability.csv"), reliability)?;
        std::fs::write(format!("{out}/vertices.csv"), csv)?;
    }
    Ok(())
}

/// The rows of every model.
fn rows(organs: &[SeriesOrgan; 3], seed: u64, cases: usize) -> [Vec<Row>; 4] {
    let found: Vec<[Vec<Row>; 4]> = (0..cases)
        .into_par_iter()
        .map(|i| case_rows(organs, seed, i).unwrap_or_default())
        .collect();
    let mut all: [Vec<Row>; 4] = Default::default();
    for case in found {
        case.into_iter().zip(&mut all).for_each(|(rows, all)| all.extend(rows));
    }
    all
}

/// A case with everything that varies drawn from its seed; every third has an instrument in view.
fn case_rows(organs: &[SeriesOrgan; 3], seed: u64, index: usize) -> Option<[Vec<Row>; 4]> {
    let mut random = Random::new(seed, 0xC0 + index as u64);
    let mut pick = |n: usize| random.below(n);
    let protocol = Protocol {
        vertices: [250, 334, 600][pick(3)],
        light: [LightKind::Distant, LightKind::Near][pick(2)],
        matches: [15, 25, 25, 50, 150][pick(5)],
        everywhere: pick(4) == 0,
        attractions: 1 + pick(2),
        seed,
        ..Protocol::default()
    };
    let cell = Cell {
        extension: [0.0, 5.0, 10.0, 15.0, 20.0][pick(5)],
        noise: [0.5, 1.0, 1.0, 2.0, 4.0][pick(5)],
    };
    let organ = &organs[pick(3)];
    let case = match organ {
        SeriesOrgan::Surface { mesh, .. } if pick(2) == 0 => closed(mesh, &protocol, cell, index)?,
        _ => organ.case(&protocol, cell, index).ok()?,
    };
    let instrument = index.is_multiple_of(3).then(|| instrument(&case.frame, &mut random));
    Some(judge(&case, instrument.as_ref(), index))
}

/// A whole organ, of which the camera sees one side.
fn closed(organ: &Mesh, protocol: &Protocol, cell: Cell, index: usize) -> Option<Case> {
    let seed = protocol.case_seed(index);
    let mut random = Random::new(seed, 0xC105ED);
    let mut turn = || std::f64::consts::TAU * uniform(&mut random);
    let turn = Rotation3::from_euler_angles(turn(), turn(), turn());
    let [low, high] = organ.bounding_box();
    let scale = 55.0 / (high - low).norm();
    let centre = nalgebra::center(&low, &high);
    let place = |p: &Point3| Point3::from(turn * ((p - centre) * scale));
    let mesh = organ.with_positions(organ.positions.iter().map(place).collect());
    let mesh = remesh(&mesh, protocol.vertices, &RemeshOptions::default()).ok()?;
    let normals = vertex_normals(&mesh.topology, &mesh.positions);
    let facing: Vec<usize> = (0..normals.len()).filter(|&v| normals[v].z < -0.8).collect();
    let v = *facing.get(random.below(facing.len().max(1)))?;
    let pull = index.is_multiple_of(2);
    let direction = normals[v] * if pull { 1.0 } else { -1.0 };
    let point = mesh.positions[v] + direction * 20.0;
    let attraction = Attraction { direction, point, angle: (protocol.reach / 20.0).atan() };
    let deformation =
        deform_to(&mesh, &[attraction], 0.01 * cell.extension, ExtensionOf::Largest, 0.0);
    let options = CaseOptions {
        vertices: mesh.positions.len(),
        extension: 0.01 * cell.extension,
        light: protocol.light.model(),
        draw: Draw { count: protocol.matches, sigma_px: cell.noise },
        pull,
    };
    Some(Case::of(textured(mesh, seed), deformation, &options, Admitted::Calm, seed, &mut random))
}

/// A shaft from a side of the image to a place near its centre, 70 px wide.
fn instrument(frame: &Frame, random: &mut Random) -> Mask {
    let [w, h] = frame.size.map(|n| n as f64);
    let mut near = |n: f64| n * (0.35 + 0.3 * uniform(random));
    let tip = Point2::new(near(w), near(h));
    let angle = std::f64::consts::TAU * uniform(random);
    let along = nalgebra::Vector2::new(angle.cos(), angle.sin());
    let covered = |i: usize| {
        let p = Point2::new((i % frame.size[0]) as f64, (i / frame.size[0]) as f64) - tip;
        p.dot(&along) > 0.0 && p.perp(&along).abs() < 35.0
    };
    Mask { size: frame.size, data: (0..frame.size[0] * frame.size[1]).map(covered).collect() }
}

fn judge(case: &Case, instrument: Option<&Mask>, index: usize) -> [Vec<Row>; 4] {
    let covered = |m: &dsfms::register::Match| instrument.is_some_and(|i| i.at_pixel(&m.pixel));
    let matches: Vec<_> = case.matches.iter().filter(|m| !covered(m)).copied().collect();
    let observation =
        Observation::new(&case.frame, &case.camera).matches(&matches).instrument(instrument);
    let mut all: [Vec<Row>; 4] = Default::default();
    for method in METHODS {
        let found = reconstruct(&case.template, &observation, method, &Default::default());
        let Ok(found) = Reconstruction::even_refused(found) else {
            continue;
        };
        let models: &[Model] = match method {
            Method::Dsfm => &[Model::Motion, Model::MotionSeen],
            Method::Dsfms => &[Model::Shading],
            _ => &[Model::Joint],
        };
        for &model in models {
            let seen = look(case, instrument, &found, model != Model::Motion);
            let row = |v: usize| Row {
                case: index,
                observed: seen.observed[v],
                visible: found.visible[v],
                error: (found.vertices[v] - case.truth[v]).norm() / seen.radius,
                features: seen.values[v],
            };
            all[model as usize] = (0..case.truth.len()).map(row).collect();
        }
    }
    all
}

fn look(
    case: &Case,
    instrument: Option<&Mask>,
    found: &Reconstruction,
    photographed: bool,
) -> ErrorFeatures {
    let lit = viewport(std::slice::from_ref(&case.frame));
    let usable = usable(case.frame.size, lit, instrument, None);
    let mesh = &case.template.mesh;
    let posed = mesh.positions.iter().map(|p| found.pose * p).collect();
    let photo = Photograph {
        camera: &case.camera,
        picture: &Picture::of(&case.frame, &ToneCurve::Srgb),
        usable: &usable,
        outline: None,
        light: &case.template.lighting(),
        albedo: &case.template.albedo.clone().unwrap_or_default(),
        exposure: None,
    };
    features(&Solved {
        scene: &Scene::new(&case.camera, mesh, posed),
        vertices: &found.vertices,
        visible: &found.visible,
        matches: &found.matches,
        photo: photographed.then_some(&photo),
        refine: &RefineOptions::default(),
    })
}

fn predict(w: &[f64; COUNT], f: &[f64; COUNT]) -> f64 {
    w.iter().zip(f).map(|(w, f)| w * f).sum::<f64>().min(LARGEST).exp()
}

/// Gamma regression with a logarithmic link, so that the mean is predicted and every error counts
/// relative to its size; every case counts the same; weights but the constant are at least 0,
/// those of distances [`LEAST`].
fn regress(rows: &[Row]) -> [f64; COUNT] {
    let mut sizes = std::collections::BTreeMap::new();
    rows.iter().for_each(|r| *sizes.entry(r.case).or_insert(0.0) += 1.0);
    let mean = rows.iter().map(|r| r.error).sum::<f64>() / rows.len().max(1) as f64;
    let mut w = [0.0; COUNT];
    w[0] = mean.ln();
    for _ in 0..60 {
        let mut normal = [[0.0; COUNT]; COUNT];
        let mut right = [0.0; COUNT];
        for r in rows {
            let eta: f64 = w.iter().zip(&r.features).map(|(w, f)| w * f).sum();
            // Newton's step of the deviance has the weight error / prediction, bounded here.
            let ratio = r.error / eta.exp();
            let weight = 1.0 / sizes[&r.case];
            let target = eta + (ratio - 1.0).min(10.0);
            for a in 0..COUNT {
                right[a] += weight * r.features[a] * target;
                (0..COUNT).for_each(|b| normal[a][b] += weight * r.features[a] * r.features[b]);
            }
        }
        descend(&normal, &right, &mut w);
    }
    w
}

/// Least squares with a little ridge and lower bounds, one coordinate after another.
fn descend(normal: &[[f64; COUNT]; COUNT], right: &[f64; COUNT], w: &mut [f64; COUNT]) {
    let ridge = 1e-4 * normal[0][0];
    for _ in 0..2000 {
        for a in 0..COUNT {
            let rest: f64 = (0..COUNT).filter(|&b| b != a).map(|b| normal[a][b] * w[b]).sum();
            let free = (right[a] - rest) / (normal[a][a] + if a > 0 { ridge } else { 0.0 });
            w[a] = if a > 0 { free.max(least(a, normal)) } else { free };
        }
    }
}

fn least(feature: usize, normal: &[[f64; COUNT]; COUNT]) -> f64 {
    let used = normal[feature][feature] > 0.0;
    if used && NAMES[feature].ends_with(" distance") { LEAST } else { 0.0 }
}

struct Report {
    /// Over all vertices, mean within a frame, the same of seen vertices.
    ranks: [f64; 4],
    /// Mean predicted and mean actual error of every tenth by prediction.
    deciles: Vec<[f64; 2]>,
    means: [f64; 2],
}

impl Report {
    fn of(rows: &[Row], w: &[f64; COUNT]) -> Self {
        let pair = |r: &Row| [predict(w, &r.features), r.error];
        let all: Vec<[f64; 2]> = rows.iter().map(pair).collect();
        let seen: Vec<[f64; 2]> = rows.iter().filter(|r| r.visible).map(pair).collect();
        let frames = |seen: bool| {
            let of = |rows: &[Row]| -> f64 {
                let kept = rows.iter().filter(|r| !seen || r.visible);
                spearman(&kept.map(pair).collect::<Vec<_>>())
            };
            let each: Vec<f64> = rows.chunk_by(|a, b| a.case == b.case).map(of).collect();
            each.iter().sum::<f64>() / each.len().max(1) as f64
        };
        let mut sorted = all.clone();
        sorted.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mean = |rows: &[[f64; 2]]| {
            [0, 1].map(|k| rows.iter().map(|r| r[k]).sum::<f64>() / rows.len().max(1) as f64)
        };
        let deciles = sorted.chunks(sorted.len().div_ceil(10).max(1)).map(mean).collect();
        let ranks = [spearman(&all), frames(false), spearman(&seen), frames(true)];
        Self { ranks, deciles, means: mean(&all) }
    }

    fn line(&self) -> String {
        let ranks = self.ranks.map(|r| format!("{r:.2}")).join(" | ");
        let [predicted, actual] = self.means;
        let deciles: Vec<String> =
            self.deciles.iter().map(|[p, a]| format!("{:.2}", p / a)).collect();
        format!("{ranks} | {actual:.4} | {predicted:.4} | {}", deciles.join(" "))
    }
}

fn spearman(pairs: &[[f64; 2]]) -> f64 {
    let ranks = |k: usize| {
        let mut order: Vec<usize> = (0..pairs.len()).collect();
        order.sort_by(|&a, &b| pairs[a][k].total_cmp(&pairs[b][k]));
        let mut rank = vec![0.0; pairs.len()];
        order.iter().enumerate().for_each(|(r, &i)| rank[i] = r as f64);
        rank
    };
    let (a, b) = (ranks(0), ranks(1));
    let middle = 0.5 * (pairs.len() as f64 - 1.0);
    let product = |x: &[f64], y: &[f64]| -> f64 {
        x.iter().zip(y).map(|(x, y)| (x - middle) * (y - middle)).sum()
    };
    product(&a, &b) / product(&a, &a).max(f64::MIN_POSITIVE)
}
