//! The lights a camera file can name.

use super::collinear::Collinear;
use super::cosine::Cosine;
use super::error::LightError;
use super::point::PointLight;
use super::ring::RingLight;
use super::spot::Spot;
use super::{Light, LightSource, Shade};
use crate::geometry::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// The table of the lights: a kind, and the struct of what is free about it, which says the rest
/// ([`LightSource`]). Files call it by the kind in small letters.
macro_rules! lights {
    ($($(#[$meta:meta])* $kind:ident $(($light:ident: $data:ty))?),* $(,)?) => {
        /// A light rigidly mounted on the camera.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(rename_all = "snake_case")]
        pub enum LightModel {
            $($(#[$meta])* $kind $(($data))?,)*
        }

        impl LightModel {
            fn source(&self) -> &dyn LightSource {
                match self { $(Self::$kind $(($light))? => lights!(@source $kind $($light)?),)* }
            }
        }

        $($(impl From<$data> for LightModel {
            fn from(light: $data) -> Self {
                Self::$kind(light)
            }
        })?)*
    };
    (@source $kind:ident) => { &$kind };
    (@source $kind:ident $light:ident) => { $light };
}

lights! {
    /// Distant and along the optical axis (the paper): `s = −N_z`.
    #[default]
    Collinear,
    /// Near, with inverse-square fall-off and a spot profile.
    Point(light: PointLight),
    /// Near, from a circle around the lens.
    Ring(light: RingLight),
}

impl LightModel {
    /// A point at the camera's centre, the same in every direction.
    pub(crate) fn at_origin(reference_distance: f64) -> Self {
        let positions = vec![Point3::origin()];
        PointLight { positions, reference_distance, spot: Spot::Isotropic }.into()
    }

    /// The same light at the camera's centre; a distant one is there already.
    pub(crate) fn at_camera(&self) -> Self {
        let Some(reference_distance) = self.reference_distance() else { return self.clone() };
        let positions = vec![Point3::origin()];
        PointLight { positions, reference_distance, spot: self.spot() }.into()
    }

    /// Whether brightness depends on how far away the surface is: fall-off from a place that is
    /// near.
    pub(crate) fn tells_distance(&self) -> bool {
        self.reference_distance().is_some()
    }

    /// Distance at which a fronto-parallel point on the axis has `s = 1`, of a light that tells
    /// distance.
    pub fn reference_distance(&self) -> Option<f64> {
        self.source().reference_distance()
    }

    /// Where its rays come from, camera axes, all alike; empty for a distant light along the
    /// optical axis.
    pub fn sources(&self) -> Vec<Point3> {
        self.source().sources()
    }

    /// Mean of the [`sources`](Self::sources); `None` for a distant light.
    pub fn centre(&self) -> Option<Point3> {
        self.source().centre()
    }

    /// Angular profile about the optical axis.
    pub fn spot(&self) -> Spot {
        self.source().spot()
    }

    /// Cosine of the angle between the normal and the direction to the middle of the light.
    pub fn cosine(&self, point: &Point3, normal: &Vector3) -> Cosine {
        match self.centre() {
            Some(centre) => Cosine::towards(&centre, point, normal),
            None => Cosine::along(-Vector3::z(), normal),
        }
    }

    /// Check every number.
    ///
    /// # Errors
    /// The first that cannot be.
    pub fn validate(&self) -> Result<(), LightError> {
        self.source().validate()
    }

    /// In words; `unit` of its lengths.
    pub fn describe(&self, unit: &str) -> String {
        self.source().describe(unit)
    }
}

impl Light for LightModel {
    fn shade(&self, point: &Point3, normal: &Vector3) -> Shade {
        self.source().shade(point, normal)
    }

    fn mirror_normal(&self, point: &Point3) -> Vector3 {
        let to_camera = -point.coords.normalize();
        // A distant light stands infinitely far behind the camera.
        let to_light = match self.centre() {
            Some(centre) => (centre - point).normalize(),
            None => -Vector3::z(),
        };
        (to_camera + to_light).normalize()
    }
}
