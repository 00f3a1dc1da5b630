//! What is estimated.

use serde::{Deserialize, Serialize};

/// What is estimated.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CalibrateOptions {
    /// Estimate k3 too; it needs corners out to the rim of the image.
    pub third_radial: bool,
    /// Estimate p1 and p2.
    pub tangential: bool,
    /// Accept boards of which a part is hidden or outside the image, from 4x4 corners on.
    pub partial: bool,
}

impl Default for CalibrateOptions {
    fn default() -> Self {
        Self { third_radial: false, tangential: true, partial: false }
    }
}
