//! A displacement of some vertices of a mesh carried to all of them as smoothly as can be.

use crate::geometry::Vector3;
use crate::mesh::Mesh;
use crate::mesh::laplacian::Laplacian;
use crate::solver::ScalarCholesky;
use std::sync::Arc;

/// `min Σᵢ mᵢ ‖(Lap d)ᵢ‖²` over all vertices `i`, with `d` given at some of them: so the normals of
/// a carried surface are right too, which brightness reads.
#[doc(alias("biharmonic interpolation", "thin plate"))]
#[derive(Clone)]
pub(super) struct SmoothCarry {
    laplacian: Laplacian,
    /// Vertices whose displacement is given, ascending.
    given: Vec<u32>,
    /// The others, ascending.
    free: Vec<u32>,
    factor: Arc<ScalarCholesky>,
}

impl std::fmt::Debug for SmoothCarry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [given, free] = [&self.given, &self.free].map(Vec::len);
        write!(f, "SmoothCarry({given} of {})", given + free)
    }
}

/// Share of the mean diagonal by which every free vertex is held at rest, so that one without a
/// neighbour has a place.
const RIDGE: f64 = 1e-9;

impl SmoothCarry {
    /// Of a rest mesh and the vertices whose displacement is given (ascending); `None` where the
    /// system cannot be solved.
    pub(super) fn of(mesh: &Mesh, given: &[u32]) -> Option<Self> {
        let laplacian = Laplacian::new(mesh);
        let free: Vec<u32> =
            (0..mesh.positions.len() as u32).filter(|v| given.binary_search(v).is_err()).collect();
        let mut place = vec![None; mesh.positions.len()];
        free.iter().enumerate().for_each(|(k, &v)| place[v as usize] = Some(k));
        let mut lower = Vec::new();
        for (i, row) in laplacian.rows.iter().enumerate() {
            let own = (i, -row.iter().map(|r| r.1).sum::<f64>());
            let whole = std::iter::once(own).chain(row.iter().map(|&(j, w)| (j as usize, w)));
            let inside: Vec<(usize, f64)> =
                whole.filter_map(|(v, w)| Some((place[v]?, w))).collect();
            for &(a, wa) in &inside {
                let below = inside.iter().filter(|&&(b, _)| b <= a);
                lower.extend(below.map(|&(b, wb)| (a, b, laplacian.mass[i] * wa * wb)));
            }
        }
        let diagonal: f64 = lower.iter().filter(|e| e.0 == e.1).map(|e| e.2).sum();
        let ridge = RIDGE * diagonal / free.len().max(1) as f64;
        lower.extend((0..free.len()).map(|k| (k, k, ridge)));
        let factor = Arc::new(ScalarCholesky::new(free.len(), &lower)?);
        Some(Self { laplacian, given: given.to_vec(), free, factor })
    }

    /// The displacement of all vertices; `None` where it is not finite.
    pub(super) fn carry(&self, displacement: &[Vector3]) -> Option<Vec<Vector3>> {
        let Laplacian { rows, mass } = &self.laplacian;
        let mut all = vec![Vector3::zeros(); rows.len()];
        self.given.iter().zip(displacement).for_each(|(&v, d)| all[v as usize] = *d);
        // What the given ones pull the others by, all others at rest.
        let mut pull = vec![Vector3::zeros(); rows.len()];
        for (i, row) in rows.iter().enumerate() {
            let bend = self.laplacian.apply(i, &all) * mass[i];
            for &(j, w) in row {
                pull[i] += bend * w;
                pull[j as usize] -= bend * w;
            }
        }
        for axis in 0..3 {
            let mut x: Vec<f64> = self.free.iter().map(|&v| pull[v as usize][axis]).collect();
            self.factor.solve(&mut x)?;
            self.free.iter().zip(x).for_each(|(&v, x)| all[v as usize][axis] = x);
        }
        Some(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Point3;
    use crate::mesh::decimate::decimate;
    use crate::mesh::normals::vertex_normals;
    use crate::mesh::shapes;

    #[test]
    fn what_is_given_stays_and_a_shift_is_carried_whole() {
        let mesh = shapes::icosphere(3, 20.0);
        let given: Vec<u32> = (0..mesh.positions.len() as u32).step_by(7).collect();
        let carry = SmoothCarry::of(&mesh, &given).unwrap();
        let shift = Vector3::new(1.0, -2.0, 3.0);
        let carried = carry.carry(&vec![shift; given.len()]).unwrap();
        assert!(carried.iter().all(|d| (d - shift).norm() < 1e-4));
        let own: Vec<Vector3> = given.iter().map(|&v| Vector3::x() * f64::from(v)).collect();
        let carried = carry.carry(&own).unwrap();
        assert!(given.iter().zip(&own).all(|(&v, d)| carried[v as usize] == *d));
    }

    #[test]
    fn the_normals_of_a_narrow_bump_are_nearer_than_by_faces() {
        let fine = shapes::irregular_sheet(40);
        let coarse = decimate(&fine, 160).unwrap();
        let [low, high] = fine.bounding_box();
        let (middle, size) = (nalgebra::center(&low, &high), (high - low).x);
        let bump = |p: &Point3| {
            Vector3::z() * 0.1 * size * (-((p - middle) / (0.15 * size)).norm_squared()).exp()
        };
        let moved = |d: &[Vector3]| -> Vec<Point3> {
            fine.positions.iter().zip(d).map(|(p, d)| p + d).collect()
        };
        let truth: Vec<Vector3> = fine.positions.iter().map(bump).collect();
        let given: Vec<Vector3> = coarse.mesh.positions.iter().map(bump).collect();
        let right = vertex_normals(&fine.topology, &moved(&truth));
        let off = |d: &[Vector3]| -> f64 {
            let normals = vertex_normals(&fine.topology, &moved(d));
            normals.iter().zip(&right).map(|(a, b)| a.angle(b)).sum()
        };
        let smooth = SmoothCarry::of(&fine, &coarse.kept).unwrap().carry(&given).unwrap();
        let [smooth, by_faces] = [off(&smooth), off(&coarse.prolong(&fine, &given))];
        assert!(smooth < 0.6 * by_faces, "{smooth}, by faces {by_faces}");
    }
}
