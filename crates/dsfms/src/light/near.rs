//! What near lights share: inverse-square fall-off and a spot profile about the camera's z axis,
//!
//! ```text
//! s = mean over sources of  max(0, −N·l) · (D0/r)² · spot(φ),   l = (x − p)/r,   cos φ = l_z
//! ```

use super::Shade;
use super::error::LightError;
use super::spot::Spot;
use crate::geometry::{Point3, Vector3};

/// Reference distance of a near light whose file gives none: 50 length units, a usual working
/// distance of a laparoscope in mm. It scales all shading alike, and so is absorbed by the gain.
pub const REFERENCE_DISTANCE: f64 = 50.0;

/// So that files may leave it out.
pub(super) fn reference_distance() -> f64 {
    REFERENCE_DISTANCE
}

/// Mean shading of a surface point by equal point sources; `distance`: D0.
pub(super) fn shade(
    sources: impl ExactSizeIterator<Item = Point3>,
    distance: f64,
    spot: Spot,
    point: &Point3,
    normal: &Vector3,
) -> Shade {
    let share = 1.0 / sources.len().max(1) as f64;
    let mut sum = Shade::default();
    for source in sources {
        let one = shade_one(distance, spot, &(point - source), normal);
        sum.value += one.value;
        sum.d_normal += one.d_normal;
        sum.d_point += one.d_point;
    }
    Shade { value: sum.value * share, d_normal: sum.d_normal * share, d_point: sum.d_point * share }
}

/// One source, seen along `q = x − p`: `s = D0² · (−N·q) · r⁻³ · spot(φ)`.
fn shade_one(distance: f64, spot: Spot, q: &Vector3, normal: &Vector3) -> Shade {
    let facing = -normal.dot(q);
    let r2 = q.norm_squared();
    // Facing away, or a point in the light itself.
    if !(facing > 0.0 && r2 > 0.0) {
        return Shade::default();
    }
    let rho = (q.x * q.x + q.y * q.y).sqrt();
    let (spot, slope) = spot.profile(rho.atan2(q.z));
    let falloff = distance.powi(2) / (r2 * r2.sqrt());
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

/// Check what every near light has.
pub(super) fn validate(distance: f64, spot: &Spot) -> Result<(), LightError> {
    if !(distance > 0.0 && distance.is_finite()) {
        return Err(LightError::ReferenceDistance(distance));
    }
    spot.validate()
}

/// A place in words.
pub(super) fn place(p: &Point3) -> String {
    format!("({:.2}, {:.2}, {:.2})", p.x, p.y, p.z)
}
