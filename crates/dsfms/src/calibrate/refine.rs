//! All intrinsics and poses together: least squares of the reprojection error.
//!
//! The poses are eliminated view by view (Schur complement); what is left is one small system in
//! the intrinsics, whose inverse is their covariance.

use super::board::{BoardCorner, on_board};
use super::closed_form::StartingCamera;
use super::error::CalibrateError;
use super::options::CalibrateOptions;
use super::target::Board;
use crate::camera::{BrownConrady, Camera, CameraModel};
use crate::geometry::{Isometry, Point3, Vector2, Vector3};
use crate::solver::Summary;
use crate::solver::levenberg_marquardt::{Options, Problem, Step, minimize};
use nalgebra::{DMatrix, DVector, Matrix2x3, Matrix6, SMatrix, UnitQuaternion, Vector6};
use serde::Serialize;

/// fx fy cx cy k1 k2 p1 p2 k3.
const NAMES: [&str; 9] = ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"];

/// An intrinsic and how well the images determine it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// `fx`, `k1`, …
    pub name: &'static str,
    /// Its value; px for focal lengths and the principal point.
    pub value: f64,
    /// Standard deviation from the residuals; 0 where it was held fixed.
    pub deviation: f64,
}

/// What refinement returns, one entry a view where there are several.
pub(super) struct SolvedCamera {
    pub camera: CameraModel,
    pub estimates: Vec<Estimate>,
    pub covariance: Vec<Vec<f64>>,
    pub poses: Vec<Isometry>,
    pub residuals: Vec<Vec<Vector2>>,
    pub summary: Summary,
}

/// Minimise from the closed form.
pub(super) fn refine(
    size: [usize; 2],
    views: &[&[BoardCorner]],
    board: &Board,
    options: &CalibrateOptions,
    start: StartingCamera,
) -> Result<SolvedCamera, CalibrateError> {
    let mut free = vec![0, 1, 2, 3, 4, 5];
    free.extend(options.tangential.then_some([6, 7]).into_iter().flatten());
    free.extend(options.third_radial.then_some(8));
    let [fx, fy] = start.camera.focal;
    let [cx, cy] = start.camera.centre;
    let state =
        CameraState { intrinsics: [fx, fy, cx, cy, 0.0, 0.0, 0.0, 0.0, 0.0], poses: start.poses };
    let mut problem = CornerReprojection { size, views, board, free, system: None };
    let limits = Options { max_steps: 200, cost_tolerance: 1e-12, ..Options::default() };
    let (state, summary) = minimize(&mut problem, state, &limits);
    problem.linearise(&state);
    let covariance = problem.covariance(&state).ok_or(CalibrateError::Degenerate)?;
    let residuals: Option<Vec<Vec<Vector2>>> =
        (0..views.len()).map(|i| problem.residuals(&state, i)).collect();
    let deviation = |i: usize| covariance[i][i].max(0.0).sqrt();
    let estimate =
        |i: usize| Estimate { name: NAMES[i], value: state.intrinsics[i], deviation: deviation(i) };
    Ok(SolvedCamera {
        camera: problem.camera(&state),
        estimates: (0..NAMES.len()).map(estimate).collect(),
        covariance,
        residuals: residuals.ok_or(CalibrateError::Degenerate)?,
        poses: state.poses,
        summary,
    })
}

#[derive(Clone)]
struct CameraState {
    intrinsics: [f64; 9],
    poses: Vec<Isometry>,
}

/// Normal equations of one view: `[intrinsics; pose]`.
struct ViewBlock {
    own: Matrix6<f64>,
    cross: DMatrix<f64>,
    right: Vector6<f64>,
}

struct CalibrationSystem {
    normal: DMatrix<f64>,
    right: DVector<f64>,
    views: Vec<ViewBlock>,
}

struct CornerReprojection<'a> {
    size: [usize; 2],
    views: &'a [&'a [BoardCorner]],
    board: &'a Board,
    /// Which of the nine intrinsics move.
    free: Vec<usize>,
    system: Option<CalibrationSystem>,
}

impl CornerReprojection<'_> {
    fn camera(&self, state: &CameraState) -> CameraModel {
        let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = state.intrinsics;
        let lens = BrownConrady { k: [k1, k2, k3], p: [p1, p2] }.into();
        CameraModel { size: self.size, focal: [fx, fy], centre: [cx, cy], lens }
    }

    fn in_camera(&self, state: &CameraState, view: usize, corner: &BoardCorner) -> Point3 {
        let p = on_board(corner, self.board);
        state.poses[view] * Point3::new(p.x, p.y, 0.0)
    }

    /// Corner minus projection; `None` where one has no projection.
    fn residuals(&self, state: &CameraState, view: usize) -> Option<Vec<Vector2>> {
        let camera = self.camera(state);
        let residual = |corner: &BoardCorner| {
            let projected = camera.project(&self.in_camera(state, view, corner))?;
            Some(corner.pixel - projected.pixel)
        };
        self.views[view].iter().map(residual).collect()
    }

    fn view_block(
        &self,
        state: &CameraState,
        view: usize,
        system: &mut CalibrationSystem,
    ) -> Option<()> {
        let (camera, m) = (self.camera(state), self.free.len());
        let pose = &state.poses[view];
        let mut block = ViewBlock {
            own: Matrix6::zeros(),
            cross: DMatrix::zeros(m, 6),
            right: Vector6::zeros(),
        };
        for corner in self.views[view] {
            let point = self.in_camera(state, view, corner);
            let projection = camera.project(&point)?;
            let residual = projection.pixel - corner.pixel;
            let all = intrinsic_jacobian(&state.intrinsics, &point);
            let inner = DMatrix::from_fn(2, m, |r, c| all[(r, self.free[c])]);
            let outer =
                pose_jacobian(&projection.jacobian, &(point.coords - pose.translation.vector));
            system.normal += inner.transpose() * &inner;
            system.right += inner.transpose() * residual;
            block.own += outer.transpose() * outer;
            block.cross += inner.transpose() * outer;
            block.right += outer.transpose() * residual;
        }
        system.views.push(block);
        Some(())
    }

    /// The intrinsics' system with the poses eliminated: matrix and right-hand side.
    fn reduced(&self, damping: f64) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let system = self.system.as_ref()?;
        let mut normal = damped(&system.normal, damping);
        let mut right = system.right.clone();
        for block in &system.views {
            let factor = damped_pose(&block.own, damping).cholesky()?;
            normal -= &block.cross * factor.inverse() * block.cross.transpose();
            right -= &block.cross * factor.solve(&block.right);
        }
        Some((normal, right))
    }

    /// Covariance of the nine intrinsics, `σ²` from the residuals.
    fn covariance(&self, state: &CameraState) -> Option<Vec<Vec<f64>>> {
        let inverse = self.reduced(0.0)?.0.cholesky()?.inverse();
        let corners: usize = self.views.iter().map(|v| v.len()).sum();
        let unknowns = self.free.len() + 6 * self.views.len();
        let spare = (2 * corners).saturating_sub(unknowns).max(1) as f64;
        let variance = self.costs(state)?.iter().sum::<f64>() / spare;
        let mut out = vec![vec![0.0; NAMES.len()]; NAMES.len()];
        for (r, &i) in self.free.iter().enumerate() {
            for (c, &j) in self.free.iter().enumerate() {
                out[i][j] = variance * inverse[(r, c)];
            }
        }
        Some(out)
    }
}

/// `∂pixel/∂(fx fy cx cy k1 k2 p1 p2 k3)`.
fn intrinsic_jacobian(intrinsics: &[f64; 9], point: &Point3) -> SMatrix<f64, 2, 9> {
    let [fx, fy, _, _, k1, k2, p1, p2, k3] = *intrinsics;
    let (x, y) = (point.x / point.z, point.y / point.z);
    let u = x * x + y * y;
    let radial = 1.0 + u * (k1 + u * (k2 + u * k3));
    let distorted = [
        x * radial + 2.0 * p1 * x * y + p2 * (u + 2.0 * x * x),
        y * radial + p1 * (u + 2.0 * y * y) + 2.0 * p2 * x * y,
    ];
    let (u2, u3) = (u * u, u * u * u);
    SMatrix::<f64, 2, 9>::from_rows(&[
        [
            distorted[0],
            0.0,
            1.0,
            0.0,
            fx * x * u,
            fx * x * u2,
            2.0 * fx * x * y,
            fx * (u + 2.0 * x * x),
            fx * x * u3,
        ]
        .into(),
        [
            0.0,
            distorted[1],
            0.0,
            1.0,
            fy * y * u,
            fy * y * u2,
            fy * (u + 2.0 * y * y),
            2.0 * fy * x * y,
            fy * y * u3,
        ]
        .into(),
    ])
}

/// `∂pixel/∂(t, ω)` for the pose `exp(ω) R, t + δt`; `arm` is the point before translation.
fn pose_jacobian(projection: &Matrix2x3<f64>, arm: &Vector3) -> SMatrix<f64, 2, 6> {
    let mut out = SMatrix::<f64, 2, 6>::zeros();
    out.fixed_columns_mut::<3>(0).copy_from(projection);
    out.fixed_columns_mut::<3>(3).copy_from(&(-projection * arm.cross_matrix()));
    out
}

fn damped(normal: &DMatrix<f64>, damping: f64) -> DMatrix<f64> {
    let mut out = normal.clone();
    (0..out.nrows()).for_each(|i| out[(i, i)] *= 1.0 + damping);
    out
}

fn damped_pose(normal: &Matrix6<f64>, damping: f64) -> Matrix6<f64> {
    normal + Matrix6::from_diagonal(&(normal.diagonal() * damping))
}

impl Problem for CornerReprojection<'_> {
    type State = CameraState;

    fn costs(&self, state: &CameraState) -> Option<Vec<f64>> {
        if state.intrinsics[..2].iter().any(|&f| f <= 0.0) {
            return None;
        }
        let mut sum = 0.0;
        for view in 0..self.views.len() {
            sum += self.residuals(state, view)?.iter().map(|r| r.norm_squared()).sum::<f64>();
        }
        Some(vec![sum])
    }

    fn labels(&self) -> Vec<&'static str> {
        vec!["reprojection, px²"]
    }

    fn linearise(&mut self, state: &CameraState) -> f64 {
        let m = self.free.len();
        let mut system = CalibrationSystem {
            normal: DMatrix::zeros(m, m),
            right: DVector::zeros(m),
            views: Vec::new(),
        };
        let complete =
            (0..self.views.len()).try_for_each(|view| self.view_block(state, view, &mut system));
        let poses: f64 = system.views.iter().map(|v| v.right.norm_squared()).sum();
        let norm = (system.right.norm_squared() + poses).sqrt();
        self.system = complete.map(|()| system);
        norm
    }

    fn step(&mut self, damping: f64) -> Option<Step> {
        let (normal, right) = self.reduced(damping)?;
        let system = self.system.as_ref()?;
        let inner = -normal.cholesky()?.solve(&right);
        let mut delta: Vec<f64> = inner.iter().copied().collect();
        let weighted = |d: f64, curvature: f64| damping * curvature * d * d;
        let mut predicted = -system.right.dot(&inner);
        predicted +=
            inner.iter().enumerate().map(|(i, &d)| weighted(d, system.normal[(i, i)])).sum::<f64>();
        for block in &system.views {
            let right = block.right + block.cross.tr_mul(&inner);
            let pose = -damped_pose(&block.own, damping).cholesky()?.solve(&right);
            predicted -= block.right.dot(&pose);
            predicted += (0..6).map(|i| weighted(pose[i], block.own[(i, i)])).sum::<f64>();
            delta.extend(pose.iter());
        }
        Some(Step { delta, predicted })
    }

    fn retract(&self, state: &CameraState, delta: &[f64]) -> CameraState {
        let mut next = state.clone();
        let (inner, outer) = delta.split_at(self.free.len());
        self.free.iter().zip(inner).for_each(|(&i, d)| next.intrinsics[i] += d);
        for (pose, d) in next.poses.iter_mut().zip(outer.chunks(6)) {
            pose.translation.vector += Vector3::new(d[0], d[1], d[2]);
            pose.rotation =
                UnitQuaternion::from_scaled_axis(Vector3::new(d[3], d[4], d[5])) * pose.rotation;
        }
        next
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Lens;

    #[test]
    fn jacobians_match_central_differences() {
        let intrinsics = [500.0, 510.0, 320.0, 240.0, -0.2, 0.1, 0.01, -0.02, 0.05];
        let camera = |v: &[f64; 9]| CameraModel {
            size: [640, 480],
            focal: [v[0], v[1]],
            centre: [v[2], v[3]],
            lens: Lens::BrownConrady { k: [v[4], v[5], v[8]], p: [v[6], v[7]] },
        };
        let point = Point3::new(8.0, -5.0, 30.0);
        let jacobian = intrinsic_jacobian(&intrinsics, &point);
        for k in 0..9 {
            let at = |h: f64| {
                let mut moved = intrinsics;
                moved[k] += h;
                camera(&moved).project(&point).unwrap().pixel
            };
            let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((numeric - jacobian.column(k)).norm() < 1e-5, "{}", NAMES[k]);
        }
        let pose = Isometry::new(Vector3::new(1.0, 2.0, 20.0), Vector3::new(0.3, -0.2, 0.1));
        let arm = point.coords - pose.translation.vector;
        let projection = camera(&intrinsics).project(&point).unwrap();
        let jacobian = pose_jacobian(&projection.jacobian, &arm);
        for k in 0..6 {
            let at = |h: f64| {
                let mut d = [0.0; 6];
                d[k] = h;
                let turn = UnitQuaternion::from_scaled_axis(Vector3::new(d[3], d[4], d[5]));
                let shift = pose.translation.vector + Vector3::new(d[0], d[1], d[2]);
                camera(&intrinsics).project(&Point3::from(turn * arm + shift)).unwrap().pixel
            };
            let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((numeric - jacobian.column(k)).norm() < 1e-4, "pose {k}");
        }
    }
}
