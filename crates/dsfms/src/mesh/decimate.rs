//! A coarser mesh on some of the vertices, and how to carry a displacement back.

use super::Mesh;
use crate::geometry::{GRAIN, Point3, Vector3, area_normal, barycentric};
use nalgebra::Matrix3;
use rayon::prelude::*;

/// A decimated mesh and where the vertices of the original lie on it.
#[derive(Clone, Debug)]
pub struct Decimated {
    /// The coarse mesh.
    pub mesh: Mesh,
    /// Original number of every coarse vertex, ascending.
    pub kept: Vec<u32>,
    /// Coarse vertex that every original vertex was merged into.
    owner: Vec<u32>,
}

/// Vertices of more neighbours are not made.
const MAX_VALENCE: usize = 12;

/// Collapse short edges, in sweeps of growing length, until about `target` vertices are left;
/// outline and orientation stay. `None` where the surface does not allow it.
#[doc(alias("quadric error", "simplification"))]
pub(crate) fn decimate(mesh: &Mesh, target: usize) -> Option<Decimated> {
    decimate_finer(mesh, target, &vec![1.0; mesh.positions.len()])
}

/// The same, with edges shorter by the factors `fineness` of the vertices.
pub(crate) fn decimate_finer(mesh: &Mesh, target: usize, fineness: &[f64]) -> Option<Decimated> {
    let mut work = Collapser {
        positions: &mesh.positions,
        fineness,
        boundary: &mesh.topology.boundary,
        faces: mesh.topology.faces.clone(),
        around: mesh.topology.vertex_faces.clone(),
        into: (0..mesh.topology.vertex_count as u32).collect(),
    };
    let mut left: Vec<u32> = work.into.clone();
    let mut limit = 0.5 * mesh.mean_edge_length();
    let [low, high] = mesh.bounding_box();
    while left.len() > target {
        let excess = left.len() - target;
        work.sweep(&left, limit * limit, excess);
        left.retain(|&v| work.into[v as usize] == v);
        limit *= GROWTH;
        if limit > (high - low).norm() {
            return None;
        }
    }
    work.finish()
}

/// Growth of the longest edge that is collapsed, from one sweep to the next.
const GROWTH: f64 = 1.15;

struct Collapser<'a> {
    positions: &'a [Point3],
    /// Lengths at a vertex count as so many times longer.
    fineness: &'a [f64],
    boundary: &'a [bool],
    faces: Vec<[u32; 3]>,
    /// Faces around every vertex; none around a vertex that is gone.
    around: Vec<Vec<u32>>,
    /// Vertex that another was merged into, itself for those that are left.
    into: Vec<u32>,
}

impl Collapser<'_> {
    /// Merge at most `most` vertices into their nearest neighbour, none twice and none next to
    /// another.
    fn sweep(&mut self, left: &[u32], limit: f64, most: usize) {
        let mut touched = vec![false; self.into.len()];
        let mut merged = 0;
        for &v in left {
            if touched[v as usize] || merged == most {
                continue;
            }
            let ring = self.ring(v);
            let at = &self.positions[v as usize];
            let nearest = ring
                .iter()
                .map(|&u| {
                    let fineness = self.fineness[u as usize] * self.fineness[v as usize];
                    ((self.positions[u as usize] - at).norm_squared() * fineness, u)
                })
                .filter(|&(distance, u)| distance < limit && !touched[u as usize])
                .min_by(|a, b| a.0.total_cmp(&b.0));
            if nearest.is_some_and(|(_, u)| self.collapse(v, u)) {
                ring.iter().for_each(|&w| touched[w as usize] = true);
                merged += 1;
            }
        }
    }

    fn ring(&self, v: u32) -> Vec<u32> {
        let faces = self.around[v as usize].iter().flat_map(|&f| self.faces[f as usize]);
        let mut ring: Vec<u32> = faces.filter(|&w| w != v).collect();
        ring.sort_unstable();
        ring.dedup();
        ring
    }

    /// Merge `v` into `u` unless that spoils the surface.
    fn collapse(&mut self, v: u32, u: u32) -> bool {
        let (mine, theirs) = (self.ring(v), self.ring(u));
        if mine.binary_search(&u).is_err() || !self.allowed(v, u, &mine, &theirs) {
            return false;
        }
        for f in std::mem::take(&mut self.around[v as usize]) {
            let face = self.faces[f as usize];
            if face.contains(&u) {
                for w in face.into_iter().filter(|&w| w != v) {
                    self.around[w as usize].retain(|&g| g != f);
                }
                self.faces[f as usize] = [u32::MAX; 3];
            } else {
                self.faces[f as usize] = face.map(|w| if w == v { u } else { w });
                self.around[u as usize].push(f);
            }
        }
        self.into[v as usize] = u;
        true
    }

    fn allowed(&self, v: u32, u: u32, mine: &[u32], theirs: &[u32]) -> bool {
        let shared = mine.iter().filter(|&w| theirs.binary_search(w).is_ok()).count();
        let faces = || self.around[v as usize].iter().map(|&f| self.faces[f as usize]);
        let common = faces().filter(|f| f.contains(&u)).count();
        let interior = !self.boundary[v as usize];
        shared == common
            && common == if interior { 2 } else { 1 }
            && mine.len() + theirs.len() < MAX_VALENCE + 2 + shared
            && (interior || self.straight(v, u, mine))
            && faces().filter(|f| !f.contains(&u)).all(|f| self.stays_good(f, v, u))
    }

    /// Whether the boundary hardly turns at `v`.
    fn straight(&self, v: u32, u: u32, ring: &[u32]) -> bool {
        let at = |w: u32| self.positions[w as usize];
        let uses = |w: u32| {
            let around = self.around[v as usize].iter();
            around.filter(|&&f| self.faces[f as usize].contains(&w)).count()
        };
        let before = ring.iter().find(|&&w| w != u && uses(w) == 1);
        before.is_some_and(|&w| {
            let (d, e) = (at(v) - at(w), at(u) - at(v));
            d.dot(&e) > 0.8 * d.norm() * e.norm()
        })
    }

    /// Whether a face keeps its side and some area when `v` moves to `u`.
    fn stays_good(&self, face: [u32; 3], v: u32, u: u32) -> bool {
        let at = |w: u32| self.positions[w as usize];
        let normal = |f: [u32; 3]| area_normal(&at(f[0]), &at(f[1]), &at(f[2]));
        let moved = face.map(|w| if w == v { u } else { w });
        let (old, new) = (normal(face), normal(moved));
        let [a, b, c] = moved.map(at);
        let sides = (b - a).norm_squared() + (c - b).norm_squared() + (a - c).norm_squared();
        old.dot(&new) > 0.5 * old.norm() * new.norm() && new.norm() > 0.05 * sides
    }

    fn finish(mut self) -> Option<Decimated> {
        let kept: Vec<u32> = (0..self.into.len() as u32)
            .filter(|&v| self.into[v as usize] == v && !self.around[v as usize].is_empty())
            .collect();
        let name = |v: u32| kept.binary_search(&v).map_or(u32::MAX, |k| k as u32);
        for v in 0..self.into.len() {
            let mut root = v as u32;
            while self.into[root as usize] != root {
                root = self.into[root as usize];
            }
            self.into[v] = root;
        }
        let faces = self.faces.iter().filter(|f| f[0] != u32::MAX).map(|f| f.map(name)).collect();
        let positions = kept.iter().map(|&v| self.positions[v as usize]).collect();
        let owner = self.into.iter().map(|&v| name(v)).collect();
        Some(Decimated { mesh: Mesh::new(positions, faces).ok()?, kept, owner })
    }
}

impl Decimated {
    /// Where a point near an original vertex lies on the coarse mesh: a face and barycentrics,
    /// which may be a little negative; `None` for a vertex without a face.
    pub(crate) fn locate(&self, point: &Point3, near: u32) -> Option<(u32, [f64; 3])> {
        let topology = &*self.mesh.topology;
        let owner = self.owner[near as usize];
        let inside = |&f: &u32| {
            let b = barycentric(point, self.mesh.corners(f as usize))?;
            Some((b.into_iter().fold(f64::INFINITY, f64::min), f, b))
        };
        let best = |faces: &mut dyn Iterator<Item = &u32>| {
            faces.filter_map(inside).max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))
        };
        let found = best(&mut topology.vertex_faces.get(owner as usize)?.iter())?;
        if found.0 > -1e-3 {
            return Some((found.1, found.2));
        }
        let ring = topology.one_ring[owner as usize].iter();
        let wider = best(&mut ring.flat_map(|&w| &topology.vertex_faces[w as usize]))?;
        Some((wider.1, wider.2))
    }

    /// Carry a displacement of the coarse vertices to the original ones. Exact, but for the
    /// estimate of its gradient, where the displacement is quadratic: the mean of linear
    /// interpolation and of the first-order expansions about the corners.
    pub(crate) fn prolong(&self, fine: &Mesh, displacement: &[Vector3]) -> Vec<Vector3> {
        self.prolong_by(fine, displacement, |v| self.locate(&fine.positions[v], v as u32))
    }

    /// The same where it is known where the original vertices lie ([`locate`](Self::locate)).
    pub(crate) fn prolong_by(
        &self,
        fine: &Mesh,
        displacement: &[Vector3],
        place: impl Fn(usize) -> Option<(u32, [f64; 3])> + Sync,
    ) -> Vec<Vector3> {
        let gradient = |v: usize| self.gradient(v, displacement);
        let gradients: Vec<Matrix3<f64>> =
            (0..displacement.len()).into_par_iter().with_min_len(GRAIN).map(gradient).collect();
        let at = |v: usize| {
            let Some((face, b)) = place(v) else { return Vector3::zeros() };
            let (point, corners) = (&fine.positions[v], self.mesh.topology.faces[face as usize]);
            let expansion =
                |k: usize| displacement[k] + gradients[k] * (point - self.mesh.positions[k]) * 0.5;
            corners.into_iter().zip(b).map(|(k, w)| expansion(k as usize) * w).sum()
        };
        (0..fine.positions.len()).into_par_iter().with_min_len(GRAIN).map(at).collect()
    }

    /// Least-squares gradient over the ring, zero across the surface.
    fn gradient(&self, v: usize, displacement: &[Vector3]) -> Matrix3<f64> {
        let (mut outer, mut mixed) = (Matrix3::zeros(), Matrix3::zeros());
        for &w in &self.mesh.topology.one_ring[v] {
            let edge = self.mesh.positions[w as usize] - self.mesh.positions[v];
            outer += edge * edge.transpose();
            mixed += (displacement[w as usize] - displacement[v]) * edge.transpose();
        }
        let ridge = Matrix3::from_diagonal_element(1e-3 * outer.trace() + 1e-300);
        mixed * (outer + ridge).try_inverse().unwrap_or_else(Matrix3::zeros)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn a_sphere_stays_closed_and_a_sheet_keeps_its_corners() {
        let sphere = decimate(&shapes::icosphere(3, 2.0), 150).unwrap();
        assert_eq!(sphere.mesh.positions.len(), 150);
        assert_eq!(sphere.mesh.topology.euler_characteristic(), 2);
        let fine = shapes::irregular_sheet(20);
        let sheet = decimate(&fine, 80).unwrap();
        assert_eq!(sheet.mesh.topology.euler_characteristic(), 1);
        assert_eq!(sheet.mesh.bounding_box(), fine.bounding_box());
        assert!(sheet.mesh.min_angles().iter().all(|a| a.to_degrees() > 5.0));
    }

    #[test]
    fn carries_back_a_bend() {
        let fine = shapes::irregular_sheet(30);
        let coarse = decimate(&fine, 150).unwrap();
        let [low, high] = fine.bounding_box();
        let size = (high - low).x;
        let bend = |p: &Point3| {
            let (x, y) = ((p.x - low.x) / size, (p.y - low.y) / size);
            Vector3::new(0.1 * y, 0.2 - x * y, x * x)
        };
        let given: Vec<Vector3> = coarse.mesh.positions.iter().map(bend).collect();
        let carried = coarse.prolong(&fine, &given);
        let flat = |v: usize| {
            let (face, b) = coarse.locate(&fine.positions[v], v as u32).unwrap();
            let corners = coarse.mesh.topology.faces[face as usize];
            corners.iter().zip(b).map(|(&k, w)| given[k as usize] * w).sum::<Vector3>()
        };
        let mean_error = |found: &dyn Fn(usize) -> Vector3| {
            let errors = (0..900).map(|v| (found(v) - bend(&fine.positions[v])).norm());
            errors.sum::<f64>() / 900.0
        };
        let (linear, quadratic) = (mean_error(&flat), mean_error(&|v| carried[v]));
        assert!(quadratic < 0.7 * linear && quadratic < 1.5e-3, "{quadratic} {linear}");
    }
}
