//! The cotangent Laplacian of a rest mesh.

use super::{Mesh, normals::lumped_areas};
use crate::geometry::Vector3;

/// Cotangents outside this are from needles, whose exact value would swamp their neighbours.
const MAX_COTANGENT: f64 = 10.0;

/// Rows of the cotangent Laplacian, negative semidefinite in the metric of the lumped areas:
/// `(Lap x)ᵢ = Σⱼ wᵢⱼ (xⱼ − xᵢ) / mᵢ`, in 1/length².
#[doc(alias("cotangent Laplacian", "Laplace-Beltrami"))]
#[derive(Clone, Debug)]
pub struct Laplacian {
    /// For every vertex its neighbours and `wᵢⱼ / mᵢ`; aligned with `Topology::one_ring`.
    pub rows: Vec<Vec<(u32, f64)>>,
    /// Lumped vertex areas `mᵢ`.
    pub mass: Vec<f64>,
}

impl Laplacian {
    /// Cotangent weights of the rest shape, each `(cot α + cot β)/2` clamped to `[0.01, 10]` so
    /// that obtuse faces cannot make the operator indefinite.
    pub fn new(mesh: &Mesh) -> Self {
        let mass = lumped_areas(mesh);
        let mut rows: Vec<Vec<(u32, f64)>> = mesh
            .topology
            .one_ring
            .iter()
            .map(|ring| ring.iter().map(|&j| (j, 0.0)).collect())
            .collect();
        for (f, face) in mesh.topology.faces.iter().enumerate() {
            let [a, b, c] = mesh.corners(f);
            for (k, (apex, p, q)) in [(a, b, c), (b, c, a), (c, a, b)].into_iter().enumerate() {
                let half = 0.5 * cotangent(&(p - apex), &(q - apex));
                let (i, j) = (face[(k + 1) % 3], face[(k + 2) % 3]);
                add(&mut rows[i as usize], j, half);
                add(&mut rows[j as usize], i, half);
            }
        }
        for (row, &m) in rows.iter_mut().zip(&mass) {
            row.iter_mut().for_each(|(_, w)| *w = w.clamp(0.01, MAX_COTANGENT) / m.max(1e-300));
        }
        Self { rows, mass }
    }

    /// `(Lap x)ᵢ` for a vector field on the vertices.
    pub fn apply(&self, i: usize, x: &[Vector3]) -> Vector3 {
        self.rows[i].iter().map(|&(j, w)| (x[j as usize] - x[i]) * w).sum()
    }
}

fn cotangent(u: &Vector3, v: &Vector3) -> f64 {
    u.dot(v) / u.cross(v).norm().max(1e-300)
}

fn add(row: &mut [(u32, f64)], j: u32, value: f64) {
    if let Ok(k) = row.binary_search_by_key(&j, |&(v, _)| v) {
        row[k].1 += value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn kills_constants_and_is_linear_on_a_flat_irregular_interior() {
        // Nearly equilateral faces: no cotangent is negative, so none is clamped.
        let sheet = shapes::irregular_sheet(9);
        let shear = |p: &crate::geometry::Point3| {
            crate::geometry::Point3::new(p.x - 0.5 * p.y, 0.75f64.sqrt() * p.y, 0.0)
        };
        let mesh = sheet.with_positions(sheet.positions.iter().map(shear).collect());
        let laplacian = Laplacian::new(&mesh);
        let linear: Vec<Vector3> =
            mesh.positions.iter().map(|p| Vector3::new(3.0, p.x - 2.0 * p.y, p.y)).collect();
        for i in 0..mesh.positions.len() {
            let value = laplacian.apply(i, &linear);
            assert_eq!(value.x, 0.0);
            if !mesh.topology.boundary[i] {
                assert!(value.norm() < 1e-9, "{value}");
            }
        }
    }

    #[test]
    fn is_symmetric_and_negative_semidefinite_in_the_mass_metric() {
        let mesh = shapes::icosphere(2, 3.0);
        let laplacian = Laplacian::new(&mesh);
        let n = mesh.positions.len();
        for seed in 0..5u64 {
            let x: Vec<Vector3> = (0..n as u64)
                .map(|i| Vector3::new(((i * 2654435761 + seed * 97) % 1000) as f64, 0.0, 0.0))
                .collect();
            let energy: f64 =
                (0..n).map(|i| laplacian.mass[i] * x[i].x * laplacian.apply(i, &x).x).sum();
            assert!(energy < 0.0);
        }
        for (i, row) in laplacian.rows.iter().enumerate() {
            for &(j, w) in row {
                let back = laplacian.rows[j as usize].iter().find(|r| r.0 == i as u32).unwrap().1;
                assert!((w * laplacian.mass[i] - back * laplacian.mass[j as usize]).abs() < 1e-12);
            }
        }
    }
}
