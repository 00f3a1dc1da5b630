//! From exploration frames to the template (paper §4, §5).
//!
//! ```text
//! frames ─► sfm ─► dense ─► remesh ─┐
//! frames, mesh, poses ──────────────┴► flatten ─► light, gains, albedo ─► features ─► Template
//! ```

use super::Progress;
use crate::camera::{Camera, CameraModel};
use crate::dense::{DenseError, DenseOptions, PosedFrame, depth_maps, surface};
use crate::geometry::{Isometry, Point3};
use crate::image::{ColorImage, Frame, Mask, ToneCurve, saturation, viewport};
use crate::light::LightModel;
use crate::mesh::remesh::{RemeshError, RemeshOptions, remesh};
use crate::mesh::{Mesh, Topology};
use crate::raster::{rasterize, visible_vertices};
use crate::sfm::{self, Features2d, SfmError, SfmOptions, SfmStage};
use crate::template::albedo::{AlbedoError, AlbedoOptions, estimate_albedo};
use crate::template::anchor::{AnchorOptions, FeatureView, anchor_features};
use crate::template::flatten::{FlattenOptions, flatten};
use crate::template::light_fit::{LightFit, LightFitOptions, fit_light};
use crate::template::photometric::AlbedoView;
use crate::template::{Flattening, LengthUnit, SurfaceTexels, Template, View};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The exploration: frames of the organ at rest, one camera.
#[derive(Clone, Copy, Debug)]
pub struct Exploration<'a> {
    /// Frames of one size, that of the camera.
    pub frames: &'a [Frame],
    /// `true` where a pixel may be used (viewport, no instrument); one per frame, or empty.
    pub valid: &'a [Option<Mask>],
    /// `true` where the organ is the first surface hit; one per frame, or empty.
    pub organ: &'a [Option<Mask>],
    /// Intrinsics of all frames.
    pub camera: &'a CameraModel,
    /// Tone curve of all frames.
    pub tone: &'a ToneCurve,
    /// Light of the camera file, if it names one: the start of its estimation.
    pub light: Option<&'a LightModel>,
}

/// Options of template building, one field per stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TemplateOptions {
    /// Vertices of the template mesh, 100 to 50,000; a given mesh keeps its own.
    pub vertices: usize,
    /// Structure from motion.
    pub sfm: SfmOptions,
    /// Multi-view stereo.
    pub dense: DenseOptions,
    /// Remeshing to `vertices`.
    pub remesh: RemeshOptions,
    /// Conformal flattening.
    pub flatten: FlattenOptions,
    /// Light estimation.
    pub light: LightFitOptions,
    /// Albedo (eqs. 1, 2).
    pub albedo: AlbedoOptions,
    /// Descriptors on the surface.
    pub anchor: AnchorOptions,
}

impl Default for TemplateOptions {
    fn default() -> Self {
        Self {
            vertices: 1000,
            sfm: SfmOptions::default(),
            dense: DenseOptions::default(),
            remesh: RemeshOptions::default(),
            flatten: FlattenOptions::default(),
            light: LightFitOptions::default(),
            albedo: AlbedoOptions::default(),
            anchor: AnchorOptions::default(),
        }
    }
}

/// A template and how it came about.
#[derive(Clone, Debug)]
pub struct BuiltTemplate {
    /// The template.
    pub template: Template,
    /// Name of every frame that was left out, and why.
    pub rejected: Vec<(String, String)>,
    /// The light and what else was tried; `None` where nothing could be measured.
    pub light: Option<LightFit>,
    /// Sparse points of structure from motion, template frame; empty for given poses.
    pub points: Vec<Point3>,
}

/// Why there is no template.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TemplateError {
    /// A field of the options out of its bounds.
    #[error("option {field} = {value}; expected {expected}")]
    Option {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: usize,
        /// The bounds.
        expected: &'static str,
    },
    /// No given pose belongs to a frame.
    #[error(
        "none of the {frames} frames has a pose in the pose file; poses are matched to frames by file name or number"
    )]
    NoPoses {
        /// Frames given.
        frames: usize,
    },
    /// Structure from motion failed.
    #[error("structure from motion: {0}")]
    Sfm(#[from] SfmError),
    /// Multi-view stereo failed.
    #[error("multi-view stereo: {0}")]
    Dense(#[from] DenseError),
    /// The stereo surface could not be remeshed.
    #[error("remeshing: {0}")]
    Remesh(#[from] RemeshError),
    /// Nothing to measure the albedo in.
    #[error("albedo: {0}")]
    Albedo(#[from] AlbedoError),
}

/// Build a template from frames alone. Its unit is [`LengthUnit::TemplateUnit`].
pub fn template_from_frames(
    exploration: &Exploration,
    options: &TemplateOptions,
    progress: &dyn Progress,
) -> Result<BuiltTemplate, TemplateError> {
    check(options)?;
    let valid = valid_masks(exploration, &options.sfm);
    let exploration = &Exploration { valid: &valid, ..*exploration };
    let usable = usable_masks(exploration);
    let report = |stage, done, total| progress.step(sfm_stage(stage), done, total);
    let sparse =
        sfm::reconstruct(exploration.frames, &usable, exploration.camera, &options.sfm, &report)?;
    let points: Vec<Point3> = sparse.points.iter().map(|p| p.position).collect();
    let mesh = dense_mesh(exploration, &sparse.camera, &sparse.poses, &points, options, progress)?;
    let views = Views {
        exploration: &Exploration { camera: &sparse.camera, ..*exploration },
        usable: &usable,
        poses: &sparse.poses,
        reprojection_px: &sparse.reprojection_px,
        features: &sparse.features,
    };
    let (template, light) = views.dress(mesh, LengthUnit::TemplateUnit, options, progress)?;
    let name = |(i, why): &(usize, String)| (exploration.frames[*i].name.clone(), why.clone());
    let rejected = sparse.rejected.iter().map(name).collect();
    Ok(BuiltTemplate { template, rejected, light, points })
}

/// Build a template on a given mesh, whose frame is the world of the given poses
/// (`camera_from_world`, `None` for frames to leave out). The mesh is kept as it is.
pub fn template_from_posed_frames(
    exploration: &Exploration,
    mesh: Mesh,
    unit: LengthUnit,
    poses: &[Option<Isometry>],
    options: &TemplateOptions,
    progress: &dyn Progress,
) -> Result<BuiltTemplate, TemplateError> {
    if poses.iter().flatten().next().is_none() {
        return Err(TemplateError::NoPoses { frames: exploration.frames.len() });
    }
    let valid = valid_masks(exploration, &options.sfm);
    let exploration = &Exploration { valid: &valid, ..*exploration };
    let usable = usable_masks(exploration);
    let count = exploration.frames.len();
    let features: Vec<Features2d> = (0..count)
        .map(|i| {
            let mask = usable.get(i).and_then(Option::as_ref);
            let found = sfm::detect(&exploration.frames[i], mask, &options.sfm);
            progress.step("features", i + 1, count);
            found
        })
        .collect();
    let views = Views {
        exploration,
        usable: &usable,
        poses,
        reprojection_px: &vec![0.0; count],
        features: &features,
    };
    let (template, light) = views.dress(mesh, unit, options, progress)?;
    let rejected = (0..count)
        .filter(|&i| poses[i].is_none())
        .map(|i| (exploration.frames[i].name.clone(), "the pose file has no pose for it".into()))
        .collect();
    Ok(BuiltTemplate { template, rejected, light, points: Vec::new() })
}

/// A template of a mesh and, where it is known, its albedo: no frames, no descriptors.
pub fn template_from_mesh(
    mesh: Mesh,
    unit: LengthUnit,
    albedo: Option<SurfaceTexels>,
    options: &TemplateOptions,
    progress: &dyn Progress,
) -> Template {
    let flattening = try_flatten(&mesh, options, progress);
    Template {
        unit,
        mesh,
        seen: Vec::new(),
        flattening,
        albedo,
        features: None,
        views: Vec::new(),
        camera: None,
        tone: ToneCurve::default(),
        light: None,
    }
}

fn check(options: &TemplateOptions) -> Result<(), TemplateError> {
    let value = options.vertices;
    if (100..=50_000).contains(&value) {
        return Ok(());
    }
    Err(TemplateError::Option { field: "vertices", value, expected: "100 to 50,000" })
}

fn sfm_stage(stage: SfmStage) -> &'static str {
    match stage {
        SfmStage::Features => "features",
        SfmStage::Matching => "matching",
        SfmStage::Registration => "camera poses",
        SfmStage::GuidedMatching => "guided matching",
    }
}

/// The given valid masks inside the viewport, which holds for every stage: its rim moves with the
/// camera and what lies beyond it is black, neither of which is tissue.
fn valid_masks(exploration: &Exploration, options: &SfmOptions) -> Vec<Option<Mask>> {
    let lit = if options.find_viewport { viewport(exploration.frames) } else { None };
    let one = |i: usize| match (exploration.valid.get(i).and_then(Option::as_ref), &lit) {
        // A mask of another size is for the stages to refuse, by name.
        (Some(own), Some(lit)) if own.size == lit.size => Some(own.and(lit)),
        (Some(own), _) => Some(own.clone()),
        (None, lit) => lit.clone(),
    };
    (0..exploration.frames.len()).map(one).collect()
}

/// Where a frame is both valid and organ.
fn usable_masks(exploration: &Exploration) -> Vec<Option<Mask>> {
    let of = |masks: &[Option<Mask>], i: usize| masks.get(i).cloned().flatten();
    (0..exploration.frames.len())
        .map(|i| match (of(exploration.valid, i), of(exploration.organ, i)) {
            (Some(valid), Some(organ)) => Some(valid.and(&organ)),
            (valid, organ) => valid.or(organ),
        })
        .collect()
}

fn dense_mesh(
    exploration: &Exploration,
    camera: &CameraModel,
    poses: &[Option<Isometry>],
    points: &[Point3],
    options: &TemplateOptions,
    progress: &dyn Progress,
) -> Result<Mesh, TemplateError> {
    let posed: Vec<PosedFrame> = poses
        .iter()
        .enumerate()
        .filter_map(|(i, pose)| {
            Some(PosedFrame {
                frame: &exploration.frames[i],
                camera,
                pose: (*pose)?,
                valid: exploration.valid.get(i).and_then(Option::as_ref),
                organ: exploration.organ.get(i).and_then(Option::as_ref),
            })
        })
        .collect();
    let report = |done, total| progress.step("stereo", done, total);
    let maps = depth_maps(&posed, points, &options.dense, &report)?;
    progress.step("surface", 0, 2);
    let fine = surface(&posed, &maps, &options.dense)?;
    progress.step("surface", 1, 2);
    let mesh = remesh(&fine.mesh, options.vertices, &options.remesh)?;
    progress.step("surface", 2, 2);
    Ok(mesh)
}

fn try_flatten(
    mesh: &Mesh,
    options: &TemplateOptions,
    progress: &dyn Progress,
) -> Option<Flattening> {
    progress.step("flattening", 0, 1);
    let result = flatten(mesh, &options.flatten);
    progress.step("flattening", 1, 1);
    result.map_err(|error| progress.warn(&format!("the template has no flattening: {error}"))).ok()
}

/// Registered frames, with all that is measured in them. One entry per frame in every list.
struct Views<'a> {
    exploration: &'a Exploration<'a>,
    usable: &'a [Option<Mask>],
    poses: &'a [Option<Isometry>],
    reprojection_px: &'a [f64],
    features: &'a [Features2d],
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
    fn dress(
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
            camera: Some(self.exploration.camera.clone()),
            tone: self.exploration.tone.clone(),
            light: Some(light.light.clone()),
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
