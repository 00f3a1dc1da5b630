//! One row an observation, and where the unknowns sit among those of the normal equations.

use super::super::bundle::Bundle;
use super::super::intrinsics::COUNT;
use nalgebra::{Matrix2x3, Matrix2x6, SMatrix, SVector, Vector2};

/// One observation, scaled by the root of its robust weight over σ.
pub(in crate::sfm) struct BundleRow {
    pub view: usize,
    pub point: usize,
    pub camera: usize,
    pub residual: Vector2<f64>,
    pub by_pose: Matrix2x6<f64>,
    pub by_point: Matrix2x3<f64>,
    pub by_intrinsics: SMatrix<f64, 2, COUNT>,
}

/// What is eliminated: the rows must be sorted by it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::sfm) enum Eliminate {
    Points,
    Poses,
}

/// Where each unknown sits.
pub(in crate::sfm) struct BundleLayout {
    pub eliminate: Eliminate,
    /// Which poses are unknown.
    pub(super) free: Vec<bool>,
    pub(super) points: usize,
    pub(super) cameras: usize,
    /// Active intrinsic parameters of every camera.
    pub intrinsics: Vec<usize>,
}

impl BundleLayout {
    /// Eliminates what leaves the smaller system.
    pub(crate) fn new(bundle: &Bundle, active: &[usize]) -> Self {
        let free: Vec<bool> = bundle.fixed.iter().map(|fixed| !fixed).collect();
        let points = bundle.points.len();
        let poses = free.iter().filter(|free| **free).count();
        let eliminate = if 6 * poses > 3 * points { Eliminate::Poses } else { Eliminate::Points };
        let cameras = bundle.cameras.len();
        Self { eliminate, free, points, cameras, intrinsics: active.to_vec() }
    }

    /// Every pose unknown, the points eliminated.
    pub(crate) fn whole(bundle: &Bundle, active: &[usize]) -> Self {
        let free = vec![true; bundle.poses.len()];
        Self { free, eliminate: Eliminate::Points, ..Self::new(bundle, active) }
    }

    /// Size of the reduced system of a [`whole`](Self::whole) layout.
    pub(crate) fn kept(&self) -> usize {
        6 * self.free.len() + self.cameras * self.intrinsics.len()
    }

    /// What a [`whole`](Self::whole) layout eliminates with one point, from the point's rows.
    pub(crate) fn point_block(&self, rows: &[BundleRow]) -> PointBlock {
        let mut block = PointBlock { own: SMatrix::zeros(), couplings: Vec::new() };
        for row in rows {
            block.own += row.by_point.transpose() * row.by_point;
            let by_pose = row.by_point.transpose() * row.by_pose;
            let pose = (0..6).map(|k| (6 * row.view + k, by_pose.column(k).into_owned()));
            block.couplings.extend(pose);
            let first = 6 * self.free.len() + row.camera * self.intrinsics.len();
            let intrinsics = self.intrinsics.iter().enumerate();
            block.couplings.extend(intrinsics.map(|(i, &k)| {
                (first + i, row.by_point.transpose() * row.by_intrinsics.column(k))
            }));
        }
        block
    }
}

/// Normal matrix of one point and its coupling to every kept unknown it meets.
pub(in crate::sfm) struct PointBlock {
    /// `V`.
    pub own: SMatrix<f64, 3, 3>,
    /// Row in the reduced system, and the column of `Wᵀ` there; a row may come more than once.
    pub couplings: Vec<(usize, SVector<f64, 3>)>,
}
