//! Options of multi-view stereo.

use crate::options::{OptionError, check, positive};
use serde::{Deserialize, Serialize};

/// How depth is estimated and fused.
///
/// Measured: `target_vertices` (`docs/results/template.md`). Other values of the rest are not
/// measured beside one another; what the defaults reach is in the same page.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DenseOptions {
    /// Bound on the depth pixels of all frames together; frames are scaled down to keep it. Sets
    /// time and memory: about 60 µs and 200 bytes a pixel on one core.
    pub max_pixels: usize,
    /// Frames that get a depth map, at most: of more, those that lie farthest apart.
    pub max_frames: usize,
    /// Frames each frame is compared with, at most (2 to 16).
    pub max_sources: usize,
    /// Of these, the best that count at a pixel: the others may be occluded or see a highlight.
    pub best_sources: usize,
    /// Smallest mean angle between two sightlines of a compared pair, degrees.
    pub min_parallax_deg: f64,
    /// Largest such angle, degrees: beyond it foreshortening and shading differ too much.
    pub max_parallax_deg: f64,
    /// PatchMatch iterations at an eighth, a quarter and a half of the working resolution.
    pub iterations: [usize; 3],
    /// Smallest mean correlation of a trusted pixel, `[0, 1]`.
    pub min_correlation: f64,
    /// Largest relative difference of depth between two frames that agree.
    pub max_relative_depth: f64,
    /// Largest distance after projection into another frame and back, px of the depth grid.
    pub max_reprojection_px: f64,
    /// Frames that must agree with a pixel.
    pub min_consistent: usize,
    /// Standard deviation of the encoded image, `[0, 1]`: quantisation, noise and compression.
    pub image_noise: f64,
    /// How far depth is filled in from trusted neighbours, px of the depth grid; 0 = not at all.
    pub fill_px: usize,
    /// Vertices of the surface, about; they set the edge of the grid of signed distances. Where
    /// they are not set: 60,000; for a template thirty for each of its vertices, at least 15,000
    /// and no more than that.
    pub target_vertices: Option<usize>,
    /// Edge of that grid, length units; overrides `target_vertices`.
    pub voxel: Option<f64>,
    /// Stiffness of the field of signed distances: what is trusted with `c` is smoothed over about
    /// `2π (smoothness / c)^¼` edges of the grid.
    pub smoothness: f64,
    /// Trust (sum over frames of `confidence`) a piece of surface needs, for every frame there is:
    /// the more frames, the more of them agree by chance.
    pub min_support: f64,
    /// Holes with at most this many edges are closed.
    pub max_hole_edges: usize,
    /// Rounds of volume-preserving (Taubin) smoothing of the surface: 40 pass waves longer than
    /// about 18 edges, and no shorter ones: a template of a thirtieth of the vertices has edges of
    /// 5.
    pub smoothing: usize,
    /// Keep only the largest connected piece.
    pub largest_only: bool,
    /// At the rim, frames do not vouch for surface that faces away from them or lies behind the
    /// surface itself (by 8 % of the depth or more): folds and tongues that no frame can have seen
    /// are peeled.
    pub peel_hidden: bool,
    /// Seed of the random search; the same seed gives the same bits.
    pub seed: u64,
}

/// Vertices of a surface for which nothing else is said.
pub(super) const MOST_VERTICES: usize = 60_000;
/// And of one that becomes a template: for each of its vertices, and at least.
const FINER: usize = 30;
const LEAST_VERTICES: usize = 15_000;

impl DenseOptions {
    /// For a surface that becomes a template of so many vertices, where nothing else is said.
    pub fn for_template(&self, vertices: usize) -> Self {
        let usual = vertices.saturating_mul(FINER).clamp(LEAST_VERTICES, MOST_VERTICES);
        Self { target_vertices: self.target_vertices.or(Some(usual)), ..self.clone() }
    }
}

impl Default for DenseOptions {
    fn default() -> Self {
        Self {
            max_pixels: 3_000_000,
            max_frames: 30,
            max_sources: 16,
            best_sources: 3,
            min_parallax_deg: 2.0,
            max_parallax_deg: 60.0,
            iterations: [6, 3, 1],
            min_correlation: 0.5,
            max_relative_depth: 0.01,
            max_reprojection_px: 1.0,
            min_consistent: 1,
            image_noise: 0.004,
            fill_px: 12,
            target_vertices: None,
            voxel: None,
            smoothness: 1.0,
            min_support: 0.003,
            max_hole_edges: 250,
            smoothing: 40,
            largest_only: true,
            peel_hidden: false,
            seed: 0,
        }
    }
}

impl DenseOptions {
    /// Check every field against its bounds.
    ///
    /// # Errors
    /// The first option out of range, by name.
    pub fn validate(&self) -> Result<(), OptionError> {
        let parallax =
            self.max_parallax_deg > self.min_parallax_deg && self.max_parallax_deg < 90.0;
        check(&[
            ("dense.max_frames", self.max_frames >= 2, "at least 2"),
            ("dense.max_pixels", self.max_pixels >= 1000, "at least 1000"),
            ("dense.max_sources", (1..=16).contains(&self.max_sources), "from 1 to 16"),
            ("dense.best_sources", self.best_sources >= 1, "at least 1"),
            ("dense.min_parallax_deg", positive(&[self.min_parallax_deg]), "positive"),
            ("dense.max_parallax_deg", parallax, "above min_parallax_deg and below 90"),
            ("dense.min_correlation", (0.0..=1.0).contains(&self.min_correlation), "from 0 to 1"),
            (
                "dense.max_relative_depth, max_reprojection_px, image_noise",
                positive(&[self.max_relative_depth, self.max_reprojection_px, self.image_noise]),
                "positive",
            ),
            (
                "dense.target_vertices",
                self.target_vertices.is_none_or(|n| n >= 100),
                "at least 100",
            ),
            ("dense.voxel", self.voxel.is_none_or(|voxel| positive(&[voxel])), "positive"),
            (
                "dense.smoothness, min_support",
                positive(&[self.smoothness, self.min_support]),
                "positive",
            ),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surface_is_finer_than_its_template_unless_it_is_said_otherwise() {
        let usual = DenseOptions::default();
        let target = |vertices| usual.for_template(vertices).target_vertices;
        assert_eq!([300, 1000, 5000].map(target), [15_000, 30_000, 60_000].map(Some));
        let own = DenseOptions { target_vertices: Some(7000), ..usual.clone() };
        assert_eq!(own.for_template(1000), own);
    }

    #[test]
    fn names_the_field_out_of_bounds() {
        assert_eq!(DenseOptions::default().validate(), Ok(()));
        let few = DenseOptions { target_vertices: Some(99), ..Default::default() };
        assert!(few.validate().is_err());
        let bad = DenseOptions { max_parallax_deg: f64::NAN, ..Default::default() };
        assert_eq!(bad.validate().unwrap_err().field, "dense.max_parallax_deg");
    }
}
