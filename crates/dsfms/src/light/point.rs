//! Near light: inverse-square fall-off and a spot profile about the camera's z axis,
//!
//! ```text
//! s = mean over lights of  max(0, −N·l) · (D0/r)² · spot(φ),   l = (x − p_L)/r,   cos φ = l_z
//! ```

use super::{PointLight, Shade};
use crate::geometry::{Point3, Vector3};

/// Shading of one surface point: the mean over the light's positions.
pub fn shade(light: &PointLight, point: &Point3, normal: &Vector3) -> Shade {
    let mut sum = Shade::default();
    for position in &light.positions {
        let one = shade_one(light, &(point - position), normal);
        sum.value += one.value;
        sum.d_normal += one.d_normal;
        sum.d_point += one.d_point;
    }
    let share = 1.0 / light.positions.len().max(1) as f64;
    Shade { value: sum.value * share, d_normal: sum.d_normal * share, d_point: sum.d_point * share }
}

/// One position, seen along `q = x − p_L`: `s = D0² · (−N·q) · r⁻³ · spot(φ)`.
fn shade_one(light: &PointLight, q: &Vector3, normal: &Vector3) -> Shade {
    let facing = -normal.dot(q);
    let r2 = q.norm_squared();
    // Facing away, or a point in the light itself.
    if !(facing > 0.0 && r2 > 0.0) {
        return Shade::default();
    }
    let rho = (q.x * q.x + q.y * q.y).sqrt();
    let (spot, slope) = light.spot.profile(rho.atan2(q.z));
    let falloff = light.reference_distance.powi(2) / (r2 * r2.sqrt());
    let value = facing * falloff * spot;
    // φ = atan2(ρ, z); on the axis its derivative has no direction and the profile no slope.
    let d_angle = if rho > 1e-12 * q.z.abs() {
        Vector3::new(q.x * q.z / rho, q.y * q.z / rho, -rho) / r2
    } else {
        Vector3::zeros()
    };
    Shade {
        value,
        d_normal: -q * (falloff * spot),
        d_point: -normal * (falloff * spot) - q * (3.0 * value / r2)
            + d_angle * (facing * falloff * slope),
    }
}

/// Half vector between the directions to the camera centre and to the mean light position.
pub fn mirror_normal(light: &PointLight, point: &Point3) -> Vector3 {
    let to_camera = -point.coords.normalize();
    let to_light = (light.mean_position() - point).normalize();
    (to_camera + to_light).normalize()
}
