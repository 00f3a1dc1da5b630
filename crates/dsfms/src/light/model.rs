//! The lights a camera file can name.

use super::{Light, Shade};
use crate::geometry::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// A light rigidly mounted on the camera.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LightModel {
    /// Distant and along the optical axis (the paper): `s = −N_z`.
    #[default]
    Collinear,
    /// Near, with inverse-square fall-off and a spot profile.
    Point(PointLight),
}

/// One or several equal point lights around the optics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointLight {
    /// Positions in camera axes, length units of the template.
    pub positions: Vec<Point3>,
    /// Distance at which a fronto-parallel point on the axis has `s = 1`.
    pub reference_distance: f64,
    /// Angular profile about the camera's z axis, seen from the light.
    pub spot: Spot,
}

/// Angular profile of a light about its axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Spot {
    /// The same in every direction.
    #[default]
    Isotropic,
    /// 1 inside `inner_deg`, falling linearly with the angle to 0 at `outer_deg`.
    Linear {
        /// Half angle of full light, degrees.
        inner_deg: f64,
        /// Half angle where the light ends, degrees.
        outer_deg: f64,
    },
    /// `cosⁿ` of the angle.
    CosinePower {
        /// The exponent n.
        exponent: f64,
    },
}

impl Light for LightModel {
    fn shade(&self, _point: &Point3, normal: &Vector3) -> Shade {
        Shade { value: (-normal.z).max(0.0), d_normal: -Vector3::z(), d_point: Vector3::zeros() }
    }

    fn mirror_normal(&self, _point: &Point3) -> Vector3 {
        -Vector3::z()
    }
}
