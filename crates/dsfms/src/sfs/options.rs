//! Options of shape from shading.

use crate::options::{OptionError, check, from_zero, positive};
use serde::{Deserialize, Serialize};

/// Options of [`super::shape_from_shading`]. Other values are not measured: it is here to compare
/// with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SfsOptions {
    /// Nodes of the depth map along the longer side of the organ's bounding box, `8..=200`.
    pub nodes_across: usize,
    /// Noise of the brightness relative to its median.
    pub relative_noise: f64,
    /// Expected curvature of the surface times its distance.
    pub curvature: f64,
    /// Expected deviation of ln depth at the border from the mean.
    pub border_sigma: f64,
    /// Saturated pixels are grown by this, px.
    pub halo_px: f64,
    /// Depth of the bulge it starts from, relative to the distance.
    pub start_bulge: f64,
    /// Most steps of the solver.
    pub max_iterations: usize,
}

impl Default for SfsOptions {
    fn default() -> Self {
        Self {
            nodes_across: 72,
            relative_noise: 0.05,
            curvature: 3.0,
            border_sigma: 0.1,
            halo_px: 12.0,
            start_bulge: 0.1,
            max_iterations: 40,
        }
    }
}

impl SfsOptions {
    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first field out of them.
    pub fn validate(&self) -> Result<(), OptionError> {
        check(&[
            ("sfs.nodes_across", (8..=200).contains(&self.nodes_across), "from 8 to 200"),
            (
                "sfs.relative_noise, curvature, border_sigma",
                positive(&[self.relative_noise, self.curvature, self.border_sigma]),
                "positive",
            ),
            ("sfs.halo_px", from_zero(&[self.halo_px]), "0 or more"),
            ("sfs.start_bulge", (-1.0..1.0).contains(&self.start_bulge), "from -1 to below 1"),
            ("sfs.max_iterations", self.max_iterations >= 1, "at least 1"),
        ])
    }
}
