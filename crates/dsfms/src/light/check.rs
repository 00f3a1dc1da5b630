//! The check every light passes: both derivatives against central differences.

use super::coat::WET_TISSUE;
use super::{Coat, Coated, Light, LightModel, PointLight, Spot, specular_angle};
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
    let ring = [[0.0, -3.0, 0.0], [2.6, 1.5, 0.0], [-2.6, 1.5, -1.0]];
    for spot in [
        Spot::Isotropic,
        Spot::Linear { inner_deg: 10.0, outer_deg: 52.0 },
        Spot::CosinePower { exponent: 1.5 },
    ] {
        for positions in [&ring[..1], &ring] {
            let light = point_light(spot, positions);
            light.validate().unwrap();
            check_light(&light);
            check_light(&Coated { light: light.clone(), coat: WET });
            check_light(&Coated { light, coat: DARK_CORNERS });
        }
    }
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
