//! The template's albedo from registered exploration frames (paper §5, eqs. 1 and 2).
//!
//! `α_i = I_i / (gain_i · s_i)` for every texel and every frame that sees it (eq. 1), `s` the
//! shading of the template under the light; then one value over frames. The paper takes the
//! minimum (eq. 2), which is biased dark by noise; the default is a robust mean over observations
//! that are neither saturated, nor in a halo or specular lobe, nor grazing, nor near a predicted
//! contour. Exposure gains are estimated along with the albedo, their mean logarithm held at 0:
//! the one global factor that images leave open is thereby fixed.

use super::SurfaceTexels;
use super::known_light::{FittedExposure, KnownLight};
use super::photometric::{AlbedoView, PreparedView, SpotObservation};
use super::relief::{shaded_normals, shaded_surface};
use super::spots::{SurfaceSpot, observe_spots, prepare, smoothed_normals, surface_point};
use super::texel_fill::{choose_resolution, fill_unseen};
use crate::camera::PosedFrame;
use crate::geometry::Vector3;
use crate::light::LightModel;
use crate::mesh::Mesh;
use crate::options::OptionError;
use rayon::prelude::*;

pub use super::albedo_options::AlbedoOptions;
pub use super::combine::{Combine, CombinedAlbedo, ViewAlbedo, combine, from_view};

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
    /// An option out of its bounds.
    #[error(transparent)]
    Options(#[from] OptionError),
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

/// Estimate albedo and gains. `mesh` in the template frame, outward orientation; `light` as
/// calibrated (its length unit that of the mesh).
///
/// # Errors
/// An option out of its bounds, no view, an image or mask of another size than its camera, or no
/// usable part of the surface in any.
#[doc(alias("eq. 1", "eq. 2"))]
pub fn estimate_albedo(
    mesh: &Mesh,
    views: &[AlbedoView],
    light: &LightModel,
    options: &AlbedoOptions,
) -> Result<AlbedoEstimate, AlbedoError> {
    let model = KnownLight { light, options };
    let Observed { normals, prepared, spots, exposure } = Observed::of(mesh, views, &model)?;
    let shaded = shaded_normals(mesh, &spots, views, &exposure, &model);
    let mut texels = SurfaceTexels::new(choose_resolution(mesh, &prepared, options));
    let scene = AlbedoScene { mesh, normals: &normals, shaded: &shaded, views: &prepared, model };
    let faces: Vec<Vec<Option<Texel>>> = (0..mesh.topology.faces.len())
        .into_par_iter()
        .map(|f| {
            let measure = |w| scene.texel(f, w, &exposure).map(Texel::from);
            let mut found = Vec::with_capacity(usize::from(texels.resolution[f]).pow(2));
            found.extend(texels.centres(f).map(measure));
            found
        })
        .collect();
    let mut observed = 0;
    for (i, texel) in faces.into_iter().flatten().enumerate() {
        let Some(texel) = texel else { continue };
        texels.value[i] = texel.value;
        texels.spread[i] = texel.spread;
        texels.views[i] = texel.views;
        observed += 1;
    }
    if observed == 0 {
        return Err(AlbedoError::NothingObserved { views: views.len() });
    }
    let observed = observed as f64 / texels.value.len() as f64;
    fill_unseen(mesh, &mut texels);
    let FittedExposure { gains, noise, .. } = exposure;
    Ok(AlbedoEstimate { texels, gains, noise, observed })
}

/// The surface refined by the shading of all views under a known light (as for
/// [`estimate_albedo`]): what stereo knows of a vertex, its `sigma` (length units, infinity for
/// nothing), holds it, brightness tells the slope between, so that where texture is missing the
/// surface is more than interpolated.
///
/// # Errors
/// An option out of its bounds, no views, or views whose sizes differ.
pub fn refine_by_shading(
    mesh: &Mesh,
    sigma: &[f64],
    views: &[AlbedoView],
    light: &LightModel,
    options: &AlbedoOptions,
) -> Result<Mesh, AlbedoError> {
    let model = KnownLight { light, options };
    let Observed { spots, exposure, .. } = Observed::of(mesh, views, &model)?;
    Ok(mesh.with_positions(shaded_surface(mesh, sigma, &spots, views, &exposure, &model)))
}

/// What the views show of a surface, before any albedo is known.
struct Observed<'a> {
    normals: Vec<Vector3>,
    prepared: Vec<PreparedView<'a>>,
    spots: Vec<SurfaceSpot>,
    exposure: FittedExposure,
}

impl<'a> Observed<'a> {
    fn of(
        mesh: &Mesh,
        views: &'a [AlbedoView<'a>],
        model: &KnownLight,
    ) -> Result<Self, AlbedoError> {
        let KnownLight { light, options } = *model;
        options.validate()?;
        check_views(views)?;
        let normals = smoothed_normals(mesh, options.normal_smoothing);
        let prepared = prepare(mesh, views, &options.bounds);
        let spots =
            observe_spots(mesh, &normals, &prepared, light, &options.bounds, options.gain_spots);
        let exposure = FittedExposure::solve(&spots, views, model);
        Ok(Self { normals, prepared, spots, exposure })
    }
}

/// A texel as it is stored.
struct Texel {
    value: [f32; 3],
    spread: f32,
    views: u16,
}

impl From<CombinedAlbedo> for Texel {
    fn from(found: CombinedAlbedo) -> Self {
        Self {
            value: found.value.map(|v| v as f32),
            spread: found.spread as f32,
            views: found.views.min(u16::MAX as usize) as u16,
        }
    }
}

pub(super) fn check_views(views: &[AlbedoView]) -> Result<(), AlbedoError> {
    if views.is_empty() {
        return Err(AlbedoError::NoViews);
    }
    for (view, v) in views.iter().enumerate() {
        let PosedFrame { frame, valid, organ, .. } = v.posed;
        let sizes = [Some(frame.size), valid.map(|m| m.size), organ.map(|m| m.size)];
        let expected = v.posed.camera.size;
        if let Some(found) = sizes.into_iter().flatten().find(|&s| s != expected) {
            return Err(AlbedoError::SizeMismatch { view, found, expected });
        }
    }
    Ok(())
}

struct AlbedoScene<'a> {
    mesh: &'a Mesh,
    /// Of the mesh: what is seen, and at which angle.
    normals: &'a [Vector3],
    /// As the shading has them.
    shaded: &'a [Vector3],
    views: &'a [PreparedView<'a>],
    model: KnownLight<'a>,
}

impl AlbedoScene<'_> {
    fn texel(&self, face: usize, w: [f64; 3], exposure: &FittedExposure) -> Option<CombinedAlbedo> {
        let (point, normal) = surface_point(self.mesh, self.normals, face, w)?;
        let (_, shaded) = surface_point(self.mesh, self.shaded, face, w)?;
        let KnownLight { light, options } = self.model;
        let mut albedos = Vec::new();
        for (v, view) in self.views.iter().enumerate() {
            let Some(o) = view.observe(v, &point, &normal, light, &options.bounds) else {
                continue;
            };
            let shade = self.model.shade_of(&o.point, &view.turned(&shaded)).value;
            let Some(value) = from_view(o.rgb, shade, exposure.gains[v]) else { continue };
            albedos.push(ViewAlbedo { value, weight: trust(&o) });
        }
        combine(&albedos, options.combine, exposure.noise)
    }
}

/// Standard deviation of the normal, rad, over the relative noise of brightness.
const TILT_OVER_NOISE: f64 = 2.5;

/// Inverse variance of an observation, up to a factor: an error of the normal changes the
/// brightness by the tangent of the angle to the light, and light from all around weighs in alike.
fn trust(o: &SpotObservation) -> f64 {
    let cos_squared = o.weight.clamp(1e-3, 1.0);
    let tilt = TILT_OVER_NOISE * TILT_OVER_NOISE * (1.0 / cos_squared - 1.0);
    1.0 / ((1.0 + tilt) * o.point.coords.norm_squared())
}

#[cfg(test)]
mod tests {
    use super::super::test_scene::{bounds, patch, pictures, true_albedo};
    use super::*;
    use crate::geometry::{Point3, point_at};
    use crate::light::{PointLight, Spot};

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
        pictures[0].frame.rgb.fill([0; 3]);
        let black = estimate_albedo(&mesh, &[pictures[0].view()], &light, &options).unwrap_err();
        assert_eq!(black, AlbedoError::NothingObserved { views: 1 });
        pictures[1].frame.size = [10, 10];
        let size = estimate_albedo(&mesh, &[pictures[1].view()], &light, &options).unwrap_err();
        assert!(matches!(size, AlbedoError::SizeMismatch { view: 0, found: [10, 10], .. }));
    }
}
