//! Options of structure from motion.

use super::intrinsics::RefineIntrinsics;
use super::triangulation::TriangulationLimits;
use crate::options::{OptionError, check, from_zero, positive};
use crate::solver::Loss;
use serde::{Deserialize, Serialize};

/// Loss of the last adjustment.
pub(super) const LAST_LOSS: Loss = Loss::GemanMcClure(1.0);

/// Options of [`reconstruct`](super::reconstruct) and
/// triangulation with known poses. The defaults suit laparoscopic frames of
/// 480 to 1080 rows.
///
/// Measured: `local_contrast` and `flow_below` (`docs/results/template.md`, faint texture), and
/// thresholds of the scores by themselves (`docs/results/choices.md`, template). Other values of
/// the rest are not measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SfmOptions {
    /// Seed of every random draw.
    pub seed: u64,
    /// Intrinsics to refine; none by default (a calibrated camera).
    pub refine: RefineIntrinsics,
    /// Strongest features kept per frame.
    pub max_features: usize,
    /// SIFT contrast threshold; tissue needs far less than the usual 0.04.
    pub contrast_threshold: f64,
    /// Clip limit of the contrast equalisation, in units of the mean histogram bin.
    pub clahe_clip: f64,
    /// Tiles of the contrast equalisation along each side.
    pub clahe_tiles: usize,
    /// Whether local contrast, which keeps faint texture and drops the shading around it, replaces
    /// the equalisation.
    pub local_contrast: LocalContrast,
    /// Keep features on and near saturated pixels (highlights move with the camera).
    pub keep_saturated: bool,
    /// Width of the border around saturated pixels that is left out, px.
    pub saturation_margin_px: f64,
    /// Find the lit viewport of the endoscope and leave out features near its rim.
    pub find_viewport: bool,
    /// Largest ratio of the distances to the nearest and second nearest descriptor, below 1.
    pub ratio: f32,
    /// Largest descriptor distance (unit descriptors, at most √2).
    pub max_distance: f32,
    /// Up to this many frames all pairs are matched, beyond only neighbours and look-alikes.
    pub all_pairs_up_to: usize,
    /// Neighbours matched on either side when there are more frames.
    pub window: usize,
    /// Distant frames matched with each frame then: those that look most like it.
    pub retrieved: usize,
    /// Strongest features compared first to skip unrelated frames.
    pub preview_features: usize,
    /// Matches among these that make the full comparison worth while.
    pub preview_matches: usize,
    /// Fewest agreeing matches of a pair, of a resection and of a first model.
    pub min_matches: usize,
    /// Smallest fraction of a view's known points that must agree with its pose.
    pub min_inlier_fraction: f64,
    /// Largest distance from the epipolar plane, px.
    pub max_epipolar_px: f64,
    /// Largest distance of a sighting from the projection of its point, px.
    pub max_reprojection_px: f64,
    /// Smallest largest angle between the sightlines of a point, degrees.
    pub min_parallax_deg: f64,
    /// Match again along epipolar lines once the poses are known.
    pub guided: bool,
    /// Between neighbouring frames with fewer verified matches than this, corners are followed by
    /// optical flow too; 0 = never. Four times `min_matches` by default: fewer are lost on the way
    /// to a pose.
    pub flow_below: usize,
}

/// When local contrast replaces the equalisation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LocalContrast {
    /// In a second attempt, where the first leaves out frames; the attempt that registers more
    /// stays.
    #[default]
    WhereNeeded,
    /// From the start.
    Always,
    /// Never.
    Never,
}

impl Default for SfmOptions {
    fn default() -> Self {
        Self {
            seed: 0,
            refine: RefineIntrinsics::default(),
            max_features: 4096,
            contrast_threshold: 0.006,
            clahe_clip: 2.0,
            clahe_tiles: 8,
            local_contrast: LocalContrast::WhereNeeded,
            keep_saturated: false,
            saturation_margin_px: 4.0,
            find_viewport: true,
            ratio: 0.85,
            max_distance: 0.8,
            all_pairs_up_to: 30,
            window: 8,
            retrieved: 8,
            preview_features: 512,
            preview_matches: 4,
            min_matches: 16,
            min_inlier_fraction: 0.25,
            max_epipolar_px: 2.0,
            max_reprojection_px: 2.5,
            min_parallax_deg: 1.5,
            guided: true,
            flow_below: 64,
        }
    }
}

impl SfmOptions {
    /// Check every bound; the error names the field.
    ///
    /// # Errors
    /// The first option out of range, by name.
    pub fn validate(&self) -> Result<(), OptionError> {
        check(&[
            ("sfm.max_features", self.max_features >= 100, "at least 100"),
            (
                "sfm.contrast_threshold, saturation_margin_px",
                from_zero(&[self.contrast_threshold, self.saturation_margin_px]),
                "0 or more",
            ),
            ("sfm.clahe_clip", positive(&[self.clahe_clip]), "positive"),
            ("sfm.clahe_tiles", self.clahe_tiles >= 1, "at least 1"),
            ("sfm.ratio", self.ratio > 0.0 && self.ratio < 1.0, "between 0 and 1"),
            ("sfm.max_distance", positive(&[self.max_distance.into()]), "positive"),
            ("sfm.min_matches", self.min_matches >= 8, "at least 8"),
            (
                "sfm.min_inlier_fraction",
                (0.0..=1.0).contains(&self.min_inlier_fraction),
                "from 0 to 1",
            ),
            (
                "sfm.max_epipolar_px, max_reprojection_px, min_parallax_deg",
                positive(&[self.max_epipolar_px, self.max_reprojection_px, self.min_parallax_deg]),
                "positive",
            ),
        ])
    }

    /// By which features of a single frame are found and compared with those of a template: always
    /// the defaults, since a template does not say by which its own were found, and other frames of
    /// it must give the same matches.
    pub(crate) fn of_frames() -> Self {
        Self::default()
    }

    /// Limits of an acceptable point.
    pub(super) fn limits(&self) -> TriangulationLimits {
        TriangulationLimits {
            max_error_px: self.max_reprojection_px,
            min_parallax_deg: self.min_parallax_deg,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bad_option_is_named() {
        assert!(SfmOptions::default().validate().is_ok());
        let options = SfmOptions { ratio: 1.5, ..Default::default() };
        assert!(options.validate().unwrap_err().to_string().contains("ratio"));
    }
}
