//! Tissue under a light: the wet film that makes it glossy, the light from all around, and what the
//! lens takes of it.
//!
//! ```text
//! I = gain · α · V(x) · T(N, x) · (s(N, x) + a)
//! ```
//!
//! `T` is what passes the film on the way in and out relative to normal incidence (Fresnel): 1 face
//! on, 0.98 at 45 degrees, 0.9 at 60, 0.74 at 70 for a refractive index of 1.4 and a light at the
//! camera. `a` is the light that the surroundings throw back, in units of the shading. `V` is the
//! vignetting of the lens ([`vignetting`]).

use super::cosine::Cosine;
use super::model::LightModel;
use super::vignetting::{BOUNDS, vignetting};
use super::{Light, Shade};
use crate::geometry::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Refractive index of wet soft tissue in visible light (1.36 to 1.42).
pub(crate) const WET_TISSUE: f64 = 1.4;

/// Bounds of a film and a lens; [`BOUNDS`] are those of the vignetting.
pub(crate) const PLAUSIBLE: &str = "an index from 1 to below 4 and a vignetting from -2 to 0.2";

/// What tissue makes of the light that reaches it, and the lens of what it sends back. The default
/// is Lambert's surface in the dark behind a perfect lens.
#[doc(alias = "BRDF")]
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coat {
    /// Refractive index of the film, at least 1; 1 = no film.
    pub refractive_index: f64,
    /// Light from all around, in units of the shading.
    pub ambient: f64,
    /// Vignetting `a` of the lens, `V = 1 + a r²` with r in focal lengths from the principal point;
    /// 0 = none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub vignetting: f64,
}

/// So that what knows nothing of vignetting reads a template without.
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl Default for Coat {
    fn default() -> Self {
        Self { refractive_index: 1.0, ambient: 0.0, vignetting: 0.0 }
    }
}

/// A light and the tissue it falls on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Coated {
    /// The light.
    pub light: LightModel,
    /// The tissue.
    pub coat: Coat,
}

impl Light for Coated {
    fn shade(&self, point: &Point3, normal: &Vector3) -> Shade {
        self.coat.shade(&self.light, point, normal)
    }

    fn mirror_normal(&self, point: &Point3) -> Vector3 {
        self.light.mirror_normal(point)
    }
}

impl Coat {
    /// Whether its figures can be those of tissue and a lens: [`PLAUSIBLE`].
    pub(crate) fn is_plausible(&self) -> bool {
        let Self { refractive_index, ambient, vignetting } = *self;
        let [least, most] = BOUNDS;
        (1.0..4.0).contains(&refractive_index)
            && ambient.is_finite()
            && (least..=most).contains(&vignetting)
    }

    /// `V · T · (s + a)` with its derivatives; 0 where the light itself does not reach.
    pub fn shade(&self, light: &LightModel, point: &Point3, normal: &Vector3) -> Shade {
        let bare = light.shade(point, normal);
        if *self == Self::default() || bare.value == 0.0 {
            return bare;
        }
        let sent = self.sent(light, bare, point, normal);
        if self.vignetting == 0.0 {
            return sent;
        }
        let (passed, slope) = vignetting(self.vignetting, point);
        Shade {
            value: sent.value * passed,
            d_normal: sent.d_normal * passed,
            d_point: sent.d_point * passed + slope * sent.value,
        }
    }

    /// `T · (s + a)`, what reaches the lens; `bare`: `s`.
    fn sent(&self, light: &LightModel, bare: Shade, point: &Point3, normal: &Vector3) -> Shade {
        let seen = Cosine::towards(&Point3::origin(), point, normal);
        let lit = light.cosine(point, normal);
        let [into, out] = [&lit, &seen].map(|c| transmission(self.refractive_index, c.value));
        // Face on: (1 − ((n − 1)/(n + 1))²)².
        let mirrored = (self.refractive_index - 1.0) / (self.refractive_index + 1.0);
        let whole = (1.0 - mirrored * mirrored).powi(2);
        let passed = into.0 * out.0 / whole;
        let (d_lit, d_seen) = (into.1 * out.0 / whole, into.0 * out.1 / whole);
        let light = bare.value + self.ambient;
        Shade {
            value: passed * light,
            d_normal: bare.d_normal * passed
                + (lit.d_normal * d_lit + seen.d_normal * d_seen) * light,
            d_point: bare.d_point * passed + (lit.d_point * d_lit + seen.d_point * d_seen) * light,
        }
    }
}

/// Share of unpolarised light that passes a smooth dielectric surface of the given refractive
/// index from air, `1 − R(θ)` (Fresnel), and its derivative; `cosine` of the angle of incidence,
/// clamped to `[0, 1]`, outside of which the derivative is 0.
pub(crate) fn transmission(index: f64, cosine: f64) -> (f64, f64) {
    let cos_i = cosine.clamp(0.0, 1.0);
    let cos_t = (1.0 - (1.0 - cos_i * cos_i) / (index * index)).max(0.0).sqrt();
    // dcos_t / dcos_i; an index of 1 bends nothing.
    let slope = if cos_t > 0.0 { cos_i / (index * index * cos_t) } else { 1.0 };
    let ratio = |a: f64, b: f64, da: f64, db: f64| {
        let sum = (a + b).max(f64::MIN_POSITIVE);
        ((a - b) / sum, 2.0 * (da * b - a * db) / (sum * sum))
    };
    let (s, ds) = ratio(cos_i, index * cos_t, 1.0, index * slope);
    let (p, dp) = ratio(index * cos_i, cos_t, index, slope);
    let inside = (0.0..=1.0).contains(&cosine);
    (1.0 - 0.5 * (s * s + p * p), if inside { -(s * ds + p * dp) } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fresnel_by_hand() {
        let share = |index, cosine| transmission(index, cosine).0;
        // Normal incidence: R = ((n − 1)/(n + 1))².
        assert!((share(1.5, 1.0) - 0.96).abs() < 1e-12);
        assert!(share(1.5, 0.0).abs() < 1e-12);
        assert!((share(1.0, 0.3) - 1.0).abs() < 1e-12);
        // Brewster's angle: the parallel part passes whole.
        let brewster = 1.5_f64.atan();
        let s = ((1.0 - 2.25) / (1.0 + 2.25_f64)).powi(2);
        assert!((share(1.5, brewster.cos()) - (1.0 - 0.5 * s)).abs() < 1e-12);
    }

    #[test]
    fn ambient_light_adds_to_the_shading() {
        let coat = Coat { ambient: 0.25, ..Coat::default() };
        let (point, normal) = (Point3::new(0.0, 0.0, 60.0), Vector3::new(0.6, 0.0, -0.8));
        let shade = coat.shade(&LightModel::Collinear, &point, &normal);
        assert!((shade.value - 1.05).abs() < 1e-12);
        assert_eq!(coat.shade(&LightModel::Collinear, &point, &-normal), Shade::default());
    }

    #[test]
    fn vignetting_is_written_only_where_there_is_some() {
        let written = |vignetting| {
            serde_json::to_string(&Coat { vignetting, ..Coat::default() }).unwrap().contains("vign")
        };
        assert!(written(-0.3) && !written(0.0));
    }
}
