//! When a surface is believed: one set for single frames and videos.

use super::look::TileLimits;
use crate::options::{OptionError, check, numbers};
use serde::{Deserialize, Serialize};

/// Pairs: beyond the first value (in the direction that is worse) the frame is lost, beyond the
/// second degraded, unless said otherwise. What has a usual value is measured against that of the
/// exploration frames, which the template keeps; `docs/results/verdict.md` says how the rest was
/// chosen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Thresholds {
    /// Fewest distinct matches that the surface explains, where they were found: chance agreements
    /// of unrelated tissue with some pose reach a dozen.
    pub matches: [usize; 2],
    /// The same where they were given: a person or a program stands for them. Below four there is
    /// no pose.
    pub given: [usize; 2],
    /// Least share of found and of given matches that the surface explains; below, degraded. With a
    /// third of given ones at random places the surface is a millimetre off
    /// (`docs/results/verdict.md`).
    pub kept: [f64; 2],
    /// Least share of given rows that are different matches; below, degraded.
    pub distinct: f64,
    /// Largest median residual of found matches, px; above, degraded.
    pub residual_px: f64,
    /// Largest standard deviation of nine visible vertices in ten that the matches leave to the
    /// pose, of the visible radius. Half a radius is no surface.
    pub pose: [f64; 2],
    /// The depth may lie outside that of the exploration by these factors: a laparoscope works from
    /// 3 to 15 cm, so an exploration already holds most of what can be.
    pub depth: [f64; 2],
    /// Least radius of the visible surface in the frame, of its diagonal.
    pub tiny: [f64; 2],
    /// Largest median distance of the matches from a rigid pose, of the frame's width; above,
    /// degraded.
    pub rigid: f64,
    /// Largest uncertainty of the depth, of the visible radius: two and a half times that of a
    /// surface which a rigid pose explains; above, degraded.
    pub depth_uncertainty: f64,
    /// Least share of the textured places that agree with the template (videos).
    pub agreement: [f64; 2],
    /// Correlation from which such a place agrees.
    pub correlation: f64,
    /// Least median correlation of image and prediction, of the usual one.
    pub structure: [f64; 2],
    /// Least strength of the texture, of the usual one; below, degraded. Half is a blur of the
    /// width of the texture, or smoke that takes half of the light.
    pub contrast: f64,
    /// Largest photometric residual, in usual ones; above, degraded: through smoke, out of focus or
    /// beside new glare, shading misleads.
    pub photometric: f64,
    /// Lower bound of the usual residual that the residual of a single frame is divided by (log
    /// brightness): a surface half a millimetre off explains as much.
    pub least_residual: f64,
    /// Least share of the comparable silhouette that shows the organ.
    pub shown: [f64; 2],
    /// Least share of the silhouette that can be compared; below, degraded.
    pub compared: f64,
    /// Largest connected part of the visible area that the image contradicts; above, degraded.
    pub contradicted: f64,
    /// Largest connected part of the visible area that is unobserved; above, degraded.
    pub unobserved: f64,
    /// Largest share of the visible area that is folded over; above, degraded.
    pub folded: f64,
    /// Least and largest exposure gain relative to the template's; outside, degraded.
    pub gain: [f64; 2],
    /// Largest change of length that an edge in twenty exceeds, relative to rest: above the first
    /// degraded, above the second lost.
    pub strain: [f64; 2],
    /// Largest root mean square change of shape from one frame to the next, of the visible radius;
    /// above, degraded.
    pub jump: f64,
    /// A tile shows the template where the logarithms of its brightness and of its red over green
    /// differ by less than these from those of the frame.
    pub tile_log: [f64; 2],
    /// And, where it has texture, with at least this correlation and this strength.
    pub tile_structure: [f64; 2],
    /// Largest difference of the sightlines of two cameras that count as one, of the frame's
    /// diagonal.
    pub camera: f64,
    /// Under the right camera the matches lie nearer to a rigid pose by this factor at least: below
    /// the first the template's camera contradicts the given one, above the second the given one is
    /// confirmed.
    pub camera_fit: [f64; 2],
}

impl Default for Thresholds {
    fn default() -> Self {
        Self {
            matches: [12, 30],
            given: [4, 8],
            kept: [0.5, 0.7],
            distinct: 0.5,
            residual_px: 2.5,
            pose: [0.5, 0.03],
            depth: [5.0, 2.0],
            tiny: [0.015, 0.04],
            rigid: 0.05,
            depth_uncertainty: 0.1,
            agreement: [0.25, 0.5],
            correlation: 0.5,
            structure: [0.3, 0.7],
            contrast: 0.5,
            photometric: 2.5,
            least_residual: 0.02,
            shown: [0.25, 0.75],
            compared: 0.3,
            contradicted: 0.08,
            unobserved: 0.35,
            folded: 0.01,
            gain: [0.2, 5.0],
            strain: [0.2, 0.8],
            jump: 0.15,
            tile_log: [0.45, 0.3],
            tile_structure: [0.4, 0.35],
            camera: 0.003,
            camera_fit: [0.8, 1.1],
        }
    }
}

impl Thresholds {
    /// When a tile shows the template.
    pub(crate) fn tile(&self) -> TileLimits {
        let [correlation, slope] = self.tile_structure;
        TileLimits { log: self.tile_log, correlation, slope }
    }

    /// Check that there are numbers, and the order of every pair.
    ///
    /// # Errors
    /// The first pair that is out of order.
    pub fn validate(&self) -> Result<(), OptionError> {
        let rising = |[a, b]: [f64; 2]| a <= b;
        check(&[
            ("verdict", numbers(self), "numbers; inf or -inf takes a limit away"),
            (
                "verdict.matches, given",
                self.matches[0] <= self.matches[1] && self.given[0] <= self.given[1],
                "two numbers, the second no less than the first",
            ),
            (
                "verdict.agreement, structure, shown, tiny, strain, gain, camera_fit",
                [
                    self.agreement,
                    self.structure,
                    self.shown,
                    self.tiny,
                    self.strain,
                    self.gain,
                    self.camera_fit,
                ]
                .into_iter()
                .all(rising),
                "two numbers, the second no less than the first",
            ),
            (
                "verdict.pose, depth",
                rising([self.pose[1], self.pose[0]]) && rising([self.depth[1], self.depth[0]]),
                "two numbers, the second no more than the first",
            ),
        ])
    }
}
