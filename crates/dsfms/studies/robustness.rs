//! What wrong matches cost: synthetic cases with clean matches, with wrong ones added until 30 %
//! are wrong, and with 30 % replaced by wrong ones. A wrong match ties a surface point to a
//! uniformly random pixel of the frame.
//!
//!     cargo run --release --example robustness [-- CASES [NOISE_PX [OPTIONS.toml]]]
//!
//! Prints the table as Markdown: the RMS error in mm overall and in the zone without matches, means
//! over the cases, and in brackets the ratio to clean matches.

use dsfms::geometry::{Point2, Point3};
use dsfms::light::LightModel;
use dsfms::pipeline::{Method, Observation, ReconstructOptions, Reconstruction, reconstruct};
use dsfms::register::Match;
use dsfms::synth::random::{Random, uniform};
use dsfms::synth::{Case, CaseOptions, Draw};
use std::error::Error;

/// Share of wrong matches.
const WRONG: f64 = 0.3;

const SPOILT: [&str; 3] = ["clean", "added", "replaced"];

const METHODS: [(&str, Method); 3] =
    [("rigid", Method::Rigid), ("dsfm", Method::Dsfm), ("joint", Method::Joint)];

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let cases: u64 = arguments.next().map_or(Ok(20), |a| a.parse())?;
    let sigma_px: f64 = arguments.next().map_or(Ok(1.0), |a| a.parse())?;
    let options = match arguments.next() {
        Some(path) => ReconstructOptions::from_toml(&std::fs::read_to_string(path)?)?,
        None => ReconstructOptions::default(),
    };
    println!(
        "| matches | method | clean: all | zone | 30 % added: all | zone | 30 % replaced: all | zone |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- |");
    for count in [25, 300] {
        for (name, method) in METHODS {
            let mut sums = [[0.0; 2]; 3];
            for seed in 0..cases {
                let case = case(Draw { count, sigma_px }, 700 + seed);
                for (how, sum) in sums.iter_mut().enumerate() {
                    let matches = spoil(&case, how, seed);
                    let vertices = solve(&case, &matches, method, &options)?;
                    sum[0] += rms(&case, &vertices) / cases as f64;
                    sum[1] += case.zone_rms(&vertices) / cases as f64;
                }
            }
            println!("| {count} | {name} | {} |", cells(&sums).join(" | "));
        }
    }
    Ok(())
}

fn case(draw: Draw, seed: u64) -> Case {
    let options = CaseOptions {
        vertices: 300,
        extension: 0.03,
        light: LightModel::Collinear,
        draw,
        pull: seed.is_multiple_of(2),
    };
    Case::new(&options, seed)
}

/// The matches of a case, spoilt in one of the ways of [`SPOILT`].
fn spoil(case: &Case, how: usize, seed: u64) -> Vec<Match> {
    let mut random = Random::new(seed, 0xBAD);
    let count = case.matches.len();
    let wrong = match SPOILT[how] {
        "added" => (WRONG / (1.0 - WRONG) * count as f64).round() as usize,
        "replaced" => (WRONG * count as f64).round() as usize,
        _ => 0,
    };
    let [width, height] = case.camera.size.map(|s| s as f64);
    let mut matches: Vec<Match> = (0..wrong)
        .map(|k| {
            let pixel = Point2::new(width * uniform(&mut random), height * uniform(&mut random));
            Match { pixel, ..case.matches[k % count] }
        })
        .collect();
    matches.extend(&case.matches[if SPOILT[how] == "replaced" { wrong } else { 0 }..]);
    matches
}

fn solve(
    case: &Case,
    matches: &[Match],
    method: Method,
    options: &ReconstructOptions,
) -> Result<Vec<Point3>, Box<dyn Error>> {
    let observation = Observation::new(&case.frame, &case.camera).matches(matches);
    let found = reconstruct(&case.template, &observation, method, options);
    Ok(Reconstruction::even_refused(found)?.vertices)
}

/// Root mean square error over all vertices, mm.
fn rms(case: &Case, vertices: &[Point3]) -> f64 {
    let squares = vertices.iter().zip(&case.truth).map(|(a, b)| (a - b).norm_squared());
    (squares.sum::<f64>() / vertices.len() as f64).sqrt()
}

fn cells(sums: &[[f64; 2]; 3]) -> Vec<String> {
    let cell = |how: usize, part: usize| match how {
        0 => format!("{:.3}", sums[how][part]),
        _ => format!("{:.3} ({:.2})", sums[how][part], sums[how][part] / sums[0][part]),
    };
    (0..6).map(|k| cell(k / 2, k % 2)).collect()
}
