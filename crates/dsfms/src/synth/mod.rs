//! The synthetic protocol of the paper (§8.1): deformation by attraction points, z-buffer
//! rendering with self-occlusion and texture, sparse correspondences that avoid the deformed zone.
//! Beside it clips to track and pictures of a chessboard to calibrate with.

pub mod case;
pub mod chessboard;
pub mod clip;
pub mod correspond;
pub mod deform;
pub mod part;
pub mod patch;
pub mod protocol;
pub mod random;
pub mod render;
mod sensor;
mod shadow;

pub use case::{Admitted, Case, CaseOptions};
pub use chessboard::{Chessboard, ChessboardError, ChessboardOptions};
pub use clip::{Clip, ClipOptions};
pub use correspond::{Draw, correspond};
pub use deform::{Attraction, Deformation, ExtensionOf, deform, deform_to};
pub use part::part;
pub use patch::{Patch, patch, textured};
pub use protocol::{Cell, LightKind, Protocol};
pub use random::Random;
pub use render::{Gloss, RenderOptions, render};
