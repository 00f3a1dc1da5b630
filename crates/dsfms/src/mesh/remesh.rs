//! Isotropic remeshing: split long edges, collapse short ones, even out valences, smooth within the
//! surface, project back (Botsch and Kobbelt 2004). Boundaries stay on the input's boundary. On
//! request edges are shorter where the surface bends ([`RemeshOptions::adaptive`]).

mod diagonals;
mod outline;
mod passes;
mod sizing;
mod working;

use super::surface_points::ClosestPoints;
use super::{Mesh, TopologyError};
use crate::geometry::Point3;
use crate::options::{OptionError, check};
pub use diagonals::fit_diagonals;
use outline::FixedEdges;
use serde::{Deserialize, Serialize};
use sizing::Sizing;
use working::WorkingMesh;

/// How a surface is remeshed. Measured: `adaptive` (`docs/results/template.md`); other values of
/// `corner_deg` are not.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RemeshOptions {
    /// Rounds of split, collapse, flip, smooth; at least 1. After about eight nothing changes.
    pub rounds: usize,
    /// Boundary vertices where the boundary turns by more than this within one edge length of the
    /// result on either side stay in place, degrees in `(0, 180]`.
    pub corner_deg: f64,
    /// How far edge lengths follow the curvature `k` of the surface, in `[0, 1]`: 0 = all of one
    /// length, 1 = `√(8 e / k)`, whose chords all miss the surface by the same `e`. Half to twice
    /// the mean.
    pub adaptive: f64,
}

impl Default for RemeshOptions {
    fn default() -> Self {
        Self { rounds: 12, corner_deg: 60.0, adaptive: 0.0 }
    }
}

impl RemeshOptions {
    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), OptionError> {
        let corner = self.corner_deg > 0.0 && self.corner_deg <= 180.0;
        check(&[
            ("remesh.rounds", self.rounds >= 1, "at least 1"),
            ("remesh.corner_deg", corner, "above 0 and at most 180"),
            ("remesh.adaptive", (0.0..=1.0).contains(&self.adaptive), "from 0 to 1"),
        ])
    }
}

/// Why a surface could not be remeshed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RemeshError {
    /// Too few vertices asked for.
    #[error("{asked} vertices asked for; at least {least} are needed")]
    TooFewVertices {
        /// The target.
        asked: usize,
        /// The minimum.
        least: usize,
    },
    /// An option out of its bounds.
    #[error(transparent)]
    Options(#[from] OptionError),
    /// The surface has no area.
    #[error("the surface has no area; nothing to remesh")]
    NoArea,
    /// The result is not a surface (a fault of ours: please report it).
    #[error("remeshing broke the surface: {0}")]
    Topology(#[from] TopologyError),
}

/// Rounds, beyond those asked for, in which a fine input may collapse: each about halves it.
const MAX_COLLAPSING: usize = 16;

/// As many as an icosahedron: fewer make no closed surface of nearly equilateral faces.
const LEAST_VERTICES: usize = 12;

/// A mesh of nearly equilateral faces, of one size unless [`RemeshOptions::adaptive`], with about
/// `target_vertices` vertices (within 5 % unless the shape forbids it) on the input's surface.
/// Unused vertices of the input are dropped; topology (components, boundaries, handles) is kept.
///
/// # Errors
/// An option out of range, or a surface of which no mesh of that many vertices can be made.
pub fn remesh(
    mesh: &Mesh,
    target_vertices: usize,
    options: &RemeshOptions,
) -> Result<Mesh, RemeshError> {
    if target_vertices < LEAST_VERTICES {
        return Err(RemeshError::TooFewVertices { asked: target_vertices, least: LEAST_VERTICES });
    }
    options.validate()?;
    let all: Vec<usize> = (0..mesh.topology.faces.len()).collect();
    let (input, _) = mesh.subset(&all);
    let surface = ClosestPoints::new(&input);
    let mut length = first_length(&input, target_vertices)?;
    let outline = FixedEdges::new(&input, options.corner_deg, length);
    let sizing = (options.adaptive > 0.0).then(|| Sizing::new(&input, length, options.adaptive));
    let mut work = WorkingMesh {
        size: sizing.as_ref().map_or(vec![1.0; input.positions.len()], |s| s.size.clone()),
        positions: input.positions.clone(),
        faces: input.topology.faces.clone(),
        fixed: outline.corners.clone(),
    };
    let (mut before, mut round) = (work.positions.len(), 0);
    for _ in 0..options.rounds + MAX_COLLAPSING {
        passes::split(&mut work, 4.0 / 3.0 * length);
        passes::collapse(&mut work, 4.0 / 5.0 * length, 4.0 / 3.0 * length);
        passes::flip(&mut work);
        passes::smooth(&mut work, &surface, &outline);
        if let Some(sizing) = &sizing {
            work.size = work
                .positions
                .iter()
                .map(|p| sizing.at(&surface, &input.topology.faces, p))
                .collect();
        }
        let count = work.positions.len();
        // A much finer input takes rounds to collapse: its count says nothing of the length yet.
        let collapsing = 4 * count < 3 * before;
        before = count;
        round += usize::from(!collapsing);
        if round == options.rounds {
            break;
        }
        if !collapsing && round + 1 < options.rounds {
            // Ever smaller corrections of the edge length, so that the count settles.
            let ratio = count as f64 / target_vertices as f64;
            length *= ratio.sqrt().clamp(0.7, 1.4);
        }
    }
    let mut result = Mesh::new(work.positions, work.faces)?;
    part_coincident(&mut result);
    Ok(result)
}

/// Vertices that were projected to one place (at narrow rims, where no edge may collapse) are moved
/// between their neighbours, off the surface by less than an edge, until every face has an area.
fn part_coincident(mesh: &mut Mesh) {
    /// A bound on time.
    const ROUNDS: usize = 20;
    let topology = mesh.topology.clone();
    for _ in 0..ROUNDS {
        let faces = &topology.faces;
        let mut stuck: Vec<u32> =
            (0..faces.len()).filter(|&f| mesh.is_degenerate(f)).flat_map(|f| faces[f]).collect();
        if stuck.is_empty() {
            return;
        }
        stuck.sort_unstable();
        stuck.dedup();
        for v in stuck {
            let on_rim = topology.boundary[v as usize];
            let along = |e: &&u32| {
                let edge = [v.min(**e), v.max(**e)];
                let found = topology.edges.binary_search(&edge);
                found.is_ok_and(|i| topology.edge_faces[i][1] == u32::MAX)
            };
            let ring = topology.one_ring[v as usize].iter();
            let near: Vec<u32> = ring.filter(|e| !on_rim || along(e)).copied().collect();
            if !near.is_empty() {
                let place = |&o: &u32| mesh.positions[o as usize].coords;
                let mean = near.iter().map(place).sum::<crate::geometry::Vector3>();
                mesh.positions[v as usize] = Point3::from(mean / near.len() as f64);
            }
        }
    }
}

/// Edge length `l` of `n` vertices of equilateral faces: `area = √3/4 l² (2n − boundary/l)`.
fn first_length(mesh: &Mesh, n: usize) -> Result<f64, RemeshError> {
    let area: f64 = mesh.face_areas().iter().sum();
    if !(area > 0.0 && area.is_finite()) {
        return Err(RemeshError::NoArea);
    }
    let lengths = mesh.edge_lengths();
    let open = mesh.topology.edge_faces.iter().zip(&lengths).filter(|(f, _)| f[1] == u32::MAX);
    let boundary: f64 = open.map(|(_, l)| l).sum();
    let (a, b, c) = (2.0 * n as f64, -boundary, -4.0 * area / 3f64.sqrt());
    Ok((-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * a))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    fn worst_angle_deg(mesh: &Mesh) -> f64 {
        mesh.min_angles().into_iter().fold(f64::INFINITY, f64::min).to_degrees()
    }

    #[test]
    fn coincident_vertices_are_parted() {
        // Inside, and at the rim along a boundary edge.
        for rim in [false, true] {
            let mut mesh = shapes::irregular_sheet(8);
            let t = mesh.topology.clone();
            let open = |i: &usize| t.edge_faces[*i][1] == u32::MAX;
            let inner = |i: &usize| t.edges[*i].iter().all(|&v| !t.boundary[v as usize]);
            let found = (0..t.edges.len()).find(|i| if rim { open(i) } else { inner(i) });
            let [a, b] = t.edges[found.unwrap()];
            mesh.positions[a as usize] = mesh.positions[b as usize];
            part_coincident(&mut mesh);
            assert!((0..t.faces.len()).all(|f| !mesh.is_degenerate(f)), "rim: {rim}");
        }
    }

    #[test]
    fn a_hemisphere_finer_and_coarser() {
        let input = shapes::hemisphere(3, 10.0);
        for target in [100, 600] {
            let mesh = remesh(&input, target, &RemeshOptions::default()).unwrap();
            let n = mesh.positions.len() as f64;
            assert!((n / target as f64 - 1.0).abs() < 0.05, "{n} for {target}");
            assert_eq!(mesh.topology.euler_characteristic(), 1);
            assert!(worst_angle_deg(&mesh) > 20.0, "{}", worst_angle_deg(&mesh));
            let surface = ClosestPoints::new(&input);
            for p in &mesh.positions {
                assert!(surface.closest(p).unwrap().distance < 1e-9);
            }
        }
    }

    #[test]
    fn a_square_keeps_its_corners_and_outline() {
        let input = shapes::irregular_sheet(12);
        let mesh = remesh(&input, 250, &RemeshOptions::default()).unwrap();
        assert!((mesh.face_areas().iter().sum::<f64>() - 1.0).abs() < 1e-9);
        for corner in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]] {
            assert!(mesh.positions.contains(&Point3::new(corner[0], corner[1], 0.0)));
        }
        assert!(mesh.topology.faces.len() > 300 && worst_angle_deg(&mesh) > 20.0);
    }

    #[test]
    fn a_closed_surface_stays_closed() {
        let mesh = remesh(&shapes::torus(24, 12), 500, &RemeshOptions::default()).unwrap();
        assert_eq!(mesh.topology.euler_characteristic(), 0);
        assert!(mesh.topology.boundary.iter().all(|&b| !b));
    }

    #[test]
    fn refuses_nonsense() {
        let sheet = shapes::irregular_sheet(4);
        let error = remesh(&sheet, 3, &RemeshOptions::default()).unwrap_err();
        assert_eq!(error, RemeshError::TooFewVertices { asked: 3, least: 12 });
    }
}
