//! From exploration frames to the template (paper §4, §5).
//!
//! ```text
//! frames ─► sfm ─► dense ─► remesh ─┐      (sfm: with known poses, triangulation alone)
//! frames, mesh, poses ──────────────┴► flatten ─► light, gains, albedo ─► features ─► Template
//! ```

mod also;
mod click;
mod error;
mod organ;
mod outline;
mod precision;
mod strokes;
mod surface;
mod usual;
mod views;

pub use click::OrganClick;
pub use error::TemplateError;
pub use organ::{FoundOrgan, OrganGuess};
pub use outline::OrganOutline;
pub use precision::{FramePrecision, SparsePrecision};
pub use strokes::{OrganStroke, StrokeError, read_strokes, strokes_from, write_strokes};

use super::Progress;
use crate::camera::CameraModel;
use crate::dense::DenseOptions;
use crate::geometry::{Isometry, Point3};
use crate::image::{Frame, Mask, ToneCurve, viewport};
use crate::light::{Coat, LightModel};
use crate::mesh::Mesh;
use crate::mesh::remesh::RemeshOptions;
use crate::options::{Documented, check, commented, from_zero, positive};
use crate::sfm::{self, Features2d, FoundModel, SfmOptions, SfmStage};
use crate::template::albedo::AlbedoOptions;
use crate::template::anchor::AnchorOptions;
use crate::template::flatten::{FlattenOptions, flatten};
use crate::template::light_fit::{LightFit, LightFitOptions};
use crate::template::scale::{Scale, ScaleError, ScaleReference, ScaleScene, find_scale};
use crate::template::scale_mesh::fit_to_mesh;
use crate::template::{Flattening, LengthUnit, SparsePoint, SurfaceTexels, Template};
use serde::{Deserialize, Serialize};
use surface::{Surface, dense_mesh};
use views::Views;

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
    /// A surface of the organ in mm, in any place: it gives a template from frames its scale.
    pub metric: Option<&'a Mesh>,
    /// Frames of the deformed organ, by the same camera: what moves apart in them is apart.
    pub also: &'a [Frame],
}

impl<'a> Exploration<'a> {
    /// Frames of one camera: every pixel may be used and show the organ, sRGB, nothing known of light and
    /// scale.
    ///
    /// ```
    /// use dsfms::{Exploration, synth::Case};
    ///
    /// let case = Case::example(1);
    /// let (frames, _) = case.explore(2);
    /// let exploration = Exploration::new(&frames, &case.camera).light(case.template.light.as_ref());
    /// assert!(exploration.valid.is_empty() && exploration.light.is_some());
    /// ```
    pub fn new(frames: &'a [Frame], camera: &'a CameraModel) -> Self {
        let tone = &ToneCurve::Srgb;
        Self { frames, valid: &[], organ: &[], camera, tone, light: None, metric: None, also: &[] }
    }

    /// With masks of the pixels that may be used; one per frame, or empty.
    pub fn valid(self, valid: &'a [Option<Mask>]) -> Self {
        Self { valid, ..self }
    }

    /// With masks of the organ; one per frame, or empty.
    pub fn organ(self, organ: &'a [Option<Mask>]) -> Self {
        Self { organ, ..self }
    }

    /// With another tone curve than sRGB.
    pub fn tone(self, tone: &'a ToneCurve) -> Self {
        Self { tone, ..self }
    }

    /// With the light that its estimation starts from.
    pub fn light(self, light: impl Into<Option<&'a LightModel>>) -> Self {
        Self { light: light.into(), ..self }
    }

    /// With frames of the deformed organ, which help to tell it from what stays.
    pub fn also(self, also: &'a [Frame]) -> Self {
        Self { also, ..self }
    }

    /// With a surface of the organ in mm, which tells the scale.
    pub fn metric(self, metric: impl Into<Option<&'a Mesh>>) -> Self {
        Self { metric: metric.into(), ..self }
    }
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
    /// Flip edges of the remeshed surface where the other diagonal of their two faces lies closer to
    /// what stereo saw ([`crate::mesh::remesh::fit_diagonals`]).
    pub fit_diagonals: bool,
    /// Conformal flattening.
    pub flatten: FlattenOptions,
    /// The organ as outlined on frames; empty = masks alone say what is organ.
    pub outlines: Vec<OrganOutline>,
    /// A pixel that shows the organ: the connected surface there stays.
    pub click: Option<OrganClick>,
    /// Pixels that show the organ, and such that do not, as drawn on frames.
    pub strokes: Vec<OrganStroke>,
    /// Refine the surface of stereo by the shading of all views.
    pub refine_by_shading: bool,
    /// Keep what lies behind the organ too, where depth steps and no mask, outline or click tells them
    /// apart.
    pub whole: bool,
    /// Known distances; without any the unit of a template from frames is not metric.
    pub scale: Vec<ScaleReference>,
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
            fit_diagonals: true,
            flatten: FlattenOptions::default(),
            outlines: Vec::new(),
            click: None,
            strokes: Vec::new(),
            refine_by_shading: true,
            whole: false,
            scale: Vec::new(),
            light: LightFitOptions::default(),
            albedo: AlbedoOptions::default(),
            anchor: AnchorOptions::default(),
        }
    }
}

impl TemplateOptions {
    /// Options from TOML; what the text does not name keeps its default.
    ///
    /// # Errors
    /// Malformed TOML, a field that does not exist, or one out of its bounds.
    pub fn from_toml(text: &str) -> Result<Self, toml::de::Error> {
        let options: Self = toml::from_str(text)?;
        options.validate().map_err(serde::de::Error::custom)?;
        Ok(options)
    }

    /// The defaults as TOML, every field under its documentation.
    pub fn commented() -> String {
        commented(&Self::default(), &TABLES)
    }

    /// Check every field against its bounds; outlines, clicks and distances are checked against the
    /// frames.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), TemplateError> {
        let Self { vertices, remesh, flatten, light, albedo, anchor, .. } = self;
        let anchoring = [anchor.merge_px, anchor.merge_deg, anchor.contour_px, anchor.grazing_cos];
        check(&[
            ("strokes", self.strokes.iter().all(OrganStroke::is_sound), "places near the frames"),
            ("vertices", (100..=50_000).contains(vertices), "100 to 50,000"),
            ("remesh.rounds", remesh.rounds >= 1, "at least 1"),
            (
                "remesh.corner_deg",
                remesh.corner_deg > 0.0 && remesh.corner_deg <= 180.0,
                "above 0 and at most 180",
            ),
            ("remesh.adaptive", (0.0..=1.0).contains(&remesh.adaptive), "from 0 to 1"),
            (
                "flatten.max_area_ratio",
                flatten.max_area_ratio > 1.0 && flatten.max_area_ratio.is_finite(),
                "a number above 1",
            ),
            ("light.spots", light.spots >= 100, "at least 100"),
            (
                "light.gain_sigma, offset_sigma",
                positive(&[light.gain_sigma, light.offset_sigma]),
                "positive",
            ),
            ("light.refractive_index", light.refractive_index >= 1.0, "at least 1"),
            ("albedo.texels_per_px", positive(&[albedo.texels_per_px]), "positive"),
            ("albedo.max_resolution", (1..=256).contains(&albedo.max_resolution), "from 1 to 256"),
            ("albedo.max_texels", albedo.max_texels >= 1, "at least 1"),
            ("albedo.gain_sigma", positive(&[albedo.gain_sigma]), "positive"),
            ("albedo.refractive_index", albedo.refractive_index >= 1.0, "at least 1"),
            (
                "anchor.merge_px, merge_deg, contour_px, grazing_cos",
                from_zero(&anchoring),
                "0 or more",
            ),
        ])?;
        self.sfm.validate()?;
        Ok(self.dense.validate()?)
    }
}

/// Where the fields of the options are documented.
const TABLES: [Documented; 11] = [
    ("", include_str!("template.rs"), "TemplateOptions"),
    ("sfm", include_str!("../sfm/options.rs"), "SfmOptions"),
    ("sfm.refine", include_str!("../sfm/intrinsics.rs"), "RefineIntrinsics"),
    ("dense", include_str!("../dense/options.rs"), "DenseOptions"),
    ("remesh", include_str!("../mesh/remesh.rs"), "RemeshOptions"),
    ("flatten", include_str!("../template/flatten.rs"), "FlattenOptions"),
    ("light", include_str!("../template/light_fit.rs"), "LightFitOptions"),
    ("light.bounds", include_str!("../template/photometric.rs"), "ObservationBounds"),
    ("albedo", include_str!("../template/albedo.rs"), "AlbedoOptions"),
    ("albedo.bounds", include_str!("../template/photometric.rs"), "ObservationBounds"),
    ("anchor", include_str!("../template/anchor.rs"), "AnchorOptions"),
];

/// A template and how it came about.
#[derive(Clone, Debug)]
pub struct BuiltTemplate {
    /// The template.
    pub template: Template,
    /// Name of every frame that was left out, and why.
    pub rejected: Vec<(String, String)>,
    /// The models that the frames fell into, the kept one first (indices count the frames given);
    /// empty for given poses.
    pub models: Vec<FoundModel>,
    /// The light and what else was tried; `None` where nothing could be measured.
    pub light: Option<LightFit>,
    /// The scale that was applied; `None` without known distances, or where none could be measured.
    pub scale: Option<Scale>,
    /// How far cameras and sparse points may be off; `None` for given poses, and where too few sightings
    /// tell.
    pub precision: Option<SparsePrecision>,
    /// The organ as the frames themselves part it from what lies behind; `None` where the user said where it is
    /// in every frame, wants all, gave the surface, or where nothing parts.
    pub organ: Option<FoundOrgan>,
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
/// Options out of their bounds, too few frames that agree on a scene, no surface, an outline or click
/// beside it.
pub fn template_from_frames(
    exploration: &Exploration,
    options: &TemplateOptions,
    progress: &dyn Progress,
) -> Result<BuiltTemplate, TemplateError> {
    options.validate()?;
    let valid = valid_masks(exploration, &options.sfm);
    let exploration = &Exploration { valid: &valid, ..*exploration };
    let usable = usable_masks(exploration);
    let report = |stage, done, total| progress.step(sfm_stage(stage), done, total);
    let sparse =
        sfm::reconstruct(exploration.frames, &usable, exploration.camera, &options.sfm, &report)?;
    from_sparse(exploration, &usable, sparse, options, progress)
}

/// Build a template from frames whose poses are known (`camera_from_world`, `None` for frames to leave
/// out) but whose surface is not: neither poses nor intrinsics are changed, and the mesh is in the poses'
/// world and unit. Its unit is called [`LengthUnit::TemplateUnit`] unless the options hold known distances.
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
    let valid = valid_masks(exploration, &options.sfm);
    let exploration = &Exploration { valid: &valid, ..*exploration };
    let usable = usable_masks(exploration);
    let report = |stage, done, total| progress.step(sfm_stage(stage), done, total);
    let (frames, camera) = (exploration.frames, exploration.camera);
    let sparse = sfm::triangulate_known(frames, &usable, camera, poses, &options.sfm, &report)?;
    if sparse.points.is_empty() {
        return Err(TemplateError::NoPoints { frames: sparse.registered() });
    }
    from_sparse(exploration, &usable, sparse, options, progress)
}

/// From poses and points to the template: surface, scale, albedo, descriptors. `usable`: one per frame.
fn from_sparse(
    exploration: &Exploration,
    usable: &[Option<Mask>],
    mut sparse: sfm::Reconstruction,
    options: &TemplateOptions,
    progress: &dyn Progress,
) -> Result<BuiltTemplate, TemplateError> {
    let points: Vec<Point3> = sparse.points.iter().map(|p| p.position).collect();
    let Surface { mut mesh, mut sigma, organ, mut around } =
        dense_mesh(exploration, &sparse, &points, options, progress)?;
    // Reconstruction took long: a mark beside the surface costs the unit, not the template.
    let scale = measure(exploration, &sparse.camera, &sparse.poses, &mesh, options).unwrap_or_else(
        |error| {
            progress.warn(&format!("scale: {error}; lengths stay in template units"));
            None
        },
    );
    let unit = match &scale {
        Some(scale) => {
            apply(scale.factor, &mut mesh, &mut sparse);
            around.iter_mut().flat_map(|m| &mut m.positions).for_each(|p| *p *= scale.factor);
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
    template.surroundings = around;
    let name = |(i, why): &(usize, String)| (exploration.frames[*i].name.clone(), why.clone());
    let rejected = sparse.rejected.iter().map(name).collect();
    let covariance = sparse.covariance(options.sfm.refine).ok();
    let precision = covariance.map(|c| SparsePrecision::of(&c, &sparse, exploration.frames, unit));
    Ok(BuiltTemplate { template, rejected, models: sparse.models, light, scale, precision, organ })
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
        (None, Some(metric)) => fit_to_mesh(mesh, metric).map(Some),
        (known, _) => Ok(known),
    }
}

/// Name and pose of every registered frame.
fn named<'a>(frames: &'a [Frame], poses: &[Option<Isometry>]) -> Vec<(&'a str, Isometry)> {
    frames.iter().zip(poses).filter_map(|(f, p)| Some((f.name.as_str(), (*p)?))).collect()
}

/// Everything in a new unit. Light and albedo are measured later, so that a light whose place is
/// known in mm meets a surface in mm.
fn apply(factor: f64, mesh: &mut Mesh, sparse: &mut sfm::Reconstruction) {
    mesh.positions.iter_mut().for_each(|p| *p *= factor);
    sparse.points.iter_mut().for_each(|p| p.position *= factor);
    for pose in sparse.poses.iter_mut().flatten() {
        pose.translation.vector *= factor;
    }
}

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
    let (template, light) = views.dress(mesh, None, unit, options, progress)?;
    let rejected = (0..count)
        .filter(|&i| poses[i].is_none())
        .map(|i| (exploration.frames[i].name.clone(), "the pose file has no pose for it".into()))
        .collect();
    Ok(BuiltTemplate {
        template,
        rejected,
        models: Vec::new(),
        light,
        scale: None,
        precision: None,
        organ: None,
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

/// Points with their sightings counted in registered frames, as [`Template::views`] are.
fn sparse_points(sparse: &sfm::Reconstruction) -> Vec<SparsePoint> {
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
