//! How well hidden structures are carried: inner points of random volumetric deformations.
//!
//!     cargo run --release --example structures [-- CASES [SEED]]
//!
//! An organ (whole, or the half of it that a camera sees) is deformed together with a ball of inner
//! points by a random smooth map of space; the surface gets an error of the size and smoothness
//! that reconstructions have; the structures are carried by the surface with that error. Then parts
//! of the organs are rendered and reconstructed, and the error is the reconstruction's own. Prints,
//! as Markdown, the inner points' mean error over the surface's. SEED is for new cases: those of
//! `docs/results/structures.md` are of 2, and nothing was chosen on them.

use dsfms::experiment::{SeriesOrgan, surface};
use dsfms::geometry::{Isometry, Point3, Vector3, align_rigid};
use dsfms::light::LightModel;
use dsfms::mesh::Mesh;
use dsfms::mesh::components::largest_component;
use dsfms::mesh::normals::vertex_normals;
use dsfms::pipeline::{Method, ReconstructOptions};
use dsfms::structures::{Carrier, Depth, depths, expected_error};
use dsfms::synth::random::{Random, normal, uniform};
use dsfms::synth::{Admitted, Case, CaseOptions, Deformation, Draw};
use rayon::prelude::*;
use std::error::Error;

/// Mean surface errors, in radii of the organ.
const SURFACE_ERRORS: [f64; 2] = [0.03, 0.01];
/// Correlation length of the surface error, in radii.
const SMOOTH: f64 = 0.35;
/// Variance of the error that all vertices share.
const COMMON: f64 = 0.3;

/// A smooth random vector field with about unit length: a sum of waves.
struct Field(Vec<(Vector3, f64, Vector3)>);

impl Field {
    /// With this correlation length.
    fn new(length: f64, random: &mut Random) -> Self {
        let vector = |random: &mut Random| Vector3::from_fn(|_, _| normal(random));
        let wave = |random: &mut Random| {
            let phase = std::f64::consts::TAU * uniform(random);
            (vector(random) / length, phase, vector(random))
        };
        Self((0..24).map(|_| wave(random)).collect())
    }

    fn scale(&self) -> f64 {
        (2.0 / (3.0 * self.0.len() as f64)).sqrt()
    }

    fn at(&self, p: &Point3) -> Vector3 {
        let sum: Vector3 =
            self.0.iter().map(|(k, phase, a)| a * (k.dot(&p.coords) + phase).cos()).sum();
        sum * self.scale()
    }

    /// Its curl, as long as the field itself: a field that keeps volumes.
    fn curl(&self, p: &Point3, length: f64) -> Vector3 {
        let of = |(k, phase, a): &(Vector3, f64, Vector3)| {
            -(k.cross(a)) * (k.dot(&p.coords) + phase).sin()
        };
        self.0.iter().map(of).sum::<Vector3>() * self.scale() * length * 0.7
    }
}

/// What deforms space.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Waves of any direction.
    Waves,
    /// Waves that keep volumes, as tissue nearly does.
    Solenoidal,
    /// A tool pressing or pulling at the front, fading with depth.
    Press,
    /// Bent and twisted as a whole.
    Bend,
}

const KINDS: [(Kind, &str); 4] = [
    (Kind::Waves, "waves"),
    (Kind::Solenoidal, "waves that keep volumes"),
    (Kind::Press, "a tool at the front"),
    (Kind::Bend, "bent and twisted"),
];

/// A map of space about the organ's centre; `size` is the organ's radius.
fn map(
    kind: Kind,
    size: f64,
    front: Point3,
    random: &mut Random,
) -> impl Fn(&Point3) -> Point3 + use<> {
    let length = size * (0.5 + 0.7 * uniform(random));
    let field = Field::new(length, random);
    let amount = size * (0.06 + 0.1 * uniform(random));
    let sign = if random.below(2) == 0 { 1.0 } else { -1.0 };
    let reach = size * (0.3 + 0.4 * uniform(random));
    let deep = size * (0.4 + 0.8 * uniform(random));
    let [bend, twist] =
        [0.6 * (uniform(random) - 0.5) / size, 0.8 * (uniform(random) - 0.5) / size];
    move |p: &Point3| match kind {
        Kind::Waves => p + field.at(p) * amount,
        Kind::Solenoidal => p + field.curl(p, length) * amount,
        Kind::Press => {
            let d = p - front;
            let fade = (-(d.x * d.x + d.y * d.y) / (2.0 * reach * reach)).exp();
            p + Vector3::z() * (1.6 * sign * amount * fade * (-d.z.max(0.0) / deep).exp())
        }
        Kind::Bend => {
            let (sin, cos) = (twist * p.x).sin_cos();
            let q = Point3::new(p.x, cos * p.y - sin * p.z, sin * p.y + cos * p.z);
            q + Vector3::z() * (bend * q.x * q.x)
        }
    }
}

/// An organ about the origin, its front towards −z, and the vertices that the template has.
struct Subject {
    name: String,
    whole: Mesh,
    template: Mesh,
    size: f64,
}

fn subject(name: &str, open: bool) -> Result<Subject, Box<dyn Error>> {
    let SeriesOrgan::Surface { mesh, .. } = SeriesOrgan::named(name)? else {
        unreachable!("an embedded organ")
    };
    let [low, high] = mesh.bounding_box();
    let middle = 0.5 * (low.coords + high.coords);
    let whole = mesh.with_positions(mesh.positions.iter().map(|p| p - middle).collect());
    let size = whole.positions.iter().map(|p| p.coords.norm()).fold(0.0, f64::max);
    let normals = vertex_normals(&whole.topology, &whole.positions);
    let front = |f: &usize| {
        whole.topology.faces[*f]
            .iter()
            .all(|&v| normals[v as usize].z < -0.1 * normals[v as usize].norm())
    };
    let template = match open {
        false => whole.clone(),
        true => {
            let kept: Vec<usize> = (0..whole.topology.faces.len()).filter(front).collect();
            largest_component(&whole.subset(&kept).0).0
        }
    };
    let name = format!("{name}, {}", if open { "front half" } else { "whole" });
    Ok(Subject { name, whole, template, size })
}

/// Whether a point lies inside a closed surface: its solid angle.
fn inside(mesh: &Mesh, p: &Point3) -> bool {
    let angle = |f: usize| {
        let [a, b, c] = mesh.corners(f).map(|q| q - p);
        let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
        let bottom = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        2.0 * a.dot(&b.cross(&c)).atan2(bottom)
    };
    let sum: f64 = (0..mesh.topology.faces.len()).map(angle).sum();
    sum.abs() > std::f64::consts::TAU
}

/// A ball of points, a tumour, somewhere inside; under the surface by at most half of the radius.
fn tumour(subject: &Subject, random: &mut Random) -> Vec<Point3> {
    loop {
        let middle = Point3::from(within_cube(random) * subject.size);
        let near = depths(&subject.template, &[middle])
            .is_some_and(|d| d[0].distance < 0.5 * subject.size);
        if near && inside(&subject.whole, &middle) {
            return ball(middle, 0.12 * subject.size, random);
        }
    }
}

fn within_cube(random: &mut Random) -> Vector3 {
    Vector3::from_fn(|_, _| 2.0 * uniform(random) - 1.0)
}

fn ball(middle: Point3, radius: f64, random: &mut Random) -> Vec<Point3> {
    let cube = (0..80).map(|_| within_cube(random)).collect::<Vec<_>>();
    cube.iter().filter(|v| v.norm() < 1.0).map(|v| middle + v * radius).collect()
}

/// One case: mean errors in mm, and their ratio.
struct Outcome {
    surface: f64,
    inner: f64,
    rigid: f64,
    /// Mean depth of the points, radii.
    depth: f64,
    /// The points' error as `expected_error` says it from the true surface error above each.
    expected: f64,
}

fn run(
    subject: &Subject,
    carrier: &Carrier,
    (kind, level): (Kind, f64),
    seed: u64,
    case: usize,
) -> Outcome {
    let mut random = Random::new(seed, 1000 * case as u64 + kind as u64);
    let points = tumour(subject, &mut random);
    let template = &subject.template;
    let front = template.positions[random.below(template.positions.len())];
    let map = map(kind, subject.size, front, &mut random);
    let vector = |r: f64, random: &mut Random| Vector3::from_fn(|_, _| r * normal(random));
    let away = Vector3::z() * (3.0 * subject.size);
    let pose = Isometry::new(vector(5.0, &mut random) + away, vector(0.3, &mut random));
    let map = |p: &Point3| pose * map(p);
    let truth: Vec<Point3> = template.positions.iter().map(&map).collect();
    let found = disturbed(&truth, subject.size, level, &mut random);
    let goal: Vec<Point3> = points.iter().map(&map).collect();
    judge(subject, [&found, &truth], [&points, &goal], carrier)
}

/// Carry points by the surface that was found.
fn judge(
    subject: &Subject,
    [found, truth]: [&[Point3]; 2],
    [points, goal]: [&[Point3]; 2],
    carrier: &Carrier,
) -> Outcome {
    let error = |a: &[Point3], b: &[Point3]| {
        a.iter().zip(b).map(|(a, b)| (a - b).norm()).sum::<f64>() / a.len() as f64
    };
    let carried = carrier.carry(found).expect("the template's vertices");
    let placed: Vec<Point3> = points.iter().map(|p| carried.at(p)).collect();
    let pose = align_rigid(&subject.template.positions, found).expect("a surface");
    let moved: Vec<Point3> = points.iter().map(|p| pose * p).collect();
    let deep = depths(&subject.template, points).expect("faces");
    let above = |d: &Depth| {
        let v = d.vertex as usize;
        let surface = (found[v] - truth[v]).norm();
        expected_error(surface, d.distance, subject.size, carried.deformation())
    };
    let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
    Outcome {
        surface: error(found, truth),
        inner: error(&placed, goal),
        rigid: error(&moved, goal),
        depth: mean(deep.iter().map(|d| d.distance / subject.size).collect()),
        expected: mean(deep.iter().map(above).collect()),
    }
}

/// A part of an organ, rendered in its deformed state, reconstructed, and its structures carried.
fn reconstructed(
    organ: &SeriesOrgan,
    kind: Kind,
    method: Method,
    seed: u64,
    case: usize,
) -> Option<Outcome> {
    let part_seed = seed.wrapping_mul(1000) + case as u64;
    let mut random = Random::new(part_seed, 77 + kind as u64);
    let part = organ.part(334, part_seed).ok()?;
    let template = part.mesh.clone();
    let size = template.positions.iter().map(|p| p.coords.norm()).fold(0.0, f64::max);
    let front = template.positions[random.below(template.positions.len())];
    let map = map(kind, size, front, &mut random);
    // Under the surface, which faces -z, by a tenth to a half of the radius.
    let above = template.positions[random.below(template.positions.len())] * 0.7;
    let middle = above + Vector3::z() * (size * (0.1 + 0.4 * uniform(&mut random)));
    let points = ball(middle, 0.1 * size, &mut random);
    let vertices: Vec<Point3> = template.positions.iter().map(&map).collect();
    let moved: Vec<f64> =
        vertices.iter().zip(&template.positions).map(|(a, b)| (a - b).norm()).collect();
    let most = moved.iter().copied().fold(0.0, f64::max);
    let zone = moved.iter().map(|d| *d > 0.5 * most).collect();
    let deformation = Deformation { vertices, zone, extension: 0.0, largest_extension: 0.0 };
    let options = CaseOptions {
        vertices: 334,
        extension: 0.0,
        light: LightModel::Collinear,
        draw: Draw { count: 50, sigma_px: 1.0 },
        pull: true,
    };
    let case = Case::of(part, deformation, &options, Admitted::Everywhere, part_seed, &mut random);
    let pose = align_rigid(&case.deformation.vertices, &case.truth)?;
    let goal: Vec<Point3> = points.iter().map(|p| pose * map(p)).collect();
    let found = surface(&case, method, &ReconstructOptions::default()).ok()?;
    let carrier = Carrier::new(&template).ok()?;
    let subject = Subject { name: String::new(), whole: template.clone(), template, size };
    Some(judge(&subject, [&found.vertices, &case.truth], [&points, &goal], &carrier))
}

/// The surface with an error that neighbours share, mostly along the lines of sight, as
/// reconstructions have it (`docs/results/report.md`).
fn disturbed(truth: &[Point3], size: f64, level: f64, random: &mut Random) -> Vec<Point3> {
    let field = Field::new(SMOOTH * size, random);
    let common = Vector3::from_fn(|_, _| normal(random));
    let raw = |p: &Point3| {
        let e = field.at(p) * (1.0 - COMMON).sqrt() * 3f64.sqrt() + common * COMMON.sqrt();
        let ray = p.coords.normalize();
        ray * e.x + 0.22 * e
    };
    let errors: Vec<Vector3> = truth.iter().map(raw).collect();
    let mean = errors.iter().map(|e| e.norm()).sum::<f64>() / errors.len() as f64;
    let scale = level * size / mean;
    truth.iter().zip(&errors).map(|(p, e)| p + e * scale).collect()
}

fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}

/// A row of a table.
fn print_row(name: &str, what: &str, all: &[Outcome]) {
    let ratios: Vec<f64> = all.iter().map(|o| o.inner / o.surface).collect();
    let mean = |value: fn(&Outcome) -> f64| all.iter().map(value).sum::<f64>() / all.len() as f64;
    let good = ratios.iter().filter(|r| **r <= 2.0).count();
    println!(
        "| {name} | {what} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} | {:.2} | {good} of {} | {:.2} |",
        mean(|o| o.depth),
        mean(|o| o.surface),
        mean(|o| o.inner),
        mean(|o| o.rigid),
        quantile(&ratios, 0.5),
        quantile(&ratios, 0.9),
        all.len(),
        mean(|o| o.expected) / mean(|o| o.inner),
    );
}

fn print_head(title: &str) {
    println!("\n{title}\n");
    println!(
        "| organ | deformation | depth, radii | surface, mm | inside, mm | inside if rigid, mm | ratio, median | \
         90th percentile | at most 2 | expected over found |"
    );
    println!("|{}", " --- |".repeat(10));
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let cases: usize = arguments.next().map_or(Ok(100), |a| a.parse())?;
    let seed: u64 = arguments.next().map_or(Ok(2), |a| a.parse())?;
    println!("{cases} cases a row, seed {seed}.");
    for level in SURFACE_ERRORS {
        print_head(&format!("Surface error drawn, {level} of the radius:"));
        for (name, open) in [("uterus", false), ("liver", false), ("uterus", true), ("liver", true)]
        {
            let subject = subject(name, open)?;
            let carrier = Carrier::new(&subject.template)?;
            for (kind, what) in KINDS {
                let one = |c| run(&subject, &carrier, (kind, level), seed, c);
                print_row(
                    &subject.name,
                    what,
                    &(0..cases).into_par_iter().map(one).collect::<Vec<_>>(),
                );
            }
        }
    }
    for (method, title) in [(Method::Dsfms, "dsfms"), (Method::Joint, "joint")] {
        print_head(&format!("Surface reconstructed from a rendered image by {title}:"));
        for name in ["uterus", "liver"] {
            let organ = SeriesOrgan::named(name)?;
            for (kind, what) in KINDS {
                let one = |c| reconstructed(&organ, kind, method, seed, c);
                let all: Vec<Option<Outcome>> =
                    (0..cases.div_ceil(5)).into_par_iter().map(one).collect();
                print_row(
                    &format!("{name}, a part"),
                    what,
                    &all.into_iter().flatten().collect::<Vec<_>>(),
                );
            }
        }
    }
    Ok(())
}
