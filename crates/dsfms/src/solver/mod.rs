//! Sparse Levenberg–Marquardt with a kept symbolic factorisation.
//!
//! [`minimize`] is the loop and knows nothing of meshes; [`NormalEquations`] holds the block-sparse
//! Gauss–Newton system of per-vertex unknowns bordered by a few global ones (gain, ambient, …), and
//! [`cholesky`] is the only place that sees the sparse linear algebra crate.

pub mod cholesky;
pub mod levenberg_marquardt;
pub mod loss;
pub mod normal_equations;
pub mod summary;

pub use levenberg_marquardt::{Options, Problem, Step, minimize};
pub use loss::Loss;
pub use normal_equations::{NormalEquations, Pattern};
pub use summary::{Stop, Summary, TermCost};
