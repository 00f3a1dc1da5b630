//! Spectral conformal maps (Mullen et al. 2008): the least conformal energy for a boundary of unit
//! size, with nothing held. The extent of the boundary counts, so no two vertices pull at the map.

use super::{conformal, energy};
use crate::geometry::Point2;
use crate::mesh::Mesh;
use crate::solver::ScalarCholesky;

/// Added to the diagonal, so that the null space of the energy does not stop the factorisation; the
/// energy's own diagonal is of the order of 1.
const SHIFT: f64 = 1e-8;
/// Steps of the inverse iteration.
const ROUNDS: usize = 200;
/// Change of the unit vector at which it ends.
const TOLERANCE: f64 = 1e-10;

/// UV of every vertex of a disc; `None` where the system cannot be solved. Inverse iteration from
/// the map of constant boundary scale, which is close.
pub(super) fn flatten_disc(mesh: &Mesh) -> Option<Vec<Point2>> {
    let mut lower = energy::matrix(mesh);
    let n = 2 * mesh.positions.len();
    lower.extend((0..n).map(|i| (i, i, SHIFT)));
    let factor = ScalarCholesky::new(n, &lower)?;
    let rim = &mesh.topology.boundary;
    let start = conformal::flatten_disc(mesh)?;
    let mut u: Vec<f64> = start.iter().flat_map(|p| [p.x, p.y]).collect();
    normalise(&mut u, rim);
    for _ in 0..ROUNDS {
        let mut next: Vec<f64> =
            u.iter().enumerate().map(|(i, x)| if rim[i / 2] { *x } else { 0.0 }).collect();
        factor.solve(&mut next)?;
        normalise(&mut next, rim);
        let change = u.iter().zip(&next).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        u = next;
        if change < TOLERANCE {
            break;
        }
    }
    energy::layout(mesh, &u)
}

/// Boundary vertices centred, with squares that add up to one.
fn normalise(u: &mut [f64], rim: &[bool]) {
    let on = |i: usize| rim[i / 2];
    let count = rim.iter().filter(|&&r| r).count() as f64;
    for axis in 0..2 {
        let places = || (axis..2 * rim.len()).step_by(2);
        let mean = places().filter(|&i| on(i)).map(|i| u[i]).sum::<f64>() / count;
        places().for_each(|i| u[i] -= mean);
    }
    let size = (0..u.len()).filter(|&i| on(i)).map(|i| u[i] * u[i]).sum::<f64>().sqrt();
    u.iter_mut().for_each(|x| *x /= size.max(1e-300));
}
