//! A start of eq. 3 from the same problem on a coarser mesh.

use super::Match;
use super::objective::Problem;
use super::pose::rest_point;
use super::solve::RegisterMemory;
use crate::geometry::{Point3, Vector3};
use crate::mesh::Mesh;
use crate::mesh::decimate::{Decimated, decimate};
use crate::solver::Loss;
use std::sync::Arc;

/// A coarser mesh of a template, and what outlives a frame on it.
pub(super) struct Coarse {
    /// The mesh it was made from.
    rest: Mesh,
    decimated: Option<Decimated>,
    memory: Box<RegisterMemory>,
}

/// Meshes of more vertices are first solved on a coarse one: below, making it takes as long as it saves
/// (`docs/results/solver.md`, as all constants here).
const COARSE_ABOVE: usize = 900;

/// Vertices of the coarsest mesh.
const COARSE: usize = 300;

/// Vertices of one mesh for each of the next coarser.
const RATIO: usize = 16;

/// How far a coarse mesh is solved: what is left is less than its own error.
const COARSE_TOLERANCE: f64 = 1e-4;

/// The annealing on a mesh of some of the vertices, carried to all of them: it finds the matches
/// that count and all but the finest part of the shape. `None` for a mesh that is coarse already, or
/// that cannot be made coarser.
pub(super) fn coarse_start(
    memory: &mut Option<Coarse>,
    fine: &Problem,
    losses: &[Loss],
) -> Option<Vec<Point3>> {
    let Problem { scene, matches, displacement, options } = *fine;
    if scene.posed.len() <= COARSE_ABOVE {
        return None;
    }
    let same = |c: &Coarse| {
        Arc::ptr_eq(&c.rest.topology, &scene.rest.topology)
            && c.rest.positions == scene.rest.positions
    };
    if !memory.as_ref().is_some_and(same) {
        let target = (scene.posed.len() / RATIO).max(COARSE);
        let (rest, decimated) = (scene.rest.clone(), decimate(scene.rest, target));
        *memory = Some(Coarse { rest, decimated, memory: Box::default() });
    }
    let Coarse { decimated, memory, .. } = memory.as_mut()?;
    let decimated = decimated.as_ref()?;
    let coarse = scene.on_some(&decimated.mesh, &decimated.kept);
    let carried = |m: &Match| {
        let (point, near) = (rest_point(scene.rest, m), scene.face(m)[0]);
        let (face, barycentric) = decimated.locate(&point, near)?;
        Some(Match { face, barycentric, pixel: m.pixel })
    };
    let matches: Vec<Match> = matches.iter().filter_map(carried).collect();
    let problem = Problem { scene: &coarse, matches: &matches, displacement, options };
    let start = coarse.posed.clone();
    let (found, _) = problem.solve(memory, start, losses, COARSE_TOLERANCE);
    let moved: Vec<Vector3> =
        found.iter().zip(&coarse.posed).map(|(now, posed)| now - posed).collect();
    let carried = decimated.prolong(scene.rest, &moved);
    Some(scene.posed.iter().zip(carried).map(|(p, d)| p + d).collect())
}
