//! The cosine of an angle of incidence.

use crate::geometry::{Point3, Vector3};

/// Cosine between a unit normal and a direction from the surface, with its derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cosine {
    /// The cosine; negative where the surface faces away.
    pub value: f64,
    /// By the normal, taken as a free vector.
    pub d_normal: Vector3,
    /// By the point, per length unit.
    pub d_point: Vector3,
}

impl Cosine {
    pub(super) fn along(direction: Vector3, normal: &Vector3) -> Self {
        Self { value: normal.dot(&direction), d_normal: direction, d_point: Vector3::zeros() }
    }

    pub(super) fn towards(place: &Point3, point: &Point3, normal: &Vector3) -> Self {
        let way = place - point;
        let distance = way.norm().max(f64::MIN_POSITIVE);
        let direction = way / distance;
        let value = normal.dot(&direction);
        let d_point = (direction * value - normal) / distance;
        Self { value, d_normal: direction, d_point }
    }
}
