//! The terms of eqs. 3 and 4 against values by hand, and the printed equations against the sums
//! that a reader of the paper would form from the surface that was found.

use dsfms::Mesh;
use dsfms::camera::{Camera, CameraModel};
use dsfms::energy::diffuse::DiffuseVertex;
use dsfms::energy::{Brightness, Diffuse, EnergyTerm, Motion, Specular};
use dsfms::geometry::{Point2, Point3, Vector3};
use dsfms::image::ColorImage;
use dsfms::light::LightModel;
use dsfms::nalgebra::Matrix2;
use dsfms::nalgebra::Matrix3;
use dsfms::pipeline::{Method, Observation, ReconstructOptions, Reconstruction, reconstruct};
use dsfms::register::scene::visibility;
use dsfms::register::{RegisterOptions, Scene, pose, register_printed};
use dsfms::solver::Summary;
use dsfms::synth::Case;

fn camera() -> CameraModel {
    CameraModel::pinhole([64, 48], [100.0, 110.0], [31.0, 23.0])
}

/// Six faces around vertex 0 at depth 50, turned about x by `tilt`; outward towards the camera.
fn fan(tilt: f64) -> Mesh {
    let at = |k: u32| {
        let a = f64::from(k) * std::f64::consts::FRAC_PI_3;
        Point3::new(a.cos(), a.sin() * tilt.cos(), 50.0 + a.sin() * tilt.sin())
    };
    let mut positions = vec![Point3::new(0.0, 0.0, 50.0)];
    positions.extend((0..6).map(at));
    let faces = (0..6).map(|k| [0, 1 + (k + 1) % 6, 1 + k]).collect();
    Mesh::new(positions, faces).unwrap()
}

fn gathered<const R: usize>(term: &impl EnergyTerm<R>, mesh: &Mesh) -> Vec<Point3> {
    term.stencil(0).iter().map(|&v| mesh.positions[v as usize]).collect()
}

#[test]
fn motion_is_the_distance_in_the_image_over_its_noise() {
    let term = Motion {
        camera: &camera(),
        faces: vec![[0, 1, 2]],
        barycentrics: vec![[0.5, 0.25, 0.25]],
        pixels: vec![Point2::new(31.0 + 2.0 - 3.0, 23.0 + 4.0)],
        sigma_px: 2.0,
    };
    // The point at these barycentrics is (1, 0, 50): pixel (33, 23).
    let corners =
        [Point3::new(0.0, 0.0, 50.0), Point3::new(4.0, 0.0, 50.0), Point3::new(0.0, 0.0, 50.0)];
    let residual = term.residual(0, &corners, &[], None).unwrap();
    assert!((residual - dsfms::geometry::Vector2::new(1.5, -2.0)).norm() < 1e-12, "{residual}");
}

#[test]
fn brightness_is_albedo_times_the_cosine() {
    let (camera, light) = (camera(), LightModel::Collinear);
    let image = ColorImage { size: camera.size, data: vec![[0.35; 3]; 64 * 48] };
    let brightness = Brightness {
        weights: [1.0, 0.0, 0.0],
        albedo: 0.6,
        added_shade: 0.0,
        white: 1.0,
        sigma: 0.1,
    };
    let seen = DiffuseVertex { vertex: 0, brightness, turn: Matrix3::identity() };
    for (degrees, expected) in [(0.0_f64, -2.5), (60.0, 0.5)] {
        let mesh = fan(degrees.to_radians());
        let term = Diffuse::new(&camera, &light, &image, &mesh.topology, &[seen]);
        // (0.35 − 0.6 cos) / 0.1, without gain and ambient light; the paper's L·N.
        let residual = term.residual(0, &gathered(&term, &mesh), &[0.0, 0.0], None).unwrap()[0];
        assert!((residual - expected).abs() < 1e-6, "{degrees} degrees: {residual}");
        let lit = term.residual(0, &gathered(&term, &mesh), &[0.0, 0.05], None).unwrap()[0];
        assert!((residual - lit - 0.5).abs() < 1e-9, "ambient light adds to the prediction");
    }
}

#[test]
fn a_specular_normal_is_parallel_to_the_light() {
    let towards = -Vector3::z();
    for (degrees, expected) in [(0.0_f64, 0.0), (30.0, 2.5), (90.0, 5.0)] {
        let mesh = fan(degrees.to_radians());
        let term = Specular::new(&mesh.topology, &[(0, towards)], 0.2);
        // |L × N| = sin, over 0.2.
        let residual = term.residual(0, &gathered(&term, &mesh), &[], None).unwrap().norm();
        assert!((residual - expected).abs() < 1e-9, "{degrees} degrees: {residual}");
    }
}

fn cost(summary: &Summary, label: &str) -> f64 {
    summary.terms.iter().find(|t| t.label == label).unwrap_or_else(|| panic!("{label}")).after
}

fn near(a: f64, b: f64, what: &str) {
    assert!((a - b).abs() < 1e-9 * (1.0 + a.abs()), "{what}: {a} against {b}");
}

/// The unsquared norm of the paper, which the solver rounds off within 10⁻³ of 0; twice, as its
/// costs are.
fn norm(r: f64) -> f64 {
    2.0 * ((r * r + 1e-6).sqrt() - 1e-3)
}

/// `Σ mᵢ ‖(Lap x)ᵢ‖²` in units of the visible surface: `‖ΔV‖²`.
fn bending(scene: &Scene, shape: &[Point3]) -> f64 {
    let x: Vec<Vector3> = shape.iter().map(|p| p.coords).collect();
    let energy: f64 = (0..x.len())
        .map(|i| scene.laplacian.mass[i] * scene.laplacian.apply(i, &x).norm_squared())
        .sum();
    energy * scene.radius().powi(2) / scene.visible_area
}

/// Shearing and anisotropy of a face, from the lengths of its edges alone.
fn conformal(rest: [&Point3; 3], now: [&Point3; 3]) -> [f64; 2] {
    let flat = |p: [&Point3; 3]| {
        let (a, b, c) = ((p[1] - p[0]).norm(), (p[2] - p[0]).norm(), (p[2] - p[1]).norm());
        let along = (a * a + b * b - c * c) / (2.0 * a);
        Matrix2::new(a, along, 0.0, (b * b - along * along).sqrt())
    };
    let f = flat(now) * flat(rest).try_inverse().unwrap();
    let c = f.transpose() * f;
    let root = c.determinant().sqrt();
    [c[(0, 1)] / root, (c[(0, 0)] - c[(1, 1)]) / (2.0 * root)]
}

#[test]
fn the_printed_eq_3_is_the_sum_of_its_lines() {
    let case = Case::example(2);
    let options = RegisterOptions::default();
    let rest = &case.template.mesh;
    let posed = pose(&case.camera, rest, &case.matches, &options, 0).unwrap();
    let rigid = rest.positions.iter().map(|p| posed.pose * p).collect();
    let scene = Scene::new(&case.camera, rest, rigid);
    let found = register_printed(&scene, &case.matches, &posed, &options);
    let labels: Vec<_> = found.summary.terms.iter().map(|t| t.label.as_str()).collect();
    // Nothing but the four lines.
    let lines = ["motion (eq. 3)", "shearing (eq. 3)", "anisotropy (eq. 3)", "smoothing (eq. 3)"];
    assert_eq!(labels, lines);

    let shape = &found.vertices;
    let motion: f64 = case
        .matches
        .iter()
        .map(|m| {
            let seen = case.camera.project(&scene.point(m, shape)).unwrap().pixel;
            norm((seen - m.pixel).norm() / options.match_sigma_px)
        })
        .sum();
    near(cost(&found.summary, "motion (eq. 3)"), motion, "motion");
    let mut strain = [0.0; 2];
    for (f, area) in rest.face_areas().into_iter().enumerate() {
        let now = rest.topology.faces[f].map(|v| &shape[v as usize]);
        let of = conformal(rest.corners(f), now);
        // S⁰ and A⁰ are 0; the area of the face weighs it.
        (0..2).for_each(|k| strain[k] += area / scene.visible_area * of[k] * of[k]);
    }
    assert!(strain[0] > 0.0 && strain[1] > 0.0);
    near(cost(&found.summary, "shearing (eq. 3)"), options.prior.conformal * strain[0], "shearing");
    near(
        cost(&found.summary, "anisotropy (eq. 3)"),
        options.prior.conformal * strain[1],
        "anisotropy",
    );
    let smoothing = options.prior.smoothing * bending(&scene, shape);
    near(cost(&found.summary, "smoothing (eq. 3)"), smoothing, "smoothing");
    // It is a minimum worth the name: no larger than at the rigid pose.
    let (before, after) = found.summary.cost();
    assert!(after < before, "{before} to {after}");
}

fn printed(case: &Case, method: Method) -> Reconstruction {
    let seen = Observation::new(&case.frame, &case.camera).matches(&case.matches);
    let options = ReconstructOptions { literal: true, ..Default::default() };
    Reconstruction::even_refused(reconstruct(&case.template, &seen, method, &options)).unwrap()
}

#[test]
fn the_printed_eq_4_is_the_sum_of_its_lines() {
    let case = Case::example(2);
    let (coarse, fine) = (printed(&case, Method::Dsfm), printed(&case, Method::Dsfms));
    let stage = fine.stages.iter().find(|s| s.name == "refine (eq. 4)").unwrap();
    let summary = stage.summary.as_ref().unwrap();
    let labels: Vec<_> = summary.terms.iter().map(|t| t.label.as_str()).collect();
    // The five lines, and what holds gain at 1 and ambient light at 0.
    let lines = [
        "boundary condition (eq. 4)",
        "reprojection (eq. 4)",
        "diffuse (eq. 4)",
        "specular (eq. 4)",
        "smoothing (eq. 4)",
        "gain = 1",
        "ambient light = 0",
    ];
    assert_eq!(labels, lines);
    assert!((fine.gain - 1.0).abs() < 1e-4 && fine.ambient.abs() < 1e-4);

    let options = ReconstructOptions::default().refine;
    let rest = &case.template.mesh;
    let rigid = rest.positions.iter().map(|p| coarse.pose * p).collect();
    let scene = Scene::new(&case.camera, rest, rigid);
    let kept = coarse.matches.iter().filter(|m| m.1).map(|m| m.0);
    let boundary: f64 = kept
        .map(|m| scene.point(&m, &fine.vertices).z - scene.point(&m, &coarse.vertices).z)
        .map(|z| norm(z / (options.depth_hold * scene.radius())))
        .sum();
    assert!(boundary > 0.0);
    near(cost(summary, "boundary condition (eq. 4)"), boundary, "boundary");
    let visible = visibility(&case.camera, rest, &coarse.vertices);
    let seen: Vec<usize> = (0..visible.len()).filter(|&v| visible[v]).collect();
    let pixel = |p: &Point3| case.camera.project(p).unwrap().pixel;
    let moved: f64 = seen
        .iter()
        .map(|&v| (pixel(&fine.vertices[v]) - pixel(&coarse.vertices[v])).norm_squared())
        .sum();
    let reprojection = options.lambda_4 / seen.len() as f64 * moved;
    near(cost(summary, "reprojection (eq. 4)"), reprojection, "reprojection");
    let smoothing = options.lambda_7 * bending(&scene, &fine.vertices);
    near(cost(summary, "smoothing (eq. 4)"), smoothing, "smoothing");
}
