//! How far a reconstruction is from the truth (paper §8: 3D error, edge-length error,
//! reprojection error).
//!
//! With the truth's connectivity, errors are per vertex and split by visibility and by the
//! deformed [`zone`]; without it, they are distances between surfaces. Lengths come out in the
//! unit of the input.
//!
//! ```
//! use dsfms::eval::{EvaluateOptions, Truth, evaluate};
//! use dsfms::{Mesh, geometry::Point3};
//!
//! let corners = [[0., 0., 50.], [1., 0., 50.], [0., 1., 50.]].map(Point3::from);
//! let truth = Mesh::new(corners.to_vec(), vec![[0, 1, 2]]).unwrap();
//! let found = truth.with_positions(corners.iter().map(|p| Point3::new(p.x, p.y, 50.5)).collect());
//! let result = evaluate(&found, &Truth::new(&truth), &EvaluateOptions::default()).unwrap();
//! assert!((result.vertices.unwrap().all.rms - 0.5).abs() < 1e-12);
//! ```

pub mod align;
pub mod stats;
pub mod zone;

use crate::camera::{Camera, CameraModel};
use crate::geometry::{Point3, Similarity};
use crate::mesh::Mesh;
use crate::mesh::surface_points::ClosestPoints;
pub use align::{Alignment, align_surfaces};
use serde::{Deserialize, Serialize};
pub use stats::ErrorStats;
pub use zone::{deformed_zone, displacement_from_rest};

/// What a reconstruction is compared with.
#[derive(Clone, Copy, Debug)]
pub struct Truth<'a> {
    /// The true surface, in the frame of the reconstruction.
    pub mesh: &'a Mesh,
    /// Vertices that the camera sees; `None` = not known.
    pub visible: Option<&'a [bool]>,
    /// Vertices of the deformed zone; `None` = not known. See [`deformed_zone`].
    pub zone: Option<&'a [bool]>,
    /// Camera of the frame, for reprojection errors.
    pub camera: Option<&'a CameraModel>,
}

impl<'a> Truth<'a> {
    /// A surface of which nothing else is known.
    pub fn new(mesh: &'a Mesh) -> Self {
        Self { mesh, visible: None, zone: None, camera: None }
    }
}

/// Options of [`evaluate`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EvaluateOptions {
    /// Motion (and scale) that is fitted and taken out before anything is measured; default none:
    /// absolute errors.
    pub alignment: Alignment,
}

/// Result of [`evaluate`]; lengths in the unit of the input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// What was taken out.
    pub alignment: Alignment,
    /// Scale of the alignment (reconstruction to truth); 1 without similarity alignment.
    pub scale: f64,
    /// Distance of every vertex to its true place; only with the truth's connectivity.
    pub vertices: Option<VertexErrors>,
    /// Root mean square difference of edge lengths; only with the truth's connectivity.
    pub edge_length_rms: Option<f64>,
    /// Distance in px between the projections of every visible vertex and of its true place; only
    /// with the truth's connectivity and a camera.
    pub reprojection_px: Option<ErrorStats>,
    /// Distance from every reconstructed vertex to the true surface.
    pub found_to_truth: ErrorStats,
    /// Distance from every true vertex to the reconstructed surface.
    pub truth_to_found: ErrorStats,
}

/// Vertex errors of a frame and of its parts; a part is `None` where it is unknown or empty.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct VertexErrors {
    /// Every vertex.
    pub all: ErrorStats,
    /// Vertices that the camera sees.
    pub visible: Option<ErrorStats>,
    /// Vertices that it does not see.
    pub hidden: Option<ErrorStats>,
    /// The deformed zone, visible or not.
    pub zone: Option<ErrorStats>,
    /// The visible part of the deformed zone.
    pub visible_zone: Option<ErrorStats>,
}

/// Why nothing could be compared.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EvaluateError {
    /// A list per vertex of the wrong length.
    #[error("{what} has {found} entries, but the true mesh has {expected} vertices")]
    Length {
        /// Which list.
        what: &'static str,
        /// Its length.
        found: usize,
        /// Vertices of the true mesh.
        expected: usize,
    },
    /// A vertex that is not a number.
    #[error("vertex {vertex} of the {which} mesh is not finite")]
    NotFinite {
        /// `reconstructed` or `true`.
        which: &'static str,
        /// 0-based vertex.
        vertex: usize,
    },
    /// Too few or collinear points.
    #[error(
        "the meshes cannot be aligned: at least three vertices that are not in line are needed"
    )]
    Alignment,
}

/// Compare a reconstruction with the truth, both in the same frame and unit (or aligned first).
///
/// # Errors
/// A truth or a mesh that cannot be measured (counts, numbers that are not finite), or no
/// alignment.
#[doc(alias("RMSE", "chamfer distance"))]
pub fn evaluate(
    found: &Mesh,
    truth: &Truth,
    options: &EvaluateOptions,
) -> Result<Evaluation, EvaluateError> {
    check(found, truth)?;
    let same = found.topology == truth.mesh.topology;
    let fit =
        align::fit(found, truth.mesh, same, options.alignment).ok_or(EvaluateError::Alignment)?;
    let aligned = found.with_positions(found.positions.iter().map(|p| fit * p).collect());
    Ok(Evaluation {
        alignment: options.alignment,
        scale: fit.scaling(),
        vertices: same.then(|| vertex_errors(&aligned.positions, truth)).flatten(),
        edge_length_rms: same.then(|| edge_length_rms(&aligned, truth.mesh)).flatten(),
        reprojection_px: same.then(|| reprojection(&aligned.positions, truth)).flatten(),
        found_to_truth: surface_distance(&aligned, truth.mesh),
        truth_to_found: surface_distance(truth.mesh, &aligned),
    })
}

fn check(found: &Mesh, truth: &Truth) -> Result<(), EvaluateError> {
    let expected = truth.mesh.positions.len();
    for (what, list) in [("the visibility list", truth.visible), ("the zone list", truth.zone)] {
        match list {
            Some(l) if l.len() != expected => {
                return Err(EvaluateError::Length { what, found: l.len(), expected });
            }
            _ => {}
        }
    }
    for (which, mesh) in [("reconstructed", found), ("true", truth.mesh)] {
        let bad = |p: &Point3| !p.coords.iter().all(|x| x.is_finite());
        if let Some(vertex) = mesh.positions.iter().position(bad) {
            return Err(EvaluateError::NotFinite { which, vertex });
        }
    }
    Ok(())
}

fn vertex_errors(found: &[Point3], truth: &Truth) -> Option<VertexErrors> {
    let errors: Vec<f64> =
        found.iter().zip(&truth.mesh.positions).map(|(a, b)| (a - b).norm()).collect();
    let part = |keep: &dyn Fn(usize) -> Option<bool>| {
        ErrorStats::of(
            errors.iter().enumerate().filter(|&(i, _)| keep(i) == Some(true)).map(|e| *e.1),
        )
    };
    let visible = |i: usize| truth.visible.map(|v| v[i]);
    let zone = |i: usize| truth.zone.map(|z| z[i]);
    Some(VertexErrors {
        all: ErrorStats::of(errors.iter().copied())?,
        visible: part(&visible),
        hidden: part(&|i| visible(i).map(|v| !v)),
        zone: part(&zone),
        visible_zone: part(&|i| Some(visible(i)? && zone(i)?)),
    })
}

/// `√ mean (‖found edge‖ − ‖true edge‖)²` over the edges of the shared connectivity.
fn edge_length_rms(found: &Mesh, truth: &Mesh) -> Option<f64> {
    let length = |mesh: &Mesh, [a, b]: [u32; 2]| {
        (mesh.positions[a as usize] - mesh.positions[b as usize]).norm()
    };
    let difference = |&e: &[u32; 2]| length(found, e) - length(truth, e);
    ErrorStats::of(found.topology.edges.iter().map(difference)).map(|s| s.rms)
}

fn reprojection(found: &[Point3], truth: &Truth) -> Option<ErrorStats> {
    let camera = truth.camera?;
    let error = |i: usize| {
        let (a, b) = (camera.project(&found[i])?, camera.project(&truth.mesh.positions[i])?);
        Some((a.pixel - b.pixel).norm())
    };
    let seen = |&i: &usize| truth.visible.is_none_or(|v| v[i]);
    ErrorStats::of((0..found.len()).filter(seen).filter_map(error))
}

fn surface_distance(from: &Mesh, to: &Mesh) -> ErrorStats {
    let surface = ClosestPoints::new(to);
    let used = |i: &usize| !from.topology.vertex_faces[*i].is_empty();
    let distances = (0..from.positions.len())
        .filter(used)
        .filter_map(|i| Some(surface.closest(&from.positions[i])?.distance));
    ErrorStats::of(distances).unwrap_or_default()
}

/// The similarity of an evaluation applied to a point list: `target = similarity * point`.
pub fn transformed(similarity: &Similarity, points: &[Point3]) -> Vec<Point3> {
    points.iter().map(|p| similarity * p).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Isometry, Vector3};
    use crate::mesh::Topology;
    use std::sync::Arc;

    /// A bent 5 × 5 grid at z ≈ 50.
    fn patch() -> Mesh {
        let positions = (0..25)
            .map(|i| (f64::from(i % 5), f64::from(i / 5)))
            .map(|(x, y)| Point3::new(x, y, 50.0 + 0.1 * x * x + 0.05 * x * y))
            .collect();
        let faces = (0..16u32)
            .map(|k| k / 4 * 5 + k % 4)
            .flat_map(|i| [[i, i + 1, i + 5], [i + 1, i + 6, i + 5]])
            .collect();
        Mesh::new(positions, faces).unwrap()
    }

    #[test]
    fn parts_by_hand() {
        let truth = patch();
        let mut moved = truth.positions.clone();
        moved[0].z += 3.0;
        moved[1].z += 4.0;
        let visible: Vec<bool> = (0..25).map(|i| i != 1).collect();
        let zone: Vec<bool> = (0..25).map(|i| i < 2).collect();
        let reference = Truth { visible: Some(&visible), zone: Some(&zone), ..Truth::new(&truth) };
        let e = evaluate(&truth.with_positions(moved), &reference, &Default::default()).unwrap();
        let v = e.vertices.unwrap();
        assert!((v.all.rms - 1.0).abs() < 1e-12 && (v.all.mean - 7.0 / 25.0).abs() < 1e-12);
        assert_eq!((v.all.median, v.all.max), (0.0, 4.0));
        assert_eq!((v.hidden.unwrap().max, v.visible_zone.unwrap().count), (4.0, 1));
        assert!((v.zone.unwrap().rms - 12.5f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn alignment_removes_a_similarity_and_nothing_else() {
        let truth = patch();
        let s = Similarity::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.0, 0.1, 0.0), 1.7);
        let found = truth.with_positions(transformed(&s, &truth.positions));
        let run = |alignment| {
            evaluate(&found, &Truth::new(&truth), &EvaluateOptions { alignment }).unwrap()
        };
        let similar = run(Alignment::Similarity);
        assert!(
            similar.vertices.unwrap().all.max < 1e-9 && similar.edge_length_rms.unwrap() < 1e-9
        );
        assert!((similar.scale - 1.0 / 1.7).abs() < 1e-9);
        assert!(run(Alignment::Rigid).edge_length_rms.unwrap() > 0.3);
        assert!(run(Alignment::None).vertices.unwrap().all.rms > 10.0);
    }

    #[test]
    fn another_connectivity_in_another_unit_is_scaled_about_the_camera() {
        let truth = patch();
        let faces = truth.topology.faces[1..].to_vec();
        let topology = Arc::new(Topology::new(25, faces).unwrap());
        let positions = truth.positions.iter().map(|p| p * 0.04).collect();
        let found = Mesh { topology, positions };
        let options = EvaluateOptions { alignment: Alignment::Similarity };
        let e = evaluate(&found, &Truth::new(&truth), &options).unwrap();
        assert!((e.scale - 25.0).abs() < 0.01 && e.found_to_truth.max < 0.01, "{e:?}");
    }

    #[test]
    fn another_connectivity_is_measured_surface_to_surface() {
        let truth = patch();
        let faces = truth.topology.faces[1..].to_vec();
        let found = Mesh { topology: Arc::new(Topology::new(25, faces).unwrap()), ..truth.clone() };
        let e = evaluate(&found, &Truth::new(&truth), &Default::default()).unwrap();
        assert!(e.vertices.is_none() && e.found_to_truth.max < 1e-12);
        // Vertex 0 lost its only face.
        assert!(e.truth_to_found.max > 0.5 && e.truth_to_found.max < 1.0);
    }

    #[test]
    fn reprojection_of_a_sideways_shift() {
        let truth = patch();
        let camera = CameraModel {
            size: [100, 100],
            focal: [100.0, 100.0],
            centre: [0.0, 0.0],
            lens: Default::default(),
        };
        let flat = truth
            .with_positions(truth.positions.iter().map(|p| Point3::new(p.x, p.y, 50.0)).collect());
        let shift = Isometry::translation(0.5, 0.0, 0.0);
        let moved = flat.with_positions(flat.positions.iter().map(|p| shift * p).collect());
        let reference = Truth { camera: Some(&camera), ..Truth::new(&flat) };
        let e = evaluate(&moved, &reference, &Default::default()).unwrap();
        assert!((e.reprojection_px.unwrap().rms - 1.0).abs() < 1e-12);
    }

    #[test]
    fn names_what_does_not_fit() {
        let truth = patch();
        let reference = Truth { visible: Some(&[true]), ..Truth::new(&truth) };
        let error = evaluate(&truth, &reference, &Default::default()).unwrap_err().to_string();
        assert!(error.contains("visibility list has 1 entries"), "{error}");
        let mut broken = truth.clone();
        broken.positions[3].x = f64::NAN;
        let error = evaluate(&broken, &Truth::new(&truth), &Default::default()).unwrap_err();
        assert!(matches!(error, EvaluateError::NotFinite { which: "reconstructed", vertex: 3 }));
    }
}
