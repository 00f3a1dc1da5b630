//! Conjugate gradients for large meshes, preconditioned by two scalar factorisations.
//!
//! In axes along and across the surface, `A` couples the three components of a displacement weakly:
//! the part of `Qᵀ A Q` within each component, with `Q` the local axes, is a scalar matrix over the
//! vertices whose factor costs a 27th of that of `A`. The two components along the surface are
//! alike enough to share theirs. The factors are made at the first step of a solve: what later
//! steps change in the matrix costs fewer iterations than new factors would.

use super::cholesky::{Cholesky, CholeskyError, Factor, dot};
use super::conjugate_gradients::{Ending, Goal, System, conjugate_gradients};
use super::matrix::Matrix;
use super::ordering::Ordered;
use super::panels::Panels;
use nalgebra::{Cholesky as Dense, Dyn, Matrix3, Point3, Vector3};
use rayon::prelude::*;

/// More iterations than this renew a factor made at another linearisation or damping.
const AGED: usize = 25;

/// More iterations than this with a fresh factor call for the direct solver.
const LIMIT: usize = 200;

pub(super) struct Iterative {
    cholesky: Cholesky,
    numeric: [Factor; 2],
    /// Along the surface, and across it: single precision is enough to precondition.
    factors: [Panels; 2],
    corner: Option<Dense<f64, Dyn>>,
    /// Axes of every vertex, in its columns.
    axes: Vec<Matrix3<f64>>,
    fresh: bool,
    renew: bool,
    values: [Vec<f64>; 2],
    along: [Vec<f32>; 2],
    across: [Vec<f32>; 1],
    memory: [[Vec<f32>; 2]; 2],
}

impl Iterative {
    pub(super) fn new(ordered: &Ordered) -> Result<Self, CholeskyError> {
        let (col_ptr, row_idx) = ordered.scalar(1);
        let cholesky = Cholesky::analyse(ordered.len(), col_ptr, row_idx)?;
        let values = [0, 1].map(|_| vec![0.0; cholesky.nnz()]);
        Ok(Self {
            cholesky,
            numeric: Default::default(),
            factors: Default::default(),
            corner: None,
            axes: vec![Matrix3::identity(); ordered.len()],
            fresh: false,
            renew: true,
            values,
            along: [0, 1].map(|_| vec![0.0; ordered.len()]),
            across: [vec![0.0; ordered.len()]],
            memory: Default::default(),
        })
    }

    /// Local axes from the edges of the pattern: the direction in which they extend least, and two
    /// across.
    pub(super) fn orient(&mut self, matrix: &Matrix, vertices: &[Point3<f64>]) {
        let mut spread = vec![Matrix3::zeros(); vertices.len()];
        for (a, b) in matrix.near.iter().filter(|(a, b)| a != b) {
            let d = vertices[a as usize] - vertices[b as usize];
            let product = d * d.transpose();
            spread[a as usize] += product;
            spread[b as usize] += product;
        }
        self.axes.clear();
        self.axes.extend(spread.iter().map(local_axes));
        self.renew = true;
    }

    fn factorise(&mut self, matrix: &Matrix, damping: f64) -> Result<(), CholeskyError> {
        let (order, floor) = (&matrix.ordered.order, matrix.floor());
        let mut at = 0;
        for (j, &old) in order.iter().enumerate() {
            let axes = &self.axes[old as usize];
            for (k, entry) in matrix.ordered.column(j).iter().enumerate() {
                let other = &self.axes[order[entry.row as usize] as usize];
                let turned = matrix.block(entry) * axes;
                let [u, v, w] = [0, 1, 2].map(|c| other.column(c).dot(&turned.column(c)));
                for (c, value) in [0.5 * (u + v), w].into_iter().enumerate() {
                    let added = if k == 0 { damping * value + floor } else { 0.0 };
                    self.values[c][at] = value + added;
                }
                at += 1;
            }
        }
        let cholesky = &self.cholesky;
        let parts = self.values.par_iter().zip(&mut self.numeric).zip(&mut self.factors);
        parts.try_for_each(|((values, numeric), factor)| {
            cholesky.factorise(values, numeric)?;
            factor.set(cholesky.panels(numeric));
            Ok(())
        })?;
        let mut corner = matrix.sums.corner.clone();
        for k in 0..corner.nrows() {
            corner[(k, k)] += damping * corner[(k, k)] + f64::MIN_POSITIVE;
        }
        self.corner = corner.cholesky();
        (self.fresh, self.renew) = (true, false);
        Ok(())
    }

    /// `z = M⁻¹ r`.
    fn precondition(&mut self, ordered: &Ordered, r: &[f64], z: &mut [f64]) {
        // Within the range of single precision, whatever the unit.
        let largest = r.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        let scale = if largest > 0.0 { 1.0 / largest } else { 1.0 };
        for (new, &v) in ordered.order.iter().enumerate() {
            let v = v as usize;
            let local = self.axes[v].tr_mul(&Vector3::new(r[3 * v], r[3 * v + 1], r[3 * v + 2]));
            let [x, y, z] = [local.x, local.y, local.z].map(|c| (c * scale) as f32);
            (self.along[0][new], self.along[1][new], self.across[0][new]) = (x, y, z);
        }
        let ([first, second], [mine, others]) = (&self.factors, &mut self.memory);
        let (along, across) = (&mut self.along, &mut self.across);
        rayon::join(|| first.solve(along, mine), || second.solve(across, others));
        for (new, &v) in ordered.order.iter().enumerate() {
            let local = [self.along[0][new], self.along[1][new], self.across[0][new]];
            let (local, v) = (Vector3::from(local.map(f64::from)), v as usize);
            let global = self.axes[v] * local / scale;
            z[3 * v..3 * v + 3].copy_from_slice(global.as_slice());
        }
        let globals = 3 * ordered.len()..;
        if let Some(corner) = &self.corner {
            let solved = corner.solve(&nalgebra::DVector::from_row_slice(&r[globals.clone()]));
            z[globals].copy_from_slice(solved.as_slice());
        }
    }

    /// The step, and the product of step and residual; `None` where the iteration fails.
    ///
    /// The residual is reduced by `reduction` in the norm of the preconditioner.
    pub(super) fn step(
        &mut self,
        matrix: &Matrix,
        damping: f64,
        reduction: f64,
    ) -> Option<(Vec<f64>, f64)> {
        self.fresh = false;
        if self.renew {
            self.factorise(matrix, damping).ok()?;
        }
        let sums = matrix.sums;
        let mut r: Vec<f64> = sums.gradient.iter().flat_map(|g| [-g.x, -g.y, -g.z]).collect();
        r.extend(sums.global_gradient.iter().map(|g| -g));
        let mut x = vec![0.0; r.len()];
        let diagonal = damped_part(matrix, damping);
        let mut solve = |iterative: &mut Self, goal: Goal, steps: usize| {
            let wide = [0, 1].map(|_| vec![[0.0; 4]; matrix.near.vertices()]);
            let mut damped = Damped { iterative, matrix, diagonal: &diagonal, wide };
            conjugate_gradients(&mut damped, &mut x, &mut r, goal, steps)
        };
        let steps = if self.fresh { LIMIT } else { AGED };
        let mut ending = solve(self, Goal::Share(reduction * reduction), steps);
        if let (Ending::Limit { goal }, false) = (ending, self.fresh) {
            self.factorise(matrix, damping).ok()?;
            ending = solve(self, Goal::Below(goal), LIMIT);
        }
        if ending != Ending::Reached {
            return None;
        }
        let slack = dot(&x, &r);
        Some((x, slack))
    }
}

/// The damped normal matrix and what preconditions it.
struct Damped<'a, 'b> {
    iterative: &'a mut Iterative,
    matrix: &'a Matrix<'b>,
    diagonal: &'a [f64],
    wide: [Vec<Wide>; 2],
}

impl System<f64> for Damped<'_, '_> {
    fn apply(&mut self, x: &[f64], out: &mut [f64]) {
        multiply(self.matrix, self.diagonal, x, out, &mut self.wide);
    }

    fn precondition(&mut self, r: &[f64], out: &mut [f64]) {
        self.iterative.precondition(self.matrix.ordered, r, out);
    }
}

/// What damping adds to the diagonal.
fn damped_part(matrix: &Matrix, damping: f64) -> Vec<f64> {
    let floor = matrix.floor();
    let mut diagonal = Vec::new();
    for v in 0..matrix.near.vertices() {
        diagonal.extend(matrix.diagonal(v).iter().map(|d| damping * d + floor));
    }
    let corner = &matrix.sums.corner;
    diagonal.extend((0..corner.nrows()).map(|k| damping * corner[(k, k)] + f64::MIN_POSITIVE));
    diagonal
}

/// A vertex's part of a vector, with room for whole registers.
type Wide = [f64; 4];

/// `y = (H + diagonal) x`; `wide`: memory, an entry a vertex.
fn multiply(
    matrix: &Matrix,
    diagonal: &[f64],
    x: &[f64],
    y: &mut [f64],
    wide: &mut [Vec<Wide>; 2],
) {
    let [from, to] = wide;
    for (from, x) in from.iter_mut().zip(x.chunks_exact(3)) {
        *from = [x[0], x[1], x[2], 0.0];
    }
    to.fill([0.0; 4]);
    let add = |to: &mut Wide, by: &Wide, s: f64| (0..4).for_each(|k| to[k] += s * by[k]);
    for column in 0..from.len() {
        let (here, mut sum) = (from[column], [0.0; 4]);
        let (first, rows) = matrix.smooth.column(column);
        add(&mut sum, &here, matrix.isotropic[first]);
        for (&s, &row) in matrix.isotropic[first..].iter().zip(rows).skip(1) {
            add(&mut to[row as usize], &here, s);
            add(&mut sum, &from[row as usize], s);
        }
        let (first, rows) = matrix.near.column(column);
        let here = Vector3::new(here[0], here[1], here[2]);
        let mut near = matrix.sums.blocks[first] * here;
        for (block, &row) in matrix.sums.blocks[first..].iter().zip(rows).skip(1) {
            let (x, y) = (&from[row as usize], &mut to[row as usize]);
            let product = block * here;
            (0..3).for_each(|k| y[k] += product[k]);
            near += block.tr_mul(&Vector3::new(x[0], x[1], x[2]));
        }
        (0..3).for_each(|k| to[column][k] += sum[k] + near[k]);
    }
    let parts = y.chunks_exact_mut(3).zip(diagonal.chunks_exact(3));
    for ((y, d), (x, sum)) in parts.zip(from.iter().zip(to.iter())) {
        (0..3).for_each(|k| y[k] = d[k] * x[k] + sum[k]);
    }
    multiply_globals(matrix, diagonal, x, y);
}

/// The part of [`multiply`] that globals have in it.
fn multiply_globals(matrix: &Matrix, diagonal: &[f64], x: &[f64], y: &mut [f64]) {
    let at = |x: &[f64], v: usize| Vector3::new(x[3 * v], x[3 * v + 1], x[3 * v + 2]);
    let n = 3 * matrix.near.vertices();
    for (k, border) in matrix.sums.border.iter().enumerate() {
        let mut sum = diagonal[n + k] * x[n + k];
        for ((v, b), y) in border.iter().enumerate().zip(y.chunks_exact_mut(3)) {
            (0..3).for_each(|c| y[c] += b[c] * x[n + k]);
            sum += b.dot(&at(x, v));
        }
        for l in 0..matrix.sums.border.len() {
            sum += matrix.sums.corner[(k, l)] * x[n + l];
        }
        y[n + k] = sum;
    }
}

/// Axes of a vertex from the sum of `ddᵀ` over its edges `d`: two along the surface, then the
/// normal (of either sign), as the columns.
fn local_axes(spread: &Matrix3<f64>) -> Matrix3<f64> {
    // The largest column of the adjugate is along the direction of least spread.
    let [a, b, c] = [0, 1, 2].map(|k| spread.column(k).into_owned());
    let adjugate = [b.cross(&c), c.cross(&a), a.cross(&b)];
    let longest = adjugate.iter().fold(Vector3::zeros(), |m, v| {
        if v.norm_squared() > Vector3::norm_squared(&m) { *v } else { m }
    });
    let Some(normal) = longest.try_normalize(1e-300) else { return Matrix3::identity() };
    let reference = if normal.x.abs() < 0.8 { Vector3::x() } else { Vector3::y() };
    let along = (reference - normal * normal.dot(&reference)).normalize();
    Matrix3::from_columns(&[along, normal.cross(&along), normal])
}

#[cfg(test)]
mod tests {
    use super::super::matrix::Accumulator;
    use super::super::pattern::Pattern;
    use super::*;

    const COLUMNS: u32 = 6;
    const ROWS: u32 = 5;

    /// Vertices of an uneven grid on a tilted plane, and its normal.
    fn tilted() -> (Vec<Point3<f64>>, Vector3<f64>) {
        let [u, v] = [Vector3::new(0.8, 0.1, 0.6), Vector3::new(-0.3, 0.9, 0.25)];
        let at = |i: u32| {
            let (x, y) = (f64::from(i % COLUMNS), f64::from(i / COLUMNS));
            Point3::from(u * (x + 0.2 * (3.0 * y).sin()) + v * (1.3 * y + 0.1 * x * x))
        };
        ((0..COLUMNS * ROWS).map(at).collect(), u.cross(&v).normalize())
    }

    fn edges() -> Vec<[u32; 2]> {
        let right = (0..COLUMNS * ROWS).filter(|i| i % COLUMNS + 1 < COLUMNS).map(|i| [i, i + 1]);
        let down = (0..COLUMNS * (ROWS - 1)).map(|i| [i, i + COLUMNS]);
        right.chain(down).collect()
    }

    /// Springs that are a hundred times stiffer along a direction than across it: what the
    /// preconditioner is exact for where that is the normal.
    fn springs(near: &Pattern, stiff: &Vector3<f64>) -> Accumulator {
        let mut sums = Accumulator::new(near, 1);
        let block = |weak: f64, strong: f64| {
            Matrix3::identity() * weak + stiff * stiff.transpose() * (100.0 * strong - weak)
        };
        for (k, [a, b]) in edges().into_iter().enumerate() {
            let of = |turn: f64| 1.0 + 0.5 * (turn * k as f64).sin();
            let stiffness = block(of(1.0), of(2.3));
            sums.blocks[near.find(a, a).unwrap()] += stiffness;
            sums.blocks[near.find(b, b).unwrap()] += stiffness;
            sums.blocks[near.find(a, b).unwrap()] -= stiffness;
        }
        for v in 0..COLUMNS * ROWS {
            sums.blocks[near.find(v, v).unwrap()] += block(1e-3, 1e-3);
            sums.gradient[v as usize] = Vector3::new(1.0, -2.0, 0.3 * f64::from(v)) * 0.1;
        }
        (sums.corner[(0, 0)], sums.global_gradient[0]) = (2.0, 0.5);
        sums
    }

    /// Whether so many steps reduce the residual to a ten thousandth.
    fn reached(stiff: &Vector3<f64>, steps: usize) -> bool {
        let (vertices, _) = tilted();
        let edges = edges();
        let near = Pattern::new(vertices.len(), edges.iter().map(|e| &e[..]));
        let smooth = Pattern::new(vertices.len(), std::iter::empty());
        let ordered = Ordered::new(&near, &smooth).unwrap();
        let (isotropic, sums) = (vec![0.0; smooth.len()], springs(&near, stiff));
        let matrix = Matrix {
            near: &near,
            smooth: &smooth,
            ordered: &ordered,
            isotropic: &isotropic,
            sums: &sums,
        };
        let mut iterative = Iterative::new(&ordered).unwrap();
        iterative.orient(&matrix, &vertices);
        iterative.factorise(&matrix, 0.0).unwrap();
        let mut r: Vec<f64> = sums.gradient.iter().flat_map(|g| [-g.x, -g.y, -g.z]).collect();
        r.push(-sums.global_gradient[0]);
        let (mut x, diagonal) = (vec![0.0; r.len()], damped_part(&matrix, 0.0));
        let wide = [0, 1].map(|_| vec![[0.0; 4]; vertices.len()]);
        let (iterative, matrix) = (&mut iterative, &matrix);
        let mut system = Damped { iterative, matrix, diagonal: &diagonal, wide };
        let goal = Goal::Share(1e-8);
        conjugate_gradients(&mut system, &mut x, &mut r, goal, steps) == Ending::Reached
    }

    #[test]
    fn what_differs_along_and_across_the_surface_alone_is_solved_in_few_steps() {
        let (_, normal) = tilted();
        assert!(reached(&normal, 2));
        // Axes of another direction do not part it.
        assert!(!reached(&Vector3::new(0.6, 0.0, 0.8), 8));
    }
}
