//! Templates on a mesh that is given.

use super::BuiltTemplate;
use super::error::TemplateError;
use super::exploration::Exploration;
use super::masks::{usable_masks, valid_masks};
use super::options::TemplateOptions;
use super::views::{Views, try_flatten};
use crate::geometry::Isometry;
use crate::image::ToneCurve;
use crate::light::Coat;
use crate::mesh::Mesh;
use crate::pipeline::Progress;
use crate::sfm::{self, Features2d, NoPose, SfmError};
use crate::template::{LengthUnit, SurfaceTexels, Template};

/// Build a template on a given mesh, whose frame is the world of the given poses
/// (`camera_from_world`, `None` for frames to leave out). The mesh is kept as it is.
///
/// ```
/// use dsfms::{Exploration, LengthUnit, Silent, TemplateOptions};
/// use dsfms::{pipeline::template_from_posed_frames, synth::Case};
///
/// let case = Case::example(1);
/// let (frames, poses) = case.explore(2);
/// let poses: Vec<_> = poses.into_iter().map(Some).collect();
/// let exploration = Exploration::new(&frames, &case.camera);
/// let (mesh, unit) = (case.template.mesh.clone(), LengthUnit::Millimetre);
/// let options = TemplateOptions::default();
/// let built = template_from_posed_frames(&exploration, mesh, unit, &poses, &options, &Silent)?;
/// assert!(built.template.features.is_some());
/// # Ok::<_, dsfms::pipeline::TemplateError>(())
/// ```
///
/// # Errors
/// Options out of their bounds, no pose, nothing to measure the albedo in.
pub fn template_from_posed_frames(
    exploration: &Exploration,
    mesh: Mesh,
    unit: LengthUnit,
    poses: &[Option<Isometry>],
    options: &TemplateOptions,
    progress: &dyn Progress,
) -> Result<BuiltTemplate, TemplateError> {
    options.validate()?;
    if poses.iter().flatten().next().is_none() {
        return Err(TemplateError::NoPoses { frames: exploration.frames.len() });
    }
    let (found, frames) = (poses.len(), exploration.frames.len());
    if found != frames {
        return Err(SfmError::Count { what: "poses", found, frames }.into());
    }
    let valid = valid_masks(exploration, &options.sfm)?;
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
    let (template, light) = views.dress(mesh, None, unit, options, progress)?;
    let rejected = (0..count)
        .filter(|&i| poses[i].is_none())
        .map(|i| (exploration.frames[i].name.clone(), NoPose::NotGiven))
        .collect();
    Ok(BuiltTemplate {
        template,
        rejected,
        models: Vec::new(),
        light,
        scale: None,
        precision: None,
        organ: None,
        organ_scene: None,
    })
}

/// A template of a mesh and, where it is known, its albedo: no frames, no descriptors.
///
/// ```
/// use dsfms::pipeline::template_from_mesh;
/// use dsfms::{LengthUnit, Silent, TemplateOptions, synth::patch};
///
/// let organ = patch(60, 1);
/// let (unit, options) = (LengthUnit::Millimetre, TemplateOptions::default());
/// let template = template_from_mesh(organ.mesh, unit, Some(organ.albedo), &options, &Silent);
/// assert!(template.flattening.is_some());
/// ```
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
        sigma: Vec::new(),
        flattening,
        albedo,
        features: None,
        views: Vec::new(),
        points: Vec::new(),
        camera: None,
        tone: ToneCurve::default(),
        light: None,
        coat: Coat::default(),
        usual: None,
        surroundings: None,
    }
}
