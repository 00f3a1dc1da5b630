//! Beyond the paper: motion, prior and shading in one problem.
//!
//! Eq. 4 starts from V′ and can only bend what motion left straight. Here the matches, the
//! conformal prior and the brightness of samples inside faces decide together, from coarse blur to
//! fine, so that texture carries the surface along while shading turns its normals.

use super::Photograph;
use super::cues::Cues;
use super::field::GainField;
use super::gain::{AtMatches, scaled};
use super::joint_objective::JointProblem;
use super::joint_options::JointOptions;
use super::mirror::mirrored;
use super::near_frame::{NearFrame, Told};
use super::samples::{ImageSamples, look};
use crate::energy::{FaceRings, Photometric, Unknowns, Workspace};
use crate::geometry::Point3;
use crate::register::{Body, Match, Scene};
use crate::solver::{Options, Summary};

/// The shape of the joint solve.
#[derive(Clone, Debug)]
pub struct Joined {
    /// Vertices in camera axes, of the mesh that was solved on.
    pub vertices: Vec<Point3>,
    /// Exposure gain of the frame relative to the albedo.
    pub gain: f64,
    /// Ambient light, linear.
    pub ambient: f64,
    /// Photometric samples of the last round.
    pub samples: usize,
    /// Mean of `|image − prediction| / image` over them.
    pub residual: f64,
    /// The last solve.
    pub summary: Summary,
    /// What the matches tell of the exposure; `None` where too few of them are seen.
    pub at_matches: Option<AtMatches>,
    /// Whether the exposure is another than expected.
    pub exposure_changed: bool,
}

impl Joined {
    /// What the last blur gave: its report, the number of its samples, and what they leave.
    pub(super) fn of(
        state: Unknowns,
        (summary, samples, residual): (Summary, usize, f64),
        told: &Told,
    ) -> Self {
        Self {
            gain: state.globals[0].exp(),
            ambient: state.globals[1],
            vertices: state.vertices,
            samples,
            residual,
            summary,
            at_matches: told.at_matches,
            exposure_changed: told.gain.changed,
        }
    }

    /// On the full mesh of `body`, with the hidden side carried along by what is seen.
    pub fn settled(mut self, body: &Body) -> Self {
        self.vertices = body.carried(&body.settled(self.vertices)).into_owned();
        self
    }
}

/// Solve motion, prior and shading together, from `start`, on the mesh of `body` that is solved on,
/// as the matches; `coarse` (V′ of eq. 3): what moved since is also tried the other way.
///
/// `depth_sigma` is eq. 3's tolerance for the depth of the matches under a distant light. An
/// exposure that is held and scales the surface is taken for unknown.
#[doc(alias("joint optimisation", "photometric refinement"))]
pub fn join(
    body: &Body,
    [coarse, start]: [&[Point3]; 2],
    depth_sigma: f64,
    matches: &[Match],
    photo: &Photograph,
    options: &JointOptions,
) -> Joined {
    let posed = &body.scene().posed;
    let frame = NearFrame { body, matches, posed, depth_sigma, photo };
    with_exposure(&frame, |frame| join_told(frame, [coarse, start], options))
}

/// Solve with the exposure as the photograph tells it, and again as unknown where it was held and
/// scaled the surface. `solve` says whether brightness told distance.
pub(super) fn with_exposure(
    frame: &NearFrame,
    mut solve: impl FnMut(&NearFrame) -> (Joined, bool),
) -> Joined {
    let (told, held) = solve(frame);
    if !held || !scaled(frame.body.scene(), &told.vertices, told.at_matches) {
        return told;
    }
    let photo = &Photograph { exposure: None, ..*frame.photo };
    let (free, _) = solve(&NearFrame { photo, ..*frame });
    Joined { exposure_changed: true, ..free }
}

/// Solve with the exposure as the photograph tells it; `true` where brightness told distance.
fn join_told(
    frame: &NearFrame,
    [coarse, start]: [&[Point3]; 2],
    options: &JointOptions,
) -> (Joined, bool) {
    // Without any blur the picture is taken as it is.
    let blurs = if options.blurs.is_empty() { &[0.0][..] } else { &options.blurs };
    let mut solve = JointSolve::new(frame, [coarse, start], options);
    let mut last = None;
    for (k, &blur) in blurs.iter().enumerate() {
        let left = blurs.len() - k - 1;
        let mirrors = if k > 0 && left == 1 { options.mirrors } else { 0 };
        last = Some(solve.at_blur(blur, mirrors, left == 0));
    }
    let last = last.expect("there is at least one blur");
    let JointSolve { state, told, .. } = solve;
    let told = told.expect("there is at least one blur");
    let gain = told.gain;
    (Joined::of(state, last, &told), gain.tells_distance(&frame.photo.light.light, &options.image))
}

/// The solve from coarse blur to fine, and what one blur leaves to the next.
struct JointSolve<'a> {
    frame: &'a NearFrame<'a>,
    /// V′ of eq. 3.
    coarse: &'a [Point3],
    /// Where the coarsest blur begins.
    start: &'a [Point3],
    options: &'a JointOptions,
    rings: FaceRings,
    workspace: Workspace,
    state: Unknowns,
    /// Rest where the shape found poses it, if that knows the pose better than the matches.
    reposed: Option<Scene<'a>>,
    told: Option<Told>,
}

impl<'a> JointSolve<'a> {
    fn new(
        frame: &'a NearFrame,
        [coarse, start]: [&'a [Point3]; 2],
        options: &'a JointOptions,
    ) -> Self {
        Self {
            frame,
            coarse,
            start,
            options,
            rings: FaceRings::of(&frame.body.scene().rest.topology),
            workspace: Workspace::default(),
            state: Unknowns { vertices: start.to_vec(), globals: vec![0.0; 2] },
            reposed: None,
            told: None,
        }
    }

    /// One blur, from so many other starts too; the solver's report, the number of samples, and
    /// what they leave.
    fn at_blur(&mut self, blur: f64, mirrors: usize, finest: bool) -> (Summary, usize, f64) {
        let NearFrame { body, matches, photo, .. } = *self.frame;
        let (first, state) = (body.scene(), &mut self.state);
        let scene = self.reposed.as_ref().unwrap_or(first);
        // What is seen carries the hidden side along, which would hold it back at rest.
        let hidden = body.extrapolated(&state.vertices);
        if let Some(hidden) = &hidden {
            state.vertices.clone_from(hidden);
        }
        let full = body.carried(&state.vertices);
        let look = look(photo, body.full().rest, &full, blur, self.options);
        let cues = Cues::of(&look, body, &state.vertices, photo, self.options);
        let at = || AtMatches::of(&look, scene, matches, [self.start, &scene.posed]);
        let at_matches = if self.told.is_none() { at() } else { None };
        let mut seen = ImageSamples::of(look, body, &state.vertices, self.options);
        let Told { gain, hold, options, .. } = self.told.get_or_insert_with(|| {
            state.globals[0] = seen.log_gain;
            let distant = !photo.light.light.tells_distance();
            let exposure = photo.told_exposure();
            Told::of(self.frame, exposure, seen.log_gain, at_matches, self.options, distant)
        });
        // The coarse stages find the shape that the smooth gain would explain away.
        let field = if finest { smooth_gain(first, options) } else { None };
        let nodes = field.as_ref().map_or(0, GainField::len);
        state.globals.resize(2 + nodes, 0.0);
        if let Some(field) = &field {
            seen = seen.smoothed(body, field);
        }
        let (count, camera) = (seen.samples.len(), photo.camera);
        let shading = Photometric::new(camera, photo.light, &seen.image, &self.rings, seen.samples);
        let problem = JointProblem {
            scene,
            matches,
            match_px: options.match_px,
            depth: hold,
            shading: &shading,
            hidden: hidden.as_deref().unwrap_or(&scene.posed),
            cues: Some(&cues),
            gain: *gain,
            nodes,
            options,
        };
        let topology = &scene.rest.topology;
        let (found, summary) =
            settle(&problem, &mut self.workspace, self.coarse, state.clone(), mirrors);
        let residual = shading.mean_residual(topology, &found.vertices, &found.globals);
        // A near light tells the distance of everything, so the shape knows the pose better than
        // the matches did; under a distant one only the matches hold it.
        if photo.light.light.tells_distance() {
            self.reposed = Some(scene.reposed(&found.vertices));
        }
        self.state = found;
        (summary, count, residual)
    }
}

/// Minimise, then start again from the other answers to what moved since `coarse`; the lowest cost
/// stays.
fn settle(
    problem: &JointProblem,
    workspace: &mut Workspace,
    coarse: &[Point3],
    state: Unknowns,
    mirrors: usize,
) -> (Unknowns, Summary) {
    let solver = Options { max_steps: 12, cost_tolerance: 1e-4, ..Options::default() };
    let mut best = problem.objective().minimise_in(workspace, state, &solver);
    let topology = &problem.scene.rest.topology;
    for vertices in mirrored(topology, coarse, &best.0.vertices, mirrors) {
        let other = Unknowns { vertices, globals: best.0.globals.clone() };
        let other = problem.objective().minimise_in(workspace, other, &solver);
        if other.1.cost().1 < best.1.cost().1 {
            best = other;
        }
    }
    best
}

/// The field of smooth gain over what is seen of a scene.
pub(super) fn smooth_gain(scene: &Scene, options: &JointOptions) -> Option<GainField> {
    let seen = (0..scene.visible.len()).filter(|&v| scene.visible[v]);
    let points: Vec<Point3> = seen.map(|v| scene.rest.positions[v]).collect();
    let length = options.smooth_length * scene.radius();
    (options.smooth_gain > 0.0).then(|| GainField::over(&points, length))?
}
