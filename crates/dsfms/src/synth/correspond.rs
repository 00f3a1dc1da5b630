//! Sparse correspondences of the synthetic protocol (paper §8.1).

use super::random::{Random, normal, uniform};
use crate::camera::{Camera, CameraModel};
use crate::geometry::{Point3, Vector2, point_at};
use crate::mesh::Mesh;
use crate::register::Match;

/// What is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Draw {
    /// Number of matches.
    pub count: usize,
    /// Gaussian noise of their pixels, px.
    pub sigma_px: f64,
}

/// Draw random surface points, area-uniform, with their noisy projections in a shape; faces with a
/// corner that is not `admitted` (hidden, or in the deformed zone) are skipped.
pub fn correspond(
    camera: &CameraModel,
    rest: &Mesh,
    shape: &[Point3],
    admitted: &[bool],
    draw: Draw,
    random: &mut Random,
) -> Vec<Match> {
    let whole = |f: &usize| rest.topology.faces[*f].iter().all(|&v| admitted[v as usize]);
    let faces: Vec<usize> = (0..rest.topology.faces.len()).filter(whole).collect();
    let areas = rest.face_areas();
    let mut cumulative = vec![0.0];
    for &f in &faces {
        cumulative.push(cumulative[cumulative.len() - 1] + areas[f]);
    }
    let total = cumulative[faces.len()];
    let mut matches = Vec::new();
    while matches.len() < draw.count && !faces.is_empty() {
        let k = cumulative.partition_point(|&c| c <= uniform(random) * total).clamp(1, faces.len());
        let face = faces[k - 1];
        let (u, v) = (uniform(random).sqrt(), uniform(random));
        let barycentric = [1.0 - u, u * (1.0 - v), u * v];
        let corners = rest.topology.faces[face].map(|v| &shape[v as usize]);
        let Some(seen) = camera.project(&point_at(corners, barycentric)) else { continue };
        let pixel = seen.pixel + Vector2::new(normal(random), normal(random)) * draw.sigma_px;
        matches.push(Match { face: face as u32, barycentric, pixel });
    }
    matches
}
