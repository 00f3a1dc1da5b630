//! A ring light: rays from a circle around the lens, square to the optical axis.
//!
//! The mean over the circle is taken at [`SOURCES`] places; for a ring smaller than half the
//! distance of the surface that is exact to 1e-9, since the trapezoidal rule on a circle converges
//! exponentially.

use super::error::LightError;
use super::spot::Spot;
use super::{LightSource, Shade, near};
use crate::geometry::{Point3, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_1_SQRT_2;

/// Places on the circle that stand for all of it.
const SOURCES: usize = 16;

/// Cosines of the first quarter of their angles, `kπ/8`.
const COSINES: [f64; 4] = [1.0, 0.923_879_532_511_286_7, FRAC_1_SQRT_2, 0.382_683_432_365_089_8];

/// A circle of light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RingLight {
    /// Radius of the circle, length units of the template; 0 is a point.
    pub radius: f64,
    /// Its centre in camera axes.
    #[serde(default = "Point3::origin")]
    pub centre: Point3,
    /// Distance from its rays at which a surface square to them has `s = 1`.
    #[serde(default = "near::reference_distance")]
    pub reference_distance: f64,
    /// Angular profile about the camera's z axis, seen from every place of the ring.
    #[serde(default)]
    pub spot: Spot,
}

impl RingLight {
    fn places(&self) -> impl ExactSizeIterator<Item = Point3> {
        (0..SOURCES).map(|i| {
            let (c, s) = (COSINES[i % 4], if i % 4 == 0 { 0.0 } else { COSINES[4 - i % 4] });
            let [x, y] = [[c, s], [-s, c], [-c, -s], [s, -c]][i / 4];
            self.centre + self.radius * Vector3::new(x, y, 0.0)
        })
    }
}

impl LightSource for RingLight {
    fn shade(&self, point: &Point3, normal: &Vector3) -> Shade {
        near::shade(self.places(), self.reference_distance, self.spot, point, normal)
    }

    fn centre(&self) -> Option<Point3> {
        Some(self.centre)
    }

    fn sources(&self) -> Vec<Point3> {
        self.places().collect()
    }

    fn reference_distance(&self) -> Option<f64> {
        Some(self.reference_distance)
    }

    fn spot(&self) -> Spot {
        self.spot
    }

    fn validate(&self) -> Result<(), LightError> {
        if !(self.radius >= 0.0 && self.radius.is_finite()) {
            return Err(LightError::Radius(self.radius));
        }
        if self.centre.coords.iter().any(|v| !v.is_finite()) {
            return Err(LightError::Centre);
        }
        near::validate(self.reference_distance, &self.spot)
    }

    fn describe(&self, unit: &str) -> String {
        format!(
            "near, a ring of radius {:.2} {unit} about {} {unit} in camera axes; {}",
            self.radius,
            near::place(&self.centre),
            self.spot.describe()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ring(radius: f64) -> RingLight {
        let (centre, spot) = (Point3::origin(), Spot::Isotropic);
        RingLight { radius, centre, reference_distance: 50.0, spot }
    }

    #[test]
    fn on_the_axis_by_hand() {
        // Every place is √(3² + 4²) = 5 away, and cos = 4/5.
        let shade = ring(3.0).shade(&Point3::new(0.0, 0.0, 4.0), &-Vector3::z());
        assert!((shade.value - 0.8 * 100.0).abs() < 1e-11);
        assert!(shade.d_point.xy().norm() < 1e-11);
    }

    #[test]
    fn sixteen_places_are_a_circle() {
        // Beside the axis, tilted, against 720 places.
        let (point, normal) =
            (Point3::new(12.0, -7.0, 40.0), Vector3::new(0.3, 0.2, -1.0).normalize());
        let light = ring(10.0);
        let places = (0..720).map(|i| {
            let (s, c) = f64::to_radians(0.5 * i as f64).sin_cos();
            Point3::new(10.0 * c, 10.0 * s, 0.0)
        });
        let places: Vec<_> = places.collect();
        let exact = near::shade(places.into_iter(), 50.0, Spot::Isotropic, &point, &normal);
        let found = light.shade(&point, &normal);
        assert!((found.value - exact.value).abs() < 1e-9, "{}", found.value - exact.value);
        assert!((found.d_point - exact.d_point).norm() < 1e-9);
    }

    #[test]
    fn a_ring_without_radius_is_a_point() {
        let (point, normal) =
            (Point3::new(12.0, -7.0, 40.0), Vector3::new(0.3, 0.2, -1.0).normalize());
        let near =
            near::shade([Point3::origin()].into_iter(), 50.0, Spot::Isotropic, &point, &normal);
        assert!((ring(0.0).shade(&point, &normal).value - near.value).abs() < 1e-15);
    }
}
