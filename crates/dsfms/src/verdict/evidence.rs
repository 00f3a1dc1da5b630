//! What the stages found out about one surface.

use super::observability::PoseUncertainty;
use super::reason::Part;
use crate::template::usual::Appearance;
use serde::Serialize;

/// Matches of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct MatchCount {
    /// All.
    pub total: usize,
    /// Those that the surface explains.
    pub kept: usize,
    /// Different places among all.
    pub distinct: usize,
    /// Different places among the kept.
    pub distinct_kept: usize,
    /// They were given, not found.
    pub given: bool,
}

/// Everything that [`super::judge`] asks; `None` where it is not known.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evidence {
    /// All coordinates are finite.
    pub finite: bool,
    /// Number of vertices that are seen.
    pub visible: usize,
    /// Visible radius, length units.
    pub radius: f64,
    /// The matches.
    pub matches: MatchCount,
    /// Median distance of the kept matches from the surface, px.
    pub residual_px: Option<f64>,
    /// Distance of the surface's contour from the organ's outline, px, that nine tenths of it do
    /// not exceed; where an outline is known.
    pub outline_px: Option<f64>,
    /// Median distance of the matches from the rigid pose, px, and the frame's width.
    pub rigid_px: Option<[f64; 2]>,
    /// What the matches leave to the pose.
    pub pose: Option<PoseUncertainty>,
    /// Median depth of what is seen, and least and largest of the exploration.
    pub depth: Option<(f64, [f64; 2])>,
    /// Radius of the visible surface in the frame, px, and the frame's diagonal.
    pub extent_px: Option<[f64; 2]>,
    /// How far depth is uncertain for the solve of eq. 3, of the visible radius.
    pub depth_uncertainty: Option<f64>,
    /// Where the camera is not the template's: how far apart they are, px, and the median distance
    /// of the matches from the rigid pose under the given one and under the template's, px.
    pub camera: Option<(f64, [f64; 2])>,
    /// Textured places that agree, and those that could be compared (videos).
    pub places: Option<[usize; 2]>,
    /// Image beside prediction.
    pub appearance: Option<Appearance>,
    /// That of the exploration frames.
    pub usual: Appearance,
    /// The template has an albedo, and nothing of the image could be compared with it.
    pub uncompared: bool,
    /// Photometric residual of the solve over that of the good frames before (videos).
    pub photometric: Option<f64>,
    /// Shading was asked for and nothing could be used for it.
    pub no_shading: bool,
    /// Exposure gain, where it was solved for.
    pub gain: Option<f64>,
    /// Largest connected part that the image contradicts.
    pub contradicted: Option<Part>,
    /// Largest connected part that is unobserved.
    pub unobserved: Option<Part>,
    /// Faces that are folded over, and their share of the visible area.
    pub folded: Option<(usize, f64)>,
    /// Change of length that one edge in twenty exceeds.
    pub strain: Option<f64>,
    /// Change of shape since the previous frame, of the radius.
    pub jump: Option<f64>,
}

/// What an exploration looks like beside its own template where the template does not say:
/// synthetic cases that are shaded as predicted have a correlation of 0.97 and a residual of 0.03.
pub const EXPECTED: Appearance = Appearance {
    correlation: Some(0.9),
    contrast: Some(1.0),
    residual: 0.05,
    shown: 0.95,
    compared: 0.8,
};

/// Nothing measured: what is unknown speaks neither for nor against a surface.
impl Default for Evidence {
    fn default() -> Self {
        Self {
            finite: true,
            visible: 1,
            radius: 1.0,
            matches: MatchCount::default(),
            residual_px: None,
            outline_px: None,
            rigid_px: None,
            pose: None,
            depth: None,
            extent_px: None,
            depth_uncertainty: None,
            camera: None,
            places: None,
            appearance: None,
            usual: EXPECTED,
            uncompared: false,
            photometric: None,
            no_shading: false,
            gain: None,
            contradicted: None,
            unobserved: None,
            folded: None,
            strain: None,
            jump: None,
        }
    }
}
