//! Sparse Levenberg–Marquardt with a kept symbolic factorisation.

pub mod loss;
pub mod summary;

pub use loss::Loss;
pub use summary::{Stop, Summary, TermCost};
