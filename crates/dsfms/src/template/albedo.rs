//! The template's albedo from registered exploration frames (paper §5, eqs. 1 and 2).
//!
//! `α_i = I_i / (gain_i · s_i)` for every texel and every frame that sees it (eq. 1), `s` the
//! shading of the template under the light; then one value over frames. The paper takes the
//! minimum (eq. 2), which is biased dark by noise; the default is a robust mean over observations
//! that are neither saturated, nor in a halo or specular lobe, nor grazing, nor near a predicted
//! contour. Exposure gains are estimated along with the albedo, their mean logarithm held at 0:
//! the one global factor that images leave open is thereby fixed.

use super::SurfaceTexels;
use super::coat::{WET_TISSUE, relative_transmission};
use super::log_linear::{LogLinear, ShadingModel};
use super::photometric::{AlbedoView, Observation, ObservationBounds, PreparedView};
use super::robust::{tukey_mean, tukey_weight};
use super::spots::{observe_spots, prepare, smoothed_normals, surface_point};
use super::texel_fill::{choose_resolution, fill_unseen};
use crate::geometry::Vector3;
use crate::light::{Light, LightModel};
use crate::mesh::Mesh;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// How the albedos of single views become one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Combine {
    /// Tukey mean of the logarithms, weighted by cosines and inverse squared distance.
    #[default]
    Robust,
    /// The paper's eq. 2: the smallest value, per channel.
    Minimum,
}

/// Options of [`estimate_albedo`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AlbedoOptions {
    /// Which observations count.
    pub bounds: ObservationBounds,
    /// How views are combined.
    pub combine: Combine,
    /// Rounds of one-ring averaging of the vertex normals.
    pub normal_smoothing: usize,
    /// Texels per pixel (by length) of the closest view that sees a face, `> 0`.
    pub texels_per_px: f64,
    /// Largest resolution of one face, `1..=256`.
    pub max_resolution: u16,
    /// Largest number of texels in all; resolutions shrink evenly to fit.
    pub max_texels: usize,
    /// Prior standard deviation of a frame's log gain (exposure control: about 0.3).
    pub gain_sigma: f64,
    /// Number of surface spots on which gains are solved.
    pub gain_spots: usize,
    /// Light from all around that the organ reflects, in units of the shading (0 = none).
    pub ambient: f64,
    /// Refractive index of the wet film on the organ, at least 1 (1 = Lambert without a film);
    /// default that of wet tissue.
    pub refractive_index: f64,
}

impl Default for AlbedoOptions {
    fn default() -> Self {
        Self {
            bounds: ObservationBounds::default(),
            combine: Combine::Robust,
            normal_smoothing: 2,
            texels_per_px: 1.0,
            max_resolution: 64,
            max_texels: 3_000_000,
            gain_sigma: 0.3,
            gain_spots: 6000,
            ambient: 0.0,
            refractive_index: WET_TISSUE,
        }
    }
}

/// What [`estimate_albedo`] found.
#[derive(Clone, Debug)]
pub struct AlbedoEstimate {
    /// Albedo on the surface, linear RGB; `views` is 0 where it was filled in from neighbours.
    pub texels: SurfaceTexels,
    /// Exposure gain of every view; geometric mean 1.
    pub gains: Vec<f64>,
    /// Robust relative standard deviation of one observation about the model.
    pub noise: f64,
    /// Fraction of texels that at least one view observed.
    pub observed: f64,
}

/// Why no albedo could be estimated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AlbedoError {
    /// Nothing to measure in.
    #[error("no registered frame; at least one is needed to measure the albedo")]
    NoViews,
    /// An image, mask and camera disagree.
    #[error(
        "view {view}: image, masks and camera differ in size ({found:?} and {expected:?} px); use the camera of these frames"
    )]
    SizeMismatch {
        /// 0-based index of the view.
        view: usize,
        /// Size of the image or mask.
        found: [usize; 2],
        /// Size in the camera.
        expected: [usize; 2],
    },
    /// No frame shows a usable part of the surface.
    #[error(
        "none of the {views} frames shows a usable part of the surface; check the poses, the masks (white = valid) and the exposure"
    )]
    NothingObserved {
        /// Number of frames given.
        views: usize,
    },
}

/// Eq. 1 with a gain: `I / (gain · shade)` per channel; `None` where the light does not reach
/// (the paper sets a predefined maximum there, which eq. 2 then never picks).
pub fn from_view(intensity: [f64; 3], shade: f64, gain: f64) -> Option<[f64; 3]> {
    let light = gain * shade;
    (light > 0.0).then(|| intensity.map(|i| i / light))
}

/// Albedo of one texel in one view, with its weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewAlbedo {
    /// Linear RGB.
    pub value: [f64; 3],
    /// Relative weight, `> 0`.
    pub weight: f64,
}

/// Albedo of one texel over all views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CombinedAlbedo {
    /// Linear RGB.
    pub value: [f64; 3],
    /// Standard deviation of the grey value over the views that count (0 for one view).
    pub spread: f64,
    /// Views that count.
    pub views: usize,
}

/// Eq. 2 or its robust substitute; `noise` is the relative standard deviation expected of one
/// value (used by [`Combine::Robust`] only). `None` without a value.
pub fn combine(albedos: &[ViewAlbedo], rule: Combine, noise: f64) -> Option<CombinedAlbedo> {
    match rule {
        Combine::Minimum => minimum(albedos),
        Combine::Robust => robust_mean(albedos, noise.max(0.02)),
    }
}

fn grey(value: [f64; 3]) -> f64 {
    (value[0] + value[1] + value[2]) / 3.0
}

fn minimum(albedos: &[ViewAlbedo]) -> Option<CombinedAlbedo> {
    let first = albedos.first()?.value;
    let lowest = |c: usize| albedos.iter().fold(first[c], |m, a| m.min(a.value[c]));
    let value = [lowest(0), lowest(1), lowest(2)];
    Some(summary(value, albedos, |_| 1.0))
}

fn robust_mean(albedos: &[ViewAlbedo], scale: f64) -> Option<CombinedAlbedo> {
    let log = |a: &ViewAlbedo| grey(a.value).max(1e-9).ln();
    let mut samples: Vec<_> = albedos.iter().map(|a| (log(a), a.weight)).collect();
    let centre = tukey_mean(&mut samples, scale);
    let weight = |a: &ViewAlbedo| a.weight * tukey_weight(log(a) - centre, scale);
    let total: f64 = albedos.iter().map(weight).sum();
    if total.is_nan() || total <= 0.0 {
        return None;
    }
    let mut value = [0.0; 3];
    for a in albedos {
        (0..3).for_each(|c| value[c] += weight(a) * a.value[c] / total);
    }
    Some(summary(value, albedos, |a| weight(a) / a.weight))
}

fn summary(
    value: [f64; 3],
    albedos: &[ViewAlbedo],
    trust: impl Fn(&ViewAlbedo) -> f64,
) -> CombinedAlbedo {
    let (mut total, mut square) = (0.0, 0.0);
    for a in albedos {
        total += trust(a);
        square += trust(a) * (grey(a.value) - grey(value)).powi(2);
    }
    let views = albedos.iter().filter(|a| trust(a) > 0.1).count().max(1);
    CombinedAlbedo { value, spread: (square / total).sqrt(), views }
}

/// Estimate albedo and gains. `mesh` in the template frame, outward orientation; `light` as
/// calibrated (its length unit that of the mesh).
pub fn estimate_albedo(
    mesh: &Mesh,
    views: &[AlbedoView],
    light: &LightModel,
    options: &AlbedoOptions,
) -> Result<AlbedoEstimate, AlbedoError> {
    check_views(views)?;
    let normals = smoothed_normals(mesh, options.normal_smoothing);
    let prepared = prepare(mesh, views, &options.bounds);
    let (gains, noise) = solve_gains(mesh, &normals, views, &prepared, light, options);
    let mut texels = SurfaceTexels::new(choose_resolution(mesh, views, &prepared, options));
    let scene = Scene { mesh, normals: &normals, views: &prepared, light, options };
    let faces: Vec<Vec<Option<CombinedAlbedo>>> = (0..mesh.topology.faces.len())
        .into_par_iter()
        .map(|f| texels.centres(f).map(|w| scene.texel(f, w, &gains, noise)).collect())
        .collect();
    let mut observed = 0;
    for (i, texel) in faces.into_iter().flatten().enumerate() {
        let Some(texel) = texel else { continue };
        texels.value[i] = texel.value.map(|v| v as f32);
        texels.spread[i] = texel.spread as f32;
        texels.views[i] = texel.views.min(u16::MAX as usize) as u16;
        observed += 1;
    }
    if observed == 0 {
        return Err(AlbedoError::NothingObserved { views: views.len() });
    }
    let observed = observed as f64 / texels.value.len() as f64;
    fill_unseen(mesh, &mut texels);
    Ok(AlbedoEstimate { texels, gains, noise, observed })
}

pub(super) fn check_views(views: &[AlbedoView]) -> Result<(), AlbedoError> {
    if views.is_empty() {
        return Err(AlbedoError::NoViews);
    }
    for (view, v) in views.iter().enumerate() {
        let sizes = [Some(v.image.size), Some(v.saturation.size), v.valid.map(|m| m.size)];
        let expected = v.camera.size;
        if let Some(found) = sizes.into_iter().flatten().find(|&s| s != expected) {
            return Err(AlbedoError::SizeMismatch { view, found, expected });
        }
    }
    Ok(())
}

/// A known light: nothing but gains to solve for.
struct KnownLight<'a> {
    light: &'a LightModel,
    options: &'a AlbedoOptions,
}

impl KnownLight<'_> {
    fn shade(&self, o: &Observation) -> f64 {
        let film = self.options.refractive_index;
        let passed = relative_transmission(film, self.light, &o.point, &o.normal);
        passed * (self.light.shade(&o.point, &o.normal).value + self.options.ambient)
    }
}

impl ShadingModel for KnownLight<'_> {
    type At = ();

    fn at(&self, _: &[f64]) -> Self::At {}

    fn log_shading(&self, o: &Observation, (): &Self::At) -> f64 {
        self.shade(o).max(1e-6).ln()
    }

    fn steps(&self) -> Vec<f64> {
        Vec::new()
    }

    fn priors(&self) -> Vec<(f64, f64)> {
        Vec::new()
    }
}

fn solve_gains(
    mesh: &Mesh,
    normals: &[Vector3],
    views: &[AlbedoView],
    prepared: &[PreparedView],
    light: &LightModel,
    options: &AlbedoOptions,
) -> (Vec<f64>, f64) {
    let spots = observe_spots(mesh, normals, prepared, light, &options.bounds, options.gain_spots);
    let model = KnownLight { light, options };
    let gain_priors = views.iter().map(|v| (v.gain.max(1e-6).ln(), options.gain_sigma)).collect();
    let fit = LogLinear { model: &model, spots: &spots, gain_priors }.solve(&[]);
    (centred_gains(&fit.log_gains), fit.scale)
}

/// Gains of geometric mean 1.
pub(super) fn centred_gains(log_gains: &[f64]) -> Vec<f64> {
    let mean = log_gains.iter().sum::<f64>() / log_gains.len().max(1) as f64;
    log_gains.iter().map(|g| (g - mean).exp()).collect()
}

struct Scene<'a> {
    mesh: &'a Mesh,
    normals: &'a [Vector3],
    views: &'a [PreparedView<'a>],
    light: &'a LightModel,
    options: &'a AlbedoOptions,
}

impl Scene<'_> {
    fn texel(&self, face: usize, w: [f64; 3], gains: &[f64], noise: f64) -> Option<CombinedAlbedo> {
        let (point, normal) = surface_point(self.mesh, self.normals, face, w)?;
        let mut albedos = Vec::new();
        for (v, view) in self.views.iter().enumerate() {
            let bounds = &self.options.bounds;
            let Some(o) = view.observe(v, &point, &normal, self.light, bounds) else { continue };
            let shade = KnownLight { light: self.light, options: self.options }.shade(&o);
            let Some(value) = from_view(o.rgb, shade, gains[v]) else { continue };
            let albedo = ViewAlbedo { value, weight: o.weight / o.point.coords.norm_squared() };
            albedos.push(albedo);
        }
        combine(&albedos, self.options.combine, noise)
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_scene::{bounds, patch, pictures, true_albedo};
    use super::*;
    use crate::geometry::{Point3, point_at};
    use crate::light::{PointLight, Spot};

    fn one(value: f64) -> ViewAlbedo {
        ViewAlbedo { value: [value; 3], weight: 1.0 }
    }

    #[test]
    fn equations_1_and_2_by_hand() {
        assert_eq!(from_view([0.2, 0.1, 0.4], 0.5, 2.0), Some([0.2, 0.1, 0.4]));
        assert_eq!(from_view([0.2; 3], 0.0, 1.0), None);
        let views = [one(0.5), one(0.52), one(0.48), one(0.9)];
        assert_eq!(combine(&views, Combine::Minimum, 0.02).unwrap().value, [0.48; 3]);
        let robust = combine(&views, Combine::Robust, 0.03).unwrap();
        assert!((robust.value[0] - 0.5).abs() < 0.005, "the highlight is rejected");
        assert_eq!((robust.views, combine(&[], Combine::Robust, 0.1)), (3, None));
    }

    #[test]
    fn the_minimum_never_rises_with_a_view() {
        let views = [one(0.5), one(0.6), one(0.3), one(0.4)];
        let lowest = |n| combine(&views[..n], Combine::Minimum, 0.1).unwrap().value[0];
        assert!((2..=4).all(|n| lowest(n) <= lowest(n - 1)));
    }

    #[test]
    fn recovers_albedo_and_gains_of_a_wavy_patch() {
        let mesh = patch();
        let light = LightModel::Point(PointLight {
            positions: vec![Point3::new(0.0, -3.0, 0.0)],
            reference_distance: 50.0,
            spot: Spot::Linear { inner_deg: 10.0, outer_deg: 52.0 },
        });
        let gains = [1.0, 1.25, 0.8, 1.1, 1.0 / 1.1];
        let pictures = pictures(&mesh, &light, gains);
        let views: Vec<_> = pictures.iter().map(|p| p.view()).collect();
        let options = AlbedoOptions { bounds: bounds(), normal_smoothing: 0, ..Default::default() };
        let found = estimate_albedo(&mesh, &views, &light, &options).unwrap();
        for (found, truth) in found.gains.iter().zip(gains) {
            assert!((found / truth - 1.0).abs() < 0.02, "gain {found}, true {truth}");
        }
        let (mut square, mut count) = (0.0, 0.0);
        for face in 0..mesh.topology.faces.len() {
            for (k, w) in found.texels.centres(face).enumerate() {
                let i = found.texels.offset[face] as usize + k;
                if found.texels.views[i] > 0 {
                    let truth = true_albedo(&point_at(mesh.corners(face), w));
                    square += (f64::from(found.texels.value[i][1]) / truth[1] - 1.0).powi(2);
                    count += 1.0;
                }
            }
        }
        assert!(found.observed > 0.8, "{} observed", found.observed);
        assert!((square / count).sqrt() < 0.02, "rms {}", (square / count).sqrt());
    }

    #[test]
    fn says_what_is_missing() {
        let (mesh, light) = (patch(), LightModel::Collinear);
        let options = AlbedoOptions::default();
        let none = estimate_albedo(&mesh, &[], &light, &options).unwrap_err();
        assert_eq!(none, AlbedoError::NoViews);
        let mut pictures = pictures(&mesh, &light, [1.0; 5]);
        pictures[0].image.data.fill([0.0; 3]);
        let black = estimate_albedo(&mesh, &[pictures[0].view()], &light, &options).unwrap_err();
        assert_eq!(black, AlbedoError::NothingObserved { views: 1 });
        pictures[1].image.size = [10, 10];
        let size = estimate_albedo(&mesh, &[pictures[1].view()], &light, &options).unwrap_err();
        assert!(matches!(size, AlbedoError::SizeMismatch { view: 0, found: [10, 10], .. }));
    }
}
