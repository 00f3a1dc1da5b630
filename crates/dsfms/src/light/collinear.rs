//! The paper's light: distant, along the optical axis, `s = −N_z`.

use super::Shade;
use crate::geometry::{Point3, Vector3};

/// `s = max(0, −N_z)`; it does not depend on the point.
pub fn shade(normal: &Vector3) -> Shade {
    if normal.z >= 0.0 {
        return Shade::default();
    }
    Shade { value: -normal.z, d_normal: -Vector3::z(), d_point: Vector3::zeros() }
}

/// Half vector between the directions to the camera centre and to a light infinitely far behind
/// the camera (`−z`).
pub fn mirror_normal(point: &Point3) -> Vector3 {
    (-point.coords.normalize() - Vector3::z()).normalize()
}
