//! How far poses and points may be off: their covariance after an adjustment.
//!
//! With `N = Σ JᵀJ/σ²` over poses, intrinsics and points (points eliminated: `S = U − W V⁻¹ Wᵀ`),
//!
//! ```text
//! C_kept = v·S⁺,    C_point = v·V⁻¹ + Y C_kept Yᵀ,  Y = V⁻¹Wᵀ
//! ```
//!
//! **Gauge.** Nothing in the sightings tells position, orientation and scale of the world. `S⁺`
//! leaves out these seven freedoms: what is reported is what remains after the similarity that
//! brings the cameras, as a whole, closest to where they should be
//! (`Σ ‖δ centre‖² + radius²‖δ rotation‖²`, the radius being that of the camera centres about their
//! mean). No camera is held, so none is without error, and the figures compare with errors after
//! alignment by a similarity.
//!
//! **Variance.** `v` is measured: the residual variance in units of σ², for a robust loss that of
//! its estimates (Huber and Ronchetti, Robust Statistics, §7.6),
//! `v = mean(ρ′² s/2)/mean(d(sρ′)/ds)²`, times sightings over redundancy. Errors that neighbouring
//! sightings share, and wrong intrinsics that were not refined, are not in it: real errors are
//! larger where there are any.

use super::super::schur::{self, BundleLayout, BundleRow, PointBlock};
use super::{
    Bundle, BundleError, BundleOptions, Eliminate, IntrinsicsPrior, check_cameras,
    count_infeasible, linearise, sort, squared_error,
};
use crate::geometry::Point3;
use crate::sfm::intrinsics;
use crate::sfm::triangulation::centre_of;
use crate::solver::Loss;
use nalgebra::{DMatrix, Matrix3, Matrix6, SMatrix};
use rayon::prelude::*;

/// Freedoms of a similarity of the world.
const GAUGE: usize = 7;

/// Covariance of an adjusted bundle, up to a similarity of the world (the module says which).
#[derive(Clone, Debug, PartialEq)]
pub struct Covariance {
    /// Of every pose: rotation of the camera about its own axes (rad), then its centre in world
    /// axes (length units).
    pub poses: Vec<Matrix6<f64>>,
    /// Of every point, world axes, squared length units; infinite without sightings.
    pub points: Vec<Matrix3<f64>>,
    /// Measured variance of the sightings in units of their assumed one; 1 = as assumed.
    pub variance: f64,
}

impl Covariance {
    /// Expected distance of a camera centre from the truth (root mean square), length units.
    pub fn centre_error(&self, view: usize) -> f64 {
        self.poses[view].fixed_view::<3, 3>(3, 3).trace().sqrt()
    }

    /// Expected angle between the rotation of a camera and the truth (root mean square), radians.
    pub(crate) fn rotation_error(&self, view: usize) -> f64 {
        self.poses[view].fixed_view::<3, 3>(0, 0).trace().sqrt()
    }

    /// Expected distance of a point from the truth (root mean square), length units.
    pub(crate) fn point_error(&self, point: usize) -> f64 {
        self.points[point].trace().sqrt()
    }
}

/// Covariance of poses and points at the minimum that [`adjust`](super::adjust) found under the
/// same options. All poses count as unknown, those marked as fixed too: they hold the gauge, which
/// is another here. `V³` time and `V²` memory in the number of views `V`.
///
/// # Errors
/// As for `adjust`; [`BundleError::Undetermined`] where sightings do not determine all unknowns.
#[doc(alias = "uncertainty")]
pub fn covariance(bundle: &Bundle, options: &BundleOptions) -> Result<Covariance, BundleError> {
    options.validate()?;
    check_cameras(bundle)?;
    let mut bundle = bundle.clone();
    sort(&mut bundle, Eliminate::Points)?;
    for camera in &mut bundle.cameras {
        *camera = intrinsics::prepared(camera, &options.refine);
    }
    let layout = BundleLayout::whole(&bundle, &options.refine.active());
    let variance = variance(&bundle, &layout, options.loss)?;
    // The prior is known, the noise of the sightings measured.
    let prior: Vec<(f64, f64)> = IntrinsicsPrior::new(&bundle, options)
        .weights()
        .map(|weight| (weight * variance, 0.0))
        .collect();
    let rows = linearise(&bundle, Loss::Squared);
    let mut normal = schur::reduced(&rows, &layout, &prior).ok_or(BundleError::Undetermined)?;
    normal.fill_upper_triangle_with_lower_triangle();
    let kept = pseudo_inverse(&bundle, normal).ok_or(BundleError::Undetermined)? * variance;
    let spans: Vec<&[BundleRow]> = rows.chunk_by(|a, b| a.point == b.point).collect();
    let of_points: Vec<(usize, Option<Matrix3<f64>>)> = spans
        .par_iter()
        .map(|rows| (rows[0].point, of_point(&layout.point_block(rows), &kept, variance)))
        .collect();
    let mut points = vec![Matrix3::from_diagonal_element(f64::INFINITY); bundle.points.len()];
    for (point, found) in of_points {
        points[point] = found.ok_or(BundleError::Undetermined)?;
    }
    let poses = (0..bundle.poses.len()).map(|v| of_pose(&bundle, &kept, v)).collect();
    Ok(Covariance { poses, points, variance })
}

/// `v`, after checking that there are more sightings than unknowns.
fn variance(bundle: &Bundle, layout: &BundleLayout, loss: Loss) -> Result<f64, BundleError> {
    let count = bundle.observations.len();
    let unknowns = layout.kept() + 3 * bundle.points.len();
    let redundancy = (2 * count + GAUGE).saturating_sub(unknowns);
    if redundancy == 0 {
        return Err(BundleError::Undetermined);
    }
    let (mut squares, mut slope) = (0.0, 0.0);
    for o in &bundle.observations {
        let s = squared_error(bundle, o)
            .ok_or_else(|| BundleError::Infeasible(count_infeasible(bundle)))?;
        squares += 0.5 * loss.evaluate(s).1.powi(2) * s;
        slope += loss.slope(s);
    }
    let count = count as f64;
    Ok(squares / count / (slope / count).powi(2) * (2.0 * count / redundancy as f64))
}

/// Directions of the kept unknowns that change no residual (turn, shift and growth of the world
/// about the mean camera centre), as columns; rotations in radii. `None` where all centres
/// coincide.
fn gauge(bundle: &Bundle, unknowns: usize) -> Option<(DMatrix<f64>, f64)> {
    let centres: Vec<Point3> = bundle.poses.iter().map(centre_of).collect();
    let count = centres.len() as f64;
    let mean = centres.iter().map(|c| c.coords).sum::<nalgebra::Vector3<f64>>() / count;
    let radius =
        (centres.iter().map(|c| (c.coords - mean).norm_squared()).sum::<f64>() / count).sqrt();
    if radius <= 1e-12 * mean.norm() {
        return None;
    }
    let mut directions = DMatrix::zeros(unknowns, GAUGE);
    for (v, pose) in bundle.poses.iter().enumerate() {
        // The world moves by a + b × c + s c: ω = −R b and τ = −R (shift of the centre).
        let turned = -pose.rotation.to_rotation_matrix().matrix();
        let c = (centres[v].coords - mean) / radius;
        let mut own = directions.fixed_rows_mut::<6>(6 * v);
        own.fixed_view_mut::<3, 3>(0, 0).copy_from(&turned);
        own.fixed_view_mut::<3, 3>(3, 0).copy_from(&(-turned * c.cross_matrix()));
        own.fixed_view_mut::<3, 3>(3, 3).copy_from(&turned);
        own.fixed_view_mut::<3, 1>(3, 6).copy_from(&(turned * c));
    }
    Some((directions, radius))
}

/// `S⁺` in the metric of the module's head: `(S + αQQᵀ)⁻¹ − QQᵀ/α` with an orthonormal basis `Q` of
/// the gauge.
fn pseudo_inverse(bundle: &Bundle, mut normal: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let (directions, radius) = gauge(bundle, normal.nrows())?;
    let q = directions.qr().q();
    let projector = &q * q.transpose();
    rotations_in(&mut normal, bundle.poses.len(), 1.0 / radius);
    let alpha = normal.trace() / normal.nrows() as f64;
    let mut inverse = (normal + &projector * alpha).cholesky()?.inverse() - projector / alpha;
    rotations_in(&mut inverse, bundle.poses.len(), 1.0 / radius);
    inverse.iter().all(|v| v.is_finite()).then_some(inverse)
}

/// Multiply rows and columns of all rotations.
fn rotations_in(matrix: &mut DMatrix<f64>, views: usize, factor: f64) {
    for i in (0..views).flat_map(|v| 6 * v..6 * v + 3) {
        matrix.row_mut(i).scale_mut(factor);
        matrix.column_mut(i).scale_mut(factor);
    }
}

/// From `(ω, τ)` in camera axes to rotation and centre: the centre moves by `−Rᵀτ`.
fn of_pose(bundle: &Bundle, kept: &DMatrix<f64>, view: usize) -> Matrix6<f64> {
    let mut change = Matrix6::identity();
    let turn = -bundle.poses[view].rotation.to_rotation_matrix().matrix().transpose();
    change.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn);
    change * kept.fixed_view::<6, 6>(6 * view, 6 * view) * change.transpose()
}

fn of_point(block: &PointBlock, kept: &DMatrix<f64>, variance: f64) -> Option<Matrix3<f64>> {
    let inverse = block.own.cholesky()?.inverse();
    let mut found = inverse * variance;
    let couplings: Vec<(usize, SMatrix<f64, 3, 1>)> =
        block.couplings.iter().map(|(at, w)| (*at, inverse * w)).collect();
    for (i, a) in &couplings {
        let row: SMatrix<f64, 3, 1> = couplings.iter().map(|(j, b)| b * kept[(*i, *j)]).sum();
        found += a * row.transpose();
    }
    Some(0.5 * (found + found.transpose()))
}

#[cfg(test)]
mod tests;
