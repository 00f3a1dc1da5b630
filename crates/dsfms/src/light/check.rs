//! The check every light passes: both derivatives against central differences.

use super::coat::{Coat, Coated, WET_TISSUE};
use super::model::LightModel;
use super::point::PointLight;
use super::ring::RingLight;
use super::spot::Spot;
use super::{Light, specular_angle};
use crate::geometry::{Point3, Vector3};

const WET: Coat = Coat { refractive_index: WET_TISSUE, ambient: 0.05, vignetting: 0.0 };
const DARK_CORNERS: Coat = Coat { vignetting: -0.7, ..WET };

/// `d_normal` and `d_point` at scattered points with scattered normals, and darkness behind.
fn check_light(light: &impl Light) {
    for i in 0..40 {
        let t = i as f64;
        let point = Point3::new(
            20.0 * (1.7 * t).sin(),
            15.0 * (2.3 * t).cos(),
            60.0 + 20.0 * (0.9 * t).sin(),
        );
        let tilt = Vector3::new(0.5 * (3.1 * t).cos(), 0.5 * (1.3 * t).sin(), -1.0);
        let normal = tilt.normalize();
        check_derivatives(light, &point, &normal);
        assert_eq!(light.shade(&point, &Vector3::z()), super::Shade::default());
        let mirror = light.mirror_normal(&point);
        assert!((mirror.norm() - 1.0).abs() < 1e-12 && mirror.z < 0.0);
        assert!(specular_angle(light, &point, &mirror) < 1e-12);
    }
}

fn check_derivatives(light: &impl Light, point: &Point3, normal: &Vector3) {
    let shade = light.shade(point, normal);
    let h = 1e-5;
    for axis in 0..3 {
        let mut d = Vector3::zeros();
        d[axis] = h;
        let along = |a: f64| light.shade(point, &(normal + d * a)).value;
        let numeric = (along(1.0) - along(-1.0)) / (2.0 * h);
        assert!((shade.d_normal[axis] - numeric).abs() < 1e-8, "normal, axis {axis}");
        let along = |a: f64| light.shade(&(point + d * a), normal).value;
        let numeric = (along(1.0) - along(-1.0)) / (2.0 * h);
        assert!((shade.d_point[axis] - numeric).abs() < 1e-8, "point, axis {axis}");
    }
}

fn point_light(spot: Spot, positions: &[[f64; 3]]) -> LightModel {
    let positions = positions.iter().map(|&p| Point3::from(p)).collect();
    LightModel::Point(PointLight { positions, reference_distance: 50.0, spot })
}

#[test]
fn every_light_passes() {
    check_light(&LightModel::Collinear);
    check_light(&Coated { light: LightModel::Collinear, coat: WET });
    let several = [[0.0, -3.0, 0.0], [2.6, 1.5, 0.0], [-2.6, 1.5, -1.0]];
    for spot in [
        Spot::Isotropic,
        Spot::Linear { inner_deg: 10.0, outer_deg: 52.0 },
        Spot::CosinePower { exponent: 1.5 },
    ] {
        let ring = RingLight {
            radius: 4.0,
            centre: [0.5, -1.0, 0.0].into(),
            reference_distance: 50.0,
            spot,
        };
        for light in [point_light(spot, &several[..1]), point_light(spot, &several), ring.into()] {
            light.validate().unwrap();
            check_light(&light);
            check_light(&Coated { light: light.clone(), coat: WET });
            check_light(&Coated { light, coat: DARK_CORNERS });
        }
    }
}

#[test]
fn a_light_is_told_in_words() {
    let text = point_light(Spot::Linear { inner_deg: 10.0, outer_deg: 52.0 }, &[[0.0, -3.0, 0.0]])
        .describe("mm");
    assert!(text.starts_with("near, at (0.00, -3.00, 0.00) mm") && text.contains("52.0 deg"));
    assert!(LightModel::Collinear.describe("mm").contains("distant"));
}

/// What others ask of a light agrees with itself.
#[test]
fn a_light_tells_where_it_is() {
    let several = [[0.0, -3.0, 0.0], [2.6, 1.5, 0.0], [-2.6, 1.5, -1.0]];
    let ring = RingLight {
        radius: 4.0,
        centre: [0.5, -1.0, 0.0].into(),
        reference_distance: 50.0,
        spot: Spot::CosinePower { exponent: 2.0 },
    };
    for light in [point_light(Spot::Isotropic, &several), ring.into(), LightModel::Collinear] {
        let sources = light.sources();
        assert_eq!(light.tells_distance(), light.centre().is_some());
        assert_eq!(light.tells_distance(), !sources.is_empty());
        if let Some(centre) = light.centre() {
            let sum: Vector3 = sources.iter().map(|p| p.coords).sum();
            assert!((sum / sources.len() as f64 - centre.coords).norm() < 1e-12);
        }
        let moved = light.at_camera();
        assert_eq!(moved.spot(), light.spot());
        assert_eq!(moved.reference_distance(), light.reference_distance());
        assert!(moved.centre().is_none_or(|c| c == Point3::origin()));
        // The share of each source of what a point gets.
        let (near, far) = (Point3::new(3.0, 2.0, 50.0), Point3::new(6.0, 4.0, 100.0));
        let falls =
            light.shade(&near, &-Vector3::z()).value > light.shade(&far, &-Vector3::z()).value;
        assert_eq!(falls, light.tells_distance());
    }
}

/// Edge-on there is neither light nor slope, as behind.
#[test]
fn edge_on_is_dark() {
    let light = point_light(Spot::Isotropic, &[[0.0; 3]]);
    let shade = light.shade(&Point3::new(0.0, 0.0, 50.0), &Vector3::x());
    assert_eq!(shade, super::Shade::default());
}

#[test]
fn unit_shading_at_the_reference_distance() {
    let light = point_light(Spot::Linear { inner_deg: 10.0, outer_deg: 52.0 }, &[[0.0; 3]]);
    let at = |z| light.shade(&Point3::new(0.0, 0.0, z), &-Vector3::z()).value;
    assert!((at(50.0) - 1.0).abs() < 1e-12);
    assert!((at(100.0) - 0.25).abs() < 1e-12);
}

#[test]
fn the_mirror_of_a_light_at_the_camera_is_the_sightline() {
    let point = Point3::new(10.0, -5.0, 60.0);
    let light = point_light(Spot::Isotropic, &[[0.0; 3]]);
    assert!((light.mirror_normal(&point) + point.coords.normalize()).norm() < 1e-12);
    // A collinear light halves the angle between the sightline and the axis.
    let half = specular_angle(&LightModel::Collinear, &point, &-Vector3::z());
    let sight = (125_f64.sqrt() / 60.0).atan();
    assert!((half - 0.5 * sight).abs() < 1e-12);
}
