//! Sparse Levenberg–Marquardt with a kept symbolic factorisation.
//!
//! [`minimize`] is the loop and knows nothing of meshes; [`NormalEquations`] holds the block-sparse
//! Gauss–Newton system of per-vertex unknowns bordered by a few global ones (gain, ambient, …), and
//! [`cholesky`] and `ordering` are the only places that see the sparse linear algebra crate.

pub mod cholesky;
mod direct;
mod iterative;
pub mod levenberg_marquardt;
pub mod loss;
pub mod normal_equations;
mod ordering;
mod panels;
pub mod pattern;
pub mod scalar;
pub mod summary;

pub use levenberg_marquardt::{Options, Problem, Step, minimize};
pub use loss::Loss;
pub use normal_equations::NormalEquations;
pub use pattern::Pattern;
pub use scalar::ScalarCholesky;
pub use summary::{Stop, Summary, TermCost};
