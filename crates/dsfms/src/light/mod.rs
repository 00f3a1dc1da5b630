//! Lights rigidly mounted on the laparoscope: how much light a surface point gets, and where a
//! highlight sits.
//!
//! Albedo, the diffuse and specular terms and the renderer all go through [`Light`], so synthetic
//! images and the energy cannot disagree about the physics.

use crate::geometry::{GRAIN, Point3, Vector3};
use rayon::prelude::*;

/// Diffuse shading `s` of one surface point and its derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shade {
    /// `s ≥ 0`: irradiance over that of a fronto-parallel point at the reference distance on the
    /// axis (the paper's `L·N`); 0 where the surface faces away.
    pub value: f64,
    /// `∂s/∂normal` (the normal taken as a free vector, not projected to the sphere).
    pub d_normal: Vector3,
    /// `∂s/∂point`, per length unit.
    pub d_point: Vector3,
}

/// What every light can do. Points and normals are in camera axes; outward unit normals point
/// towards the camera where the surface is visible (`N·z < 0`).
pub trait Light: Send + Sync {
    /// Diffuse shading of a point.
    fn shade(&self, point: &Point3, normal: &Vector3) -> Shade;
    /// Unit normal that a perfect mirror at `point` needs to send the light into the camera:
    /// the half vector between the directions to the camera and to the light.
    fn mirror_normal(&self, point: &Point3) -> Vector3;
}

/// What a kind of light says of itself; everything else follows from it ([`LightModel`]).
///
/// A new kind is a struct with this trait in a file of its own, and its line in the table of
/// `model.rs`.
pub(crate) trait LightSource: Send + Sync {
    /// Diffuse shading of a point, in camera axes.
    fn shade(&self, point: &Point3, normal: &Vector3) -> Shade;
    /// Mean of where its rays come from, camera axes; `None` for a distant light along the optical
    /// axis.
    fn centre(&self) -> Option<Point3> {
        None
    }
    /// Where its rays come from.
    fn sources(&self) -> Vec<Point3> {
        Vec::new()
    }
    /// Distance at which a fronto-parallel point on the axis has `s = 1`; `None` where distance is
    /// all one.
    fn reference_distance(&self) -> Option<f64> {
        None
    }
    /// Angular profile about the optical axis.
    fn spot(&self) -> Spot {
        Spot::Isotropic
    }
    /// Check every number.
    fn validate(&self) -> Result<(), LightError>;
    /// In words; `unit` of its lengths.
    fn describe(&self, unit: &str) -> String;
}

/// Diffuse shading ([`Shade::value`]) of every vertex of a shape (camera axes; unit normals of its
/// vertices), at least 0.
pub(crate) fn lit(light: &impl Light, shape: &[Point3], normals: &[Vector3]) -> Vec<f64> {
    let lit = |(p, n): (&Point3, &Vector3)| light.shade(p, n).value.max(0.0);
    shape.par_iter().zip(normals).with_min_len(GRAIN).map(lit).collect()
}

/// Angle in rad, `[0, π]`, between a unit normal and the one that would mirror the light into
/// the camera: highlights sit where it is small.
pub(crate) fn specular_angle(light: &impl Light, point: &Point3, normal: &Vector3) -> f64 {
    let mirror = light.mirror_normal(point);
    // atan2 keeps its precision near zero, where acos loses half the digits.
    mirror.cross(normal).norm().atan2(mirror.dot(normal))
}

#[cfg(test)]
mod check;
pub mod coat;
mod collinear;
mod cosine;
mod error;
mod model;
mod near;
mod point;
mod ring;
mod spot;
pub mod vignetting;

pub use coat::{Coat, Coated};
pub use cosine::Cosine;
pub use error::LightError;
pub use model::LightModel;
pub use near::REFERENCE_DISTANCE;
pub use point::PointLight;
pub use ring::RingLight;
pub use spot::Spot;
