//! The paper's experiment (§8.1): many synthetic cases, every method on each, tables and plots.
//!
//! A [`Plan`] says what is run; [`run`] works through its cases on all cores, appends every
//! finished case to a file and goes on from that file after an interruption; [`summarise`] turns
//! the records into the rows of a table. Errors are absolute: nothing is aligned.

pub mod ablation;
mod error;
mod measure;
mod organ;
mod plan;
mod record;
mod report;
mod run;
mod summary;

pub use error::ExperimentError;
pub use measure::{Errors, measure, observation, surface};
pub use organ::SeriesOrgan;
pub use plan::{Arm, Plan, arms_of};
pub use record::Record;
pub use report::{Metric, markdown, table_csv, times_csv};
pub use run::run;
pub use summary::{Row, Spread, summarise};
