//! Everything on the surface that comes from the registered frames.

use super::error::TemplateError;
use super::exploration::Exploration;
use super::found_organ::FoundOrgan;
use super::options::TemplateOptions;
use crate::camera::{Camera, PosedFrame};
use crate::geometry::{Isometry, Point3};
use crate::image::Mask;
use crate::mesh::{Mesh, Topology};
use crate::pipeline::{Progress, logging};
use crate::raster::{OCCLUSION_TOLERANCE, rasterize, visible_vertices};
use crate::sfm::Features2d;
use crate::template::albedo::{AlbedoOptions, estimate_albedo, refine_by_shading};
use crate::template::anchor::{AnchorOptions, FeatureView, anchor_features};
use crate::template::flatten::flatten;
use crate::template::light_fit::{LightFit, LightFitOptions, Vignetting, fit_light};
use crate::template::photometric::AlbedoView;
use crate::template::{Flattening, LengthUnit, Surroundings, Template, TemplateView};
use rayon::prelude::*;

/// Registered frames, with all that is measured in them. One entry per frame in every list.
pub(super) struct Views<'a> {
    pub exploration: &'a Exploration<'a>,
    pub usable: &'a [Option<Mask>],
    pub poses: &'a [Option<Isometry>],
    pub reprojection_px: &'a [f64],
    pub features: &'a [Features2d],
}

/// Views that show a feature of the surroundings in one place, at least: on a dark wall many are
/// highlights, which move with the camera (`docs/results/track.md`, the camera by what lies around
/// the organ).
const CONFIRMED: usize = 3;

/// Pixels within which views agree on the place, over those of the organ: the surface of the
/// surroundings is coarser. Not measured.
const COARSER: f64 = 2.0;

/// A registered frame.
pub(super) struct RegisteredFrame {
    pub(super) frame: usize,
    pub(super) pose: Isometry,
}

impl Views<'_> {
    /// Everything on the surface that comes from the frames; `sigma`: expected error of the
    /// vertices, for a surface that may be refined.
    pub(super) fn dress(
        &self,
        mut mesh: Mesh,
        sigma: Option<&[f64]>,
        unit: LengthUnit,
        options: &TemplateOptions,
        progress: &dyn Progress,
    ) -> Result<(Template, Option<LightFit>), TemplateError> {
        let registered = self.registered();
        let tone = self.exploration.tone.table();
        progress.step("light and albedo", 0, 2);
        let views: Vec<AlbedoView> =
            registered.iter().map(|r| self.albedo_view(r, &tone)).collect();
        let Exploration { light: known, vignetting, .. } = *self.exploration;
        let vignetting = vignetting.map_or(options.light.vignetting, Vignetting::Known);
        let fit = LightFitOptions { vignetting, ..options.light.clone() };
        let light = fit_light(&mesh, &views, known, &fit)?;
        logging::light(&light, progress);
        if light.candidates.is_empty() {
            progress.warn(
                "one frame has a pose: its light cannot be told from the albedo, and is taken from the \
                 camera file, or to be at the camera",
            );
        }
        progress.step("light and albedo", 1, 2);
        let (ambient, vignetting) = (light.ambient, light.vignetting);
        let shading = AlbedoOptions { ambient, vignetting, ..options.albedo.clone() };
        if let (Some(sigma), true) = (sigma, options.refine_by_shading) {
            mesh = refine_by_shading(&mesh, sigma, &views, &light.light, &shading)?;
        }
        let albedo = estimate_albedo(&mesh, &views, &light.light, &shading)?;
        progress.step("light and albedo", 2, 2);
        let flattening = try_flatten(&mesh, options, progress);
        let feature_views: Vec<FeatureView> =
            registered.iter().map(|r| self.feature_view(r)).collect();
        let features = anchor_features(&mesh, &feature_views, &options.anchor);
        let visible: Vec<Vec<bool>> =
            registered.par_iter().map(|r| self.visible(r, &mesh)).collect();
        let mut template = Template {
            unit,
            seen: seen_counts(&mesh.topology, &visible),
            sigma: Vec::new(),
            flattening,
            albedo: Some(albedo.texels),
            features: Some(features),
            views: self.named(&registered, &albedo.gains),
            points: Vec::new(),
            camera: Some(self.exploration.camera.clone()),
            tone: self.exploration.tone.clone(),
            light: Some(light.light.clone()),
            coat: shading.coat(),
            usual: None,
            surroundings: None,
            mesh,
        };
        template.usual = self.usual(&template, &registered);
        Ok((template, Some(light)))
    }

    /// What lies around the organ, with the keypoints beside the organ of frames that show where it
    /// ends.
    pub(super) fn around(
        &self,
        mesh: Mesh,
        organ: &FoundOrgan,
        options: &AnchorOptions,
    ) -> Surroundings {
        let beside = |r: RegisteredFrame| -> Option<(RegisteredFrame, Mask)> {
            let name = &self.exploration.frames[r.frame].name;
            let (_, organ) = organ.guess.masks.iter().find(|(of, _)| of == name)?;
            let beside = organ.dilate(options.contour_px).complement();
            let usable = self.usable[r.frame].as_ref();
            Some((r, usable.map_or_else(|| beside.clone(), |usable| usable.and(&beside))))
        };
        let beside: Vec<(RegisteredFrame, Mask)> =
            self.registered().into_iter().filter_map(beside).collect();
        let view = |(r, beside)| {
            let whole = self.feature_view(r);
            FeatureView { posed: PosedFrame { valid: Some(beside), ..whole.posed }, ..whole }
        };
        let views: Vec<FeatureView> = beside.iter().map(|(r, mask)| view((r, mask))).collect();
        let options = AnchorOptions {
            least_views: CONFIRMED,
            merge_px: COARSER * options.merge_px,
            ..options.clone()
        };
        let features = anchor_features(&mesh, &views, &options);
        Surroundings { mesh, features }
    }

    fn registered(&self) -> Vec<RegisteredFrame> {
        let one = |(frame, pose): (usize, &Option<Isometry>)| {
            Some(RegisteredFrame { frame, pose: (*pose)? })
        };
        self.poses.iter().enumerate().filter_map(one).collect()
    }

    fn albedo_view<'v>(
        &'v self,
        registered: &RegisteredFrame,
        tone: &'v [f32; 256],
    ) -> AlbedoView<'v> {
        AlbedoView { posed: self.posed(registered), tone, gain: 1.0 }
    }

    fn posed(&self, registered: &RegisteredFrame) -> PosedFrame<'_> {
        PosedFrame {
            frame: &self.exploration.frames[registered.frame],
            camera: self.exploration.camera,
            pose: registered.pose,
            valid: self.usable[registered.frame].as_ref(),
            organ: None,
        }
    }

    fn named(&self, registered: &[RegisteredFrame], gains: &[f64]) -> Vec<TemplateView> {
        let view = |(r, &gain): (&RegisteredFrame, &f64)| TemplateView {
            name: self.exploration.frames[r.frame].name.clone(),
            camera_from_template: r.pose,
            gain,
            reprojection_px: self.reprojection_px[r.frame],
        };
        registered.iter().zip(gains).map(view).collect()
    }

    fn feature_view(&self, registered: &RegisteredFrame) -> FeatureView<'_> {
        let Features2d { points, descriptors, .. } = &self.features[registered.frame];
        FeatureView { posed: self.posed(registered), points, descriptors }
    }

    /// The vertices that one view sees, inside its mask.
    pub(super) fn visible(&self, registered: &RegisteredFrame, mesh: &Mesh) -> Vec<bool> {
        let camera = self.exploration.camera;
        let positions: Vec<Point3> = mesh.positions.iter().map(|p| registered.pose * p).collect();
        let raster = rasterize(camera, &mesh.topology, &positions);
        let nearest = raster.depth.iter().copied().fold(f64::INFINITY, f64::min);
        let tolerance = OCCLUSION_TOLERANCE * nearest;
        let mut visible = visible_vertices(camera, &mesh.topology, &positions, &raster, tolerance);
        if let Some(mask) = &self.usable[registered.frame] {
            for (seen, p) in visible.iter_mut().zip(&positions) {
                *seen &= camera.project(p).is_some_and(|q| mask.at_pixel(&q.pixel));
            }
        }
        visible
    }
}

fn seen_counts(topology: &Topology, visible: &[Vec<bool>]) -> Vec<u32> {
    let count = |v: usize| visible.iter().filter(|view| view[v]).count() as u32;
    (0..topology.vertex_count).map(count).collect()
}

/// The flattening, or a warning.
pub(super) fn try_flatten(
    mesh: &Mesh,
    options: &TemplateOptions,
    progress: &dyn Progress,
) -> Option<Flattening> {
    progress.step("flattening", 0, 1);
    let result = flatten(mesh, &options.flatten);
    progress.step("flattening", 1, 1);
    result.map_err(|error| progress.warn(&format!("the template has no flattening: {error}"))).ok()
}
