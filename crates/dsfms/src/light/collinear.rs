//! The paper's light: distant, along the optical axis, `s = max(0, −N_z)`; it does not depend on
//! the point.

use super::error::LightError;
use super::{LightSource, Shade};
use crate::geometry::{Point3, Vector3};

/// The light of the paper; nothing about it is free.
pub(super) struct Collinear;

impl LightSource for Collinear {
    fn shade(&self, _: &Point3, normal: &Vector3) -> Shade {
        if normal.z >= 0.0 {
            return Shade::default();
        }
        Shade { value: -normal.z, d_normal: -Vector3::z(), d_point: Vector3::zeros() }
    }

    fn validate(&self) -> Result<(), LightError> {
        Ok(())
    }

    fn describe(&self, _: &str) -> String {
        "distant, along the optical axis".into()
    }
}
