//! The cotangent Laplacian of a rest mesh.

use super::{Mesh, normals::lumped_areas};
use crate::geometry::Vector3;

/// Cotangents outside this are from needles, whose exact value would swamp their neighbours.
const MAX_COTANGENT: f64 = 10.0;

/// Rows of the cotangent Laplacian, negative semidefinite in the metric of the lumped areas:
/// `(Lap x)ᵢ = Σⱼ wᵢⱼ (xⱼ − xᵢ) / mᵢ`, in 1/length².
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
