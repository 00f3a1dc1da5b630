use super::*;
use crate::camera::CameraModel;
use crate::energy::Jacobian;
use crate::energy::check::bent_patch;
use crate::energy::{GlobalsPrior, Motion, RestFaces, Shearing, Smoothing, Stretch};
use crate::geometry::{Point2, Point3};
use crate::mesh::laplacian::Laplacian;
use crate::mesh::{Mesh, shapes};
use nalgebra::SMatrix;
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

fn camera() -> CameraModel {
    CameraModel::pinhole([640, 480], [600.0, 600.0], [319.5, 239.5])
}

/// A sheet of 40 × 40 mm, gently bent, 80 mm in front of the camera.
fn sheet(n: usize) -> Mesh {
    let flat = shapes::irregular_sheet(n);
    let bend = |p: &Point3| {
        let (x, y) = (40.0 * (p.x - 0.5), 40.0 * (p.y - 0.5));
        Point3::new(x, y, 80.0 + 0.01 * x * x + 0.005 * x * y)
    };
    flat.with_positions(flat.positions.iter().map(bend).collect())
}

fn objective<'a>(mesh: &Mesh, rest: &'a RestFaces, camera: &'a CameraModel) -> Objective<'a> {
    let faces: Vec<[u32; 3]> = mesh.topology.faces.iter().step_by(7).copied().collect();
    let pixels = faces.iter().map(|f| {
        let p = mesh.positions[f[0] as usize];
        let pull = 6.0 * (-(p.x * p.x + p.y * p.y) / 60.0).exp();
        Point2::new(319.5 + 600.0 * p.x / p.z + pull, 239.5 + 600.0 * p.y / p.z)
    });
    let motion = Motion {
        camera,
        pixels: pixels.collect(),
        barycentrics: vec![[1.0, 0.0, 0.0]; faces.len()],
        faces,
        sigma_px: 1.0,
    };
    let smoothing = Smoothing::of_displacement(&Laplacian::new(mesh), &mesh.positions, 1600.0);
    Objective::over(mesh.positions.len(), 1)
        .plus("motion", 1.0, Loss::GemanMcClure(4.0), motion)
        .plus("shearing", 3e4, Loss::Squared, Shearing { rest })
        .plus("stretch", 3e3, Loss::Squared, Stretch { rest })
        .plus("smoothing", 100.0, Loss::Squared, smoothing)
        .plus("gain prior", 1.0, Loss::Squared, GlobalsPrior::of(0, 0.1, 0.3))
}

fn start(mesh: &Mesh) -> Unknowns {
    let moved = mesh.positions.iter().map(|p| p + Vector3::new(0.05 * p.y.sin(), 0.0, 0.02));
    Unknowns { vertices: moved.collect(), globals: vec![0.0] }
}

fn farthest(a: &Unknowns, b: &Unknowns) -> f64 {
    a.vertices.iter().zip(&b.vertices).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

#[test]
fn assembly_equals_the_dense_sum() {
    let mesh = bent_patch();
    let rest = RestFaces::new(&mesh, 100.0);
    let smoothing = || Smoothing::of_displacement(&Laplacian::new(&mesh), &mesh.positions, 100.0);
    let mut problem = Objective::over(25, 1)
        .plus("shearing", 2.0, Loss::Huber(0.01), Shearing { rest: &rest })
        .plus("stretch", 3.0, Loss::Squared, Stretch { rest: &rest })
        .plus("smoothing", 0.5, Loss::Squared, smoothing())
        .plus("gain prior", 0.7, Loss::Squared, GlobalsPrior::of(0, 0.1, 0.3));
    let state = start(&mesh);
    let (mut hessian, mut gradient) = (DMatrix::zeros(76, 76), DVector::zeros(76));
    add_dense(
        2.0,
        Loss::Huber(0.01),
        &Shearing { rest: &rest },
        &state,
        &mut hessian,
        &mut gradient,
    );
    add_dense(3.0, Loss::Squared, &Stretch { rest: &rest }, &state, &mut hessian, &mut gradient);
    add_dense(0.5, Loss::Squared, &smoothing(), &state, &mut hessian, &mut gradient);
    (hessian[(75, 75)], gradient[75]) = (0.7 / 0.09, 0.7 * (0.0 - 0.1) / 0.09);
    problem.prepare();
    let norm = problem.linearise(&state);
    assert!((norm - gradient.norm()).abs() < 1e-9 * norm);
    // Damping keeps the free rigid motion in check.
    let found = DVector::from_vec(problem.step(0.1).unwrap().delta);
    let damped = &hessian + DMatrix::from_diagonal(&(hessian.diagonal() * 0.1));
    let residual = &damped * &found + &gradient;
    assert!(residual.norm() < 1e-8 * gradient.norm(), "{}", residual.norm());
}

fn add_dense<const R: usize>(
    weight: f64,
    loss: Loss,
    term: &impl EnergyTerm<R>,
    state: &Unknowns,
    hessian: &mut DMatrix<f64>,
    gradient: &mut DVector<f64>,
) {
    for i in 0..term.count() {
        let stencil = term.stencil(i);
        let v: Vec<Point3> = stencil.iter().map(|&k| state.vertices[k as usize]).collect();
        let mut dv = vec![SMatrix::<f64, R, 3>::zeros(); v.len()];
        let jacobian = Jacobian { vertices: &mut dv, globals: &mut [] };
        let r = term.residual(i, &v, &[], Some(jacobian)).unwrap();
        let w = weight * term.weight(i) * loss.evaluate(r.norm_squared()).1;
        let mut row = DMatrix::zeros(R, gradient.len());
        for (&k, d) in stencil.iter().zip(&dv) {
            row.view_mut((0, 3 * k as usize), (R, 3)).copy_from(d);
        }
        *hessian += row.transpose() * &row * w;
        *gradient += row.transpose() * DVector::from_row_slice(r.as_slice()) * w;
    }
}

#[test]
fn conjugate_gradients_end_where_the_direct_solver_does() {
    let (mesh, camera) = (sheet(33), camera());
    let rest = RestFaces::new(&mesh, 1600.0);
    let options = Options { cost_tolerance: 1e-10, ..Options::default() };
    let (found, _) = objective(&mesh, &rest, &camera).minimise(start(&mesh), &options);
    // Never oriented: solved directly.
    let mut direct = objective(&mesh, &rest, &camera);
    direct.prepare();
    let (expected, summary) = minimize(&mut direct, start(&mesh), &options);
    assert!(summary.cost().1 < 0.9 * summary.cost().0);
    // A match of 1 px is worth 0.13 mm here.
    let distance = farthest(&found, &expected);
    assert!(distance < 1e-3, "{distance} mm");
    assert!((found.globals[0] - 0.1).abs() < 1e-6);
}

#[test]
fn a_kept_workspace_gives_what_a_fresh_one_does() {
    let camera = camera();
    for n in [12, 33] {
        let mesh = sheet(n);
        let rest = RestFaces::new(&mesh, 1600.0);
        let options = Options::default();
        let make = || objective(&mesh, &rest, &camera);
        let mut workspace = Workspace::default();
        let (fresh, _) = make().minimise_in(&mut workspace, start(&mesh), &options);
        let (again, _) = make().minimise_in(&mut workspace, start(&mesh), &options);
        assert_eq!(fresh, again);
        // An objective with pairs that the workspace does not know.
        let far = Smoothing::of_displacement(&Laplacian::new(&mesh), &mesh.positions, 100.0);
        let other = || make().plus("far", 1.0, Loss::Norm, far.clone());
        let (kept, _) = other().minimise_in(&mut workspace, start(&mesh), &options);
        let (fresh, _) = other().minimise(start(&mesh), &options);
        assert!(farthest(&kept, &fresh) < 1e-6, "{}", farthest(&kept, &fresh));
    }
}

#[test]
fn a_reserved_workspace_holds_every_block_that_may_come() {
    let camera = camera();
    let mesh = sheet(33);
    let rest = RestFaces::new(&mesh, 1600.0);
    let vertices = mesh.positions.len();
    let around = |faces: &Vec<u32>| -> Vec<u32> {
        faces.iter().flat_map(|&f| mesh.topology.faces[f as usize]).collect()
    };
    let all: Vec<Vec<u32>> = mesh.topology.vertex_faces.iter().map(around).collect();
    let mut workspace = Workspace::reserved(vertices, 1, all.iter().map(Vec::as_slice));
    let blocks = |workspace: &Workspace| workspace.system.as_ref().unwrap().equations.near().len();
    let reserved = blocks(&workspace);
    let make = || objective(&mesh, &rest, &camera);
    let (state, _) = make().minimise_in(&mut workspace, start(&mesh), &Options::default());
    let (fresh, _) = make().minimise(start(&mesh), &Options::default());
    // Another order of the unknowns, and iterations that end as near to the direct solver as above.
    assert!(farthest(&state, &fresh) < 1e-3, "{}", farthest(&state, &fresh));
    assert_eq!(blocks(&workspace), reserved);
}

#[test]
fn blocks_are_found_again_and_others_are_not_mistaken_for_them() {
    let stencils: [&[u32]; 3] = [&[0, 1, 2], &[2, 3], &[0, 1, 2, 3, 4, 5]];
    let pattern = Pattern::new(6, stencils.into_iter());
    let known = KnownSlots::default();
    let first = known.locate(&pattern, 0, stencils[..2].iter().copied()).unwrap();
    let again = known.locate(&pattern, 0, stencils[..2].iter().copied()).unwrap();
    assert!(Arc::ptr_eq(&first, &again));
    let by_hand: Vec<u32> =
        [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2), (2, 2), (3, 2), (3, 3)]
            .map(|(a, b)| pattern.find(a, b).unwrap() as u32)
            .into();
    assert_eq!(*first, by_hand[..]);
    // The same vertices in other stencils, fewer, more, and another term.
    let split: [&[u32]; 3] = [&[0, 1], &[2], &[2, 3]];
    assert_ne!(known.locate(&pattern, 0, split.into_iter()).unwrap(), first);
    assert_eq!(known.locate(&pattern, 0, stencils[..1].iter().copied()).unwrap()[..], first[..6]);
    assert_eq!(known.locate(&pattern, 0, stencils.into_iter()).unwrap().len(), 9 + 21);
    let far: [&[u32]; 1] = [&[0, 7]];
    assert!(known.locate(&pattern, 1, far.into_iter()).is_none());
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let camera = camera();
    for n in [12, 33] {
        let mesh = sheet(n);
        let rest = RestFaces::new(&mesh, 1600.0);
        let solve = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                objective(&mesh, &rest, &camera).minimise(start(&mesh), &Options::default()).0
            })
        };
        assert_eq!(solve(1), solve(4));
    }
}

#[test]
fn a_trial_leaves_the_linearisation_and_the_costs_that_are_made_anew() {
    let (mesh, camera) = (sheet(12), camera());
    let rest = RestFaces::new(&mesh, 1600.0);
    let state = start(&mesh);
    let (mut kept, mut anew) = (objective(&mesh, &rest, &camera), objective(&mesh, &rest, &camera));
    kept.prepare();
    anew.prepare();
    let (tried, costs) = (kept.trial(&state).unwrap(), anew.costs(&state).unwrap());
    assert!(tried.iter().zip(&costs).all(|(a, b)| (a - b).abs() <= 1e-12 * b.abs()));
    assert_eq!(kept.linearise(&state), anew.linearise(&state));
    // A refused trial changes nothing of the model that is solved.
    let mut other = state.clone();
    other.vertices[3].x += 0.1;
    kept.trial(&other).unwrap();
    assert_eq!(kept.step(0.1).unwrap().delta, anew.step(0.1).unwrap().delta);
    assert_eq!(kept.linearise(&state), anew.linearise(&state));
}

/// A shallow cone of `n` faces about one vertex, the first.
fn cone(n: u32) -> Mesh {
    let rim = (0..n).map(|k| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(n)).sin_cos();
        Point3::new(cos, sin, 0.2)
    });
    let faces = (0..n).map(|k| [0, 1 + k, 1 + (k + 1) % n]).collect();
    Mesh::new([Point3::origin()].into_iter().chain(rim).collect(), faces).unwrap()
}

#[test]
fn vertices_of_any_valence_are_solved() {
    for n in [47, 48, 300] {
        let mesh = cone(n);
        let rest = RestFaces::new(&mesh, 3.0);
        let smoothing = Smoothing::of_displacement(&Laplacian::new(&mesh), &mesh.positions, 3.0);
        let problem = Objective::over(mesh.positions.len(), 0)
            .plus("shearing", 1.0, Loss::Squared, Shearing { rest: &rest })
            .plus("stretch", 1.0, Loss::Squared, Stretch { rest: &rest })
            .plus("smoothing", 1.0, Loss::Squared, smoothing);
        let mut vertices = mesh.positions.clone();
        vertices[0].z += 0.05;
        let state = Unknowns { vertices, globals: Vec::new() };
        let (_, summary) = problem.minimise(state, &Options::default());
        let (before, after) = summary.cost();
        assert!(after < 1e-3 * before, "valence {n}: {before} to {after}");
        let ring = crate::energy::ring::OneRing::of(&mesh.topology, 0).unwrap();
        let gathered: Vec<Point3> =
            ring.stencil.iter().map(|&v| mesh.positions[v as usize]).collect();
        // The axis of the cone, seen from its inside.
        assert!((ring.normal(&gathered).unwrap().unit - Vector3::z()).norm() < 1e-9);
    }
}
