//! A disc mapped to the plane: conformal, with the least area distortion.
//!
//! Among all conformal maps of a disc the one whose scale is constant along the boundary varies
//! least in scale (Chebyshev's principle; Springborn, Schröder, Pinkall 2008). Its log scale `u`
//! solves `Δu = K`, `u = 0` on the boundary, which gives the curvature of the boundary in the
//! plane; the boundary curve is integrated from it and filled in harmonically (Sawhney and Crane
//! 2017, "Boundary first flattening"). Linear: one Cholesky factorisation, three solves.

use crate::geometry::{Point2, Point3, Vector2};
use crate::mesh::Mesh;
use crate::mesh::boundary::boundary_loops;
use crate::solver::ScalarCholesky;
use std::f64::consts::{PI, TAU};

/// UV of every vertex of a disc, in length units of the mesh; `None` where the system cannot be
/// solved (a vertex without a face counts as such).
pub(super) fn flatten_disc(mesh: &Mesh) -> Option<Vec<Point2>> {
    let n = mesh.positions.len();
    let outline = boundary_loops(&mesh.topology).into_iter().next()?;
    let cotan = Cotan::new(mesh);
    let defect = angle_defects(mesh);
    if outline.len() == n {
        return unfold_without_interior(mesh, &outline, &defect);
    }
    let interior = Interior::new(mesh, &cotan)?;
    // u: (L u) = −K inside with L = −Δ, 0 on the boundary.
    let mut u = vec![0.0; n];
    interior.solve(&cotan, |i| -defect[i], &mut u)?;
    let turning: Vec<f64> =
        outline.iter().map(|&v| defect[v as usize] + cotan.apply(v as usize, &u)).collect();
    let curve = close_curve(mesh, &outline, &turning);
    let (mut x, mut y) = (vec![0.0; n], vec![0.0; n]);
    for (&v, p) in outline.iter().zip(&curve) {
        (x[v as usize], y[v as usize]) = (p.x, p.y);
    }
    interior.solve(&cotan, |_| 0.0, &mut x)?;
    interior.solve(&cotan, |_| 0.0, &mut y)?;
    Some(x.into_iter().zip(y).map(|(x, y)| Point2::new(x, y)).collect())
}

/// A strip without an inner vertex has nothing to solve for: only its outline is laid out.
fn unfold_without_interior(mesh: &Mesh, outline: &[u32], defect: &[f64]) -> Option<Vec<Point2>> {
    let turning: Vec<f64> = outline.iter().map(|&v| defect[v as usize]).collect();
    let mut uv = vec![Point2::origin(); outline.len()];
    for (&v, p) in outline.iter().zip(close_curve(mesh, outline, &turning)) {
        uv[v as usize] = p;
    }
    Some(uv)
}

/// Rows of `L = −Δ` with plain (unclamped) cotangent weights: only these make the map conformal.
pub(super) struct Cotan {
    pub(super) rows: Vec<Vec<(u32, f64)>>,
}

impl Cotan {
    pub(super) fn new(mesh: &Mesh) -> Self {
        let t = &mesh.topology;
        let mut weights = vec![0.0; t.edges.len()];
        for (f, face) in t.faces.iter().enumerate() {
            let corners = mesh.corners(f);
            for k in 0..3 {
                let (i, j) = ((k + 1) % 3, (k + 2) % 3);
                let (p, q) = (corners[i] - corners[k], corners[j] - corners[k]);
                if let Some(edge) = t.edge_index(face[i], face[j]) {
                    weights[edge] += 0.5 * p.dot(&q) / p.cross(&q).norm().max(1e-300);
                }
            }
        }
        let mut rows = vec![Vec::new(); t.vertex_count];
        for (&[a, b], &w) in t.edges.iter().zip(&weights) {
            rows[a as usize].push((b, w));
            rows[b as usize].push((a, w));
        }
        Self { rows }
    }

    fn apply(&self, i: usize, x: &[f64]) -> f64 {
        self.rows[i].iter().map(|&(j, w)| w * (x[i] - x[j as usize])).sum()
    }
}

/// The Laplace equation with values given on the boundary.
struct Interior {
    factor: ScalarCholesky,
    /// Inner vertices, ascending.
    vertices: Vec<u32>,
}

impl Interior {
    fn new(mesh: &Mesh, cotan: &Cotan) -> Option<Self> {
        let boundary = &mesh.topology.boundary;
        let vertices: Vec<u32> =
            (0..boundary.len() as u32).filter(|&v| !boundary[v as usize]).collect();
        let mut place = vec![usize::MAX; boundary.len()];
        vertices.iter().enumerate().for_each(|(k, &v)| place[v as usize] = k);
        let mut lower = Vec::new();
        for (k, &v) in vertices.iter().enumerate() {
            let row = &cotan.rows[v as usize];
            lower.push((k, k, row.iter().map(|r| r.1).sum()));
            let below = row.iter().map(|&(j, w)| (place[j as usize], w));
            lower.extend(below.filter(|&(j, _)| j < k).map(|(j, w)| (k, j, -w)));
        }
        Some(Self { factor: ScalarCholesky::new(vertices.len(), &lower)?, vertices })
    }

    /// Fill the inner values of `x` so that `(L x)ᵢ = source(i)` there; the others are given.
    fn solve(&self, cotan: &Cotan, source: impl Fn(usize) -> f64, x: &mut [f64]) -> Option<()> {
        self.vertices.iter().for_each(|&v| x[v as usize] = 0.0);
        let mut rhs: Vec<f64> = self
            .vertices
            .iter()
            .map(|&v| source(v as usize) - cotan.apply(v as usize, x))
            .collect();
        self.factor.solve(&mut rhs)?;
        self.vertices.iter().zip(rhs).for_each(|(&v, value)| x[v as usize] = value);
        Some(())
    }
}

/// `2π` (inside) or `π` (on the boundary) minus the angles around each vertex.
fn angle_defects(mesh: &Mesh) -> Vec<f64> {
    let mut defect: Vec<f64> =
        mesh.topology.boundary.iter().map(|&b| if b { PI } else { TAU }).collect();
    for (f, face) in mesh.topology.faces.iter().enumerate() {
        let corners = mesh.corners(f);
        for k in 0..3 {
            let at = |j: usize| -> &Point3 { corners[(k + j) % 3] };
            defect[face[k] as usize] -= (at(1) - at(0)).angle(&(at(2) - at(0)));
        }
    }
    defect
}

/// The closed plane curve with the given turning angles (sum 2π) whose edge lengths differ least
/// from those on the surface: `min Σ (l̃ − l)²/l` subject to closing.
fn close_curve(mesh: &Mesh, outline: &[u32], turning: &[f64]) -> Vec<Point2> {
    let n = outline.len();
    let at = |k: usize| &mesh.positions[outline[k % n] as usize];
    let lengths: Vec<f64> = (0..n).map(|k| (at(k + 1) - at(k)).norm()).collect();
    let mut heading = 0.0;
    let directions: Vec<Vector2> = turning
        .iter()
        .map(|angle| {
            heading += angle;
            Vector2::new(heading.cos(), heading.sin())
        })
        .collect();
    let gap: Vector2 = lengths.iter().zip(&directions).map(|(&l, d)| d * l).sum();
    let spread: nalgebra::Matrix2<f64> =
        lengths.iter().zip(&directions).map(|(&l, d)| d * d.transpose() * l).sum();
    let correction = spread.try_inverse().map_or(Vector2::zeros(), |inverse| inverse * gap);
    let mut p = Point2::origin();
    let mut curve = Vec::with_capacity(n);
    for (&l, d) in lengths.iter().zip(&directions) {
        curve.push(p);
        p += d * (l * (1.0 - d.dot(&correction)));
    }
    curve
}
