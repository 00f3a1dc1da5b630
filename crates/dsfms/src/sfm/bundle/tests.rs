use super::*;
use crate::camera::Lens;
use crate::geometry::{Isometry, Point3, Vector3, align_similarity};
use crate::sfm::RefineIntrinsics;
use crate::sfm::random::Random;
use crate::sfm::triangulation::centre_of;

/// Eight cameras on an arc about 80 points, seen without noise.
pub(super) fn scene() -> Bundle {
    let camera = CameraModel::pinhole([640, 480], [548.0, 549.0], [316.4, 243.2]);
    let mut random = Random::new(1, 0);
    let mut unit = || random.below(1_000_000) as f64 / 1e6 - 0.5;
    let points: Vec<_> =
        (0..80).map(|_| Point3::new(30.0 * unit(), 30.0 * unit(), 20.0 * unit())).collect();
    let poses: Vec<_> = (0..8)
        .map(|i| {
            let turn = Vector3::new(0.1 * unit(), 0.12 * (i as f64 - 3.5), 0.1 * unit());
            Isometry::new(Vector3::new(unit(), unit(), 60.0 + 6.0 * unit()), turn)
        })
        .collect();
    let mut observations = Vec::new();
    for (view, pose) in poses.iter().enumerate() {
        for (point, p) in points.iter().enumerate() {
            let pixel = camera.project(&(pose * p)).unwrap().pixel;
            observations.push(BundleObservation { view, point, pixel, sigma_px: 1.0 });
        }
    }
    let mut fixed = vec![false; 8];
    fixed[0] = true;
    let cameras = vec![camera];
    let (priors, camera_of) = (cameras.clone(), vec![0; poses.len()]);
    Bundle { cameras, priors, camera_of, poses, fixed, points, observations }
}

fn disturbed(truth: &Bundle) -> Bundle {
    let mut bundle = truth.clone();
    let mut random = Random::new(2, 0);
    let mut unit = || random.below(1_000_000) as f64 / 1e6 - 0.5;
    for pose in &mut bundle.poses[1..] {
        let step = nalgebra::Vector6::from_fn(|i, _| unit() * if i < 3 { 0.02 } else { 1.0 });
        *pose = retract(pose, &step);
    }
    bundle.points.iter_mut().for_each(|p| *p += Vector3::new(unit(), unit(), unit()));
    bundle
}

fn scale_focal(camera: &mut CameraModel, factor: f64) {
    camera.focal = camera.focal.map(|f| factor * f);
}

/// Every view with a camera of its own, except the last two, which share one; focal lengths differ
/// from view to view and the pixels are what those cameras see.
fn zooming() -> Bundle {
    let mut bundle = scene();
    let views = bundle.poses.len();
    bundle.camera_of = (0..views).map(|v| v.min(views - 2)).collect();
    let camera = |c: usize| {
        let mut camera = bundle.cameras[0].clone();
        camera.lens = Lens::BrownConrady { k: [0.02 * c as f64 - 0.05, 0.0, 0.0], p: [0.0; 2] };
        scale_focal(&mut camera, 1.0 + 0.04 * c as f64);
        camera
    };
    bundle.cameras = (0..views - 1).map(camera).collect();
    bundle.priors = bundle.cameras.clone();
    for o in &mut bundle.observations {
        let camera = &bundle.cameras[bundle.camera_of[o.view]];
        o.pixel = camera.project(&(bundle.poses[o.view] * bundle.points[o.point])).unwrap().pixel;
    }
    bundle
}

fn centre_error(a: &Bundle, b: &Bundle) -> f64 {
    let centres = |s: &Bundle| s.poses.iter().map(centre_of).collect::<Vec<_>>();
    let (from, to) = (centres(a), centres(b));
    let fit = align_similarity(&from, &to).unwrap();
    from.iter().zip(&to).map(|(f, t)| (fit * f - t).norm()).fold(0.0, f64::max)
}

#[test]
fn converges_to_the_truth() {
    let truth = scene();
    let mut bundle = disturbed(&truth);
    let summary = adjust(&mut bundle, &BundleOptions::default()).unwrap();
    assert!(summary.cost().1 < 1e-12 * summary.cost().0, "{summary:?}");
    assert!(centre_error(&bundle, &truth) < 1e-6);
    assert_eq!(bundle.poses[0], truth.poses[0]);
}

#[test]
fn outliers_are_outvoted_by_the_robust_loss() {
    let truth = scene();
    let mut bundle = disturbed(&truth);
    bundle.observations.iter_mut().step_by(29).for_each(|o| o.pixel.x += 25.0);
    let options = BundleOptions { loss: Loss::GemanMcClure(2.0), ..Default::default() };
    adjust(&mut bundle, &BundleOptions::default()).unwrap();
    adjust(&mut bundle, &options).unwrap();
    assert!(centre_error(&bundle, &truth) < 0.02, "{}", centre_error(&bundle, &truth));
}

#[test]
fn a_wrong_focal_length_is_recovered() {
    let truth = scene();
    let mut bundle = disturbed(&truth);
    scale_focal(&mut bundle.cameras[0], 1.04);
    let refine = RefineIntrinsics { focal: true, ..Default::default() };
    let options = BundleOptions { refine, cost_tolerance: 1e-12, ..Default::default() };
    adjust(&mut bundle, &options).unwrap();
    let [camera] = &bundle.cameras[..] else { panic!("one camera") };
    assert!((camera.focal[0] / 548.0 - 1.0).abs() < 5e-3, "{:?}", camera.focal);
}

#[test]
fn either_elimination_gives_the_same_step() {
    let mut bundle = disturbed(&scene());
    scale_focal(&mut bundle.cameras[0], 1.01);
    // Not every view sees every point.
    bundle.observations.retain(|o| (o.view + 3 * o.point) % 5 != 0);
    let mut layout = BundleLayout::new(&bundle, &[0, 1]);
    assert_eq!(layout.eliminate, Eliminate::Points);
    let mut steps = Vec::new();
    for eliminate in [Eliminate::Points, Eliminate::Poses] {
        layout.eliminate = eliminate;
        sort(&mut bundle, eliminate).unwrap();
        let rows = linearise(&bundle, Loss::Huber(1.0));
        steps.push(solve(&rows, &layout, &[(3.0, 0.5), (2.0, -1.0)], 1e-3).unwrap());
    }
    let [a, b] = [&steps[0], &steps[1]];
    let near = |x: &[f64], y: &[f64]| x.iter().zip(y).all(|(x, y)| (x - y).abs() < 1e-7);
    let focal = 6 * bundle.poses.len() + 3 * bundle.points.len();
    assert!(a.delta.len() == b.delta.len() && near(&a.delta, &b.delta));
    assert!(a.delta[focal].abs() > 1e-4);
    assert!((a.predicted / b.predicted - 1.0).abs() < 1e-9);
    assert_eq!(a.delta[..6], [0.0; 6]);
}

pub(super) fn tight() -> BundleOptions {
    let loss = Loss::Squared;
    BundleOptions { cost_tolerance: 1e-14, loss, max_steps: 200, ..Default::default() }
}

#[test]
fn cameras_of_their_own_are_recovered_and_a_shared_one_stays_shared() {
    let truth = zooming();
    let mut bundle = disturbed(&truth);
    for (c, camera) in bundle.cameras.iter_mut().enumerate() {
        scale_focal(camera, if c % 2 == 0 { 1.02 } else { 0.99 });
    }
    let refine = RefineIntrinsics { focal: true, distortion: true, ..Default::default() };
    let options = BundleOptions { refine, prior_scale: f64::INFINITY, ..tight() };
    let summary = adjust(&mut bundle, &options).unwrap();
    assert!(summary.cost().1 < 1e-12 * summary.cost().0, "{summary:?}");
    for (camera, truth) in bundle.cameras.iter().zip(&truth.cameras) {
        assert!((camera.focal[0] / truth.focal[0] - 1.0).abs() < 1e-4, "{camera:?}");
        let k = |c: &CameraModel| match c.lens {
            Lens::BrownConrady { k, .. } => k[0],
            _ => f64::NAN,
        };
        assert!((k(camera) - k(truth)).abs() < 1e-3, "{camera:?}");
    }
}

/// The step against the dense normal equations, whose Jacobian comes from central differences.
#[test]
fn the_step_solves_the_dense_normal_equations() {
    let mut bundle = disturbed(&zooming());
    bundle.points.truncate(9);
    bundle.observations.retain(|o| o.point < 9 && (o.view + o.point) % 4 != 1);
    let mut layout = BundleLayout::new(&bundle, &[0, 3]);
    let (views, cameras) = (bundle.poses.len(), bundle.cameras.len());
    let at_cameras = 6 * views + 3 * 9;
    let unknowns = at_cameras + 2 * cameras;
    let offset = vec![[0.0; COUNT]; cameras];
    let prior: Vec<(f64, f64)> = (0..2 * cameras).map(|i| (2.0 + i as f64, 0.3)).collect();
    for eliminate in [Eliminate::Points, Eliminate::Poses] {
        layout.eliminate = eliminate;
        sort(&mut bundle, eliminate).unwrap();
        let residuals = |b: &Bundle| {
            let one = |o: &BundleObservation| {
                let seen =
                    b.cameras[b.camera_of[o.view]].project(&(b.poses[o.view] * b.points[o.point]));
                seen.unwrap().pixel - o.pixel
            };
            let all: Vec<f64> = b.observations.iter().flat_map(|o| one(o).data.0[0]).collect();
            nalgebra::DVector::from_vec(all)
        };
        let mut own = BundleLayout::new(&bundle, &[0, 3]);
        own.eliminate = eliminate;
        let adjustment = Adjustment {
            layout: own,
            prior: IntrinsicsPrior::new(&bundle, &tight()),
            loss: Loss::Squared,
            rows: Vec::new(),
            normal: Vec::new(),
        };
        let start = Adjusted { bundle: bundle.clone(), offset: offset.clone() };
        let at = |k: usize, h: f64| {
            let mut x = vec![0.0; unknowns];
            x[k] = h;
            residuals(&adjustment.retract(&start, &x).bundle)
        };
        let columns: Vec<_> = (6..unknowns).map(|k| (at(k, 1e-5) - at(k, -1e-5)) / 2e-5).collect();
        let jacobian = nalgebra::DMatrix::from_columns(&columns);
        let mut normal = jacobian.transpose() * &jacobian;
        let mut gradient = jacobian.transpose() * residuals(&bundle);
        for (i, (weight, g)) in prior.iter().enumerate() {
            normal[(at_cameras - 6 + i, at_cameras - 6 + i)] += weight;
            gradient[at_cameras - 6 + i] += g;
        }
        let damping = 1e-2;
        for k in 0..unknowns - 6 {
            normal[(k, k)] *= 1.0 + damping;
        }
        let wanted = -normal.cholesky().unwrap().solve(&gradient);
        let rows = linearise(&bundle, Loss::Squared);
        let step = solve(&rows, &layout, &prior, damping).unwrap();
        let found = &step.delta[6..];
        let miss = found.iter().zip(wanted.iter()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(miss < 1e-5 * wanted.amax(), "{eliminate:?}: {miss} of {}", wanted.amax());
    }
}

#[test]
fn many_views_of_few_points_converge_too() {
    let mut truth = scene();
    truth.points.truncate(12);
    truth.observations.retain(|o| o.point < 12);
    let mut bundle = disturbed(&truth);
    assert_eq!(BundleLayout::new(&bundle, &[]).eliminate, Eliminate::Poses);
    let summary = adjust(&mut bundle, &BundleOptions::default()).unwrap();
    assert!(summary.cost().1 < 1e-12 * summary.cost().0, "{summary:?}");
    assert!(centre_error(&bundle, &truth) < 1e-6);
}

#[test]
fn bad_input_is_refused() {
    let mut bundle = scene();
    bundle.observations[3].view = 99;
    assert!(matches!(
        adjust(&mut bundle, &BundleOptions::default()),
        Err(BundleError::Index(3, 99, 3))
    ));
    let mut bundle = scene();
    bundle.camera_of[2] = 1;
    let refused = adjust(&mut bundle, &BundleOptions::default()).unwrap_err();
    assert_eq!(refused, BundleError::Cameras { views: 8, named: 7, cameras: 1, priors: 1 });
    let mut bundle = scene();
    bundle.points[0].z = -1000.0;
    let result = adjust(&mut bundle, &BundleOptions::default());
    assert_eq!(result.unwrap_err(), BundleError::Infeasible(8));
}
