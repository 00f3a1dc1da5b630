//! Why an experiment cannot be run.

use std::path::PathBuf;

/// Why an experiment cannot be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExperimentError {
    /// The results on disk belong to another experiment.
    #[error(
        "{} was made with another {}; choose another folder, or drop its results",
        path.display(), differing.join(", ")
    )]
    OtherParameters {
        /// The file of results.
        path: PathBuf,
        /// The parameters that differ.
        differing: Vec<String>,
    },
    /// A file of results that this program did not write.
    #[error("{} line {line}: {problem}; choose another folder, or drop it", path.display())]
    Results {
        /// The file.
        path: PathBuf,
        /// 1-based line.
        line: usize,
        /// What is wrong with it.
        problem: String,
    },
    /// The operating system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        #[source]
        source: std::io::Error,
    },
    /// The worker threads did not start.
    #[error("cannot start the worker threads: {0}")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// An organ that gives no part to deform.
    #[error("organ {name}: {problem}")]
    Organ {
        /// Its name or file.
        name: String,
        /// What is wrong with it.
        problem: String,
    },
}

impl ExperimentError {
    pub(super) fn io(path: &std::path::Path, source: std::io::Error) -> Self {
        Self::Io { path: path.into(), source }
    }
}
