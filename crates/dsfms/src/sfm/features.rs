//! Keypoints made for tissue: contrast equalised, low threshold, nothing on highlights or masks.

use super::{SfmOptions, kornia};
use crate::geometry::Point2;
use crate::image::exposure::saturation;
use crate::image::{Frame, Mask};

/// Keypoints of one frame; all vectors have the same length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Features2d {
    /// Positions, px.
    pub points: Vec<Point2>,
    /// Standard deviation of the Gaussian at which each was found, px.
    pub scale: Vec<f32>,
    /// Dominant gradient direction, radians, clockwise from +x.
    pub angle: Vec<f32>,
    /// RootSIFT (Arandjelović, Zisserman 2012), `round(512·√(h/‖h‖₁))` capped at 255.
    pub descriptors: Vec<[u8; 128]>,
}

impl Features2d {
    /// Number of keypoints.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }
}

/// Detect and describe the keypoints of a frame, strongest first, at most `max_features`.
///
/// `mask`: `true` = valid; keypoints outside are dropped. Saturated pixels and their
/// surroundings are left out unless `options.keep_saturated`.
pub fn detect(frame: &Frame, mask: Option<&Mask>, options: &SfmOptions) -> Features2d {
    let grey = frame.luma();
    let equalised = kornia::equalise(&grey, options.clahe_clip, options.clahe_tiles);
    let blocked =
        (!options.keep_saturated).then(|| saturation(frame).dilate(options.saturation_margin_px));
    let mut keypoints = kornia::sift(&equalised, options.contrast_threshold);
    keypoints.retain(|k| {
        mask.is_none_or(|m| m.at_pixel(&k.point))
            && blocked.as_ref().is_none_or(|m| !m.at_pixel(&k.point))
    });
    // Stable: equal responses keep the detector's order.
    keypoints.sort_by(|a, b| b.response.total_cmp(&a.response));
    keypoints.truncate(options.max_features);
    Features2d {
        points: keypoints.iter().map(|k| k.point).collect(),
        scale: keypoints.iter().map(|k| k.scale).collect(),
        angle: keypoints.iter().map(|k| k.angle).collect(),
        descriptors: keypoints.iter().map(|k| root_sift(&k.descriptor)).collect(),
    }
}

/// RootSIFT as bytes: Euclidean distances between these are Hellinger distances of histograms.
fn root_sift(histogram: &[f32; 128]) -> [u8; 128] {
    let total: f32 = histogram.iter().sum::<f32>().max(f32::MIN_POSITIVE);
    histogram.map(|v| (512.0 * (v / total).sqrt()).round().min(255.0) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn root_sift_is_a_unit_vector_of_512() {
        let descriptor = root_sift(&std::array::from_fn(|i| (i % 7) as f32));
        let norm: f64 = descriptor.iter().map(|&v| (v as f64).powi(2)).sum::<f64>().sqrt();
        assert!((norm - 512.0).abs() < 3.0, "{norm}");
    }
}
