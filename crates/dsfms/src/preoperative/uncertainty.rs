//! What the data leave open of the similarity, and of a target inside.
//!
//! Errors of neighbouring samples go together (the organ has bent, the template is smooth), so
//! samples are no independent witnesses: the template falls into patches, each one witness, and the
//! covariance is the sandwich `H⁻¹ (Σ g gᵀ) H⁻¹` over the scores of the patches (Liang and Zeger
//! 1986). Where those happen to agree by chance, the plain `H⁻¹` counts.

use super::align::{Aligned, AlignmentProblem, NormalMatrix, Schedule, Seven};
use super::options::PreoperativeOptions;
use super::target::{SurfaceSample, Target};
use super::{LandmarkPair, align::PLACES};
use crate::geometry::{Isometry, Point3, Similarity, Vector3};
use crate::structures::{expected_error, patches};

/// Independent places where it is the organ that has bent: its motion is smooth.
const BENT_PLACES: f64 = 8.0;
/// How much of its bending an organ hides from the residual of the best similarity, of what it
/// shows: turn, shift and growth take up the smoothest part. Fitted on synthetic bending
/// (`docs/results/register_ct.md`).
const TAKEN_UP: f64 = 2.0;
/// Patches of the template.
const PATCHES: usize = 24;

/// What is known of a registration's error.
#[derive(Clone, Debug)]
pub struct Uncertainty {
    /// Covariance of turn (rad), shift and growth (of the template's size) about the middle of the
    /// placed template, as the data show it: [turn x, y, z, shift x, y, z, growth], axes of the
    /// preoperative surface.
    pub covariance: [[f64; 7]; 7],
    /// Smallest eigenvalue of the surface's own system, of its mean: 0 where the surface can slide
    /// along itself (a sphere about its centre, a plane), about 0.05 for an organ seen from one
    /// side.
    pub condition: f64,
    /// The motion of that eigenvalue.
    weakest: Seven,
    /// The plain covariance.
    plain: NormalMatrix,
    sandwich: NormalMatrix,
    /// Middle of the placed template and its size, mm.
    middle: Point3,
    size: f64,
}

impl Uncertainty {
    /// Of an alignment.
    pub fn of(
        target: &Target,
        samples: &[SurfaceSample],
        landmarks: &[LandmarkPair],
        aligned: &Aligned,
        noise: f64,
        options: &PreoperativeOptions,
    ) -> Self {
        let schedule = Schedule {
            cut: [aligned.cut; 2],
            landmark_sigma: options.landmark_sigma / aligned.similarity.scaling(),
            scale: options.scale,
            steps: 0,
        };
        let fit = AlignmentProblem::new(target, samples, landmarks, &schedule);
        let sums = Sums::of(&fit, samples, &aligned.similarity);
        let held = options.scale.bounds()[0] == options.scale.bounds()[1];
        let (plain, sandwich) = sums.covariances(held);
        // What is no noise of the template has bent, and few places are independent of each other.
        let noisy = (noise / aligned.sigma.max(f64::MIN_POSITIVE)).powi(2).min(1.0);
        let plain = plain * (noisy + (1.0 - noisy) * PLACES / BENT_PLACES);
        let (condition, weakest) = sums.condition(held);
        let scale = aligned.similarity.scaling();
        let larger = if plain.trace() > sandwich.trace() { plain } else { sandwich };
        Self {
            covariance: std::array::from_fn(|r| std::array::from_fn(|c| larger[(r, c)])),
            condition,
            weakest,
            plain,
            sandwich,
            middle: aligned.similarity * fit.middle,
            size: fit.size * scale,
        }
    }

    /// Expected distance by which the similarity puts a point wrong, mm; `point`: preoperative
    /// frame.
    #[doc(alias = "target registration error")]
    pub fn at(&self, point: &Point3) -> f64 {
        let y = (point - self.middle) / self.size;
        let mut motion = nalgebra::SMatrix::<f64, 3, 7>::zeros();
        motion.fixed_view_mut::<3, 3>(0, 0).copy_from(&-y.cross_matrix());
        motion.fixed_view_mut::<3, 3>(0, 3).fill_with_identity();
        motion.set_column(6, &y);
        let spread = |c: &NormalMatrix| (motion * c * motion.transpose()).trace().max(0.0).sqrt();
        self.size * spread(&self.plain).max(spread(&self.sandwich))
    }

    /// The motion along which the surface slides most easily, in words.
    pub(crate) fn weakest(&self) -> &'static str {
        let part = |k: usize| self.weakest.fixed_rows::<3>(k).norm_squared();
        match [part(0), part(3), self.weakest[6].powi(2)] {
            [turn, shift, growth] if growth >= turn && growth >= shift => "a change of scale",
            [turn, shift, _] if turn >= shift => "a turn",
            _ => "a shift",
        }
    }
}

/// Sums over the samples.
struct Sums {
    /// Of everything, weighted by the loss.
    matrix: NormalMatrix,
    /// Of the samples alone, of unit residuals in sizes, over their weights.
    surface: NormalMatrix,
    meat: NormalMatrix,
    witnesses: f64,
}

impl Sums {
    fn of(fit: &AlignmentProblem, samples: &[SurfaceSample], pose: &Similarity) -> Self {
        let points: Vec<Point3> = samples.iter().map(|s| s.point).collect();
        let groups = patches(&points, PATCHES);
        let rows = fit.rows(pose);
        let [surface_loss, landmark_loss] = fit.losses();
        let [ws, wl] = fit.weights();
        let mut sums = Self {
            matrix: NormalMatrix::zeros(),
            surface: NormalMatrix::zeros(),
            meat: NormalMatrix::zeros(),
            witnesses: 0.0,
        };
        let mut total = 0.0;
        for group in &groups {
            let mut score = Seven::zeros();
            let mut heard = false;
            for row in group.iter().filter_map(|&i| rows[i as usize]) {
                let weight = surface_loss.evaluate(row.residual * row.residual).1;
                score += row.derivative * (ws * weight * row.residual);
                let square = row.derivative * row.derivative.transpose();
                sums.matrix += square * (ws * weight);
                sums.surface += square * (weight / (fit.size * fit.size));
                total += weight;
                heard = true;
            }
            sums.meat += score * score.transpose();
            sums.witnesses += f64::from(heard);
        }
        sums.surface /= total.max(f64::MIN_POSITIVE);
        for (residual, derivatives) in fit.landmark_rows(pose) {
            let weight = wl * landmark_loss.evaluate(residual.norm_squared()).1;
            let mut score = Seven::zeros();
            for k in 0..3 {
                sums.matrix += derivatives[k] * derivatives[k].transpose() * weight;
                score += derivatives[k] * (weight * residual[k]);
            }
            sums.meat += score * score.transpose();
            sums.witnesses += 1.0;
        }
        sums
    }

    /// Plain and sandwich; a scale that is held has none.
    fn covariances(&self, held: bool) -> (NormalMatrix, NormalMatrix) {
        let mut matrix = self.matrix;
        if held {
            matrix.row_mut(6).fill(0.0);
            matrix.column_mut(6).fill(0.0);
        }
        // What is open stays large, not infinite.
        let floor = 1e-9 * matrix.diagonal().max() + f64::MIN_POSITIVE;
        let mut inverse = (matrix + NormalMatrix::from_diagonal_element(floor))
            .try_inverse()
            .unwrap_or_else(|| NormalMatrix::from_diagonal_element(1.0 / floor));
        if held {
            inverse.row_mut(6).fill(0.0);
            inverse.column_mut(6).fill(0.0);
        }
        // Few witnesses know less than their own scatter says.
        let few = self.witnesses / (self.witnesses - 7.0).max(1.0);
        (inverse, inverse * self.meat * inverse * few)
    }

    fn condition(&self, held: bool) -> (f64, Seven) {
        let mut matrix = self.surface;
        if held {
            matrix.row_mut(6).fill(0.0);
            matrix.column_mut(6).fill(0.0);
            matrix[(6, 6)] = 1e9;
        }
        let found = matrix.symmetric_eigen();
        let k = found.eigenvalues.imin();
        (found.eigenvalues[k].max(0.0), found.eigenvectors.column(k).into_owned())
    }
}

/// Expected error of a target, mm: what the similarity leaves open, what it has taken up of the
/// bending, and what the bending does to what lies under the surface ([`expected_error`]).
/// `surface`: residual of the surface, `depth` under it, `half_extent` of the template,
/// `deformation`: residual of the similarity alone beyond noise; all mm.
pub fn expected_target_error(
    similarity: f64,
    surface: f64,
    depth: f64,
    half_extent: f64,
    deformation: f64,
) -> f64 {
    let carried = expected_error(surface, depth, half_extent, deformation);
    similarity.hypot(TAKEN_UP * deformation).hypot(carried)
}

/// Turn and shift from one pose to another, degrees and mm at `point` (template frame).
pub(super) fn difference(a: &Similarity, b: &Similarity, point: &Point3) -> (f64, f64) {
    let turn: Isometry = a.isometry.inverse() * b.isometry;
    let shift: Vector3 = b * point - a * point;
    (turn.rotation.angle().to_degrees(), shift.norm())
}

const _: () = assert!(PLACES > PATCHES as f64);
