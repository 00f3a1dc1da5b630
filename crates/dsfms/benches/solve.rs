//! Solves of eq. 3, eq. 4 and the joint problem over mesh sizes: `cargo bench --bench solve`.
//!
//! Synthetic patches, 300 matches of 1 px outside a zone pulled by 3 %. CPU milliseconds of the
//! whole process (median of the repetitions), steps of the last solve, and RMS error against the
//! truth over the whole surface. `warm` keeps coarse mesh and symbolic factors; eq. 4 and joint
//! also start from their own solution, as in a video. Arguments choose sizes and problems:
//! `-- 432 6912 eq3 joint`; `-- solve` is all of them.

use dsfms::image::{Mask, Picture, ToneCurve};
use dsfms::light::LightModel;
use dsfms::refine::{
    JointOptions, Near, NearFrame, Photograph, RefineOptions, VideoMemory, VideoOptions, join,
    join_near, refine,
};
use dsfms::register::{
    Body, RegisterMemory, RegisterOptions, Registered, Scene, pose, register, register_in,
};
use dsfms::solver::Summary;
use dsfms::synth::{Case, CaseOptions, Draw};
use std::time::Instant;

const SIZES: [usize; 5] = [432, 1728, 6912, 19200, 50000];

fn main() {
    let args: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let sizes: Vec<usize> = args.iter().filter_map(|a| a.parse().ok()).collect();
    let named = |a: &&str| *a != "solve" && a.parse::<usize>().is_err();
    let problems: Vec<&str> = args.iter().map(String::as_str).filter(named).collect();
    println!("vertices  problem      CPU ms  wall ms  steps  refused  RMS mm");
    for &n in if sizes.is_empty() { &SIZES[..] } else { &sizes } {
        bench_size(n, &|name| problems.is_empty() || problems.contains(&name));
    }
}

fn bench_size(n: usize, wanted: &dyn Fn(&str) -> bool) {
    let case = case(n);
    let options = RegisterOptions::default();
    let posed = pose(&case.camera, &case.template.mesh, &case.matches, &options, 0)
        .expect("300 matches find the pose");
    let rigid = case.template.mesh.positions.iter().map(|p| posed.pose * p).collect();
    let scene = Scene::new(&case.camera, &case.template.mesh, rigid);
    let coarse = |_: usize| register(&scene, &case.matches, &posed, &options);
    let start = if wanted("eq3") {
        let (time, found) = median_time(n, coarse);
        report(n, "eq3", time, &found.summary, rms(&case, &found.vertices));
        let memory = std::cell::RefCell::new(RegisterMemory::default());
        let warm =
            |_| register_in(&mut memory.borrow_mut(), &scene, &case.matches, &posed, &options);
        warm(0);
        let (time, warmed) = median_time(n, warm);
        report(n, "eq3 warm", time, &warmed.summary, rms(&case, &warmed.vertices));
        found
    } else {
        coarse(0)
    };
    bench_shading(n, &case, &scene, &start, wanted);
}

fn bench_shading(
    n: usize,
    case: &Case,
    scene: &Scene,
    start: &Registered,
    wanted: &dyn Fn(&str) -> bool,
) {
    let picture = Picture::of(&case.frame, &ToneCurve::Srgb);
    let usable = Mask::filled(case.frame.size, true);
    let Some(albedo) = &case.template.albedo else { return };
    let photo = Photograph {
        camera: &case.camera,
        picture: &picture,
        usable: &usable,
        outline: None,
        light: &case.template.lighting(),
        albedo,
        exposure: None,
    };
    if wanted("eq4") {
        let options = RefineOptions::default();
        let (time, found) = median_time(n, |_| {
            refine(&Body::plain(scene), &start.vertices, &case.matches, &photo, &options)
        });
        report(n, "eq4", time, &found.summary, rms(case, &found.vertices));
        let (time, warmed) = median_time(n, |_| {
            refine(&Body::plain(scene), &found.vertices, &case.matches, &photo, &options)
        });
        report(n, "eq4 warm", time, &warmed.summary, rms(case, &warmed.vertices));
    }
    if wanted("joint") {
        let options = JointOptions::default();
        let hold = start.depth_sigma;
        let (time, found) = median_time(n, |_| {
            let shapes = [&start.vertices[..]; 2];
            join(&Body::plain(scene), shapes, hold, &case.matches, &photo, &options)
        });
        report(n, "joint", time, &found.summary, rms(case, &found.vertices));
        let (matches, posed) = (&case.matches[..], &scene.posed[..]);
        let body = &Body::plain(scene);
        let frame = NearFrame { body, matches, posed, depth_sigma: hold, photo: &photo };
        let near = Near { shape: &found.vertices, ambient: found.ambient, gap: false };
        let memory = std::cell::RefCell::new(VideoMemory::default());
        let video = VideoOptions::default();
        let warm = |_| join_near(&mut memory.borrow_mut(), &frame, near, &options, &video);
        warm(0);
        let (time, warmed) = median_time(n, warm);
        line(n, "joint warm", time, [warmed.summary.iterations, 0], rms(case, &warmed.vertices));
    }
}

fn case(vertices: usize) -> Case {
    let options = CaseOptions {
        vertices,
        extension: 0.03,
        light: LightModel::Collinear,
        draw: Draw { count: 300, sigma_px: 1.0 },
        pull: true,
    };
    Case::new(&options, 7)
}

/// Median CPU and wall milliseconds of a few repetitions, and the last result.
fn median_time<T>(vertices: usize, work: impl Fn(usize) -> T) -> ([f64; 2], T) {
    let repeats = (20_000 / vertices).clamp(1, 9);
    let mut times = Vec::new();
    let mut timed = |i: usize| {
        let (cpu, wall) = (cpu_ms(), Instant::now());
        let value = work(i);
        times.push([cpu_ms() - cpu, wall.elapsed().as_secs_f64() * 1e3]);
        value
    };
    let mut value = timed(0);
    for i in 1..repeats {
        value = timed(i);
    }
    let middle = |k: usize| {
        let mut all: Vec<f64> = times.iter().map(|t| t[k]).collect();
        all.sort_unstable_by(f64::total_cmp);
        all[all.len() / 2]
    };
    ([middle(0), middle(1)], value)
}

/// CPU time of all threads of this process, ms; 0 where the system does not tell.
fn cpu_ms() -> f64 {
    let Ok(tasks) = std::fs::read_dir("/proc/self/task") else { return 0.0 };
    tasks
        .flatten()
        .filter_map(|task| std::fs::read_to_string(task.path().join("schedstat")).ok())
        .filter_map(|text| text.split_whitespace().next()?.parse::<f64>().ok())
        .sum::<f64>()
        * 1e-6
}

fn rms(case: &Case, shape: &[dsfms::geometry::Point3]) -> f64 {
    let squares = shape.iter().zip(&case.truth).map(|(a, b)| (a - b).norm_squared());
    (squares.sum::<f64>() / shape.len() as f64).sqrt()
}

fn report(n: usize, problem: &str, time: [f64; 2], summary: &Summary, rms: f64) {
    line(n, problem, time, [summary.iterations, summary.refused], rms);
}

fn line(n: usize, problem: &str, [cpu, wall]: [f64; 2], [steps, refused]: [usize; 2], rms: f64) {
    println!("{n:8}  {problem:10} {cpu:8.1}  {wall:7.1}  {steps:5}  {refused:7}  {rms:6.4}");
}
