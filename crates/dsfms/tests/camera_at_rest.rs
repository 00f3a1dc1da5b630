//! Tissue that stretches before a camera at rest.

use dsfms::camera::CameraModel;
use dsfms::geometry::{Isometry, Point3, Vector3};
use dsfms::register::{
    CameraMotion, Match, RegisterOptions, Scene, pose, posed_from, register,
};
use dsfms::synth::{Draw, Patch, Random, correspond, patch};

/// Where the camera stands.
fn view() -> Isometry {
    Isometry::new(Vector3::new(2.0, -1.0, 70.0), Vector3::new(0.15, -0.2, 0.05))
}

/// The organ stretched by 3 % from `fixed` (x, mm) on, as far as it goes, and lifted a little.
fn beat(organ: &Patch, fixed: f64) -> Vec<Point3> {
    let at = |p: &Point3| {
        let (x, y) = ((p.x - fixed).max(0.0), p.y);
        let grown = Vector3::new(0.03 * x, if x > 0.0 { 0.03 * y } else { 0.0 }, 0.0);
        let lift = 0.6 * (-(p.x - 10.0).powi(2) / 150.0 - p.y * p.y / 150.0).exp();
        view() * (p + grown - Vector3::z() * lift)
    };
    organ.mesh.positions.iter().map(at).collect()
}

#[test]
fn stretch() {
    let camera = CameraModel::pinhole([640, 480], [600.0; 2], [319.5, 239.5]);
    let organ = patch(600, 3);
    let rest = &organ.mesh;
    for fixed in [-40.0, -10.0, 0.0] {
        let truth = beat(&organ, fixed);
        let draw = Draw { count: 120, sigma_px: 0.5 };
        let anywhere = vec![true; truth.len()];
        let matches: Vec<Match> =
            correspond(&camera, rest, &truth, &anywhere, draw, &mut Random::new(1, 2));
        let error = |shape: &[Point3]| {
            let off: f64 = shape.iter().zip(&truth).map(|(a, b)| (a - b).norm()).sum();
            let deep: f64 = shape.iter().zip(&truth).map(|(a, b)| (a - b).z.abs()).sum();
            [off / truth.len() as f64, deep / truth.len() as f64]
        };
        let still: Vec<Point3> = rest.positions.iter().map(|p| view() * p).collect();
        println!("fixed {fixed}: nothing {:?}", error(&still));
        for motion in [CameraMotion::Moving, CameraMotion::AtRest, CameraMotion::Auto] {
            let options = RegisterOptions { camera_motion: motion, ..RegisterOptions::default() };
            let found = pose(&camera, rest, &matches, &options, 0).unwrap();
            println!("   shared {}", found.shared_motion_px);
            let posed = posed_from(&[view()], &camera, rest, &matches, found, &options).unwrap();
            let rigid: Vec<Point3> = rest.positions.iter().map(|p| posed.pose * p).collect();
            let scene = Scene::new(&camera, rest, rigid.clone());
            let shape = register(&scene, &matches, &posed, &options).vertices;
            println!("  {motion:?} at rest {} rigid {:?} eq. 3 {:?} shared {}", posed.at_rest, error(&rigid), error(&shape), posed.shared_motion_px);
        }
    }
}
