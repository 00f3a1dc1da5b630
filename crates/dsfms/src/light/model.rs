//! The lights a camera file can name.

use super::{Light, Shade, collinear, point};
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

impl Spot {
    /// Relative intensity at an angle from the axis (rad, `[0, π]`) and its derivative per rad.
    /// Within the kinks of [`Spot::Linear`] the derivative is that of the inner side.
    pub fn profile(&self, angle: f64) -> (f64, f64) {
        match *self {
            Self::Isotropic => (1.0, 0.0),
            Self::Linear { inner_deg, outer_deg } => {
                let (inner, outer) = (inner_deg.to_radians(), outer_deg.to_radians());
                let slope = -1.0 / (outer - inner);
                if angle <= inner {
                    (1.0, 0.0)
                } else if angle <= outer {
                    (slope * (angle - outer), slope)
                } else {
                    (0.0, 0.0)
                }
            }
            Self::CosinePower { exponent: 0.0 } => (1.0, 0.0),
            Self::CosinePower { exponent } => {
                let cos = angle.cos();
                if cos <= 0.0 {
                    return (0.0, 0.0);
                }
                let power = cos.powf(exponent - 1.0);
                (power * cos, -exponent * power * angle.sin())
            }
        }
    }

    fn validate(&self) -> Result<(), LightError> {
        match *self {
            Self::Linear { inner_deg, outer_deg }
                if !(0.0 <= inner_deg && inner_deg < outer_deg && outer_deg <= 180.0) =>
            {
                Err(LightError::Spot { inner_deg, outer_deg })
            }
            Self::CosinePower { exponent } if !(exponent >= 0.0 && exponent.is_finite()) => {
                Err(LightError::Exponent(exponent))
            }
            _ => Ok(()),
        }
    }
}

/// What makes a light unusable.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LightError {
    /// A point light that is nowhere.
    #[error("light.positions is empty; a point light needs at least one [x, y, z] in camera axes")]
    NoPosition,
    /// NaN or infinite coordinate.
    #[error("light.positions[{0}] holds a number that is not finite")]
    Position(usize),
    /// Not positive.
    #[error("light.reference_distance is {0}; it must be positive")]
    ReferenceDistance(f64),
    /// Angles out of order.
    #[error(
        "light.spot runs from {inner_deg} to {outer_deg} degrees; expected 0 <= inner < outer <= 180"
    )]
    Spot {
        /// Where full light ends.
        inner_deg: f64,
        /// Where the light ends.
        outer_deg: f64,
    },
    /// Negative or not finite.
    #[error("light.spot exponent is {0}; it must not be negative")]
    Exponent(f64),
}

impl PointLight {
    /// Mean of the positions, camera axes.
    pub fn mean_position(&self) -> Point3 {
        let sum: Vector3 = self.positions.iter().map(|p| p.coords).sum();
        (sum / self.positions.len().max(1) as f64).into()
    }
}

impl LightModel {
    /// Check every number.
    pub fn validate(&self) -> Result<(), LightError> {
        let Self::Point(light) = self else { return Ok(()) };
        if light.positions.is_empty() {
            return Err(LightError::NoPosition);
        }
        let infinite = |p: &Point3| p.coords.iter().any(|v| !v.is_finite());
        if let Some(i) = light.positions.iter().position(infinite) {
            return Err(LightError::Position(i));
        }
        if !(light.reference_distance > 0.0 && light.reference_distance.is_finite()) {
            return Err(LightError::ReferenceDistance(light.reference_distance));
        }
        light.spot.validate()
    }
}

impl Light for LightModel {
    fn shade(&self, point: &Point3, normal: &Vector3) -> Shade {
        match self {
            Self::Collinear => collinear::shade(normal),
            Self::Point(light) => point::shade(light, point, normal),
        }
    }

    fn mirror_normal(&self, point: &Point3) -> Vector3 {
        match self {
            Self::Collinear => collinear::mirror_normal(point),
            Self::Point(light) => point::mirror_normal(light, point),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_spot_by_hand() {
        let spot = Spot::Linear { inner_deg: 10.0, outer_deg: 52.0 };
        assert_eq!(spot.profile(0.0), (1.0, 0.0));
        let (value, slope) = spot.profile(31_f64.to_radians());
        assert!((value - 0.5).abs() < 1e-12);
        assert!((slope + 1.0 / 42_f64.to_radians()).abs() < 1e-12);
        assert_eq!(spot.profile(1.0).0, 0.0);
    }

    #[test]
    fn validate_names_the_field() {
        let light = |spot, distance| {
            LightModel::Point(PointLight {
                positions: vec![Point3::new(0.0, -3.0, 0.0)],
                reference_distance: distance,
                spot,
            })
        };
        assert!(light(Spot::Isotropic, 50.0).validate().is_ok());
        let message = light(Spot::Isotropic, f64::NAN).validate().unwrap_err().to_string();
        assert!(message.contains("reference_distance"));
        assert!(light(Spot::Linear { inner_deg: 50.0, outer_deg: 10.0 }, 1.0).validate().is_err());
        assert!(light(Spot::CosinePower { exponent: -1.0 }, 1.0).validate().is_err());
    }
}
