//! Keypoints made for tissue: contrast equalised, low threshold, nothing on highlights or masks.

use super::sift::sift;
use super::{LocalContrast, SfmOptions};
use crate::geometry::Point2;
use crate::image::exposure::saturation;
use crate::image::filter::blur;
use crate::image::{Frame, Mask, Plane, clahe};

/// Keypoints of one frame; all vectors have the same length, but for the descriptors where corners
/// were followed.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Features2d {
    /// Positions, px.
    pub points: Vec<Point2>,
    /// Standard deviation of the Gaussian at which each was found, px.
    pub scale: Vec<f32>,
    /// Dominant gradient direction, radians, clockwise from +x.
    pub angle: Vec<f32>,
    /// RootSIFT (Arandjelović, Zisserman 2012), `round(512·√(h/‖h‖₁))` capped at 255. Corners
    /// followed by optical flow come last and have none.
    #[serde(with = "crate::checkpoint::flat")]
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

/// Standard deviation of a keypoint found at Gaussian scale `scale` px.
pub(super) fn sigma_of_scale(scale: f64) -> f64 {
    let floor = 1.6_f64;
    (scale / floor).max(1.0).sqrt()
}

/// Detect and describe the keypoints of a frame, strongest first, at most `max_features`.
///
/// `mask`: `true` = valid; keypoints outside are dropped. Saturated pixels and their
/// surroundings are left out unless `options.keep_saturated`.
#[doc(alias("SIFT", "keypoints", "descriptors"))]
pub fn detect(frame: &Frame, mask: Option<&Mask>, options: &SfmOptions) -> Features2d {
    let grey = frame.luma();
    let equalised = match options.local_contrast {
        LocalContrast::Always => local_contrast(&grey),
        _ => clahe(&grey, options.clahe_clip, options.clahe_tiles),
    };
    let blocked = highlights(frame, options);
    let usable = |p: &Point2| {
        mask.is_none_or(|m| m.at_pixel(p)) && blocked.as_ref().is_none_or(|m| !m.at_pixel(p))
    };
    let keypoints = sift(&equalised, options.contrast_threshold, options.max_features, &usable);
    Features2d {
        points: keypoints.iter().map(|k| k.point).collect(),
        scale: keypoints.iter().map(|k| k.scale).collect(),
        angle: keypoints.iter().map(|k| k.angle).collect(),
        descriptors: keypoints.iter().map(|k| root_sift(&k.descriptor)).collect(),
    }
}

/// Highlights and their surroundings, which move with the camera; `None` where they may be used.
pub(super) fn highlights(frame: &Frame, options: &SfmOptions) -> Option<Mask> {
    (!options.keep_saturated).then(|| saturation(frame).dilate(options.saturation_margin_px))
}

/// Grey less its mean, over its spread, both of the neighbourhood: in `[0, 1]` about 0.5.
pub(super) fn local_contrast(grey: &Plane) -> Plane {
    /// Standard deviations of the windows of mean and spread, over the image width.
    const WINDOWS: [f64; 2] = [0.01, 0.02];
    /// Spread below which there is nothing but quantisation and noise.
    const FLOOR: f32 = 0.008;
    /// Spread of the result.
    const SPREAD: f32 = 0.16;
    let sigma = WINDOWS.map(|w| w * grey.size[0] as f64);
    let mean = blur(grey, sigma[0]);
    let detail: Vec<f32> = grey.data.iter().zip(&mean.data).map(|(g, m)| g - m).collect();
    let square = detail.iter().map(|d| d * d).collect();
    let spread = blur(&Plane { size: grey.size, data: square }, sigma[1]);
    let value =
        |(d, s): (&f32, &f32)| (0.5 + SPREAD * d / (s.max(0.0).sqrt() + FLOOR)).clamp(0.0, 1.0);
    Plane { size: grey.size, data: detail.iter().zip(&spread.data).map(value).collect() }
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
    fn local_contrast_drops_shading_and_lifts_faint_texture() {
        let value = |i: usize| {
            let (x, y) = ((i % 100) as f32, (i / 100) as f32);
            0.2 + 0.005 * x + 0.02 * (1.5 * x).sin() * (1.4 * y).cos()
        };
        let grey = Plane { size: [100, 80], data: (0..8000).map(value).collect() };
        let out = local_contrast(&grey);
        let inner = |i: &usize| (10..90).contains(&(i % 100)) && (10..70).contains(&(i / 100));
        let row: Vec<f32> = (0..8000).filter(inner).map(|i| out.data[i]).collect();
        let mean = row.iter().sum::<f32>() / row.len() as f32;
        let spread =
            (row.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / row.len() as f32).sqrt();
        assert!((mean - 0.5).abs() < 0.02, "{mean}");
        assert!((0.05..0.2).contains(&spread), "{spread}");
    }

    #[test]
    fn root_sift_is_a_unit_vector_of_512() {
        let descriptor = root_sift(&std::array::from_fn(|i| (i % 7) as f32));
        let norm: f64 = descriptor.iter().map(|&v| (v as f64).powi(2)).sum::<f64>().sqrt();
        assert!((norm - 512.0).abs() < 3.0, "{norm}");
    }
}
