//! Rigid structure from motion (paper §4): from exploration frames and intrinsics to camera poses
//! and sparse points.
//!
//! ```text
//! detect ─► verify pairs (─► optical flow) ─► tracks ─► grow (pair, resection, triangulation, adjustment)
//!        ─► guided matching along epipolar lines ─► final bundle adjustment
//! ```
//!
//! Sightlines, not pixels, carry the two-view geometry, so pinhole and fisheye cameras are treated
//! alike. Every loop runs in a fixed order with seeded draws: the same frames and options give the
//! same bits at any number of threads.

pub mod bundle;
mod collect;
mod error;
pub mod essential;
pub mod features;
mod five_point;
mod followed;
mod frames;
pub mod guided;
mod incremental;
pub mod intrinsics;
mod kept;
mod known;
mod magsac;
mod map;
pub mod matching;
pub mod options;
pub mod places;
pub mod random;
mod reconstruct;
pub mod reconstruction;
mod rematch;
pub mod resection;
mod schur;
mod sift;
pub mod tracks;
pub mod triangulation;
pub mod two_view;

pub use bundle::Covariance;
pub use error::SfmError;
pub use features::{Features2d, detect};
pub(crate) use frames::check_sizes;
pub use frames::{SfmProgress, SfmStage};
pub use intrinsics::RefineIntrinsics;
pub(crate) use known::triangulate_known;
pub use matching::{DescriptorMatch, match_descriptors};
pub use options::{LocalContrast, SfmOptions};
pub use reconstruct::reconstruct;
pub(crate) use reconstruct::reconstruct_kept;
pub use reconstruction::{FoundModel, NoPose, ScenePoint, SparseReconstruction, TrackedPixel};
pub(crate) use resection::error_px;
pub use resection::{Resection, refine_pose, resect};
