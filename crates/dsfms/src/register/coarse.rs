//! Coarser meshes of a template, for a start of eq. 3.

use super::Scene;
use super::correspondence::Match;
use super::pose::rest_point;
use crate::energy::Workspace;
use crate::mesh::Mesh;
use crate::mesh::decimate::{Decimated, decimate};
use std::sync::Arc;

/// What outlives a frame of the same template: the coarse mesh and the symbolic factors.
#[derive(Default)]
pub struct RegisterMemory {
    pub(super) coarse: Option<Coarse>,
    pub(super) workspace: Workspace,
}

/// A coarser mesh of a template, and what outlives a frame on it.
pub(super) struct Coarse {
    /// The mesh it was made from.
    rest: Mesh,
    decimated: Option<Decimated>,
    memory: Box<RegisterMemory>,
}

/// Meshes of more vertices are first solved on a coarse one: below, making it takes as long as it
/// saves (`docs/results/solver.md`, as all constants here).
const COARSE_ABOVE: usize = 900;

/// Vertices of the coarsest mesh.
const COARSE: usize = 300;

/// Vertices of one mesh for each of the next coarser.
const RATIO: usize = 16;

/// The next coarser mesh of a scene's template and what is kept of its solves, made where there is
/// none. `None` for a mesh that is coarse already, or that cannot be made coarser.
pub(super) fn coarser<'m>(
    memory: &'m mut Option<Coarse>,
    scene: &Scene,
) -> Option<(&'m Decimated, &'m mut RegisterMemory)> {
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
    Some((decimated.as_ref()?, memory))
}

/// The matches of a mesh on a coarser one; those beside it are left out.
pub(super) fn on_coarser(decimated: &Decimated, rest: &Mesh, matches: &[Match]) -> Vec<Match> {
    let carried = |m: &Match| {
        let (point, near) = (rest_point(rest, m), rest.topology.faces[m.face as usize][0]);
        let (face, barycentric) = decimated.locate(&point, near)?;
        Some(Match { face, barycentric, pixel: m.pixel })
    };
    matches.iter().filter_map(carried).collect()
}
