//! Pose, eq. 3 and eq. 4 in a row, with the visibility, the masks and the verdict around them.

use super::logging;
use super::sight::{Sight, check};
use super::stage_log::StageLog;
use super::trust::{Trusted, trust};
use super::{Method, Observation, ReconstructError, ReconstructOptions, Reconstruction};
use crate::camera::Camera;
use crate::expected_error::{Model, Solved, expected_errors};
use crate::geometry::Point3;
use crate::image::segment::{Segment, segment};
use crate::raster::rasterize;
use crate::refine::{Joined, Photograph, RefineOptions, Refined, join, refine, refine_printed};
use crate::register::scene::visibility;
use crate::register::solve::{EXPLAINED, kept_matches, limit_px};
use crate::register::{
    Body, Deformable, KnownPoses, Match, Posed, RegisterError, RegisterMemory, RegisterOptions,
    Registered, Scene, find, pose, posed_from, register, register_in, register_printed,
};
use crate::sfs::{SfsInput, SfsOptions, shape_from_shading};
use crate::template::Template;
use crate::verdict::{Evidence, Level, Verdict};

/// Reconstruct one deformed frame; of several, see [`reconstruct_with`].
///
/// # Errors
/// Frame and camera of different size, a black frame, no pose, no descriptors where matches have to
/// be found, no albedo for a shading method, a surface that must not be shown.
///
/// ```
/// use dsfms::{Method, Observation, ReconstructOptions, reconstruct, synth::Case};
///
/// let case = Case::example(1);
/// let observation = Observation::new(&case.frame, &case.camera).matches(&case.matches);
/// let options = ReconstructOptions::default();
/// let found = reconstruct(&case.template, &observation, Method::Dsfm, &options)?;
/// assert!(case.zone_rms(&found.vertices) < 5.0); // mm, where no match lies
/// # Ok::<_, dsfms::pipeline::ReconstructError>(())
/// ```
#[doc(alias("NRSfM", "shape from template", "SfT"))]
pub fn reconstruct(
    template: &Template,
    observation: &Observation,
    method: Method,
    options: &ReconstructOptions,
) -> Result<Reconstruction, ReconstructError> {
    let mut log = StageLog::default();
    let deformable = log.time("mesh", || Deformable::of(&template.mesh));
    reconstruct_logged(template, &deformable, observation, method, options, log)
}

/// Reconstruct one deformed frame with what was made of the template's mesh before.
///
/// # Errors
/// As [`reconstruct`].
pub fn reconstruct_with(
    template: &Template,
    deformable: &Deformable,
    observation: &Observation,
    method: Method,
    options: &ReconstructOptions,
) -> Result<Reconstruction, ReconstructError> {
    reconstruct_logged(template, deformable, observation, method, options, StageLog::default())
}

fn reconstruct_logged(
    template: &Template,
    deformable: &Deformable,
    observation: &Observation,
    method: Method,
    options: &ReconstructOptions,
    mut log: StageLog,
) -> Result<Reconstruction, ReconstructError> {
    options.validate()?;
    let options = &options.clone().at_size(observation.frame.size);
    let sight = log.time("prepare", || {
        check(template, observation, method)?;
        Ok::<_, ReconstructError>(Sight::new(template, observation, method))
    })?;
    let matches = log.time("matching", || matches_of(&sight, method, options))?;
    let posed = log.time("pose", || posed(template, observation, &matches, options))?;
    let rigid = template.mesh.positions.iter().map(|p| posed.pose * p).collect();
    let scene = Scene::new(observation.camera, &template.mesh, rigid);
    let mut result = rigid_result(&scene, &matches, &posed, &options.register);
    match method {
        Method::Rigid => {}
        Method::Sfs => shade_alone(&sight, &mut result, &mut log)?,
        Method::Dsfm | Method::Dsfms | Method::Joint => {
            // The printed forms speak of the mesh as it is.
            let body = match options.literal {
                true => Body::plain(&scene),
                false => Body::new(&scene, deformable, options.register.anchor),
            };
            let deformation = FrameSolve { sight: &sight, body: &body, options };
            deformation.solve(method, &matches, &posed, &mut result, &mut log)?;
        }
    }
    log.time("visibility", || see(&sight, &mut result));
    let looked = match options.literal {
        true => options.refine.as_printed(),
        false => options.refine.clone(),
    };
    log.time("expected error", || expect(&sight, &scene, method, &looked, &mut result));
    let trusted = Trusted { sight: &sight, scene: &scene, posed: &posed, method, options };
    log.time("verdict", || trust(&trusted, &mut result));
    result.stages = log.stages;
    logging::reconstruction(observation.frame, &result);
    match result.verdict.level {
        Level::Lost => Err(ReconstructError::Refused(Box::new(result))),
        Level::Ok | Level::Degraded => Ok(result),
    }
}

/// The solves of a frame that deforms, on the mesh of `body`.
struct FrameSolve<'a> {
    sight: &'a Sight<'a>,
    body: &'a Body<'a>,
    options: &'a ReconstructOptions,
}

impl FrameSolve<'_> {
    /// Eq. 3, and from its shape what the method asks for; into `result`.
    fn solve(
        &self,
        method: Method,
        matches: &[Match],
        posed: &Posed,
        result: &mut Reconstruction,
        log: &mut StageLog,
    ) -> Result<(), ReconstructError> {
        let Self { sight, body, options } = self;
        let on_body = body.matches(matches);
        let coarse = log.time("register (eq. 3)", || {
            let (scene, options, literal) = (body.scene(), &options.register, options.literal);
            match method {
                _ if literal => register_printed(scene, &on_body, posed, options),
                Method::Dsfm => register(scene, &on_body, posed, options),
                _ => {
                    let memory = &mut RegisterMemory::default();
                    register_in(memory, scene, &on_body, posed, options)
                }
            }
        });
        log.attach(&coarse.summary);
        take_coarse(result, body, matches, &coarse);
        if method == Method::Dsfm {
            return Ok(());
        }
        let kept = kept_matches(&on_body, &coarse.kept);
        let photo = sight.photograph().ok_or(ReconstructError::NoAlbedo(method))?;
        if method == Method::Dsfms {
            let refined = log.time("refine (eq. 4)", || self.refined(&coarse, &kept, &photo));
            log.attach(&refined.summary);
            take_refined(result, &refined);
        } else {
            let found = log.time("outline", || self.segmented(&result.vertices, &photo));
            let photo = match &found {
                Some(Segment { outline, usable, marked }) => {
                    logging::outline(sight.observation.frame, *marked);
                    Photograph { outline: Some(outline), usable, ..photo }
                }
                None => photo,
            };
            let joined = log.time("joint", || joined(body, &coarse, &kept, &photo, options));
            log.attach(&joined.summary);
            take_joined(result, &joined);
        }
        Ok(())
    }

    /// The organ by its colours, about the silhouette of `shape` (camera axes), if it is asked for and no mask says.
    fn segmented(&self, shape: &[Point3], photo: &Photograph) -> Option<Segment> {
        if !self.options.joint.find_outline || self.sight.observation.organ.is_some() {
            return None;
        }
        let topology = &self.sight.template.mesh.topology;
        let rough = rasterize(photo.camera, topology, shape).silhouette();
        segment(&photo.picture.linear, &rough, photo.usable)
    }

    /// Eq. 4 from the shape of eq. 3.
    fn refined(&self, coarse: &Registered, kept: &[Match], photo: &Photograph) -> Refined {
        let Self { body, options, .. } = self;
        let start = &coarse.vertices;
        if options.literal {
            return refine_printed(body, start, kept, photo, &options.refine);
        }
        let mut refined = refine(body, start, kept, photo, &options.refine);
        // Eq. 3 follows the noise of its matches too: what explains no more than rest does stays at rest.
        let comparison = options.comparison(body, kept, photo);
        let beyond_motion = comparison.kept_beyond(start, refined.vertices);
        refined.vertices = comparison.kept(&body.scene().posed, beyond_motion);
        refined.settled(body)
    }
}

/// Motion and shading in one problem, from the shape of eq. 3; `kept`: the matches that it explains, on the mesh of
/// `body`. What explains no more than rest does stays at rest.
pub(crate) fn joined(
    body: &Body,
    coarse: &Registered,
    kept: &[Match],
    photo: &Photograph,
    options: &ReconstructOptions,
) -> Joined {
    let (start, depth_sigma) = (&coarse.vertices, coarse.depth_sigma);
    let mut joined = join(body, start, depth_sigma, kept, photo, &options.joint);
    let still = &body.scene().posed;
    joined.vertices = options.comparison(body, kept, photo).kept(still, joined.vertices);
    joined.settled(body)
}

/// The rigid pose of the frame.
fn posed(
    template: &Template,
    observation: &Observation,
    matches: &[Match],
    options: &ReconstructOptions,
) -> Result<Posed, RegisterError> {
    let (camera, rest, register) = (observation.camera, &template.mesh, &options.register);
    let found = pose(camera, rest, matches, register, options.seed)?;
    match options.literal {
        true => Ok(found),
        false => {
            let known = KnownPoses { views: &template.views, around: None };
            posed_from(&known, camera, rest, matches, found, register)
        }
    }
}

/// The given matches, with found ones behind them for the joint solve; or found ones alone.
fn matches_of(
    sight: &Sight,
    method: Method,
    options: &ReconstructOptions,
) -> Result<Vec<Match>, ReconstructError> {
    let Sight { template, observation, usable, .. } = sight;
    let Observation { camera, frame, .. } = observation;
    let found = || {
        let features = template.features.as_ref().ok_or(ReconstructError::NoDescriptors)?;
        let (mesh, register) = (&template.mesh, &options.register);
        Ok(find(camera, mesh, features, frame, usable, register, options.seed)?)
    };
    match observation.matches {
        None => found(),
        // Eqs. 3 and 4 are those of the matches that they are given.
        Some(given) if method == Method::Joint && options.find_beside_given && !options.literal => {
            let beside = found().unwrap_or_default();
            Ok(given.iter().copied().chain(beside).collect())
        }
        Some(given) => Ok(given.to_vec()),
    }
}

fn rigid_result(
    scene: &Scene,
    matches: &[Match],
    posed: &Posed,
    options: &RegisterOptions,
) -> Reconstruction {
    let limit = limit_px(options).max(EXPLAINED * posed.median_px());
    let kept = posed.residuals_px.iter().map(|&r| r <= limit);
    Reconstruction {
        verdict: Verdict::default(),
        evidence: Evidence::default(),
        vertices: scene.posed.clone(),
        pose: posed.pose,
        visible: Vec::new(),
        expected_error: None,
        error_bound: None,
        observed: None,
        regions: Vec::new(),
        gain: 1.0,
        ambient: 0.0,
        matches: matches.iter().copied().zip(kept).collect(),
        shaded: None,
        stages: Vec::new(),
    }
}

fn take_coarse(result: &mut Reconstruction, body: &Body, matches: &[Match], coarse: &Registered) {
    result.vertices = body.carried(&body.settled(coarse.vertices.clone())).into_owned();
    result.matches = matches.iter().copied().zip(coarse.kept.iter().copied()).collect();
}

fn take_refined(result: &mut Reconstruction, refined: &Refined) {
    result.vertices.clone_from(&refined.vertices);
    (result.gain, result.ambient) = (refined.gain, refined.ambient);
    result.shaded = Some(refined.diffuse_vertices);
}

fn take_joined(result: &mut Reconstruction, joined: &Joined) {
    result.vertices.clone_from(&joined.vertices);
    (result.gain, result.ambient) = (joined.gain, joined.ambient);
    result.shaded = Some(joined.samples);
}

/// The SfS baseline at the rigid registration.
fn shade_alone(
    sight: &Sight,
    result: &mut Reconstruction,
    log: &mut StageLog,
) -> Result<(), ReconstructError> {
    let photo = sight.photograph().ok_or(ReconstructError::NoAlbedo(Method::Sfs))?;
    let input = SfsInput {
        mesh: &sight.template.mesh,
        pose: result.pose,
        camera: photo.camera,
        grey: &photo.picture.linear.grey(),
        usable: photo.usable,
        saturated: &photo.picture.saturated,
        albedo: Some(photo.albedo),
        light: &photo.light.light,
    };
    let shaded = log.time("sfs", || shape_from_shading(&input, &SfsOptions::default()))?;
    log.attach(&shaded.summary);
    (result.vertices, result.gain) = (shaded.vertices, shaded.gain);
    Ok(())
}

/// Final visibility.
fn see(sight: &Sight, result: &mut Reconstruction) {
    let Sight { template, observation, usable, .. } = sight;
    result.visible = visibility(observation.camera, &template.mesh, &result.vertices);
    for (visible, p) in result.visible.iter_mut().zip(&result.vertices) {
        *visible &= observation.camera.project(p).is_some_and(|q| usable.at_pixel(&q.pixel));
    }
}

/// Expected errors, where the method has a model of them.
fn expect(
    sight: &Sight,
    scene: &Scene,
    method: Method,
    refine: &RefineOptions,
    result: &mut Reconstruction,
) {
    let photo = sight.photograph();
    let model = match method {
        Method::Rigid | Method::Sfs => return,
        Method::Dsfm if photo.is_some() => Model::MotionSeen,
        Method::Dsfm => Model::Motion,
        Method::Dsfms => Model::Shading,
        Method::Joint => Model::Joint,
    };
    let (vertices, visible, matches) = (&result.vertices, &result.visible, &result.matches);
    let photo = photo.as_ref();
    let solved = Solved { scene, vertices, visible, matches, photo, refine };
    let found = expected_errors(&solved, model);
    result.error_bound = Some(found.bound);
    result.expected_error = Some(found.errors);
    result.observed = Some(found.observed);
}
