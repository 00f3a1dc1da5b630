//! The solve of eq. 4: rounds, each with visibility and albedo as the last shape shows them.

use super::RefineOptions;
use super::evidence::{ShadingEvidence, gather_on, gather_on_from, look_at};
use super::gain::{AtMatches, GainPrior, scaled};
use super::objective::objective;
use super::photograph::Photograph;
use crate::energy::{Unknowns, Workspace};
use crate::geometry::Point3;
use crate::register::{Body, Match};
use crate::solver::{Options, Summary};

/// Options of a solve of eq. 4.
pub(super) fn solver() -> Options {
    Options { max_steps: 20, cost_tolerance: 1e-5, ..Options::default() }
}

/// The fine shape V″.
#[derive(Clone, Debug)]
pub struct Refined {
    /// Vertices in camera axes, of the mesh that was solved on.
    pub vertices: Vec<Point3>,
    /// Exposure gain of the frame relative to the albedo.
    pub gain: f64,
    /// Ambient light, linear.
    pub ambient: f64,
    /// Vertices that carried the diffuse condition in the last round.
    pub diffuse_vertices: usize,
    /// Vertices that carried the specular condition in the last round.
    pub specular_vertices: usize,
    /// The last solve.
    pub summary: Summary,
}

impl Refined {
    pub(super) fn of(found: Unknowns, evidence: &ShadingEvidence, summary: Summary) -> Self {
        Self {
            gain: found.globals[0].exp(),
            ambient: found.globals[1],
            vertices: found.vertices,
            diffuse_vertices: evidence.diffuse.len(),
            specular_vertices: evidence.specular.len(),
            summary,
        }
    }

    /// On the full mesh of `body`, with the hidden side carried along by what is seen.
    pub fn settled(mut self, body: &Body) -> Self {
        self.vertices = body.carried(&body.settled(self.vertices)).into_owned();
        self
    }
}

/// Solve eq. 4 from the coarse shape V′, holding the depth of the matches it was built on; shape
/// and matches are on the mesh of `body` that is solved on. An exposure that is held and scales the
/// surface is taken for unknown.
#[doc(alias("eq. 4", "photometric refinement"))]
pub fn refine(
    body: &Body,
    coarse: &[Point3],
    matches: &[Match],
    photo: &Photograph,
    options: &RefineOptions,
) -> Refined {
    let (told, held) = refine_told(body, coarse, matches, photo, options);
    if !scaled(body.scene(), &told.vertices, held) {
        return told;
    }
    let unknown = &Photograph { exposure: None, ..*photo };
    refine_told(body, coarse, matches, unknown, options).0
}

/// Solve with the exposure as the photograph tells it; with what the matches tell of it, where
/// brightness told distance.
fn refine_told(
    body: &Body,
    coarse: &[Point3],
    matches: &[Match],
    photo: &Photograph,
    options: &RefineOptions,
) -> (Refined, Option<AtMatches>) {
    let (scene, full) = (body.scene(), body.carried(coarse));
    let look = look_at(photo, body.full().rest, &full, options);
    let at_matches = AtMatches::of(&look, scene, matches, [coarse, &scene.posed]);
    let mut evidence = gather_on_from(look, body, coarse, photo, options);
    let prior = GainPrior::of(photo.told_exposure(), evidence.log_gain, at_matches, &options.image);
    let tells_distance = prior.tells_distance(&photo.light.light, &options.image);
    let held = at_matches.filter(|_| tells_distance);
    let globals = vec![evidence.log_gain, 0.0];
    let mut state = Unknowns { vertices: coarse.to_vec(), globals };
    let (mut round, mut workspace) = (0, Workspace::default());
    loop {
        let objective = objective(scene, coarse, matches, photo, &evidence, prior, options);
        let (next, summary) = objective.minimise_in(&mut workspace, state, &solver());
        round += 1;
        if round == options.rounds.max(1) {
            return (Refined::of(next, &evidence, summary), held);
        }
        state = next;
        evidence = gather_on(body, &state.vertices, photo, options);
    }
}
