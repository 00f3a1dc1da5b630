//! Inner points under a volumetric map: their error against the surface's.

#[path = "common/organ.rs"]
mod organ;

use dsfms::Mesh;
use dsfms::geometry::{Isometry, Point3, Vector3};
use dsfms::structures::Carrier;
use dsfms::synth::{Random, patch};
use organ::closed;

/// Bend about the y axis, a bulge pressed in from the front and a twist: tens of per cent of
/// strain.
fn deformed(p: &Point3) -> Point3 {
    let press =
        -6.0 * (-((p.x - 4.0).powi(2) + (p.y + 3.0).powi(2)) / 200.0).exp() * (-p.z / 30.0).exp();
    let bend = 0.006 * p.x * p.x;
    let twist = 0.004 * p.y;
    let (sin, cos) = (twist * p.z * 0.2).sin_cos();
    let q = Point3::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y, p.z + bend - press);
    Isometry::new(Vector3::new(2.0, -1.0, 70.0), Vector3::new(0.2, -0.1, 0.3)) * q
}

/// An ellipsoid of 50 x 40 x 30 mm.
fn ellipsoid() -> Mesh {
    closed(24, 40, |d| Vector3::new(25.0 * d.x, 20.0 * d.y, 15.0 * d.z))
}

/// A surface error that varies slowly, of the kind that reconstructions make, and jitter.
fn noise(p: &Point3, random: &mut Random) -> Vector3 {
    let slow =
        Vector3::new((0.12 * p.y).sin(), (0.1 * p.x + 1.0).sin(), (0.15 * (p.x + p.y)).cos());
    let jitter = Vector3::from_fn(|_, _| 2.0 * unit(random) - 1.0);
    0.6 * slow + 0.3 * jitter
}

fn unit(random: &mut Random) -> f64 {
    dsfms::synth::random::uniform(random)
}

/// Mean error of the surface, of the inner points, and of the inner points moved rigidly.
fn errors(rest: &Mesh, inner: &[Point3]) -> [f64; 3] {
    let mut random = Random::new(3, 9);
    let truth: Vec<Point3> = rest.positions.iter().map(deformed).collect();
    let found: Vec<Point3> =
        rest.positions.iter().zip(&truth).map(|(p, t)| t + noise(p, &mut random)).collect();
    let carrier = Carrier::new(rest).unwrap();
    let carried = carrier.carry(&found).unwrap();
    let rigid = dsfms::geometry::align_rigid(&rest.positions, &found).unwrap();
    let mean = |d: Vec<f64>| d.iter().sum::<f64>() / d.len() as f64;
    [
        mean(found.iter().zip(&truth).map(|(a, b)| (a - b).norm()).collect()),
        mean(inner.iter().map(|p| (carried.at(p) - deformed(p)).norm()).collect()),
        mean(inner.iter().map(|p| (rigid * p - deformed(p)).norm()).collect()),
    ]
}

/// A ball of points, as a tumour.
fn ball(middle: Point3, radius: f64) -> Vec<Point3> {
    let mut random = Random::new(1, 4);
    let mut points = Vec::new();
    while points.len() < 200 {
        let v = Vector3::from_fn(|_, _| 2.0 * unit(&mut random) - 1.0);
        if v.norm() < 1.0 {
            points.push(middle + radius * v);
        }
    }
    points
}

#[test]
fn inside_a_closed_organ_the_error_is_at_most_twice_the_surface() {
    let [surface, inner, rigid] = errors(&ellipsoid(), &ball(Point3::new(4.0, -3.0, 0.0), 8.0));
    println!("closed: surface {surface:.2} mm, inside {inner:.2} mm, rigid {rigid:.2} mm");
    assert!(inner < 2.0 * surface && inner < 0.8 * rigid, "{surface} {inner} {rigid}");
}

#[test]
fn under_an_open_surface_too() {
    let rest = patch(1000, 2).mesh;
    let [surface, inner, rigid] = errors(&rest, &ball(Point3::new(4.0, -3.0, 8.0), 5.0));
    println!("open: surface {surface:.2} mm, inside {inner:.2} mm, rigid {rigid:.2} mm");
    assert!(inner < 2.0 * surface && inner < rigid, "{surface} {inner} {rigid}");
}

#[test]
fn fewer_centres_than_vertices_still_carry_rigid_motions_exactly() {
    let rest = patch(1500, 5).mesh;
    let pose = Isometry::new(Vector3::new(3.0, 1.0, 60.0), Vector3::new(0.4, -0.2, 0.9));
    let moved: Vec<Point3> = rest.positions.iter().map(|p| pose * p).collect();
    let carrier = Carrier::new(&rest).unwrap();
    let p = Point3::new(5.0, 6.0, 20.0);
    assert!((carrier.carry(&moved).unwrap().at(&p) - pose * p).norm() < 1e-9);
}
