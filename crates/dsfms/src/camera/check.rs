//! The check every camera model passes: round trip, and the Jacobian against central differences.

use super::{Camera, CameraModel, Lens};
use crate::geometry::{Point2, Point3, Vector3};

/// `project ∘ unproject = id` over the image wherever there is a sightline, and `∂pixel/∂point`
/// against central differences at several depths. Returns the fraction of pixels with a sightline.
fn check_camera(camera: &CameraModel) -> f64 {
    camera.validate().unwrap();
    let [w, h] = camera.size.map(|n| n as f64 - 1.0);
    let grid = 24;
    let mut seen = 0;
    for i in 0..=grid {
        for j in 0..=grid {
            let pixel = Point2::new(w * i as f64 / grid as f64, h * j as f64 / grid as f64);
            let Some(ray) = camera.unproject(&pixel) else { continue };
            seen += 1;
            assert!((ray.norm() - 1.0).abs() < 1e-12);
            for depth in [3.0, 75.0] {
                check_point(camera, &Point3::from(ray * depth), &pixel);
            }
        }
    }
    seen as f64 / ((grid + 1) * (grid + 1)) as f64
}

fn check_point(camera: &CameraModel, point: &Point3, pixel: &Point2) {
    let projection = camera.project(point).unwrap();
    assert!((projection.pixel - pixel).norm() < 1e-6, "round trip at {pixel}");
    let step = 1e-5 * point.coords.norm();
    let scale = camera.focal[0] / point.coords.norm();
    for axis in 0..3 {
        let mut d = Vector3::zeros();
        d[axis] = step;
        let ends = (camera.project(&(point + d)), camera.project(&(point - d)));
        let (Some(a), Some(b)) = ends else { continue };
        let numeric = (a.pixel - b.pixel) / (2.0 * step);
        let error = (projection.jacobian.column(axis) - numeric).norm();
        let size = scale.max(projection.jacobian.column(axis).norm());
        assert!(error < 1e-5 * size, "axis {axis} at {pixel}: {error}, scale {size}");
    }
}

fn laparoscope(lens: Lens) -> CameraModel {
    CameraModel { size: [1920, 1080], focal: [952.0, 955.0], centre: [958.3, 541.2], lens }
}

#[test]
fn pinhole() {
    assert_eq!(check_camera(&laparoscope(Lens::Pinhole)), 1.0);
}

#[test]
fn brown_conrady() {
    let mild = Lens::BrownConrady { k: [-0.2, 0.05, 0.0], p: [0.003, -0.002] };
    assert_eq!(check_camera(&laparoscope(mild)), 1.0);
    // Calibrated on a laparoscope whose image circle does not reach the corners: the polynomial
    // turns at r = 1.06, and the corners have no sightline.
    let strong = Lens::BrownConrady { k: [-0.2318, 0.3405, -0.2386], p: [0.0; 2] };
    let seen = check_camera(&laparoscope(strong));
    assert!((0.75..0.95).contains(&seen), "{seen}");
}

#[test]
fn kannala_brandt() {
    // 160 degrees across the width: θ = 80° = 1.396 rad at 960 px.
    let lens = Lens::KannalaBrandt { k: [-0.02, 0.004, -0.001, 0.0001] };
    let camera = CameraModel { focal: [700.0, 700.0], ..laparoscope(lens) };
    assert!(check_camera(&camera) > 0.85);
    let edge = Vector3::new(80_f64.to_radians().sin(), 0.0, 80_f64.to_radians().cos());
    check_point(&camera, &Point3::from(edge), &camera.project(&Point3::from(edge)).unwrap().pixel);
}

#[test]
fn rational() {
    // cv2.calibrateCamera with CALIB_RATIONAL_MODEL gives pairs of large coefficients that nearly
    // cancel.
    let lens = Lens::Rational { k: [4.21, 1.6, 0.1, 4.4, 2.2, 0.15], p: [0.0011, -0.0007] };
    assert_eq!(check_camera(&laparoscope(lens)), 1.0);
}

/// `∂(x_d, y_d)/∂(k1, k2)` of every lens against central differences.
#[test]
fn radial_derivatives() {
    let point = crate::geometry::Vector2::new(0.4, -0.3);
    for kind in Lens::KINDS {
        let named = ["k1", "k2", "k3", "k4", "p1", "p2"].map(|name| (name, 0.02));
        let lens = kind.named_coefficients(&named);
        let analytic = lens.radial_derivatives(&point);
        for (n, analytic) in analytic.iter().enumerate() {
            let at = |h: f64| {
                let step = [0, 1].map(|i| if i == n { h } else { 0.0 });
                lens.radial_moved(step).distort(&point).unwrap().value
            };
            let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((numeric - analytic).norm() < 1e-9, "{}, k{}", kind.name, n + 1);
        }
    }
}

#[test]
fn behind_the_camera_is_refused() {
    let camera = laparoscope(Lens::Pinhole);
    assert!(camera.project(&Point3::new(1.0, 1.0, 0.0)).is_none());
    assert!(camera.project(&Point3::new(1.0, 1.0, -5.0)).is_none());
    assert!(camera.project(&Point3::new(f64::NAN, 1.0, 5.0)).is_none());
}
