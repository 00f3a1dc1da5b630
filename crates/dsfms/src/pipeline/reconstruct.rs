//! Pose, eq. 3 and eq. 4 in a row, with the visibility, the masks and the verdict around them.

use super::frame_solve::FrameSolve;
use super::logging;
use super::sight::{Described, Sight, check};
use super::stage_log::StageLog;
use super::trust::{Trusted, trust};
use super::{Method, Observation, ReconstructError, ReconstructOptions, Reconstruction};
use crate::camera::Camera;
use crate::expected_error::{Model, Solved, expected_errors};
use crate::refine::RefineOptions;
use crate::register::scene::visibility;
use crate::register::solve::{EXPLAINED, limit_px};
use crate::register::{
    Body, Deformable, KnownPoses, Match, Posed, RegisterError, RegisterOptions, Scene, pose,
    posed_from,
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
    let options = &options.clone().at_size(observation.frame.size).in_form();
    let sight = log.time("prepare", || {
        check(template, observation, method)?;
        Ok::<_, ReconstructError>(Sight::new(template, observation, method))
    })?;
    let (described, matches) = log.time("matching", || {
        let asked = finds_matches(observation, method, options);
        let described = asked.then(|| sight.described()).flatten();
        let matches = matches_of(&sight, described.as_ref(), options)?;
        Ok::<_, ReconstructError>((described, matches))
    })?;
    let posed = log.time("pose", || posed(template, observation, &matches, options))?;
    let rigid = template.mesh.positions.iter().map(|p| posed.pose * p).collect();
    let scene = Scene::new(observation.camera, &template.mesh, rigid);
    let mut result = rigid_result(&scene, &matches, &posed, &options.register);
    match method {
        Method::Rigid => {}
        Method::Sfs => shade_alone(&sight, &options.sfs, &mut result, &mut log)?,
        Method::Dsfm | Method::Dsfms | Method::Joint => {
            // The printed forms speak of the mesh as it is.
            let body = match options.literal {
                true => Body::plain(&scene),
                false => Body::new(&scene, deformable, options.register.anchor),
            };
            let described = described.as_ref();
            let deformation = FrameSolve { sight: &sight, described, body: &body, options };
            // On a thread of the pool its many small parallel loops cost no hand-over.
            rayon::scope(|_| deformation.solve(method, &matches, &posed, &mut result, &mut log))?;
        }
    }
    log.time("visibility", || see(&sight, &mut result));
    log.time("expected error", || expect(&sight, &scene, method, &options.refine, &mut result));
    let trusted = Trusted { sight: &sight, scene: &scene, posed: &posed, method, options };
    log.time("verdict", || trust(&trusted, &mut result));
    result.stages = log.stages;
    logging::reconstruction(observation.frame, &result);
    match result.verdict.level {
        Level::Lost => Err(ReconstructError::Refused(Box::new(result))),
        Level::Ok | Level::Degraded => Ok(result),
    }
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
    let known = KnownPoses { views: &template.views, around: None };
    posed_from(&known, camera, rest, matches, found, register)
}

/// The given matches, with found ones behind them for the joint solve; or found ones alone.
fn matches_of(
    sight: &Sight,
    described: Option<&Described>,
    options: &ReconstructOptions,
) -> Result<Vec<Match>, ReconstructError> {
    let Observation { camera, matches: given, .. } = *sight.observation;
    let found = described.map(|Described { search, seen }| {
        search.matches(camera, seen, &options.register, options.seed)
    });
    match (given, found) {
        (None, None) => Err(ReconstructError::NoDescriptors),
        (None, Some(found)) => Ok(found?),
        (Some(given), None) => Ok(given.to_vec()),
        (Some(given), Some(found)) => {
            Ok(given.iter().copied().chain(found.unwrap_or_default()).collect())
        }
    }
}

/// Whether descriptors are asked for matches.
fn finds_matches(observation: &Observation, method: Method, options: &ReconstructOptions) -> bool {
    let beside = method == Method::Joint && options.find_beside_given;
    observation.matches.is_none() || beside
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
        outline: None,
        stages: Vec::new(),
    }
}

/// The SfS baseline at the rigid registration.
fn shade_alone(
    sight: &Sight,
    options: &SfsOptions,
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
    let shaded = log.time("sfs", || shape_from_shading(&input, options))?;
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
