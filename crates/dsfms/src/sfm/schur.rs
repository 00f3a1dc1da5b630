//! The damped normal equations of the bundle adjustment with one kind of block eliminated.
//!
//! With `[U W; Wᵀ V]` the normal matrix of what is kept (blocks, then intrinsics) and what is
//! eliminated, damped by `λ·diag`: `(U − W V⁻¹ Wᵀ) δk = −(g_k − W V⁻¹ g_e)`,
//! `δe = −V⁻¹(g_e + Wᵀ δk)`. Points go where there are many of them (an exploration), poses where
//! they have more unknowns than the points (long tracks of few points); both give the same step.

mod layout;

pub(super) use layout::{BundleLayout, BundleRow, Eliminate, PointBlock};

use crate::solver::Step;
use nalgebra::{DMatrix, DVector, SMatrix, SVector, Vector2};
use rayon::prelude::*;
use std::ops::Range;

/// Solve for one step; `rows` sorted by what is eliminated, then by the other. `prior`: second
/// derivative and gradient of each active intrinsic. `None` when a damped matrix is not positive
/// definite.
pub(super) fn solve(
    rows: &[BundleRow],
    layout: &BundleLayout,
    prior: &[(f64, f64)],
    damping: f64,
) -> Option<Step> {
    let point = |row: &BundleRow| (row.point, row.by_point);
    let pose = |row: &BundleRow| (row.view, row.by_pose);
    let all = vec![true; layout.points];
    match layout.eliminate {
        Eliminate::Points => {
            let (poses, points, intrinsics, promise) =
                Elimination::new(&layout.free, &all, layout, damping, pose, point)
                    .solve(rows, prior)?;
            Some(step(&poses, &points, intrinsics, promise))
        }
        Eliminate::Poses => {
            let (points, poses, intrinsics, promise) =
                Elimination::new(&all, &layout.free, layout, damping, point, pose)
                    .solve(rows, prior)?;
            Some(step(&poses, &points, intrinsics, promise))
        }
    }
}

/// Zero for fixed poses; intrinsics camera by camera, each in the order of
/// [`BundleLayout::intrinsics`].
fn step(
    poses: &[SVector<f64, 6>],
    points: &[SVector<f64, 3>],
    intrinsics: Vec<f64>,
    predicted: f64,
) -> Step {
    let mut delta = Vec::with_capacity(6 * poses.len() + 3 * points.len() + intrinsics.len());
    poses.iter().for_each(|d| delta.extend(d.iter()));
    points.iter().for_each(|d| delta.extend(d.iter()));
    delta.extend(intrinsics);
    Step { delta, predicted }
}

/// The undamped reduced matrix (lower triangle) of a [`BundleLayout::whole`]; `None` where the
/// sightings of a point do not determine it.
pub(super) fn reduced(
    rows: &[BundleRow],
    layout: &BundleLayout,
    prior: &[(f64, f64)],
) -> Option<DMatrix<f64>> {
    let point = |row: &BundleRow| (row.point, row.by_point);
    let pose = |row: &BundleRow| (row.view, row.by_pose);
    let all = vec![true; layout.points];
    let system = Elimination::new(&layout.free, &all, layout, 0.0, pose, point);
    let mut total = system.reduced(rows, &system.spans(rows))?;
    system.add_prior(&mut total, prior);
    Some(total.matrix)
}

/// Kept blocks of `K` unknowns, eliminated ones of `E`; `kept` and `gone` tell the block of a row
/// and its derivative.
struct Elimination<'a, const K: usize, const E: usize, Kept, Gone> {
    /// First row of each kept block in the reduced system; `None` for what does not change.
    at: Vec<Option<usize>>,
    /// Which eliminated blocks are unknown.
    free: &'a [bool],
    /// Active intrinsics of each camera, the number of cameras, and the row of the first of all.
    intrinsics: &'a [usize],
    cameras: usize,
    intrinsics_at: usize,
    damping: f64,
    kept: Kept,
    gone: Gone,
}

/// Normal equations of what is kept, summed over some eliminated blocks (lower triangle).
struct Partial {
    matrix: DMatrix<f64>,
    /// Diagonal of `U` alone: what the damping scales with.
    diagonal: DVector<f64>,
    /// `g_k − W V⁻¹ g_e`.
    right: DVector<f64>,
    /// `g_k` alone.
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

/// Steps of the kept blocks, the eliminated ones and the intrinsics, and the promise.
type Solution<const K: usize, const E: usize> =
    (Vec<SVector<f64, K>>, Vec<SVector<f64, E>>, Vec<f64>, f64);

impl<'a, const K: usize, const E: usize, Kept, Gone> Elimination<'a, K, E, Kept, Gone>
where
    Kept: Fn(&BundleRow) -> (usize, SMatrix<f64, 2, K>) + Sync,
    Gone: Fn(&BundleRow) -> (usize, SMatrix<f64, 2, E>) + Sync,
{
    fn new(
        kept_free: &[bool],
        free: &'a [bool],
        layout: &'a BundleLayout,
        damping: f64,
        kept: Kept,
        gone: Gone,
    ) -> Self {
        let mut next = 0;
        let place = |&free: &bool| {
            free.then(|| {
                next += K;
                next - K
            })
        };
        let at = kept_free.iter().map(place).collect();
        let (intrinsics, cameras) = (&layout.intrinsics, layout.cameras);
        Self { at, free, intrinsics, cameras, intrinsics_at: next, damping, kept, gone }
    }

    fn size(&self) -> usize {
        self.camera_at(self.cameras)
    }

    /// Row of the first intrinsic of a camera.
    fn camera_at(&self, camera: usize) -> usize {
        self.intrinsics_at + camera * self.intrinsics.len()
    }

    fn solve(&self, rows: &[BundleRow], prior: &[(f64, f64)]) -> Option<Solution<K, E>> {
        let spans = self.spans(rows);
        let mut total = self.reduced(rows, &spans)?;
        let change = self.reduced_step(&mut total, prior)?;
        let own: Vec<Option<(SVector<f64, E>, f64)>> =
            spans.par_iter().map(|s| self.back_substitute(&rows[s.clone()], &change)).collect();
        let mut promise = -total.gradient.dot(&change)
            + self.damping * change.component_mul(&change).dot(&total.diagonal);
        let mut eliminated = vec![SVector::zeros(); self.free.len()];
        for (span, own) in spans.iter().zip(own) {
            let (step, promised) = own?;
            eliminated[(self.gone)(&rows[span.start]).0] = step;
            promise += promised;
        }
        let block = |at: &Option<usize>| {
            at.map_or_else(SVector::zeros, |at| change.fixed_rows::<K>(at).into_owned())
        };
        let kept = self.at.iter().map(block).collect();
        let intrinsics = change.rows_range(self.intrinsics_at..).iter().copied().collect();
        change.iter().all(|v| v.is_finite()).then_some((kept, eliminated, intrinsics, promise))
    }

    /// The reduced system of all eliminated blocks.
    fn reduced(&self, rows: &[BundleRow], spans: &[Range<usize>]) -> Option<Partial> {
        /// Fixed, so that the order of summation does not depend on the number of threads.
        const PARTS: usize = 8;
        let part = spans.len().div_ceil(PARTS).max(1);
        let partials: Vec<Option<Partial>> =
            spans.par_chunks(part).map(|spans| self.reduce(rows, spans)).collect();
        let mut total = Partial::zero(self.size());
        for partial in partials {
            total.add(&partial?);
        }
        Some(total)
    }

    /// Prior and damping into the reduced system, and its solution.
    fn reduced_step(&self, total: &mut Partial, prior: &[(f64, f64)]) -> Option<DVector<f64>> {
        self.add_prior(total, prior);
        for i in 0..self.size() {
            total.matrix[(i, i)] += self.damping * total.diagonal[i] + 1e-12;
        }
        match self.size() {
            0 => Some(DVector::zeros(0)),
            _ => Some(-std::mem::take(&mut total.matrix).cholesky()?.solve(&total.right)),
        }
    }

    fn add_prior(&self, total: &mut Partial, prior: &[(f64, f64)]) {
        for (i, &(weight, gradient)) in prior.iter().enumerate() {
            let at = self.intrinsics_at + i;
            total.matrix[(at, at)] += weight;
            total.diagonal[at] += weight;
            total.right[at] += gradient;
            total.gradient[at] += gradient;
        }
    }

    /// Ranges of rows with the same eliminated block.
    fn spans(&self, rows: &[BundleRow]) -> Vec<Range<usize>> {
        let mut start = 0;
        rows.chunk_by(|a, b| (self.gone)(a).0 == (self.gone)(b).0)
            .map(|chunk| {
                start += chunk.len();
                start - chunk.len()..start
            })
            .collect()
    }

    /// `V` damped, its undamped diagonal, and `g_e`, of one eliminated block.
    fn own_block(
        &self,
        rows: &[BundleRow],
    ) -> (SMatrix<f64, E, E>, SVector<f64, E>, SVector<f64, E>) {
        let (mut v, mut gradient) = (SMatrix::zeros(), SVector::zeros());
        for row in rows {
            let (_, by_own) = (self.gone)(row);
            v += by_own.transpose() * by_own;
            gradient += by_own.transpose() * row.residual;
        }
        let diagonal = v.diagonal();
        (v + SMatrix::from_diagonal(&(diagonal * self.damping)), diagonal, gradient)
    }

    /// Contribution of some eliminated blocks to the reduced system.
    fn reduce(&self, rows: &[BundleRow], spans: &[Range<usize>]) -> Option<Partial> {
        let mut partial = Partial::zero(self.size());
        for span in spans {
            let rows = &rows[span.clone()];
            let mut of_intrinsics = self.no_couplings(rows);
            let mut couplings = Vec::with_capacity(rows.len());
            for row in rows {
                self.add_intrinsics(&mut partial, row, &mut of_intrinsics);
                let (block, by_kept) = (self.kept)(row);
                if let Some(at) = self.at[block] {
                    add_kept(&mut partial, &by_kept, &row.residual, at);
                    couplings.push((at, by_kept.transpose() * (self.gone)(row).1));
                }
            }
            if self.free[(self.gone)(&rows[0]).0] {
                self.subtract(&mut partial, rows, &couplings, &of_intrinsics)?;
            }
        }
        Some(partial)
    }

    /// Row and coupling, still zero, of the intrinsics of every camera that sees one eliminated
    /// block; ascending.
    fn no_couplings(&self, rows: &[BundleRow]) -> Vec<(usize, SVector<f64, E>)> {
        let mut cameras: Vec<usize> = rows.iter().map(|row| row.camera).collect();
        cameras.sort_unstable();
        cameras.dedup();
        let of = |camera| self.camera_at(camera)..self.camera_at(camera + 1);
        cameras.into_iter().flat_map(of).map(|at| (at, SVector::zeros())).collect()
    }

    /// `− W V⁻¹ Wᵀ` and `− W V⁻¹ g_e` of one eliminated block.
    fn subtract(
        &self,
        partial: &mut Partial,
        rows: &[BundleRow],
        couplings: &[(usize, SMatrix<f64, K, E>)],
        of_intrinsics: &[(usize, SVector<f64, E>)],
    ) -> Option<()> {
        let (v, _, gradient) = self.own_block(rows);
        let inverse = v.cholesky()?.inverse();
        for (i, (at, w)) in couplings.iter().enumerate() {
            let y = w * inverse;
            let mut right = partial.right.fixed_rows_mut::<K>(*at);
            right -= y * gradient;
            // Rows are sorted, so the block (at, other) lies in the lower triangle.
            for (other, w) in &couplings[..=i] {
                let mut block = partial.matrix.fixed_view_mut::<K, K>(*at, *other);
                block -= y * w.transpose();
            }
            for (row, z) in of_intrinsics {
                let mut block = partial.matrix.fixed_view_mut::<1, K>(*row, *at);
                block -= (y * z).transpose();
            }
        }
        for (k, (row, z)) in of_intrinsics.iter().enumerate() {
            let y = inverse * z;
            partial.right[*row] -= y.dot(&gradient);
            for (column, other) in &of_intrinsics[..=k] {
                partial.matrix[(*row, *column)] -= y.dot(other);
            }
        }
        Some(())
    }

    fn add_intrinsics(
        &self,
        partial: &mut Partial,
        row: &BundleRow,
        couplings: &mut [(usize, SVector<f64, E>)],
    ) {
        let first = self.camera_at(row.camera);
        let own = couplings.iter().position(|(at, _)| *at == first).unwrap_or(0);
        let column = |k: usize| row.by_intrinsics.column(k);
        let (block, by_kept) = (self.kept)(row);
        let (_, by_own) = (self.gone)(row);
        for (i, &k) in self.intrinsics.iter().enumerate() {
            let at = first + i;
            for (j, &l) in self.intrinsics[..=i].iter().enumerate() {
                partial.matrix[(at, first + j)] += column(k).dot(&column(l));
            }
            partial.diagonal[at] += column(k).norm_squared();
            partial.right[at] += column(k).dot(&row.residual);
            partial.gradient[at] += column(k).dot(&row.residual);
            if let Some(kept_at) = self.at[block] {
                let mut block = partial.matrix.fixed_view_mut::<1, K>(at, kept_at);
                block += column(k).transpose() * by_kept;
            }
            couplings[own + i].1 += by_own.transpose() * column(k);
        }
    }

    /// Step of one eliminated block and its share of the promise.
    fn back_substitute(
        &self,
        rows: &[BundleRow],
        change: &DVector<f64>,
    ) -> Option<(SVector<f64, E>, f64)> {
        if !self.free[(self.gone)(&rows[0]).0] {
            return Some((SVector::zeros(), 0.0));
        }
        let (v, diagonal, gradient) = self.own_block(rows);
        let mut right = gradient;
        for row in rows {
            let mut moved = Vector2::zeros();
            let (block, by_kept) = (self.kept)(row);
            if let Some(at) = self.at[block] {
                moved += by_kept * change.fixed_rows::<K>(at);
            }
            for (i, &k) in self.intrinsics.iter().enumerate() {
                moved += row.by_intrinsics.column(k) * change[self.camera_at(row.camera) + i];
            }
            right += (self.gone)(row).1.transpose() * moved;
        }
        let step = -v.cholesky()?.solve(&right);
        let promise =
            -gradient.dot(&step) + self.damping * step.component_mul(&step).dot(&diagonal);
        Some((step, promise))
    }
}

fn add_kept<const K: usize>(
    partial: &mut Partial,
    by_kept: &SMatrix<f64, 2, K>,
    residual: &Vector2<f64>,
    at: usize,
) {
    let u = by_kept.transpose() * by_kept;
    let gradient = by_kept.transpose() * residual;
    let mut block = partial.matrix.fixed_view_mut::<K, K>(at, at);
    block += u;
    let mut diagonal = partial.diagonal.fixed_rows_mut::<K>(at);
    diagonal += u.diagonal();
    let mut right = partial.right.fixed_rows_mut::<K>(at);
    right += gradient;
    let mut total = partial.gradient.fixed_rows_mut::<K>(at);
    total += gradient;
}
