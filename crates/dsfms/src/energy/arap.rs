//! As rigid as possible (Sorkine and Alexa 2007): every vertex's ring turns as one.
//!
//! `r = (xⱼ − xᵢ) − Rᵢ (pⱼ − pᵢ)` for every directed edge of the rest shape `p`, weighted by the
//! cotangent weight of the edge over the visible area, with `Rᵢ` the rotation that fits the ring of
//! `i` best: the polar factor of `M = Σⱼ wᵢⱼ (xⱼ − xᵢ)(pⱼ − pᵢ)ᵀ`. The rotations are functions of
//! the vertices, not unknowns, and their derivative is kept, so this is the reduced energy and its
//! exact Jacobian, not one half of an alternation. For small strain of a flat piece it is the
//! isometric prior; beyond that it resists bending (within a ring, hence the less the finer the
//! mesh).

use super::{EnergyTerm, Infeasible, Jacobian};
use crate::geometry::{Point3, Vector3};
use crate::mesh::laplacian::Laplacian;
use nalgebra::{Matrix3, SVector};

/// Rings of the rest shape with their weights.
#[doc(alias = "as-rigid-as-possible")]
#[derive(Clone, Debug)]
pub struct Arap {
    rings: Vec<Ring>,
    /// Ring and place in it of every directed edge.
    spokes: Vec<(u32, u32)>,
}

#[derive(Clone, Debug)]
struct Ring {
    /// The vertex first, then its neighbours.
    stencil: Vec<u32>,
    /// Rest edges from the vertex to its neighbours.
    edges: Vec<Vector3>,
    /// Their cotangent weights over the visible area.
    weights: Vec<f64>,
}

/// The rotation of a ring and what its derivative needs.
struct RingFit {
    rotation: Matrix3<f64>,
    /// `R (tr S · I − S)⁻¹ Rᵀ` for `M = R S`: from the moment of a change of `M` to the turn of
    /// `R`.
    compliance: Matrix3<f64>,
}

impl Arap {
    /// The prior of a rest shape, relative to `reference_area` (the visible area); `rest` in any
    /// rigid pose, with the Laplacian of the same shape.
    pub fn new(laplacian: &Laplacian, rest: &[Point3], reference_area: f64) -> Self {
        let (mut rings, mut spokes) = (Vec::new(), Vec::new());
        for (i, row) in laplacian.rows.iter().enumerate().filter(|(_, row)| row.len() > 1) {
            let scale = laplacian.mass[i] / reference_area;
            spokes.extend((0..row.len()).map(|k| (rings.len() as u32, k as u32)));
            rings.push(Ring {
                stencil: [i as u32].into_iter().chain(row.iter().map(|r| r.0)).collect(),
                edges: row.iter().map(|&(j, _)| rest[j as usize] - rest[i]).collect(),
                weights: row.iter().map(|&(_, w)| w * scale).collect(),
            });
        }
        Self { rings, spokes }
    }
}

impl Ring {
    /// The best rotation; infeasible where the ring has collapsed to a line and no rotation is
    /// best.
    fn fit(&self, v: &[Point3]) -> Result<RingFit, Infeasible> {
        let terms = self.edges.iter().zip(&v[1..]).zip(&self.weights);
        let moment: Matrix3<f64> = terms.map(|((e, x), &w)| (x - v[0]) * e.transpose() * w).sum();
        let svd = moment.try_svd(true, true, f64::EPSILON, 100).ok_or(Infeasible)?;
        let (u, v_t) = (svd.u.ok_or(Infeasible)?, svd.v_t.ok_or(Infeasible)?);
        let mut s = svd.singular_values;
        let mut sign = Vector3::repeat(1.0);
        if (u * v_t).determinant() < 0.0 {
            let weakest = s.imin();
            (sign[weakest], s[weakest]) = (-1.0, -s[weakest]);
        }
        let stiffness = Vector3::new(s.y + s.z, s.z + s.x, s.x + s.y);
        if stiffness.min() <= 1e-9 * stiffness.max() || !stiffness.max().is_finite() {
            return Err(Infeasible);
        }
        let rotation = u * Matrix3::from_diagonal(&sign) * v_t;
        let compliance = u * Matrix3::from_diagonal(&stiffness.map(|k| 1.0 / k)) * u.transpose();
        Ok(RingFit { rotation, compliance })
    }
}

impl EnergyTerm<3> for Arap {
    fn count(&self) -> usize {
        self.spokes.len()
    }

    fn stencil(&self, i: usize) -> &[u32] {
        &self.rings[self.spokes[i].0 as usize].stencil
    }

    fn weight(&self, i: usize) -> f64 {
        let (ring, spoke) = self.spokes[i];
        self.rings[ring as usize].weights[spoke as usize]
    }

    fn residual(
        &self,
        i: usize,
        v: &[Point3],
        _: &[f64],
        jacobian: Option<Jacobian<'_, 3>>,
    ) -> Result<SVector<f64, 3>, Infeasible> {
        let (ring, spoke) = (&self.rings[self.spokes[i].0 as usize], self.spokes[i].1 as usize);
        let fit = ring.fit(v)?;
        let turned = fit.rotation * ring.edges[spoke];
        if let Some(j) = jacobian {
            // A step d of neighbour k turns the ring by compliance · (w R eₖ × d), and with it this
            // edge: −δ(R e) = R e × turn.
            let lever = turned.cross_matrix() * fit.compliance;
            for (k, (edge, &w)) in ring.edges.iter().zip(&ring.weights).enumerate() {
                let d = lever * (fit.rotation * edge * w).cross_matrix();
                j.vertices[k + 1] += d;
                j.vertices[0] -= d;
            }
            j.vertices[spoke + 1] += Matrix3::identity();
            j.vertices[0] -= Matrix3::identity();
        }
        Ok(v[spoke + 1] - v[0] - turned)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::check::{assert_jacobian, bent_patch, energy, rigidly_moved, warped};
    use crate::energy::{Isometric, RestFaces};
    use crate::mesh::{Mesh, shapes};

    fn arap(mesh: &Mesh, area: f64) -> Arap {
        Arap::new(&Laplacian::new(mesh), &mesh.positions, area)
    }

    #[test]
    fn derivative() {
        let mesh = bent_patch();
        assert_jacobian(&arap(&mesh, 7.0), &warped(&mesh, 0.2), &[]);
    }

    #[test]
    fn ignores_rigid_motion_and_resists_bending() {
        let mesh = bent_patch();
        let term = arap(&mesh, 7.0);
        assert!(energy(&term, &rigidly_moved(&mesh.positions)) < 1e-20);
        let shape = warped(&mesh, 0.1);
        let found = energy(&term, &shape);
        assert!((energy(&term, &rigidly_moved(&shape)) / found - 1.0).abs() < 1e-9);
        // A strip of two squares folded upright keeps every length, yet costs.
        let strip = |fold: f64| -> Vec<Point3> {
            [[-1., 0.], [-1., 1.], [0., 0.], [0., 1.], [1., 0.], [1., 1.]]
                .map(
                    |[x, y]: [f64; 2]| {
                        if x > 0.0 { (x * (1.0 - fold), y, x * fold) } else { (x, y, 0.0) }
                    },
                )
                .map(|(x, y, z)| Point3::new(x, y, z))
                .to_vec()
        };
        let faces = vec![[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]];
        let flat = Mesh::new(strip(0.0), faces).unwrap();
        let rest = RestFaces::new(&flat, 2.0);
        assert!(energy(&Isometric { rest: &rest }, &strip(1.0)) < 1e-24);
        assert!(energy(&arap(&flat, 2.0), &strip(1.0)) > 0.1);
    }

    #[test]
    fn a_scaled_sheet_by_hand_and_the_isometric_prior_at_small_strain() {
        // Nearly equilateral faces: hardly a cotangent is clamped, and the weights add up to the
        // area.
        let sheet = shapes::irregular_sheet(9);
        let shear = |p: &Point3| Point3::new(p.x - 0.5 * p.y, 0.75_f64.sqrt() * p.y, 0.0);
        let mesh = sheet.with_positions(sheet.positions.iter().map(shear).collect());
        let area: f64 = mesh.face_areas().iter().sum();
        let term = arap(&mesh, area);
        // Scaled by s: ‖F − R‖² = 2 (s − 1)² over the area, twice, for each edge counts both ways.
        let scaled: Vec<Point3> = mesh.positions.iter().map(|p| p * 1.5).collect();
        assert!((energy(&term, &scaled) - 1.0).abs() < 5e-3, "{}", energy(&term, &scaled));
        let strained: Vec<Point3> = mesh
            .positions
            .iter()
            .map(|p| Point3::new(1.0002 * p.x + 1e-4 * p.y, 0.9999 * p.y, 0.0))
            .collect();
        let rest = RestFaces::new(&mesh, area);
        let ratio = energy(&term, &strained) / energy(&Isometric { rest: &rest }, &strained);
        assert!((ratio - 1.0).abs() < 1e-2, "{ratio}");
    }
}
