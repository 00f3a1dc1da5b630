//! A rod with a rounded tip, as light and camera meet it.

use crate::geometry::{Isometry, Point3, Vector3};
use crate::light::{Light, LightModel, specular_angle};

/// Radius of the shaft, mm.
const RADIUS: f64 = 2.5;

/// Length of the bright jaws before the dark shaft begins, mm.
const JAWS: f64 = 14.0;

/// A rod from its tip to where it enters.
#[derive(Clone, Copy, Debug)]
pub(super) struct Instrument {
    tip: Point3,
    /// From the tip towards the trocar, unit.
    along: Vector3,
    length: f64,
}

/// A point of its surface.
pub(super) struct InstrumentHit {
    pub point: Point3,
    normal: Vector3,
    /// Distance from the tip along the axis, mm.
    behind: f64,
}

impl Instrument {
    pub(super) fn new(tip: Point3, trocar: Point3) -> Self {
        let axis = trocar - tip;
        let length = axis.norm();
        Self { tip, along: axis / length.max(1e-9), length }
    }

    /// In other axes.
    pub(super) fn moved(&self, pose: &Isometry) -> Self {
        Self { tip: pose * self.tip, along: pose * self.along, ..*self }
    }

    /// First meeting with the ray `origin + t direction` (unit) between 0 and `limit`.
    pub(super) fn hit(
        &self,
        origin: &Point3,
        direction: &Vector3,
        limit: f64,
    ) -> Option<InstrumentHit> {
        let t = self.cylinder(origin, direction).or_else(|| self.cap(origin, direction))?;
        if !(t > 1e-6 && t < limit) {
            return None;
        }
        let point = origin + direction * t;
        let behind = (point - self.tip).dot(&self.along);
        let foot = self.tip + self.along * behind.max(0.0);
        Some(InstrumentHit { point, normal: (point - foot) / RADIUS, behind })
    }

    fn cylinder(&self, origin: &Point3, direction: &Vector3) -> Option<f64> {
        let offset = origin - self.tip;
        let across = direction - self.along * direction.dot(&self.along);
        let apart = offset - self.along * offset.dot(&self.along);
        let t = first_root(across.norm_squared(), across.dot(&apart), apart.norm_squared())?;
        let behind = (offset + direction * t).dot(&self.along);
        (0.0..=self.length).contains(&behind).then_some(t)
    }

    fn cap(&self, origin: &Point3, direction: &Vector3) -> Option<f64> {
        let offset = origin - self.tip;
        first_root(1.0, direction.dot(&offset), offset.norm_squared())
    }

    /// Whether it stands between the camera and a point.
    pub(super) fn hides(&self, point: &Point3) -> bool {
        let distance = point.coords.norm();
        self.hit(&Point3::origin(), &(point.coords / distance), distance).is_some()
    }

    /// Whether it stands between two points.
    pub(super) fn between(&self, from: &Point3, to: &Point3) -> bool {
        let way = to - from;
        let distance = way.norm();
        self.hit(from, &(way / distance), distance).is_some()
    }
}

/// Smaller `t` of `a t² + 2 b t + c = r²`.
fn first_root(a: f64, b: f64, c: f64) -> Option<f64> {
    let discriminant = b * b - a * (c - RADIUS * RADIUS);
    (a > 1e-12 && discriminant >= 0.0).then(|| (-b - discriminant.sqrt()) / a)
}

impl InstrumentHit {
    /// Brightness of the metal, linear, before exposure: bright jaws, dark shaft, a hard highlight.
    pub(super) fn brightness(&self, light: &LightModel) -> [f64; 3] {
        let jaws = self.behind < JAWS;
        let base = if jaws { [0.42, 0.42, 0.44] } else { [0.06, 0.06, 0.065] };
        let shade = light.shade(&self.point, &self.normal).value;
        let angle = specular_angle(light, &self.point, &self.normal);
        let glint = 1.6 * (-0.5 * (angle / 0.10).powi(2)).exp()
            + 0.12 * (-0.5 * (angle / 0.45).powi(2)).exp();
        // Slots of the jaws and the seam where the shaft begins.
        let slot = jaws && (self.behind % 1.6) < 0.35 || (self.behind - JAWS).abs() < 0.4;
        let dim = if slot { 0.45 } else { 1.0 };
        base.map(|b| dim * (b * shade + glint * shade.min(1.5)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rod_across_the_axis_is_met_at_its_near_side() {
        let rod = Instrument::new(Point3::new(-10.0, 0.0, 50.0), Point3::new(40.0, 0.0, 50.0));
        let hit = rod.hit(&Point3::origin(), &Vector3::z(), 1e3).unwrap();
        assert!((hit.point.z - 47.5).abs() < 1e-12 && (hit.behind - 10.0).abs() < 1e-12);
        assert!((hit.normal + Vector3::z()).norm() < 1e-12, "towards the camera");
        assert!(
            rod.hides(&Point3::new(0.0, 0.0, 60.0)) && !rod.hides(&Point3::new(0.0, 0.0, 40.0))
        );
        // The sightline to x = -15 passes the tip at 2.4 mm, within its radius; that to -16 at 3.2.
        assert!(rod.hides(&Point3::new(-15.0, 0.0, 60.0)));
        assert!(!rod.hides(&Point3::new(-16.0, 0.0, 60.0)));
        assert!(rod.between(&Point3::new(5.0, 0.0, 60.0), &Point3::new(5.0, 0.0, 0.0)));
    }
}
