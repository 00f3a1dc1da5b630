//! The conformal energy of a map of a disc: Dirichlet energy minus area, zero where it is conformal
//! (Lévy et al. 2002 and Desbrun et al. 2002, in the form of Mullen et al. 2008).

use super::conformal::Cotan;
use crate::geometry::{Point2, signed_area};
use crate::mesh::Mesh;

/// Lower triangle of `M` in `E = ½ uᵀMu`, `u = (x₀, y₀, x₁, y₁, …)`: positive semi-definite, with
/// the translations (and, where the surface unfolds exactly, turns and scales) in its null space.
pub(super) fn matrix(mesh: &Mesh) -> Vec<(usize, usize, f64)> {
    let mut lower = Vec::new();
    for (i, row) in Cotan::new(mesh).rows.iter().enumerate() {
        let sum: f64 = row.iter().map(|r| r.1).sum();
        for axis in 0..2 {
            lower.push((2 * i + axis, 2 * i + axis, sum));
            let below = row.iter().filter(|(j, _)| (*j as usize) < i);
            lower.extend(below.map(|&(j, w)| (2 * i + axis, 2 * j as usize + axis, -w)));
        }
    }
    let t = &mesh.topology;
    for face in &t.faces {
        for k in 0..3 {
            let (a, b) = (face[k], face[(k + 1) % 3]);
            let rim = t.edge_index(a, b).is_some_and(|e| t.edge_faces[e][1] == u32::MAX);
            if rim {
                // The area is ½ Σ (x_a y_b − x_b y_a) along the boundary.
                let (a, b) = (2 * a as usize, 2 * b as usize);
                lower.push((a.max(b + 1), a.min(b + 1), -0.5));
                lower.push((b.max(a + 1), b.min(a + 1), 0.5));
            }
        }
    }
    lower
}

/// UV of the interleaved solution, scaled to the area of the surface; `None` for a map of no area.
pub(super) fn layout(mesh: &Mesh, u: &[f64]) -> Option<Vec<Point2>> {
    let uv: Vec<Point2> = u.chunks(2).map(|p| Point2::new(p[0], p[1])).collect();
    let faces = mesh.topology.faces.iter();
    let mapped: f64 = faces.map(|face| signed_area(&face.map(|v| uv[v as usize]))).sum();
    let scale = (mesh.face_areas().iter().sum::<f64>() / mapped).sqrt();
    (scale.is_finite() && scale > 0.0).then(|| uv.iter().map(|p| p * scale).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    fn energy(mesh: &Mesh, u: &[f64]) -> f64 {
        let twice: f64 = matrix(mesh)
            .iter()
            .map(|&(i, j, v)| if i == j { v * u[i] * u[i] } else { 2.0 * v * u[i] * u[j] })
            .sum();
        0.5 * twice
    }

    #[test]
    fn zero_for_similarities_and_known_for_a_stretch() {
        let sheet = shapes::irregular_sheet(7);
        let flat = sheet.positions.iter().flat_map(|p| {
            // The sheet itself, turned and scaled.
            [2.0 * p.x - p.y + 3.0, p.x + 2.0 * p.y - 1.0]
        });
        assert!(energy(&sheet, &flat.collect::<Vec<_>>()).abs() < 1e-9);
        // Stretched by s along x: E = ½(s² + 1)A − sA = ½(s − 1)²A.
        let area: f64 = sheet.face_areas().iter().sum();
        let wide: Vec<f64> = sheet.positions.iter().flat_map(|p| [3.0 * p.x, p.y]).collect();
        assert!((energy(&sheet, &wide) - 2.0 * area).abs() < 1e-9 * area);
    }
}
