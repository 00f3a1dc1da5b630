//! The hidden side moves like tissue: a volumetric prior.
//!
//! What a frame shows of an organ carries the rest along: inside a closed surface lies tissue that
//! resists strain. The surface and points inside it form a graph whose edges turn as rigidly as they
//! can (as-rigid-as-possible over a volume, Sorkine and Alexa 2007), with what is seen held where it
//! was found, and what is not held weakly to the rigid pose, since organs hang on their surroundings:
//!
//! ```text
//! Σᵢ Σⱼ ‖(xⱼ − xᵢ) − ½(Rᵢ + Rⱼ)(pⱼ − pᵢ)‖² + SEEN Σ_seen ‖xᵢ − sᵢ‖² + α Σ_hidden ‖xᵢ − pᵢ‖²
//! ```
//!
//! An open surface has no inside, and its stretch and bending carry what is not seen of it.

use crate::geometry::{Neighbours, Point3, Vector3, align_rigid};
use crate::mesh::Mesh;
use crate::solver::ScalarCholesky;
use nalgebra::Matrix3;
use rayon::prelude::*;

/// Edges of every point to its nearest: as many as fill a shell of a cubic grid (6 + 8).
const EDGES: usize = 14;

/// Points along the shortest side of the bounding box, at most: the hidden side is as smooth as what
/// carries it.
const ACROSS: f64 = 10.0;

/// Weight of a seen vertex, of one edge.
const SEEN: f64 = 100.0;

/// Rounds of turning and solving at most. Four leave 1.15 mm of a bent organ's hidden zone (7.9 mm away at
/// most), all of them 0.70.
const ROUNDS: usize = 60;

/// A round that moves no point by more than this part of the spacing inside is the last.
const SETTLED: f64 = 0.01;

/// A rest surface and what lies inside.
#[doc(alias = "volumetric prior")]
#[derive(Clone, Debug)]
pub struct Volume {
    /// Vertices of the surface, then points inside (template frame).
    points: Vec<Point3>,
    edges: Vec<[u32; 2]>,
    surface: usize,
    /// Of the points inside, length units.
    spacing: f64,
}

impl Volume {
    /// The volume of a closed rest surface; `None` of an open one.
    pub fn of(mesh: &Mesh) -> Option<Self> {
        let [low, high] = mesh.bounding_box();
        let spacing = (high - low).min() / ACROSS;
        if mesh.topology.boundary.contains(&true) || spacing.is_nan() || spacing <= 0.0 {
            return None;
        }
        let mut points = mesh.positions.clone();
        points.extend(inside(mesh, low, high, spacing));
        let neighbours = Neighbours::of(points.iter().map(|p| p.coords.into()).collect());
        let near = |i: usize| neighbours.nearest(i, EDGES).into_iter().map(move |j| [i, j]);
        let near =
            (0..points.len()).flat_map(near).map(|[i, j]| [i.min(j) as u32, i.max(j) as u32]);
        let mut edges: Vec<[u32; 2]> = mesh.topology.edges.iter().copied().chain(near).collect();
        edges.iter_mut().for_each(|e| e.sort_unstable());
        edges.sort_unstable();
        edges.dedup();
        Some(Self { points, edges, surface: mesh.positions.len(), spacing })
    }

    /// `shape` with what is not `seen` carried along by what is. `posed`: the rest surface where the
    /// rigid pose puts it (all camera axes). `anchor`: how firmly the hidden side hangs on its
    /// surroundings, of the stiffness of tissue as thick as the organ. `None` where nothing holds the
    /// volume.
    pub fn extrapolated(
        &self,
        posed: &[Point3],
        shape: &[Point3],
        seen: &[bool],
        anchor: f64,
    ) -> Option<Vec<Point3>> {
        if !seen.iter().any(|&s| s) || seen.iter().all(|&s| s) {
            return None;
        }
        let pose = align_rigid(&self.points[..self.surface], posed)?;
        let rest: Vec<Point3> = self.points.iter().map(|p| pose * p).collect();
        // A layer of springs over a body of ACROSS layers: as stiff as the body for an anchor of 1.
        let hold = anchor * EDGES as f64 / (6.0 * ACROSS);
        let weight = |i: usize| match seen.get(i) {
            Some(true) => SEEN,
            Some(false) => hold,
            None => 0.0,
        };
        let factor = self.factor(&weight)?;
        let of_seen = |points: &[Point3]| -> Vec<Point3> {
            (0..self.surface).filter(|&i| seen[i]).map(|i| points[i]).collect()
        };
        // From where the seen part went as a whole: few rounds would not turn the volume far.
        let motion = align_rigid(&of_seen(&rest), &of_seen(shape)).unwrap_or_default();
        let mut now: Vec<Point3> = rest.iter().map(|p| motion * p).collect();
        let held = (0..self.surface).filter(|&i| seen[i]);
        held.for_each(|i| now[i] = shape[i]);
        for _ in 0..ROUNDS {
            let turns = self.turns(&rest, &now);
            let mut right: [Vec<f64>; 3] = [0, 1, 2].map(|_| vec![0.0; now.len()]);
            let mut add = |i: usize, v: Vector3| (0..3).for_each(|c| right[c][i] += v[c]);
            for &[i, j] in &self.edges {
                let (i, j) = (i as usize, j as usize);
                let edge = (turns[i] + turns[j]) * (rest[j] - rest[i]) * 0.5;
                add(j, edge);
                add(i, -edge);
            }
            for i in 0..self.surface {
                let target = if seen[i] { shape[i] } else { rest[i] };
                add(i, target.coords * weight(i));
            }
            let mut most = 0.0_f64;
            for (c, right) in right.iter_mut().enumerate() {
                factor.solve(right)?;
                for (p, &x) in now.iter_mut().zip(right.iter()) {
                    most = most.max((p[c] - x).abs());
                    p[c] = x;
                }
            }
            if most < SETTLED * self.spacing {
                break;
            }
        }
        let kept = |i: usize| if seen[i] { shape[i] } else { now[i] };
        Some((0..self.surface).map(kept).collect())
    }

    fn factor(&self, weight: &impl Fn(usize) -> f64) -> Option<ScalarCholesky> {
        // A millionth of an edge holds points that nothing else does.
        let diagonal = (0..self.points.len()).map(|i| (i, i, weight(i) + 1e-6));
        let edges = self.edges.iter().flat_map(|&[i, j]| {
            let (i, j) = (i as usize, j as usize);
            [(i, i, 1.0), (j, j, 1.0), (j, i, -1.0)]
        });
        ScalarCholesky::new(self.points.len(), &diagonal.chain(edges).collect::<Vec<_>>())
    }

    /// Rotation that fits the edges of every point best.
    fn turns(&self, rest: &[Point3], now: &[Point3]) -> Vec<Matrix3<f64>> {
        let mut sums = vec![Matrix3::zeros(); rest.len()];
        for &[i, j] in &self.edges {
            let (i, j) = (i as usize, j as usize);
            let product = (now[j] - now[i]) * (rest[j] - rest[i]).transpose();
            sums[i] += product;
            sums[j] += product;
        }
        sums.into_par_iter().map(rotation).collect()
    }
}

/// The rotation nearest to a matrix; none where there is no such.
fn rotation(m: Matrix3<f64>) -> Matrix3<f64> {
    let svd = m.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Matrix3::identity() };
    let mut sign = Vector3::repeat(1.0);
    if (u * v_t).determinant() < 0.0 {
        sign[svd.singular_values.imin()] = -1.0;
    }
    u * Matrix3::from_diagonal(&sign) * v_t
}

/// Points of a cubic grid inside a closed surface, none nearer to it than half a spacing.
fn inside(mesh: &Mesh, low: Point3, high: Point3, spacing: f64) -> Vec<Point3> {
    let count = [0, 1, 2].map(|c| ((high[c] - low[c]) / spacing).ceil() as usize);
    let at = |i: usize| {
        let (x, y, z) = (i % count[0], i / count[0] % count[1], i / count[0] / count[1]);
        low + (Vector3::new(x as f64, y as f64, z as f64) + Vector3::repeat(0.5)) * spacing
    };
    let all = (0..count.iter().product::<usize>()).into_par_iter().map(at);
    let away = 0.25 * spacing * spacing;
    let free = |p: &Point3| mesh.positions.iter().all(|q| (p - q).norm_squared() > away);
    all.filter(|p| winding(mesh, p).abs() > 0.5 && free(p)).collect()
}

/// Winding number of a closed surface about a point (van Oosterom and Strackee 1983): 0 outside.
fn winding(mesh: &Mesh, point: &Point3) -> f64 {
    let solid_angle = |face: usize| {
        let [a, b, c] = mesh.corners(face).map(|p| p - point);
        let (la, lb, lc) = (a.norm(), b.norm(), c.norm());
        let below = la * lb * lc + a.dot(&b) * lc + b.dot(&c) * la + c.dot(&a) * lb;
        2.0 * a.dot(&b.cross(&c)).atan2(below)
    };
    let total: f64 = (0..mesh.topology.faces.len()).map(solid_angle).sum();
    total / (4.0 * std::f64::consts::PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn an_open_surface_has_no_inside() {
        assert!(Volume::of(&shapes::irregular_sheet(5)).is_none());
    }

    #[test]
    fn a_ball_has_an_inside_and_follows_a_rigid_motion() {
        let ball = shapes::icosphere(3, 10.0);
        assert!((winding(&ball, &Point3::new(1.0, 2.0, -3.0)).abs() - 1.0).abs() < 1e-9);
        assert!(winding(&ball, &Point3::new(11.0, 0.0, 0.0)).abs() < 1e-9);
        let volume = Volume::of(&ball).unwrap();
        assert!(volume.points.len() > ball.positions.len() + 200);
        let turn = nalgebra::Rotation3::new(Vector3::new(0.1, 0.2, -0.1));
        let moved = |p: &Point3| turn * p + Vector3::new(1.0, 0.5, 80.0);
        let posed: Vec<Point3> =
            ball.positions.iter().map(|p| p + Vector3::new(0.0, 0.0, 80.0)).collect();
        let shape: Vec<Point3> = ball.positions.iter().map(moved).collect();
        let seen: Vec<bool> = ball.positions.iter().map(|p| p.z < -1.0).collect();
        let start: Vec<Point3> =
            (0..seen.len()).map(|v| if seen[v] { shape[v] } else { posed[v] }).collect();
        let found = volume.extrapolated(&posed, &start, &seen, 0.0).unwrap();
        let worst = found.iter().zip(&shape).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        let before = start.iter().zip(&shape).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(worst < 0.01 * before, "{worst} of {before}");
        assert!(volume.extrapolated(&posed, &start, &vec![true; seen.len()], 0.0).is_none());
    }

    #[test]
    fn a_dent_in_front_hardly_moves_the_back() {
        let ball = shapes::icosphere(3, 10.0);
        let volume = Volume::of(&ball).unwrap();
        let posed: Vec<Point3> =
            ball.positions.iter().map(|p| p + Vector3::new(0.0, 0.0, 80.0)).collect();
        let dent = |p: &Point3| {
            let depth = 3.0 * (-(p.x * p.x + p.y * p.y) / 8.0).exp();
            Vector3::new(0.0, 0.0, if p.z < 72.0 { depth } else { 0.0 })
        };
        let shape: Vec<Point3> = posed.iter().map(|p| p + dent(p)).collect();
        let seen: Vec<bool> = ball.positions.iter().map(|p| p.z < 0.0).collect();
        let found = volume.extrapolated(&posed, &shape, &seen, 0.1).unwrap();
        let back = (0..seen.len()).filter(|&v| ball.positions[v].z > 5.0);
        let most = back.map(|v| (found[v] - posed[v]).norm()).fold(0.0, f64::max);
        assert!(most < 0.5 && most > 0.0, "{most}");
    }
}
