//! What the template's own exploration frames look like beside it: the measure for other frames.

use serde::{Deserialize, Serialize};

/// How a frame looks beside what template and light predict.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Appearance {
    /// Median zero-mean correlation of image and prediction over the textured tiles, in `[-1, 1]`;
    /// `None` where nothing has texture.
    pub correlation: Option<f64>,
    /// Median slope of image on prediction there, of logarithms: 1 where the texture is as strong
    /// as predicted, less through blur, smoke and what covers it.
    pub contrast: Option<f64>,
    /// Robust spread of the log ratio of image to prediction over the tiles.
    pub residual: f64,
    /// Share of what can be compared that looks like the template, in `[0, 1]`.
    pub shown: f64,
    /// Share of the predicted silhouette that can be compared.
    pub compared: f64,
}

/// The exploration frames beside the template that was made from them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Usual {
    /// Frames that were looked at.
    pub frames: usize,
    /// Medians over the frames.
    pub appearance: Appearance,
    /// Least and largest median depth of the visible surface, length units.
    pub depth: [f64; 2],
}

/// Frames that correlate less with a given surface were posed wrongly, or show something else.
/// Rendered frames, mesh and poses given: 0.99; poses 3 mm beside: 0.67; with transposed rotations:
/// 0.34. A real gallbladder, all found: 0.85.
const LEAST_ALIKE: f64 = 0.75;

impl Usual {
    /// The correlation of the exploration frames with a given surface, where it is too low for the
    /// surface to lie where the poses say.
    pub fn unlike(&self) -> Option<f64> {
        self.appearance.correlation.filter(|&correlation| correlation < LEAST_ALIKE)
    }

    /// All figures are finite, and those that others are measured by are positive.
    pub(crate) fn is_plausible(&self) -> bool {
        let Appearance { correlation, contrast, residual, shown, compared } = self.appearance;
        let [near, far] = self.depth;
        let positive = |x: f64| x.is_finite() && x > 0.0;
        correlation.is_none_or(f64::is_finite)
            && contrast.is_none_or(f64::is_finite)
            && [shown, compared].iter().all(|x| (0.0..=1.0).contains(x))
            && [residual, near, far].into_iter().all(positive)
            && near <= far
    }
}
