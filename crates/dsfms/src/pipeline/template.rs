//! From exploration frames to the template (paper §4, §5).
//!
//! ```text
//! frames ─► sfm ─► dense ─► remesh ─┐      (sfm: with known poses, triangulation alone)
//! frames, mesh, poses ──────────────┴► flatten ─► light, gains, albedo ─► features ─► Template
//! ```

mod also;
mod click;
mod error;
mod exploration;
mod found_organ;
mod given;
mod guess;
mod kept;
mod masks;
mod options;
mod organ;
mod organ_scene;
mod outline;
mod precision;
mod registered;
mod strokes;
mod surface;
mod usual;
mod views;

pub use click::OrganClick;
pub use error::TemplateError;
pub use exploration::Exploration;
pub use found_organ::FoundOrgan;
pub use given::{template_from_mesh, template_from_posed_frames};
pub use guess::OrganGuess;
pub use options::TemplateOptions;
pub use organ::{Organ, OrganOptions};
pub use organ_scene::{OrganScene, OrganSceneError};
pub use outline::OrganOutline;
pub use precision::{FramePrecision, SparsePrecision};
pub use strokes::{
    OrganStroke, StrokeError, drawn_from, read_strokes, strokes_from, write_strokes,
};

use super::{Progress, logging};
use crate::camera::CameraModel;
use crate::checkpoint::Keep;
use crate::geometry::{Isometry, Point3};
use crate::image::Mask;
use crate::mesh::Mesh;
use crate::preoperative::scale_on_surface;
use crate::sfm::{self, FoundModel, NoPose, SfmStage};
use crate::template::light_fit::LightFit;
use crate::template::scale::{Scale, ScaleError, ScaleScene, find_scale};
use crate::template::{LengthUnit, SparsePoint, Template};
use masks::{usable_masks, valid_masks};
use registered::named;
use surface::{StereoSurface, dense_mesh};
use views::Views;

/// A template and how it came about.
#[derive(Clone, Debug)]
pub struct BuiltTemplate {
    /// The template.
    pub template: Template,
    /// Name of every frame that was left out, and why.
    pub rejected: Vec<(String, NoPose)>,
    /// The models that the frames fell into, the kept one first (indices count the frames given);
    /// empty for given poses.
    pub models: Vec<FoundModel>,
    /// The light and what else was tried; `None` where nothing could be measured.
    pub light: Option<LightFit>,
    /// The scale that was applied; `None` without known distances, or where none could be measured.
    pub scale: Option<Scale>,
    /// How far cameras and sparse points may be off; `None` for given poses, and where too few
    /// sightings tell.
    pub precision: Option<SparsePrecision>,
    /// The organ as the frames themselves part it from what lies behind; `None` where the user said
    /// where it is in every frame, wants all, gave the surface, or where nothing parts.
    pub organ: Option<FoundOrgan>,
    /// By what the organ was told, for other strokes; `None` where the frames were not asked.
    pub organ_scene: Option<OrganScene>,
}

/// Build a template from frames alone. Its unit is [`LengthUnit::TemplateUnit`], or mm where the
/// options hold known distances.
///
/// ```no_run
/// use dsfms::{CameraInput, Silent, TemplateOptions, find_frames, read_frames, template_from_frames};
///
/// let camera = CameraInput::read("camera.json".as_ref(), None)?;
/// let frames = read_frames(&find_frames(&["exploration".into()])?)?;
/// let exploration = camera.exploration(&frames);
/// let built = template_from_frames(&exploration, &TemplateOptions::default(), &Silent)?;
/// assert!(built.template.albedo.is_some());
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
/// `examples/1_template.rs` runs it on rendered frames.
///
/// # Errors
/// Options out of their bounds, too few frames that agree on a scene, no surface, an outline or
/// click beside it.
pub fn template_from_frames(
    exploration: &Exploration,
    options: &TemplateOptions,
    progress: &dyn Progress,
) -> Result<BuiltTemplate, TemplateError> {
    options.validate()?;
    let valid = valid_masks(exploration, &options.sfm)?;
    let exploration = &Exploration { valid: &valid, ..*exploration };
    let usable = usable_masks(exploration);
    let report = |stage, done, total| progress.step(sfm_stage(stage), done, total);
    let Exploration { frames, camera, .. } = *exploration;
    let keep =
        exploration.keep.with(|key| kept::sparse_key(key, exploration, &usable, &options.sfm));
    let sparse = sfm::reconstruct_kept(frames, &usable, camera, &options.sfm, &report, keep)?;
    from_sparse(exploration, &usable, sparse, options, progress, keep)
}

/// Build a template from frames whose poses are known (`camera_from_world`, `None` for frames to
/// leave out) but whose surface is not: neither poses nor intrinsics are changed, and the mesh is
/// in the poses' world and unit. Its unit is called [`LengthUnit::TemplateUnit`] unless the options
/// hold known distances.
///
/// ```no_run
/// use dsfms::io::poses::{PoseList, match_poses, read_poses};
/// use dsfms::{CameraInput, Silent, TemplateOptions, find_frames, pipeline::template_from_poses, read_frames};
///
/// let camera = CameraInput::read("camera.json".as_ref(), None)?;
/// let frames = read_frames(&find_frames(&["exploration".into()])?)?;
/// let names: Vec<&str> = frames.iter().map(|f| f.name.as_str()).collect();
/// let poses = match_poses(&read_poses("poses.json".as_ref(), PoseList::Exploration)?, &names);
/// let exploration = camera.exploration(&frames);
/// let built = template_from_poses(&exploration, &poses, &TemplateOptions::default(), &Silent)?;
/// # Ok::<_, Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// As [`template_from_frames`]; fewer than two poses, or none that the frames agree with.
pub fn template_from_poses(
    exploration: &Exploration,
    poses: &[Option<Isometry>],
    options: &TemplateOptions,
    progress: &dyn Progress,
) -> Result<BuiltTemplate, TemplateError> {
    options.validate()?;
    if poses.iter().flatten().count() < 2 {
        return Err(TemplateError::TooFewPoses {
            found: poses.iter().flatten().count(),
            frames: exploration.frames.len(),
        });
    }
    let valid = valid_masks(exploration, &options.sfm)?;
    let exploration = &Exploration { valid: &valid, ..*exploration };
    let usable = usable_masks(exploration);
    let report = |stage, done, total| progress.step(sfm_stage(stage), done, total);
    let Exploration { frames, camera, .. } = *exploration;
    let keep = exploration.keep.with(|key| {
        kept::sparse_key(key, exploration, &usable, &options.sfm);
        key.value(&poses);
    });
    let known = &options.sfm;
    let sparse = sfm::triangulate_known(frames, &usable, camera, poses, known, &report, keep)?;
    if sparse.points.is_empty() {
        return Err(TemplateError::NoPoints { frames: sparse.registered() });
    }
    from_sparse(exploration, &usable, sparse, options, progress, keep)
}

/// From poses and points to the template: surface, scale, albedo, descriptors. `usable`: one per
/// frame.
fn from_sparse(
    exploration: &Exploration,
    usable: &[Option<Mask>],
    mut sparse: sfm::SparseReconstruction,
    options: &TemplateOptions,
    progress: &dyn Progress,
    keep: Keep,
) -> Result<BuiltTemplate, TemplateError> {
    logging::sparse(exploration.frames, &sparse, &options.sfm, progress);
    let keep = keep.with(|key| kept::dense_key(key, exploration, options));
    let points: Vec<Point3> = sparse.points.iter().map(|p| p.position).collect();
    let StereoSurface { mut mesh, mut sigma, mut told } =
        dense_mesh(exploration, &sparse, &points, options, progress, keep)?;
    // Reconstruction took long: a mark beside the surface costs the unit, not the template.
    let scale = measure(exploration, &sparse.camera, &sparse.poses, &mesh, options).unwrap_or_else(
        |error| {
            progress.warn(&format!("scale: {error}; lengths stay in template units"));
            None
        },
    );
    let unit = match &scale {
        Some(scale) => {
            tracing::info!(factor = scale.factor, "scale");
            apply(scale.factor, &mut mesh, &mut sparse);
            told.around.iter_mut().flat_map(|m| &mut m.positions).for_each(|p| *p *= scale.factor);
            sigma.iter_mut().for_each(|s| *s *= scale.factor);
            LengthUnit::Millimetre
        }
        None => LengthUnit::TemplateUnit,
    };
    let views = Views {
        exploration: &Exploration { camera: &sparse.camera, ..*exploration },
        usable,
        poses: &sparse.poses,
        reprojection_px: &sparse.reprojection_px,
        features: &sparse.features,
    };
    let (mut template, light) = views.dress(mesh, Some(&sigma), unit, options, progress)?;
    template.points = sparse_points(&sparse);
    template.sigma = sigma;
    template.surroundings = told
        .around
        .zip(told.organ.as_ref())
        .map(|(mesh, organ)| views.around(mesh, organ, &options.anchor));
    let name = |(i, why): &(usize, NoPose)| (exploration.frames[*i].name.clone(), why.clone());
    let rejected = sparse.rejected.iter().map(name).collect();
    let covariance = sparse.covariance(options.sfm.refine).ok();
    let precision = covariance.map(|c| SparsePrecision::of(&c, &sparse, exploration.frames, unit));
    Ok(BuiltTemplate {
        template,
        rejected,
        models: sparse.models,
        light,
        scale,
        precision,
        organ: told.organ,
        organ_scene: told.scene,
    })
}

/// The scale that the known distances, or else the metric surface, ask for.
fn measure(
    exploration: &Exploration,
    camera: &CameraModel,
    poses: &[Option<Isometry>],
    mesh: &Mesh,
    options: &TemplateOptions,
) -> Result<Option<Scale>, ScaleError> {
    let poses = named(exploration.frames, poses);
    let known = find_scale(&ScaleScene { mesh, camera, poses: &poses }, &options.scale)?;
    match (known, exploration.metric) {
        (None, Some(metric)) => scale_on_surface(mesh, metric).map(Some),
        (known, _) => Ok(known),
    }
}

/// Everything in a new unit. Light and albedo are measured later, so that a light whose place is
/// known in mm meets a surface in mm.
fn apply(factor: f64, mesh: &mut Mesh, sparse: &mut sfm::SparseReconstruction) {
    mesh.positions.iter_mut().for_each(|p| *p *= factor);
    sparse.points.iter_mut().for_each(|p| p.position *= factor);
    for pose in sparse.poses.iter_mut().flatten() {
        pose.translation.vector *= factor;
    }
}

/// Points with their sightings counted in registered frames, as [`Template::views`] are.
fn sparse_points(sparse: &sfm::SparseReconstruction) -> Vec<SparsePoint> {
    let mut view = vec![0; sparse.poses.len()];
    let registered = view.iter_mut().zip(&sparse.poses).filter(|(_, pose)| pose.is_some());
    for (next, (view, _)) in (0..).zip(registered) {
        *view = next;
    }
    let point = |p: &sfm::ScenePoint| SparsePoint {
        position: p.position,
        rgb: p.rgb,
        error_px: p.error_px,
        sightings: p.track.iter().map(|t| (view[t.frame], t.pixel)).collect(),
    };
    sparse.points.iter().map(point).collect()
}

fn sfm_stage(stage: SfmStage) -> &'static str {
    match stage {
        SfmStage::Features => "features",
        SfmStage::Matching => "matching",
        SfmStage::Registration => "camera poses",
        SfmStage::GuidedMatching => "guided matching",
        SfmStage::OpticalFlow => "optical flow",
    }
}
