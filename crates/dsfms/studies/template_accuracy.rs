//! How good a template is where the truth is known: the rendered scene, from frames and intrinsics.
//!
//!     cargo run --release --example template_accuracy -- SCENE [--masks] [--light] [--vertices N] [--mesh PLY] [--options TOML] [--out DIR]
//!
//! SCENE holds `exploration/`, `camera.json`, `masks/exploration/` and `ground_truth/` (rest mesh
//! with UV and albedo, poses, views per vertex). Prints Markdown: poses after one similarity of the
//! camera centres, then, under that similarity and no other alignment, surface, completeness and
//! albedo. DIR gets `surface.ply` (aligned), `truth.csv` (a row per vertex of the truth) and
//! `albedo.csv` (found over true for each face), to look at.

use dsfms::camera::Camera;
use dsfms::eval::transformed;
use dsfms::geometry::{Isometry, Point3, Similarity, Vector2, align_similarity, median, point_at};
use dsfms::image::{ColorImage, Mask};
use dsfms::io::albedo::read_albedo_image;
use dsfms::io::camera::read_camera;
use dsfms::io::images::{find_frames, read_frames};
use dsfms::io::masks::{MaskKind, read_masks};
use dsfms::io::mesh::{MeshFile, read_mesh};
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::io::poses::{NamedPose, PoseList, match_poses, read_poses};
use dsfms::mesh::Mesh;
use dsfms::mesh::surface_points::ClosestPoints;
use dsfms::pipeline::{
    BuiltTemplate, Exploration, Progress, TemplateOptions, template_from_frames,
    template_from_posed_frames,
};
use dsfms::template::{LengthUnit, Template};
use std::error::Error;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Instant;

type Outcome<T> = Result<T, Box<dyn Error>>;

/// A piece of the true surface counts as reconstructed within this, mm.
const COMPLETE_MM: f64 = 0.5;

struct Arguments {
    scene: PathBuf,
    /// Organ masks are given.
    masks: bool,
    /// The light of the camera file is given as a start; else nothing is known of it.
    light: bool,
    vertices: usize,
    /// A surface to measure light and albedo on, with the true poses.
    mesh: Option<PathBuf>,
    /// Options of template building (TOML).
    options: Option<PathBuf>,
    out: Option<PathBuf>,
}

fn main() -> Outcome<()> {
    let arguments = arguments()?;
    let scene = &arguments.scene;
    let paths = find_frames(&[scene.join("exploration")])?;
    let frames = read_frames(&paths)?;
    let file = read_camera(&scene.join("camera.json"))?;
    let masks = read_masks(&frames, &paths, &scene.join("masks/exploration"), MaskKind::Organ)?.0;
    let masks: Vec<Option<Mask>> = masks.into_iter().map(Some).collect();
    let tone = file.tone.clone().unwrap_or_default();
    let organ: &[Option<Mask>] = if arguments.masks { &masks } else { &[] };
    let light = file.light.as_ref().filter(|_| arguments.light);
    let exploration = Exploration::new(&frames, &file.camera).organ(organ).tone(&tone).light(light);
    let mut options: TemplateOptions = match &arguments.options {
        Some(path) => toml::from_str(&std::fs::read_to_string(path)?)?,
        None => TemplateOptions::default(),
    };
    options.vertices = arguments.vertices;
    let truth = Truth::read(scene)?;
    let clock = Clock::default();
    let built = match &arguments.mesh {
        Some(path) => {
            let names: Vec<&str> = frames.iter().map(|f| f.name.as_str()).collect();
            let (mesh, poses) = (read_mesh(path)?.mesh, match_poses(&truth.poses, &names));
            let unit = LengthUnit::Millimetre;
            template_from_posed_frames(&exploration, mesh, unit, &poses, &options, &clock)?
        }
        None => template_from_frames(&exploration, &options, &clock)?,
    };
    let organ_only = |p: &Point3| on_organ(p, &truth, &exploration, &masks);
    let names: Vec<&str> = frames.iter().map(|f| f.name.as_str()).collect();
    report(&built, &truth, &names, &organ_only, arguments.out.as_deref())?;
    clock.report();
    Ok(())
}

fn arguments() -> Outcome<Arguments> {
    let usage = "usage: template_accuracy SCENE [--masks] [--light] [--vertices N] [--mesh PLY] [--options TOML] [--out DIR]";
    let mut words = std::env::args().skip(1);
    let scene = words.next().ok_or(usage)?.into();
    let mut out = Arguments {
        scene,
        masks: false,
        light: false,
        vertices: 1000,
        mesh: None,
        options: None,
        out: None,
    };
    while let Some(word) = words.next() {
        match word.as_str() {
            "--masks" => out.masks = true,
            "--light" => out.light = true,
            "--vertices" => out.vertices = words.next().ok_or(usage)?.parse()?,
            "--mesh" => out.mesh = Some(words.next().ok_or(usage)?.into()),
            "--options" => out.options = Some(words.next().ok_or(usage)?.into()),
            "--out" => out.out = Some(words.next().ok_or(usage)?.into()),
            _ => return Err(usage.into()),
        }
    }
    Ok(out)
}

struct Truth {
    rest: MeshFile,
    albedo: ColorImage,
    /// Exploration frames that see each vertex.
    seen: Vec<u32>,
    poses: Vec<NamedPose>,
}

impl Truth {
    fn read(scene: &Path) -> Outcome<Self> {
        let folder = scene.join("ground_truth");
        // A NumPy file of 16-bit counts behind a head of a stated length.
        let seen = std::fs::read(folder.join("rest_vertex_seen_count.npy"))?;
        let head = 10 + usize::from(u16::from_le_bytes([seen[8], seen[9]]));
        let (seen, _) = seen[head..].as_chunks();
        Ok(Self {
            rest: read_mesh(&folder.join("rest_world.obj"))?,
            albedo: read_albedo_image(&folder.join("albedo.png"))?,
            seen: seen.iter().map(|&n| i16::from_le_bytes(n).max(0) as u32).collect(),
            poses: read_poses(&folder.join("poses.json"), PoseList::Exploration)?,
        })
    }

    /// True linear albedo at a point of a face (nearest pixel of the texture).
    fn albedo_at(&self, face: usize, w: [f64; 3]) -> Option<[f64; 3]> {
        let corners = self.rest.uv.as_ref()?[face];
        let uv: Vector2 = corners.iter().zip(w).map(|(p, w)| p.coords * w).sum();
        let [width, height] = self.albedo.size;
        let at = |t: f64, n: usize| ((t * n as f64) as usize).min(n - 1);
        let pixel = at(1.0 - uv.y, height) * width + at(uv.x, width);
        Some(self.albedo.data[pixel].map(f64::from))
    }
}

/// Whether a point of the world projects on the organ wherever it projects at all; one frame may
/// disagree (the rim of a mask).
fn on_organ(p: &Point3, truth: &Truth, exploration: &Exploration, masks: &[Option<Mask>]) -> bool {
    let names: Vec<&str> = exploration.frames.iter().map(|f| f.name.as_str()).collect();
    let beside = |(pose, mask): (Option<Isometry>, &Option<Mask>)| {
        let (pose, mask) = (pose?, mask.as_ref()?);
        let pixel = exploration.camera.project(&(pose * p))?.pixel;
        let [w, h] = mask.size.map(|n| n as f64 - 1.0);
        let inside = (0.0..=w).contains(&pixel.x) && (0.0..=h).contains(&pixel.y);
        (inside && !mask.at_pixel(&pixel)).then_some(())
    };
    match_poses(&truth.poses, &names).into_iter().zip(masks).filter_map(beside).count() <= 1
}

fn report(
    built: &BuiltTemplate,
    truth: &Truth,
    names: &[&str],
    on_organ: &dyn Fn(&Point3) -> bool,
    out: Option<&Path>,
) -> Outcome<()> {
    let template = &built.template;
    println!("| what | found |\n| --- | --- |");
    println!("| registered frames | {} of {} |", template.views.len(), names.len());
    let world = poses(template, truth)?;
    sparse(built, &world, truth, on_organ);
    let positions = transformed(&world, &template.mesh.positions);
    let aligned = Mesh { topology: template.mesh.topology.clone(), positions };
    let distances = surface(&aligned, &truth.rest.mesh, on_organ);
    let scaled: Vec<f64> = template.sigma.iter().map(|s| s * world.scaling()).collect();
    expected_errors(&aligned, &scaled, &distances, on_organ);
    let gaps = completeness(&aligned, truth);
    let shades = albedo(template, &aligned, truth, on_organ);
    if let Some(light) = &built.light {
        let [name, residual] = [&light.candidates[0].name, &percent(light.relative_residual)];
        println!("| light found | {name}, residual {residual} |");
    }
    let Some(out) = out else { return Ok(()) };
    std::fs::create_dir_all(out)?;
    let extras = PlyExtras { expected_error: Some(&distances), ..Default::default() };
    let file = out.join("surface.ply");
    write_ply(&file, &aligned.topology, &aligned.positions, LengthUnit::Millimetre, &extras)?;
    let mut rows = String::from("x,y,z,seen,distance\n");
    for ((p, seen), gap) in truth.rest.mesh.positions.iter().zip(&truth.seen).zip(gaps) {
        writeln!(rows, "{},{},{},{seen},{gap}", p.x, p.y, p.z)?;
    }
    std::fs::write(out.join("truth.csv"), rows)?;
    let mut rows = String::from("x,y,z,red,green,blue,views,area\n");
    for Shade { centre: p, ratio: [r, g, b], area, views } in shades {
        writeln!(rows, "{},{},{},{r},{g},{b},{views},{area}", p.x, p.y, p.z)?;
    }
    Ok(std::fs::write(out.join("albedo.csv"), rows)?)
}

/// The similarity that takes camera centres to the true ones, and what is left of the poses.
fn poses(template: &Template, truth: &Truth) -> Outcome<Similarity> {
    let names: Vec<&str> = template.views.iter().map(|v| v.name.as_str()).collect();
    let (found, known): (Vec<Isometry>, Vec<Isometry>) = template
        .views
        .iter()
        .zip(match_poses(&truth.poses, &names))
        .filter_map(|(v, pose)| Some((v.camera_from_template, pose?)))
        .unzip();
    let centres = |poses: &[Isometry]| -> Vec<Point3> {
        poses.iter().map(|p| p.inverse_transform_point(&Point3::origin())).collect()
    };
    let (from, to) = (centres(&found), centres(&known));
    let world = align_similarity(&from, &to).ok_or("the camera centres lie on a line")?;
    let moved = transformed(&world, &from);
    let squares = moved.iter().zip(&to).map(|(a, b)| (a - b).norm_squared());
    println!("| camera centres, rms mm | {:.4} |", mean(squares).sqrt());
    let turns = found.iter().zip(&known).map(|(f, k)| {
        (f.rotation * world.isometry.rotation.inverse() * k.rotation.inverse()).angle().to_degrees()
    });
    println!("| camera rotations, rms degrees | {:.4} |", mean(turns.map(|a| a * a)).sqrt());
    let reprojection = mean(template.points.iter().map(|p| p.error_px));
    let count = template.points.len();
    println!("| sparse points, mean reprojection error | {count}, {reprojection:.3} px |");
    Ok(world)
}

/// Points of the exploration against the true surface, and how far cameras and points are said to
/// be off.
fn sparse(
    built: &BuiltTemplate,
    world: &Similarity,
    truth: &Truth,
    on_organ: &dyn Fn(&Point3) -> bool,
) {
    let positions: Vec<Point3> = built.template.points.iter().map(|p| p.position).collect();
    let closest = ClosestPoints::new(&truth.rest.mesh);
    let of_organ = transformed(world, &positions).into_iter().filter(|p| on_organ(p));
    let mut distances: Vec<f64> =
        of_organ.filter_map(|p| Some(closest.closest(&p)?.distance)).collect();
    let off = median(&mut distances).unwrap_or(f64::NAN);
    println!("| sparse points on the organ to truth, median mm | {off:.4} |");
    let Some(precision) = &built.precision else { return };
    let (centre, rotation_deg) = precision.cameras();
    let [centre, point] = [centre, precision.point_median].map(|v| world.scaling() * v);
    println!(
        "| expected: centres rms mm, rotations rms degrees | {centre:.4}, {rotation_deg:.4} |"
    );
    println!("| expected: sparse points, median mm | {point:.4} |");
}

/// Distance of every vertex from the truth.
fn surface(found: &Mesh, truth: &Mesh, on_organ: &dyn Fn(&Point3) -> bool) -> Vec<f64> {
    let closest = ClosestPoints::new(truth);
    let distance = |p: &Point3| closest.closest(p).map_or(f64::NAN, |c| c.distance);
    let all: Vec<f64> = found.positions.iter().map(distance).collect();
    let mut own: Vec<f64> =
        (0..all.len()).filter(|&v| on_organ(&found.positions[v])).map(|v| all[v]).collect();
    own.sort_by(f64::total_cmp);
    let at = |q: f64| own[((own.len() - 1) as f64 * q) as usize];
    println!("| vertices, of which on the organ | {}, {} |", all.len(), own.len());
    let rms = mean(own.iter().map(|d| d * d)).sqrt();
    println!("| surface to truth, median / rms mm | {:.3} / {rms:.3} |", at(0.5));
    println!(
        "| surface to truth, 90th / 99th percentile / largest mm | {:.3} / {:.3} / {:.2} |",
        at(0.9),
        at(0.99),
        at(1.0)
    );
    all
}

/// What the template expects its vertices to be off, and how far off they are in those terms.
fn expected_errors(
    found: &Mesh,
    expected: &[f64],
    distances: &[f64],
    on_organ: &dyn Fn(&Point3) -> bool,
) {
    let own = |&v: &usize| expected[v].is_finite() && on_organ(&found.positions[v]);
    let own: Vec<usize> = (0..expected.len()).filter(own).collect();
    if own.is_empty() {
        return;
    }
    let quantile = |mut values: Vec<f64>, q: f64| {
        values.sort_by(f64::total_cmp);
        values[((values.len() - 1) as f64 * q) as usize]
    };
    let median = quantile(own.iter().map(|&v| expected[v]).collect(), 0.5);
    let ratio = |q: f64| quantile(own.iter().map(|&v| distances[v] / expected[v]).collect(), q);
    println!(
        "| expected error, median mm; true over expected, 68th / 95th percentile | {median:.3}; {:.2} / {:.2} |",
        ratio(0.683),
        ratio(0.954)
    );
}

/// Distance of every true vertex from the surface found.
fn completeness(found: &Mesh, truth: &Truth) -> Vec<f64> {
    let closest = ClosestPoints::new(found);
    let rest = &truth.rest.mesh;
    let distance = |p: &Point3| closest.closest(p).map_or(f64::NAN, |c| c.distance);
    let gaps: Vec<f64> = rest.positions.iter().map(distance).collect();
    let mut area = vec![0.0; gaps.len()];
    for (face, own) in rest.topology.faces.iter().zip(rest.face_areas()) {
        face.iter().for_each(|&v| area[v as usize] += own / 3.0);
    }
    let share = |least: u32, bound: f64| {
        let seen = || (0..gaps.len()).filter(|&v| truth.seen[v] >= least);
        let all: f64 = seen().map(|v| area[v]).sum();
        percent(seen().filter(|&v| gaps[v] <= bound).map(|v| area[v]).sum::<f64>() / all)
    };
    for least in [2, 3, 5] {
        let shares = [share(least, COMPLETE_MM), share(least, 1.0)];
        println!(
            "| surface seen by {least} frames or more, within {COMPLETE_MM} / 1 mm | {} |",
            shares.join(" / ")
        );
    }
    gaps
}

/// Albedo of one face, or one texel of it, found over true, with its area and views.
struct Shade {
    centre: Point3,
    ratio: [f64; 3],
    area: f64,
    views: f64,
}

/// Relative error of the albedo up to one factor a channel (the light's colour), by number of
/// views.
fn albedo(
    template: &Template,
    aligned: &Mesh,
    truth: &Truth,
    on_organ: &dyn Fn(&Point3) -> bool,
) -> Vec<Shade> {
    let Some(texels) = &template.albedo else { return Vec::new() };
    let closest = ClosestPoints::new(&truth.rest.mesh);
    let (mut fine, mut coarse, mut filled) = (Vec::new(), Vec::new(), 0.0);
    for (face, area) in aligned.face_areas().into_iter().enumerate() {
        if !aligned.corners(face).iter().all(|p| on_organ(p)) {
            continue;
        }
        let area = area / f64::from(texels.resolution[face]).powi(2);
        let (mut sums, mut views, mut count) = ([[0.0; 2]; 3], 0.0, 0.0);
        for (k, w) in texels.centres(face).enumerate() {
            let i = texels.offset[face] as usize + k;
            let place = closest.closest(&point_at(aligned.corners(face), w));
            let known = place.and_then(|at| truth.albedo_at(at.face as usize, at.barycentric));
            let Some(known) = known else { continue };
            if texels.views[i] == 0 {
                filled += area;
                continue;
            }
            let found = texels.value[i].map(f64::from);
            let ratio = [0, 1, 2].map(|c| found[c] / known[c].max(1e-6));
            fine.push(Shade {
                centre: Point3::origin(),
                ratio,
                area,
                views: f64::from(texels.views[i]),
            });
            (0..3).for_each(|c| sums[c] = [sums[c][0] + found[c], sums[c][1] + known[c]]);
            (views, count) = (views + f64::from(texels.views[i]), count + 1.0);
        }
        if count > 0.0 {
            let ratio = sums.map(|[found, known]| found / known);
            let [a, b, c] = aligned.corners(face);
            let centre = point_at([a, b, c], [1.0 / 3.0; 3]);
            coarse.push(Shade { centre, ratio, area: area * count, views: views / count });
        }
    }
    let measured: f64 = fine.iter().map(|s| s.area).sum();
    println!("| albedo measured, of the surface | {} |", percent(measured / (measured + filled)));
    albedo_errors("means of faces", &coarse);
    albedo_errors("texels", &fine);
    coarse
}

fn albedo_errors(what: &str, shades: &[Shade]) {
    // The factor with the least squared relative error.
    let factor = [0, 1, 2].map(|c| {
        let sum =
            |power: i32| -> f64 { shades.iter().map(|s| s.area * s.ratio[c].powi(power)).sum() };
        sum(1) / sum(2)
    });
    for (label, from, to) in [
        ("all", 0.0, 1e9),
        ("1 view", 0.0, 1.5),
        ("2 or 3 views", 1.5, 3.5),
        ("more views", 3.5, 1e9),
    ] {
        let chosen = || shades.iter().filter(|s| s.views >= from && s.views < to);
        let area: f64 = chosen().map(|s| s.area).sum();
        let all: f64 = shades.iter().map(|s| s.area).sum();
        let square =
            |s: &Shade| s.area * mean((0..3).map(|c| (factor[c] * s.ratio[c] - 1.0).powi(2)));
        let rms = (chosen().map(square).sum::<f64>() / area).sqrt();
        let share = percent(area / all);
        println!("| albedo, {what}, {label} ({share}): rms error | {} |", percent(rms));
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / count
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

/// Wall-clock and processor seconds at the end of every stage.
struct Clock {
    start: Instant,
    stages: Mutex<Vec<(String, [f64; 2])>>,
}

/// Processor time of this process, all threads, s; 0 where the system does not say.
fn processor_seconds() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = text.rsplit(')').next().unwrap_or("").split_whitespace();
    // User and system time, in hundredths of a second.
    fields.skip(11).take(2).filter_map(|f| f.parse::<f64>().ok()).sum::<f64>() / 100.0
}

impl Default for Clock {
    fn default() -> Self {
        Self { start: Instant::now(), stages: Mutex::default() }
    }
}

impl Progress for Clock {
    fn step(&self, stage: &str, _: usize, _: usize) {
        let now = [self.start.elapsed().as_secs_f64(), processor_seconds()];
        let Ok(mut stages) = self.stages.lock() else { return };
        match stages.iter_mut().find(|(name, _)| name == stage) {
            Some((_, end)) => *end = now,
            None => stages.push((stage.into(), now)),
        }
    }

    fn warn(&self, message: &str) {
        eprintln!("{message}");
    }
}

impl Clock {
    fn report(&self) {
        let mut last = [0.0; 2];
        let Ok(stages) = self.stages.lock() else { return };
        for (name, end) in stages.iter() {
            let [wall, processor] = [0, 1].map(|k| end[k] - last[k]);
            println!("| {name}: wall, processor s | {wall:.1}, {processor:.1} |");
            last = *end;
        }
        println!("| all: wall, processor s | {:.1}, {:.1} |", last[0], last[1]);
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let peak = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
        let peak = peak.and_then(|l| l.trim().strip_suffix(" kB")?.trim().parse::<f64>().ok());
        if let Some(peak) = peak {
            println!("| peak memory, MB | {:.0} |", peak / 1024.0);
        }
    }
}
