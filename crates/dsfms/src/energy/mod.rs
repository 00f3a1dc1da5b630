//! Energy terms of eqs. 3 and 4, one file per term, and the objective that sums them.
//!
//! A term is a family of residual blocks; it sees only the vertices it declares, so the sparsity
//! pattern cannot be wrong and is factorised symbolically once. A new term is one new file.

pub mod anchor;
pub mod anisotropy;
pub mod arap;
pub mod boundary;
pub mod check;
pub mod diffuse;
pub mod face;
pub mod globals;
pub mod isometric;
pub mod motion;
pub mod objective;
pub mod photometric;
pub mod reprojection;
pub mod ring;
pub mod shearing;
pub mod silhouette;
pub mod smoothing;
pub mod specular;
pub mod stretch;

use crate::geometry::Point3;
pub use anchor::AnchorPrior;
pub use anisotropy::Anisotropy;
pub use arap::Arap;
pub use boundary::Boundary;
pub use diffuse::Diffuse;
pub use face::{FaceTerm, RestFaces};
pub use globals::GlobalsPrior;
pub use isometric::Isometric;
pub use motion::Motion;
use nalgebra::{SMatrix, SVector};
pub use objective::{Objective, Unknowns, Workspace};
pub use photometric::{FaceRings, Lift, Photometric};
pub use reprojection::Reprojection;
pub use shearing::Shearing;
pub use silhouette::{ContourPoint, Silhouette};
pub use smoothing::Smoothing;
pub use specular::Specular;
pub use stretch::Stretch;

/// What the channels of an image say of a surface point, as one weighted sum of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brightness {
    /// Weights `w` of red, green and blue; not all positive where white glare has to cancel.
    pub weights: [f64; 3],
    /// The sum `w·α` over the linear albedo, smoothed like the image.
    pub albedo: f64,
    /// What the smoothing adds to the shading `s`, which varies within it:
    /// `s₀ = smooth(α s) / smooth(α) − s` at the shape that the sample was read at, in units of
    /// `s`; 0 where shading is taken at the point.
    pub added_shade: f64,
    /// The sum `w·1` over white light.
    pub white: f64,
    /// Noise of the prediction of `w·I`, linear light.
    pub sigma: f64,
}

/// A residual has no value here (a point behind the camera, a collapsed face): the trial step
/// fails. Treating it as zero would let the cost fall by failing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Infeasible;

/// Where a term writes the derivatives of one block.
pub struct Jacobian<'a, const R: usize> {
    /// `∂r/∂vₖ` for every vertex of the stencil.
    pub vertices: &'a mut [SMatrix<f64, R, 3>],
    /// `∂r/∂gₖ` for every global of the term.
    pub globals: &'a mut [SVector<f64, R>],
}

/// A family of residual blocks `rᵢ : (ℝ³)ᵏ × ℝᵐ → ℝᴿ`, one per correspondence, face or vertex.
pub trait EnergyTerm<const R: usize>: Send + Sync {
    /// Number of blocks in `Σᵢ wᵢ ρ(‖rᵢ‖²)`.
    fn count(&self) -> usize;

    /// The vertices block `i` reads: a face, a one-ring; fixed for the life of the term.
    fn stencil(&self, i: usize) -> &[u32];

    /// The global unknowns (gain, ambient, …) block `i` reads, no two the same.
    fn globals(&self, _i: usize) -> &[usize] {
        &[]
    }

    /// Weight `wᵢ` of a block, outside the loss.
    fn weight(&self, _i: usize) -> f64 {
        1.0
    }

    /// The weights `wₖ` of a block that is linear and the same in every direction,
    /// `r = Σ wₖ vₖ − constant` with `R = 3`; `None` for the blocks of every other term. Least
    /// squares of such a term have a constant matrix, which is summed once.
    fn isotropic(&self, _i: usize) -> Option<&[f64]> {
        None
    }

    /// `rᵢ` at the gathered stencil `v` and globals `g`; and its derivatives, when asked for.
    /// The Jacobian arrives zeroed.
    fn residual(
        &self,
        i: usize,
        v: &[Point3],
        g: &[f64],
        jacobian: Option<Jacobian<'_, R>>,
    ) -> Result<SVector<f64, R>, Infeasible>;
}
