//! The hidden side moves like tissue: a volumetric prior.
//!
//! What a frame shows of an organ carries the rest along: inside a closed surface lies tissue that
//! resists strain and keeps its volume. The surface and points inside it form a graph whose edges
//! turn as rigidly as they can (as-rigid-as-possible over a volume, Sorkine and Alexa 2007) while
//! the neighbourhood of every point changes its volume as little as it can, with what is seen held
//! where it was found, and what is not held weakly to the rigid pose, since organs hang on their
//! surroundings:
//!
//! ```text
//! Σᵢ Σⱼ (‖(xⱼ − xᵢ) − R̄ᵢⱼ(pⱼ − pᵢ)‖² + κ ‖(xⱼ − xᵢ) − Ūᵢⱼ(pⱼ − pᵢ)‖²) / (1 + κ)
//!     + SEEN Σ_seen ‖xᵢ − sᵢ‖² + α Σ_hidden ‖xᵢ − pᵢ‖²
//! ```
//!
//! `R` is the rotation and `U` the matrix of determinant 1 that is nearest to the map of a point's
//! edges, a bar the mean of an edge's ends. Maps and points are found in turns (projective
//! dynamics, Bouaziz et al. 2014). Inside is what the surface winds about by more than half (the
//! generalised winding number, Jacobson et al. 2013), so that an open surface has an inside too, as
//! deep as it is hollow. A sheet has none, and its stretch and bending carry what is not seen of
//! it.

use crate::geometry::{Neighbours, Point3, Vector3, align_rigid, bounding_box, scatter};
use crate::mesh::Mesh;
use crate::solver::{Anderson, ScalarCholesky, ScalarPattern};
use nalgebra::Matrix3;
use rayon::prelude::*;

/// Edges of every point to its nearest: on a body-centred grid 8 and 6.
const EDGES: usize = 14;

/// Points along the shortest side of the bounding box, at most: the hidden side is as smooth as
/// what carries it.
const ACROSS: f64 = 10.0;

/// Cells of the grid over the bounding box, at most: a bound on the work, since a thin shell is
/// long and wide. A box of 3 to 3 to 1 has 9,000.
const CELLS: f64 = 2e4;

/// Fewer points inside are no volume but a sheet that is a little bent; organs have several
/// hundred.
const LEAST: usize = 50;

/// Weight of a seen vertex, of one edge.
const SEEN: f64 = 100.0;

/// `κ`: how much more tissue resists a change of volume than one of shape. With the seen side of
/// nine drawn scenes at the truth 1.10 mm of the hidden zone are left without, 0.86 with 4, 0.83
/// with 10, which takes more rounds.
const VOLUME: f64 = 4.0;

/// Rounds of finding maps and points at most; 9 to 18 were needed (`docs/results/choices.md`).
const ROUNDS: usize = 60;

/// A round that moves no point by more than this part of the spacing inside is the last. Stopped at
/// 0.01, or after 60 rounds without acceleration, the hidden zone is 0.95 mm off in place of 0.86.
const SETTLED: f64 = 2e-3;

/// Newton's steps towards determinant 1: two take a scale of 1.1 to one of 1.0001.
const NEWTON_STEPS: usize = 2;

/// The longest step along the gradient of the determinant: a map that is nearly flat has hardly any
/// gradient.
const LONGEST_STEP: f64 = 0.5;

/// Newton's steps towards a rotation at most: a map that stretches one way tenfold takes six.
const POLAR_STEPS: usize = 12;

/// Less determinant, of a matrix whose entries have a sum of squares of 1, is nearly flat: a
/// rotation has 0.19.
const FLAT: f64 = 1e-3;

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
    /// The same whatever is seen.
    pattern: ScalarPattern,
}

impl Volume {
    /// The volume behind a rest surface (template frame, any unit): what lies in a closed one, or
    /// in the hollow of an open one. `None` where there is hardly any.
    pub fn of(mesh: &Mesh) -> Option<Self> {
        let axes = own_axes(&mesh.positions);
        let own: Vec<Point3> =
            mesh.positions.iter().map(|p| axes.tr_mul(&p.coords).into()).collect();
        let [low, high] = bounding_box(&own);
        let size = high - low;
        let spacing = (size.min() / ACROSS).max((size.product() / CELLS).cbrt());
        if spacing.is_nan() || spacing <= 0.0 {
            return None;
        }
        let inside = inside(&mesh.with_positions(own), low, high, spacing);
        let inside = inside.into_iter().map(|p| Point3::from(axes * p.coords)).collect();
        Self::around(inside, mesh, spacing)
    }

    /// The same inside behind another mesh of the same surface; `None` where that leaves hardly
    /// any.
    pub(super) fn behind(&self, mesh: &Mesh) -> Option<Self> {
        let free = |p: &&Point3| is_free(p, mesh, self.spacing);
        let inside = self.points[self.surface..].iter().filter(free).copied().collect();
        Self::around(inside, mesh, self.spacing)
    }

    fn around(inside: Vec<Point3>, mesh: &Mesh, spacing: f64) -> Option<Self> {
        if inside.len() < LEAST {
            return None;
        }
        let mut points = mesh.positions.clone();
        points.extend(inside);
        let neighbours = Neighbours::of(points.iter().map(|p| p.coords.into()).collect());
        let near = |i: usize| neighbours.nearest(i, EDGES).into_iter().map(move |j| [i, j]);
        let near =
            (0..points.len()).flat_map(near).map(|[i, j]| [i.min(j) as u32, i.max(j) as u32]);
        let mut edges: Vec<[u32; 2]> = mesh.topology.edges.iter().copied().chain(near).collect();
        edges.iter_mut().for_each(|e| e.sort_unstable());
        edges.sort_unstable();
        edges.dedup();
        let pattern = ScalarPattern::of(points.len(), &stiffness(points.len(), &edges, |_| 1.0))?;
        Some(Self { points, edges, surface: mesh.positions.len(), spacing, pattern })
    }

    /// `shape` with what is not `seen` carried along by what is. `posed`: the rest surface where
    /// the rigid pose puts it (all camera axes). `anchor`: how firmly the hidden side hangs on its
    /// surroundings, of the stiffness of tissue as thick as the organ. `None` where nothing holds
    /// the volume.
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
        let hold = anchor * EDGES as f64 / (6.0 * ACROSS) / (1.0 + VOLUME);
        let weight = |i: usize| match seen.get(i) {
            Some(true) => SEEN,
            Some(false) => hold,
            None => 0.0,
        };
        let stiffness = stiffness(rest.len(), &self.edges, weight);
        let factor = self.pattern.factor(rest.len(), &stiffness)?;
        let of_seen = |points: &[Point3]| -> Vec<Point3> {
            (0..self.surface).filter(|&i| seen[i]).map(|i| points[i]).collect()
        };
        // From where the seen part went as a whole: few rounds would not turn the volume far.
        let motion = align_rigid(&of_seen(&rest), &of_seen(shape)).unwrap_or_default();
        let mut now: Vec<Point3> = rest.iter().map(|p| motion * p).collect();
        let held = (0..self.surface).filter(|&i| seen[i]);
        held.for_each(|i| now[i] = shape[i]);
        let spread = self.spreads(&rest);
        let mut anderson = Anderson::default();
        for _ in 0..ROUNDS {
            let image = self.relaxed(&rest, &now, &spread, &factor, |i| {
                let target = if seen[i] { shape[i] } else { rest[i] };
                target.coords * weight(i)
            })?;
            let from = flat(&now);
            let most = from.iter().zip(&image).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let next = anderson.next(&from, image);
            let points = next.as_chunks::<3>().0.iter();
            now.iter_mut().zip(points).for_each(|(p, &x)| *p = x.into());
            if most < SETTLED * self.spacing {
                break;
            }
        }
        let kept = |i: usize| if seen[i] { shape[i] } else { now[i] };
        Some((0..self.surface).map(kept).collect())
    }

    /// One round: the maps of every point, then the coordinates of the points for these maps, one
    /// point after the other. `held`: what holds a surface point, times its weight.
    fn relaxed(
        &self,
        rest: &[Point3],
        now: &[Point3],
        spread: &[Matrix3<f64>],
        factor: &ScalarCholesky,
        held: impl Fn(usize) -> Vector3,
    ) -> Option<Vec<f64>> {
        let maps = self.maps(rest, now, spread);
        let mut right: [Vec<f64>; 3] = [0, 1, 2].map(|_| vec![0.0; now.len()]);
        let mut add = |i: usize, v: Vector3| (0..3).for_each(|c| right[c][i] += v[c]);
        for &[i, j] in &self.edges {
            let (i, j) = (i as usize, j as usize);
            let edge = (maps[i] + maps[j]) * (rest[j] - rest[i]) * 0.5;
            add(j, edge);
            add(i, -edge);
        }
        (0..self.surface).for_each(|i| add(i, held(i)));
        right.par_iter_mut().try_for_each(|right| factor.solve(right))?;
        let [x, y, z] = &right;
        Some((0..now.len()).flat_map(|i| [x[i], y[i], z[i]]).collect())
    }

    /// What every point's edges should have become: between the nearest rotation and the nearest
    /// map that keeps the volume.
    fn maps(&self, rest: &[Point3], now: &[Point3], spread: &[Matrix3<f64>]) -> Vec<Matrix3<f64>> {
        let sums = self.sums(rest, now).into_par_iter().zip(spread);
        let map = |(sum, spread): (Matrix3<f64>, &Matrix3<f64>)| {
            (rotation(sum) + unimodular(sum * spread) * VOLUME) / (1.0 + VOLUME)
        };
        sums.map(map).collect()
    }

    /// Inverse of the sum of `e eᵀ` over the edges of every point at rest.
    fn spreads(&self, rest: &[Point3]) -> Vec<Matrix3<f64>> {
        let invert = |m: Matrix3<f64>| {
            let ridge = Matrix3::identity() * (1e-9 * m.trace());
            (m + ridge).try_inverse().unwrap_or_else(Matrix3::zeros)
        };
        self.sums(rest, rest).into_iter().map(invert).collect()
    }

    /// Sum of `e′ eᵀ` over the edges of every point, which are `e` at rest and `e′` here.
    fn sums(&self, rest: &[Point3], now: &[Point3]) -> Vec<Matrix3<f64>> {
        let mut sums = vec![Matrix3::zeros(); rest.len()];
        for &[i, j] in &self.edges {
            let (i, j) = (i as usize, j as usize);
            let product = (now[j] - now[i]) * (rest[j] - rest[i]).transpose();
            sums[i] += product;
            sums[j] += product;
        }
        sums
    }
}

/// Lower triangle of the Laplacian of a graph of `n` points, each held by a weight.
fn stiffness(
    n: usize,
    edges: &[[u32; 2]],
    weight: impl Fn(usize) -> f64,
) -> Vec<(usize, usize, f64)> {
    // A millionth of an edge holds points that nothing else does.
    let diagonal = (0..n).map(|i| (i, i, weight(i) + 1e-6));
    let edges = edges.iter().flat_map(|&[i, j]| {
        let (i, j) = (i as usize, j as usize);
        [(i, i, 1.0), (j, j, 1.0), (j, i, -1.0)]
    });
    diagonal.chain(edges).collect()
}

/// Coordinates one after the other.
fn flat(points: &[Point3]) -> Vec<f64> {
    points.iter().flat_map(|p| [p.x, p.y, p.z]).collect()
}

/// The matrix of determinant 1 nearest to one, by Newton's steps along the gradient of the
/// determinant.
fn unimodular(mut m: Matrix3<f64>) -> Matrix3<f64> {
    for _ in 0..NEWTON_STEPS {
        let gradient = cofactors(&m);
        let determinant = gradient.column(0).dot(&m.column(0));
        let step = (1.0 - determinant) / gradient.norm_squared().max(1e-9);
        m += gradient * step.clamp(-LONGEST_STEP, LONGEST_STEP);
    }
    m
}

/// The rotation nearest to a matrix; none where there is no such.
fn rotation(m: Matrix3<f64>) -> Matrix3<f64> {
    polar(m).unwrap_or_else(|| {
        let svd = m.svd(true, true);
        let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Matrix3::identity() };
        let mut sign = Vector3::repeat(1.0);
        if (u * v_t).determinant() < 0.0 {
            sign[svd.singular_values.imin()] = -1.0;
        }
        u * Matrix3::from_diagonal(&sign) * v_t
    })
}

/// The same by Newton's iteration, its determinant scaled to 1 (Higham 1986): less work than an
/// SVD. `None` of a matrix that turns inside out or is nearly flat.
fn polar(m: Matrix3<f64>) -> Option<Matrix3<f64>> {
    let mut r = m / m.norm();
    for _ in 0..POLAR_STEPS {
        let cofactors = cofactors(&r);
        let determinant = cofactors.column(0).dot(&r.column(0));
        if determinant.is_nan() || determinant < FLAT {
            return None;
        }
        let scale = determinant.cbrt();
        let next = (r / scale + cofactors * (scale / determinant)) * 0.5;
        let change = (next - r).norm_squared();
        r = next;
        // Twice as many digits with every step: 8 are 16.
        if change < 1e-16 {
            return Some(r);
        }
    }
    None
}

/// Gradient of the determinant.
fn cofactors(m: &Matrix3<f64>) -> Matrix3<f64> {
    let [a, b, c] = [0, 1, 2].map(|k| Vector3::from(m.column(k)));
    Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)])
}

/// Directions in which points are spread (columns, in no order): what is made along them turns with
/// the points.
fn own_axes(points: &[Point3]) -> Matrix3<f64> {
    scatter(points.iter().copied()).1.symmetric_eigen().eigenvectors
}

/// Points of a body-centred cubic grid inside a surface, one in `spacing³` and none nearer to a
/// vertex than half a spacing. It looks the same from both ends of every axis, and each of its
/// points has 14 neighbours nearer than the others.
fn inside(mesh: &Mesh, low: Point3, high: Point3, spacing: f64) -> Vec<Point3> {
    let (side, middle) = (2.0_f64.cbrt() * spacing, nalgebra::center(&low, &high));
    let reach = [0, 1, 2].map(|c| (0.5 * (high[c] - low[c]) / side).ceil() as i64);
    let count = reach.map(|n| 2 * n + 1);
    let at = |i: i64| {
        let cell = [i % count[0], i / count[0] % count[1], i / count[0] / count[1]];
        let corner = Vector3::from([0, 1, 2].map(|c| (cell[c] - reach[c]) as f64));
        [0.0, 0.5].map(|half| middle + (corner + Vector3::repeat(half)) * side)
    };
    let all = (0..count.iter().product::<i64>()).into_par_iter().flat_map_iter(at);
    all.filter(|p| winding(mesh, p).abs() > 0.5 && is_free(p, mesh, spacing)).collect()
}

/// Whether a point is no nearer to a vertex than half a spacing.
fn is_free(point: &Point3, mesh: &Mesh, spacing: f64) -> bool {
    let away = 0.25 * spacing * spacing;
    mesh.positions.iter().all(|q| (point - q).norm_squared() > away)
}

/// Winding number of a surface about a point (van Oosterom and Strackee 1983): of a closed one 0
/// outside.
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
    fn the_nearest_rotation_by_newton_is_that_of_the_singular_values() {
        let turn = nalgebra::Rotation3::new(Vector3::new(0.4, -1.1, 0.7)).into_inner();
        let (skew, about) = (Matrix3::new(2.0, 0.3, 0.1, 0.3, 0.5, -0.2, 0.1, -0.2, 1.0), 1e-12);
        // The symmetric part changes no rotation that stands before it.
        for scale in [1e-6, 1.0, 1e6] {
            assert!((polar(turn * skew * scale).unwrap() - turn).norm() < about);
        }
        let mirrored = turn * skew * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
        let flat = turn * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 1e-4));
        for m in [mirrored, flat, Matrix3::zeros()] {
            assert!(polar(m).is_none());
            let r = rotation(m);
            assert!(
                (r.determinant() - 1.0).abs() < about
                    && (r * r.transpose() - Matrix3::identity()).norm() < about
            );
        }
        assert!((rotation(flat) - turn).norm() < 1e-9);
    }

    #[test]
    fn a_sheet_has_no_inside_and_a_cup_has() {
        assert!(Volume::of(&shapes::irregular_sheet(5)).is_none());
        let ball = shapes::icosphere(3, 10.0);
        let low = |face: &[u32; 3]| face.iter().all(|&v| ball.positions[v as usize].z < 3.0);
        let faces: Vec<[u32; 3]> = ball.topology.faces.iter().copied().filter(low).collect();
        let cup = Volume::of(&Mesh::new(ball.positions.clone(), faces).unwrap()).unwrap();
        let deep = cup.points[cup.surface..].iter();
        assert!(deep.clone().count() > 200 && deep.clone().all(|p| p.z < 6.0));
    }

    #[test]
    fn what_is_drawn_out_gets_thinner() {
        let ball = shapes::icosphere(3, 10.0);
        let volume = Volume::of(&ball).unwrap();
        let seen: Vec<bool> = ball.positions.iter().map(|p| p.z.abs() > 5.0).collect();
        let shape: Vec<Point3> =
            ball.positions.iter().map(|p| Point3::new(p.x, p.y, 1.2 * p.z)).collect();
        let found = volume.extrapolated(&ball.positions, &shape, &seen, 0.0).unwrap();
        let waist: Vec<f64> = (0..seen.len())
            .filter(|&v| ball.positions[v].z.abs() < 1.5)
            .map(|v| found[v].x.hypot(found[v].y) / ball.positions[v].x.hypot(ball.positions[v].y))
            .collect();
        let mean = waist.iter().sum::<f64>() / waist.len() as f64;
        assert!(mean < 0.97, "{mean}");
    }

    #[test]
    fn the_nearest_map_that_keeps_the_volume() {
        // A scale of 1.1 becomes 1.1 + (1 − 1.331) / 3.63 = 1.0088, and from there 1.0001.
        let scaled = unimodular(Matrix3::identity() * 1.1);
        assert!((scaled - Matrix3::identity() * 1.000077).amax() < 1e-6, "{scaled}");
        let sheared = Matrix3::new(1.0, 0.3, 0.0, 0.0, 1.0, -0.2, 0.0, 0.0, 1.0);
        assert_eq!(unimodular(sheared), sheared);
        let turned = nalgebra::Rotation3::new(Vector3::new(0.4, -0.2, 0.7)).into_inner();
        let any = Matrix3::new(1.1, 0.2, -0.1, 0.05, 0.8, 0.1, -0.2, 0.1, 0.95);
        let found = unimodular(any);
        assert!((found.determinant() - 1.0).abs() < 1e-3, "{}", found.determinant());
        assert!((unimodular(turned * any) - turned * found).amax() < 1e-12);
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
