//! Everything on the surface that comes from the registered frames.

use super::{Exploration, TemplateError, TemplateOptions, try_flatten};
use crate::camera::Camera;
use crate::geometry::{Isometry, Point3};
use crate::image::{ColorImage, Mask, saturation};
use crate::mesh::{Mesh, Topology};
use crate::pipeline::Progress;
use crate::raster::{rasterize, visible_vertices};
use crate::sfm::Features2d;
use crate::template::albedo::{AlbedoOptions, estimate_albedo};
use crate::template::anchor::{FeatureView, anchor_features};
use crate::template::light_fit::{LightFit, fit_light};
use crate::template::photometric::AlbedoView;
use crate::template::{LengthUnit, Template, View};
use rayon::prelude::*;

/// Registered frames, with all that is measured in them. One entry per frame in every list.
pub(super) struct Views<'a> {
    pub exploration: &'a Exploration<'a>,
    pub usable: &'a [Option<Mask>],
    pub poses: &'a [Option<Isometry>],
    pub reprojection_px: &'a [f64],
    pub features: &'a [Features2d],
}

/// A registered frame prepared for measuring.
struct Prepared {
    frame: usize,
    pose: Isometry,
    image: ColorImage,
    saturated: Mask,
}

impl Views<'_> {
    /// Everything on the surface that comes from the frames.
    pub fn dress(
        &self,
        mesh: Mesh,
        unit: LengthUnit,
        options: &TemplateOptions,
        progress: &dyn Progress,
    ) -> Result<(Template, Option<LightFit>), TemplateError> {
        let flattening = try_flatten(&mesh, options, progress);
        let prepared = self.prepare();
        progress.step("light and albedo", 0, 2);
        let views: Vec<AlbedoView> = prepared.iter().map(|p| self.albedo_view(p)).collect();
        let light = fit_light(&mesh, &views, self.exploration.light, &options.light)?;
        progress.step("light and albedo", 1, 2);
        let shading = AlbedoOptions { ambient: light.ambient, ..options.albedo.clone() };
        let albedo = estimate_albedo(&mesh, &views, &light.light, &shading)?;
        progress.step("light and albedo", 2, 2);
        let features = anchor_features(&mesh, &self.feature_views(&prepared), &options.anchor);
        let visible: Vec<Vec<bool>> = prepared.par_iter().map(|p| self.visible(p, &mesh)).collect();
        let template = Template {
            unit,
            seen: seen_counts(&mesh.topology, &visible),
            flattening,
            albedo: Some(albedo.texels),
            features: Some(features),
            views: self.registered(&prepared, &albedo.gains),
            points: Vec::new(),
            camera: Some(self.exploration.camera.clone()),
            tone: self.exploration.tone.clone(),
            light: Some(light.light.clone()),
            coat: shading.coat(),
            mesh,
        };
        Ok((template, Some(light)))
    }

    fn prepare(&self) -> Vec<Prepared> {
        let one = |(i, pose): (usize, &Option<Isometry>)| {
            let frame = &self.exploration.frames[i];
            Some(Prepared {
                frame: i,
                pose: (*pose)?,
                image: frame.linear(self.exploration.tone),
                saturated: saturation(frame),
            })
        };
        self.poses.iter().enumerate().filter_map(one).collect()
    }

    fn albedo_view<'p>(&'p self, prepared: &'p Prepared) -> AlbedoView<'p> {
        AlbedoView {
            image: &prepared.image,
            saturation: &prepared.saturated,
            valid: self.usable[prepared.frame].as_ref(),
            camera: self.exploration.camera,
            pose: prepared.pose,
            gain: 1.0,
        }
    }

    fn registered(&self, prepared: &[Prepared], gains: &[f64]) -> Vec<View> {
        let view = |(p, &gain): (&Prepared, &f64)| View {
            name: self.exploration.frames[p.frame].name.clone(),
            camera_from_template: p.pose,
            gain,
            reprojection_px: self.reprojection_px[p.frame],
        };
        prepared.iter().zip(gains).map(view).collect()
    }

    fn feature_views<'p>(&'p self, prepared: &'p [Prepared]) -> Vec<FeatureView<'p>> {
        let view = |p: &'p Prepared| FeatureView {
            camera: self.exploration.camera,
            pose: p.pose,
            valid: self.usable[p.frame].as_ref(),
            points: &self.features[p.frame].points,
            descriptors: &self.features[p.frame].descriptors,
        };
        prepared.iter().map(view).collect()
    }

    /// The vertices that one view sees, inside its mask.
    fn visible(&self, prepared: &Prepared, mesh: &Mesh) -> Vec<bool> {
        let camera = self.exploration.camera;
        let positions: Vec<Point3> = mesh.positions.iter().map(|p| prepared.pose * p).collect();
        let raster = rasterize(camera, &mesh.topology, &positions);
        let nearest = raster.depth.iter().copied().fold(f64::INFINITY, f64::min);
        let tolerance = OCCLUSION_TOLERANCE * nearest;
        let mut visible = visible_vertices(camera, &mesh.topology, &positions, &raster, tolerance);
        if let Some(mask) = &self.usable[prepared.frame] {
            for (seen, p) in visible.iter_mut().zip(&positions) {
                *seen &= camera.project(p).is_some_and(|q| mask.at_pixel(&q.pixel));
            }
        }
        visible
    }
}

/// A vertex counts as seen when it lies within this of the z-buffer, relative to the depth.
const OCCLUSION_TOLERANCE: f64 = 0.01;

fn seen_counts(topology: &Topology, visible: &[Vec<bool>]) -> Vec<u32> {
    let count = |v: usize| visible.iter().filter(|view| view[v]).count() as u32;
    (0..topology.vertex_count).map(count).collect()
}
