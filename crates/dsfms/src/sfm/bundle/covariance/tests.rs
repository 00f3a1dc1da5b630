use super::super::tests::{scene, tight};
use super::super::{BundleObservation, adjust};
use super::*;
use crate::geometry::Vector3;
use crate::sfm::RefineIntrinsics;
use crate::sfm::random::Random;
use nalgebra::{DVector, Vector6};

/// Some views of some points of the scene, each point seen by all views but one.
fn part(views: usize, points: usize) -> Bundle {
    let mut bundle = scene();
    bundle.poses.truncate(views);
    bundle.camera_of.truncate(views);
    bundle.fixed.truncate(views);
    bundle.points.truncate(points);
    let within = |o: &BundleObservation| o.view < views && o.point < points;
    bundle.observations.retain(|o| within(o) && (o.view + o.point) % (views + 2) != 0);
    bundle
}

/// Noise of three uniform numbers: deviation 0.5 px.
fn noisy(bundle: &Bundle, seed: u64) -> Bundle {
    let mut random = Random::new(seed, 7);
    let mut unit = || random.below(1_000_000) as f64 / 1e6 - 0.5;
    let mut normal = || unit() + unit() + unit();
    let mut bundle = bundle.clone();
    for o in &mut bundle.observations {
        o.pixel += nalgebra::Vector2::new(normal(), normal());
    }
    bundle
}

/// Against the inverse of the whole normal matrix, bordered by the constraint of the gauge.
#[test]
fn blocks_are_those_of_the_dense_inverse() {
    let bundle = noisy(&part(4, 9), 1);
    let refine = RefineIntrinsics { focal: true, ..Default::default() };
    let options = BundleOptions { refine, ..tight() };
    let found = covariance(&bundle, &options).unwrap();
    let (poses, kept) = (6 * 4, 6 * 4 + 1);
    let size = kept + 3 * 9;
    let mut normal = DMatrix::zeros(size + GAUGE, size + GAUGE);
    for row in linearise(&bundle, Loss::Squared) {
        let mut full = DMatrix::zeros(2, size + GAUGE);
        full.fixed_view_mut::<2, 6>(0, 6 * row.view).copy_from(&row.by_pose);
        full.fixed_view_mut::<2, 1>(0, poses).copy_from(&row.by_intrinsics.column(0));
        full.fixed_view_mut::<2, 3>(0, kept + 3 * row.point).copy_from(&row.by_point);
        normal += full.transpose() * full;
    }
    normal[(poses, poses)] +=
        found.variance * IntrinsicsPrior::new(&bundle, &options).weights().next().unwrap();
    let (mut constraint, radius) = gauge(&bundle, kept).unwrap();
    for v in 0..4 {
        let mut rows = constraint.rows_mut(6 * v, 3);
        rows *= radius;
    }
    normal.view_mut((0, size), (kept, GAUGE)).copy_from(&constraint);
    normal.view_mut((size, 0), (GAUGE, kept)).copy_from(&constraint.transpose());
    let dense = normal.try_inverse().unwrap() * found.variance;
    let near = |a: &[f64], b: &[f64]| {
        let largest = b.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6 * largest)
    };
    for v in 0..4 {
        let wanted = of_pose(&bundle, &dense, v);
        assert!(near(found.poses[v].as_slice(), wanted.as_slice()), "{}{wanted}", found.poses[v]);
    }
    for (p, own) in found.points.iter().enumerate() {
        let at = kept + 3 * p;
        let wanted = dense.fixed_view::<3, 3>(at, at).into_owned();
        assert!(near(own.as_slice(), wanted.as_slice()), "{own}{wanted}");
    }
}

/// Errors of the poses (ω, τ) and points of a solution, less the similarity of the gauge.
fn errors(found: &Bundle, truth: &Bundle) -> (Vec<Vector6<f64>>, Vec<Vector3>) {
    let views = truth.poses.len();
    let mut own = DVector::zeros(6 * views);
    for (v, (a, b)) in found.poses.iter().zip(&truth.poses).enumerate() {
        let turn = (a.rotation * b.rotation.inverse()).scaled_axis();
        let shift = -(b.rotation * (centre_of(a) - centre_of(b)));
        own.fixed_rows_mut::<3>(6 * v).copy_from(&turn);
        own.fixed_rows_mut::<3>(6 * v + 3).copy_from(&shift);
    }
    let (directions, radius) = gauge(truth, 6 * views).unwrap();
    for v in 0..views {
        let mut turn = own.fixed_rows_mut::<3>(6 * v);
        turn *= radius;
    }
    let along = (directions.transpose() * &directions).try_inverse().unwrap()
        * directions.transpose()
        * &own;
    own -= directions * &along;
    let of_view = |v: usize| {
        let mut error = own.fixed_rows::<6>(6 * v).into_owned();
        let mut turn = error.fixed_rows_mut::<3>(0);
        turn /= radius;
        error
    };
    let part = |i: usize| along.fixed_rows::<3>(i).into_owned();
    let mean: Vector3 =
        truth.poses.iter().map(|p| centre_of(p).coords).sum::<Vector3>() / views as f64;
    let of_point = |(a, b): (&Point3, &Point3)| {
        let q = (b.coords - mean) / radius;
        (a - b) - (part(3) + part(0).cross(&q) + q * along[6])
    };
    let points = found.points.iter().zip(&truth.points).map(of_point).collect();
    ((0..views).map(of_view).collect(), points)
}

#[test]
fn solutions_of_noisy_sightings_spread_as_told() {
    const RUNS: u64 = 40;
    let truth = part(6, 30);
    for loss in [Loss::Squared, Loss::GemanMcClure(1.5)] {
        let options = BundleOptions { loss, cost_tolerance: 1e-9, ..Default::default() };
        let (mut turns, mut shifts, mut points) = ([0.0; 6], [0.0; 6], 0.0);
        let (mut told, mut variance) = (None, 0.0);
        for run in 0..RUNS {
            let mut bundle = noisy(&truth, run);
            adjust(&mut bundle, &options).unwrap();
            let (poses, of_points) = errors(&bundle, &truth);
            for (v, error) in poses.iter().enumerate() {
                turns[v] += error.fixed_rows::<3>(0).norm_squared() / RUNS as f64;
                shifts[v] += error.fixed_rows::<3>(3).norm_squared() / RUNS as f64;
            }
            points += of_points.iter().map(|e| e.norm_squared()).sum::<f64>() / RUNS as f64;
            let found = covariance(&bundle, &options).unwrap();
            variance += found.variance / RUNS as f64;
            told.get_or_insert(found);
        }
        let told = told.unwrap();
        // Of the first run the shape, of all the size.
        let size = (variance / told.variance).sqrt();
        let near = |found: f64, told: f64| (found.sqrt() / (size * told) - 1.0).abs() < 0.3;
        for v in 0..6 {
            assert!(near(turns[v], told.rotation_error(v)), "{loss:?} {v}: {turns:?}");
            assert!(near(shifts[v], told.centre_error(v)), "{loss:?} {v}: {shifts:?}");
        }
        let of_points = told.points.iter().map(|c| c.trace()).sum::<f64>().sqrt();
        assert!(near(points, of_points), "{loss:?}: {} {of_points}", points.sqrt());
        if loss == Loss::Squared {
            assert!((variance / 0.25 - 1.0).abs() < 0.1, "{variance}");
        }
    }
}

#[test]
fn what_the_sightings_do_not_tell_is_an_error() {
    // Two views of four points: at most 16 numbers for 12 + 12 − 7 unknowns.
    let few = part(2, 4);
    assert_eq!(covariance(&few, &BundleOptions::default()), Err(BundleError::Undetermined));
    // Two cameras in one place.
    let mut turned = part(3, 30);
    turned.poses = vec![turned.poses[0]; 3];
    assert_eq!(covariance(&turned, &BundleOptions::default()), Err(BundleError::Undetermined));
}
