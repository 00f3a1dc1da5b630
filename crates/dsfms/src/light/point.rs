//! One or several point lights around the optics.

use super::error::LightError;
use super::spot::Spot;
use super::{LightSource, Shade, near};
use crate::geometry::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// One or several equal point lights around the optics.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointLight {
    /// Positions in camera axes, length units of the template.
    pub positions: Vec<Point3>,
    /// Distance at which a fronto-parallel point on the axis has `s = 1`.
    #[serde(default = "near::reference_distance")]
    pub reference_distance: f64,
    /// Angular profile about the camera's z axis, seen from the light.
    #[serde(default)]
    pub spot: Spot,
}

impl LightSource for PointLight {
    fn shade(&self, point: &Point3, normal: &Vector3) -> Shade {
        let sources = self.positions.iter().copied();
        near::shade(sources, self.reference_distance, self.spot, point, normal)
    }

    fn centre(&self) -> Option<Point3> {
        let sum: Vector3 = self.positions.iter().map(|p| p.coords).sum();
        Some((sum / self.positions.len().max(1) as f64).into())
    }

    fn sources(&self) -> Vec<Point3> {
        self.positions.clone()
    }

    fn reference_distance(&self) -> Option<f64> {
        Some(self.reference_distance)
    }

    fn spot(&self) -> Spot {
        self.spot
    }

    fn validate(&self) -> Result<(), LightError> {
        if self.positions.is_empty() {
            return Err(LightError::NoPosition);
        }
        let infinite = |p: &Point3| p.coords.iter().any(|v| !v.is_finite());
        if let Some(i) = self.positions.iter().position(infinite) {
            return Err(LightError::Position(i));
        }
        near::validate(self.reference_distance, &self.spot)
    }

    fn describe(&self, unit: &str) -> String {
        let places: Vec<String> = self.positions.iter().map(near::place).collect();
        format!("near, at {} {unit} in camera axes; {}", places.join(", "), self.spot.describe())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn validate_names_the_field() {
        let light = |spot, reference_distance| PointLight {
            positions: vec![Point3::new(0.0, -3.0, 0.0)],
            reference_distance,
            spot,
        };
        assert!(light(Spot::Isotropic, 50.0).validate().is_ok());
        let message = light(Spot::Isotropic, f64::NAN).validate().unwrap_err().to_string();
        assert!(message.contains("reference_distance"));
        assert!(light(Spot::Linear { inner_deg: 50.0, outer_deg: 10.0 }, 1.0).validate().is_err());
        assert!(light(Spot::CosinePower { exponent: -1.0 }, 1.0).validate().is_err());
    }
}
