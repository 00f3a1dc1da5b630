//! Least-squares conformal maps (Lévy et al. 2002): the conformal energy with two vertices held.

use super::energy;
use crate::geometry::Point2;
use crate::mesh::Mesh;
use crate::mesh::boundary::boundary_loops;
use crate::solver::ScalarCholesky;

/// UV of every vertex of a disc; `None` where the system cannot be solved.
pub(super) fn flatten_disc(mesh: &Mesh) -> Option<Vec<Point2>> {
    let [a, b] = pins(mesh)?;
    let mut u = vec![0.0; 2 * mesh.positions.len()];
    u[2 * b] = (mesh.positions[b] - mesh.positions[a]).norm();
    let mut place = vec![usize::MAX; u.len()];
    let free: Vec<usize> = (0..u.len()).filter(|i| i / 2 != a && i / 2 != b).collect();
    free.iter().enumerate().for_each(|(k, &i)| place[i] = k);
    let (mut lower, mut rhs) = (Vec::new(), vec![0.0; free.len()]);
    for (i, j, value) in energy::matrix(mesh) {
        match (place[i], place[j]) {
            (usize::MAX, usize::MAX) => {}
            (k, usize::MAX) => rhs[k] -= value * u[j],
            (usize::MAX, k) => rhs[k] -= value * u[i],
            (k, l) => lower.push((k, l, value)),
        }
    }
    ScalarCholesky::new(free.len(), &lower)?.solve(&mut rhs)?;
    free.iter().zip(rhs).for_each(|(&i, value)| u[i] = value);
    energy::layout(mesh, &u)
}

/// Two vertices of the boundary far from each other.
fn pins(mesh: &Mesh) -> Option<[usize; 2]> {
    let outline = boundary_loops(&mesh.topology).into_iter().next()?;
    let farthest = |from: u32| {
        let distance =
            |v: &&u32| (mesh.positions[**v as usize] - mesh.positions[from as usize]).norm();
        outline.iter().max_by(|a, b| distance(a).total_cmp(&distance(b))).copied()
    };
    let a = farthest(outline[0])?;
    let b = farthest(a)?;
    (a != b).then_some([a as usize, b as usize])
}
