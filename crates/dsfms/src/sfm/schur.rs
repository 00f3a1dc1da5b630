//! The damped normal equations of the bundle adjustment with the points eliminated.
//!
//! With `[U W; Wᵀ V]` the normal matrix of cameras (poses, then intrinsics) and points, damped by
//! `λ·diag`: `(U − W V⁻¹ Wᵀ) δc = −(g_c − W V⁻¹ g_p)`, `δp = −V⁻¹(g_p + Wᵀ δc)`.

use super::bundle::Bundle;
use super::intrinsics::COUNT;
use nalgebra::{DMatrix, DVector, Matrix2x3, Matrix2x6, Matrix3, SMatrix, Vector2, Vector3};
use rayon::prelude::*;
use std::ops::Range;

/// One observation, scaled by the root of its robust weight over σ.
pub(super) struct Row {
    pub view: usize,
    pub point: usize,
    pub residual: Vector2<f64>,
    pub by_pose: Matrix2x6<f64>,
    pub by_point: Matrix2x3<f64>,
    pub by_intrinsics: SMatrix<f64, 2, COUNT>,
}

/// Where each unknown sits in the reduced system.
pub(super) struct Layout {
    /// First row of each view's pose; `None` for fixed views.
    pub pose_at: Vec<Option<usize>>,
    /// Active intrinsic parameters.
    pub intrinsics: Vec<usize>,
    /// Row of the first of them.
    pub intrinsics_at: usize,
    points: usize,
}

impl Layout {
    pub fn new(bundle: &Bundle, active: &[usize]) -> Self {
        let mut next = 0;
        let place = |&fixed: &bool| {
            (!fixed).then(|| {
                next += 6;
                next - 6
            })
        };
        let pose_at = bundle.fixed.iter().map(place).collect();
        Self {
            pose_at,
            intrinsics: active.to_vec(),
            intrinsics_at: next,
            points: bundle.points.len(),
        }
    }

    fn size(&self) -> usize {
        self.intrinsics_at + self.intrinsics.len()
    }
}

/// A damped step and the drop of the cost that the linear model promises for it.
pub(super) struct Step {
    pub cameras: DVector<f64>,
    pub points: Vec<Vector3<f64>>,
    pub promise: f64,
}

/// Normal equations of the cameras summed over some points (lower triangle).
struct Partial {
    matrix: DMatrix<f64>,
    /// Diagonal of `U` alone: what the damping scales with.
    diagonal: DVector<f64>,
    /// `g_c − W V⁻¹ g_p`.
    right: DVector<f64>,
    /// `g_c` alone.
    gradient: DVector<f64>,
}

impl Partial {
    fn zero(n: usize) -> Self {
        let vector = || DVector::zeros(n);
        Self {
            matrix: DMatrix::zeros(n, n),
            diagonal: vector(),
            right: vector(),
            gradient: vector(),
        }
    }

    fn add(&mut self, other: &Self) {
        self.matrix += &other.matrix;
        self.diagonal += &other.diagonal;
        self.right += &other.right;
        self.gradient += &other.gradient;
    }
}

/// Solve for one step; `rows` sorted by point. `prior`: second derivative and gradient of each
/// active intrinsic. `None` when the damped matrix is not positive definite.
pub(super) fn solve(
    rows: &[Row],
    layout: &Layout,
    prior: &[(f64, f64)],
    damping: f64,
) -> Option<Step> {
    /// Fixed, so that the order of summation does not depend on the number of threads.
    const PARTS: usize = 8;
    let spans = spans_by_point(rows);
    let part = spans.len().div_ceil(PARTS).max(1);
    let partials: Vec<Option<Partial>> =
        spans.par_chunks(part).map(|spans| reduce(rows, spans, layout, damping)).collect();
    let mut total = Partial::zero(layout.size());
    for partial in partials {
        total.add(&partial?);
    }
    for (i, &(weight, gradient)) in prior.iter().enumerate() {
        let at = layout.intrinsics_at + i;
        total.matrix[(at, at)] += weight;
        total.diagonal[at] += weight;
        total.right[at] += gradient;
        total.gradient[at] += gradient;
    }
    for i in 0..layout.size() {
        total.matrix[(i, i)] += damping * total.diagonal[i] + 1e-12;
    }
    let cameras = match layout.size() {
        0 => DVector::zeros(0),
        _ => -total.matrix.cholesky()?.solve(&total.right),
    };
    let own: Vec<Option<(Vector3<f64>, f64)>> = spans
        .par_iter()
        .map(|s| back_substitute(&rows[s.clone()], layout, &cameras, damping))
        .collect();
    let mut points = vec![Vector3::zeros(); layout.points];
    let mut promise = -total.gradient.dot(&cameras)
        + damping * cameras.component_mul(&cameras).dot(&total.diagonal);
    for (span, own) in spans.iter().zip(own) {
        let (step, promised) = own?;
        points[rows[span.start].point] = step;
        promise += promised;
    }
    cameras.iter().all(|v| v.is_finite()).then_some(Step { cameras, points, promise })
}

/// Ranges of rows with the same point.
fn spans_by_point(rows: &[Row]) -> Vec<Range<usize>> {
    let mut start = 0;
    rows.chunk_by(|a, b| a.point == b.point)
        .map(|chunk| {
            start += chunk.len();
            start - chunk.len()..start
        })
        .collect()
}

/// `V` damped, its undamped diagonal, and `g_p`.
fn point_block(rows: &[Row], damping: f64) -> (Matrix3<f64>, Vector3<f64>, Vector3<f64>) {
    let (mut v, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
    for row in rows {
        v += row.by_point.transpose() * row.by_point;
        gradient += row.by_point.transpose() * row.residual;
    }
    let diagonal = v.diagonal();
    (v + Matrix3::from_diagonal(&(diagonal * damping)), diagonal, gradient)
}

/// Contribution of some points to the reduced system.
fn reduce(rows: &[Row], spans: &[Range<usize>], layout: &Layout, damping: f64) -> Option<Partial> {
    let mut partial = Partial::zero(layout.size());
    let active = layout.intrinsics.len();
    for span in spans {
        let rows = &rows[span.clone()];
        let (v, _, gradient) = point_block(rows, damping);
        let inverse = v.cholesky()?.inverse();
        let mut intrinsic_coupling = vec![Vector3::zeros(); active];
        let mut couplings = Vec::with_capacity(rows.len());
        for row in rows {
            add_intrinsics(&mut partial, row, layout, &mut intrinsic_coupling);
            if let Some(at) = layout.pose_at[row.view] {
                add_pose(&mut partial, row, at);
                couplings.push((at, row.by_pose.transpose() * row.by_point));
            }
        }
        for (i, (at, w)) in couplings.iter().enumerate() {
            let y = w * inverse;
            let mut right = partial.right.fixed_rows_mut::<6>(*at);
            right -= y * gradient;
            // Rows are sorted by view, so the block (at, other) lies in the lower triangle.
            for (other, w) in &couplings[..=i] {
                let mut block = partial.matrix.fixed_view_mut::<6, 6>(*at, *other);
                block -= y * w.transpose();
            }
            for (k, z) in intrinsic_coupling.iter().enumerate() {
                let mut block =
                    partial.matrix.fixed_view_mut::<1, 6>(layout.intrinsics_at + k, *at);
                block -= (y * z).transpose();
            }
        }
        for (k, z) in intrinsic_coupling.iter().enumerate() {
            let y = inverse * z;
            partial.right[layout.intrinsics_at + k] -= y.dot(&gradient);
            for (l, other) in intrinsic_coupling[..=k].iter().enumerate() {
                let at = (layout.intrinsics_at + k, layout.intrinsics_at + l);
                partial.matrix[at] -= y.dot(other);
            }
        }
    }
    Some(partial)
}

fn add_pose(partial: &mut Partial, row: &Row, at: usize) {
    let u = row.by_pose.transpose() * row.by_pose;
    let gradient = row.by_pose.transpose() * row.residual;
    let mut block = partial.matrix.fixed_view_mut::<6, 6>(at, at);
    block += u;
    let mut diagonal = partial.diagonal.fixed_rows_mut::<6>(at);
    diagonal += u.diagonal();
    let mut right = partial.right.fixed_rows_mut::<6>(at);
    right += gradient;
    let mut total = partial.gradient.fixed_rows_mut::<6>(at);
    total += gradient;
}

fn add_intrinsics(
    partial: &mut Partial,
    row: &Row,
    layout: &Layout,
    coupling: &mut [Vector3<f64>],
) {
    let column = |k: usize| row.by_intrinsics.column(k);
    for (i, &k) in layout.intrinsics.iter().enumerate() {
        let at = layout.intrinsics_at + i;
        for (j, &l) in layout.intrinsics[..=i].iter().enumerate() {
            partial.matrix[(at, layout.intrinsics_at + j)] += column(k).dot(&column(l));
        }
        partial.diagonal[at] += column(k).norm_squared();
        partial.right[at] += column(k).dot(&row.residual);
        partial.gradient[at] += column(k).dot(&row.residual);
        if let Some(pose_at) = layout.pose_at[row.view] {
            let mut block = partial.matrix.fixed_view_mut::<1, 6>(at, pose_at);
            block += column(k).transpose() * row.by_pose;
        }
        coupling[i] += row.by_point.transpose() * column(k);
    }
}

/// Step of one point and its share of the promise.
fn back_substitute(
    rows: &[Row],
    layout: &Layout,
    cameras: &DVector<f64>,
    damping: f64,
) -> Option<(Vector3<f64>, f64)> {
    let (v, diagonal, gradient) = point_block(rows, damping);
    let mut right = gradient;
    for row in rows {
        let mut moved = Vector2::zeros();
        if let Some(at) = layout.pose_at[row.view] {
            moved += row.by_pose * cameras.fixed_rows::<6>(at);
        }
        for (i, &k) in layout.intrinsics.iter().enumerate() {
            moved += row.by_intrinsics.column(k) * cameras[layout.intrinsics_at + i];
        }
        right += row.by_point.transpose() * moved;
    }
    let step = -v.cholesky()?.solve(&right);
    let promise = -gradient.dot(&step) + damping * step.component_mul(&step).dot(&diagonal);
    Some((step, promise))
}
