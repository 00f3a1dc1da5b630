//! The derivative check every term goes through.

use super::{EnergyTerm, Jacobian};
use crate::geometry::{Point3, Vector3};
use nalgebra::{SMatrix, SVector};

/// Assert that the analytic Jacobian of every feasible block agrees with central differences at
/// the given vertices and globals, to `1e-5` of its largest entry. At least one block must be
/// feasible.
///
/// # Panics
/// When a derivative is wrong: this is a test helper, public so that a term of one's own can use
/// it.
pub fn assert_jacobian<const R: usize>(
    term: &impl EnergyTerm<R>,
    vertices: &[Point3],
    globals: &[f64],
) {
    let mut checked = 0;
    for i in 0..term.count() {
        let stencil = term.stencil(i);
        let v: Vec<Point3> = stencil.iter().map(|&k| vertices[k as usize]).collect();
        let g: Vec<f64> = term.globals(i).iter().map(|&k| globals[k]).collect();
        let mut dv = vec![SMatrix::<f64, R, 3>::zeros(); v.len()];
        let mut dg = vec![SVector::<f64, R>::zeros(); g.len()];
        let jacobian = Jacobian { vertices: &mut dv, globals: &mut dg };
        if term.residual(i, &v, &g, Some(jacobian)).is_err() {
            continue;
        }
        checked += 1;
        for k in 0..v.len() {
            for axis in 0..3 {
                let numeric = central(1e-5, |h| {
                    let mut moved = v.clone();
                    moved[k] += Vector3::ith(axis, h);
                    term.residual(i, &moved, &g, None).expect("feasible nearby")
                });
                compare(i, &dv[k].column(axis).into_owned(), &numeric, &dv);
            }
        }
        for k in 0..g.len() {
            let numeric = central(1e-6, |h| {
                let mut moved = g.clone();
                moved[k] += h;
                term.residual(i, &v, &moved, None).expect("feasible nearby")
            });
            let scale = 1.0 + dg[k].amax();
            assert!((dg[k] - numeric).amax() < 1e-5 * scale, "block {i}, global {k}");
        }
    }
    assert!(checked > 0, "no feasible block to check");
}

fn central<const R: usize>(h: f64, f: impl Fn(f64) -> SVector<f64, R>) -> SVector<f64, R> {
    (f(h) - f(-h)) / (2.0 * h)
}

fn compare<const R: usize>(
    block: usize,
    analytic: &SVector<f64, R>,
    numeric: &SVector<f64, R>,
    all: &[SMatrix<f64, R, 3>],
) {
    let scale = all.iter().fold(1e-3_f64, |m, j| m.max(j.amax()));
    let error = (analytic - numeric).amax();
    assert!(error < 1e-5 * scale, "block {block}: analytic {analytic} numeric {numeric}");
}

/// A bent, irregular patch in front of a camera: 5 × 5 vertices, about 10 units wide at depth 60,
/// outward normals towards the camera.
#[cfg(test)]
pub(crate) fn bent_patch() -> crate::mesh::Mesh {
    let mut positions = Vec::new();
    for i in 0..25 {
        let (x, y) = ((i % 5) as f64, (i / 5) as f64);
        let wobble = 0.3 * ((3 * i) as f64).sin();
        let z = 60.0 + 0.4 * (x - 2.0).powi(2) + 0.2 * (y - 2.0).powi(2) + 0.2 * wobble;
        positions.push(Point3::new(2.5 * (x - 2.0) + wobble, 2.4 * (y - 2.0) - wobble, z));
    }
    let mut faces = Vec::new();
    for row in 0..4u32 {
        for column in 0..4u32 {
            let a = 5 * row + column;
            faces.push([a, a + 5, a + 1]);
            faces.push([a + 1, a + 5, a + 6]);
        }
    }
    crate::mesh::Mesh::new(positions, faces).expect("a grid is manifold")
}

/// Sum of the weighted squared residuals of a term without globals.
#[cfg(test)]
pub(crate) fn energy<const R: usize>(term: &impl EnergyTerm<R>, vertices: &[Point3]) -> f64 {
    let block = |i: usize| {
        let v: Vec<Point3> = term.stencil(i).iter().map(|&k| vertices[k as usize]).collect();
        term.weight(i) * term.residual(i, &v, &[], None).expect("feasible").norm_squared()
    };
    (0..term.count()).map(block).sum()
}

/// A shape under a fixed rotation and translation.
#[cfg(test)]
pub(crate) fn rigidly_moved(shape: &[Point3]) -> Vec<Point3> {
    let motion =
        crate::geometry::Isometry::new(Vector3::new(3.0, -7.0, 11.0), Vector3::new(0.4, -0.9, 0.3));
    shape.iter().map(|p| motion * p).collect()
}

/// A mesh stretched, sheared and bent by the given amount.
#[cfg(test)]
pub(crate) fn warped(mesh: &crate::mesh::Mesh, amount: f64) -> Vec<Point3> {
    let warp = |p: &Point3| {
        Point3::new(p.x * (1.0 + amount), p.y + amount * p.x, p.z + 0.2 * amount * p.x * p.y)
    };
    mesh.positions.iter().map(warp).collect()
}
