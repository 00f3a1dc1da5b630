//! Sparse Levenberg–Marquardt with a kept symbolic factorisation.
//!
//! [`minimize`] is the only loop and knows nothing of what it minimises (meshes, bundles, cameras,
//! lights); `minimize_few` takes a small problem as functions, `conjugate_gradients` is the
//! iterative solver of large linear systems, `Anderson` shortens a fixed-point iteration.
//! [`NormalEquations`] holds the block-sparse Gauss–Newton system of per-vertex unknowns bordered
//! by a few global ones (gain, ambient, …), and [`cholesky`], `scalar` and `ordering` are the only
//! places of it that see the crate of sparse linear algebra.

mod anderson;
pub mod cholesky;
pub(crate) mod conjugate_gradients;
mod direct;
mod few;
mod iterative;
pub mod levenberg_marquardt;
mod matrix;
pub mod normal_equations;
mod ordering;
mod panels;
pub mod pattern;
pub mod scalar;
pub mod summary;

pub use crate::geometry::Loss;
pub(crate) use anderson::Anderson;
pub(crate) use few::minimize_few;
pub use levenberg_marquardt::{Options, Problem, Step, minimize};
pub use normal_equations::NormalEquations;
pub use pattern::Pattern;
pub use scalar::{ScalarCholesky, ScalarPattern};
pub use summary::{Stop, Summary, TermCost};
