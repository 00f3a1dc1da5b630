//! Keypoints made for tissue: contrast equalised, low threshold, nothing on highlights or masks.

use super::{SfmOptions, kornia};
use crate::geometry::Point2;
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
    let blocked = (!options.keep_saturated).then(|| saturated(frame, options.saturation_margin_px));
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

/// `true` within `margin` px (square neighbourhood) of a pixel with a channel at 250 or above.
fn saturated(frame: &Frame, margin: usize) -> Mask {
    let bright = frame.rgb.iter().map(|p| p.iter().any(|&v| v >= 250)).collect();
    dilate(&Mask { size: frame.size, data: bright }, margin)
}

/// Grow the `true` area by `margin` px in a square neighbourhood.
pub(super) fn dilate(mask: &Mask, margin: usize) -> Mask {
    let [w, h] = mask.size;
    let near = |i: usize, n: usize| i.saturating_sub(margin)..(i + margin + 1).min(n);
    let mut rows = vec![false; w * h];
    for y in 0..h {
        for x in (0..w).filter(|&x| mask.at(x, y)) {
            rows[y * w..][near(x, w)].fill(true);
        }
    }
    let mut data = vec![false; w * h];
    for y in 0..h {
        for x in (0..w).filter(|&x| rows[y * w + x]) {
            near(y, h).for_each(|v| data[v * w + x] = true);
        }
    }
    Mask { size: mask.size, data }
}

/// The viewport that all frames share: `true` where some frame is brighter than `24 / 255`,
/// shrunk by `margin` px, since the rim gives strong keypoints that move with the camera.
/// `None` when the whole image is lit.
pub fn viewport(frames: &[Frame], margin: usize) -> Option<Mask> {
    const DARK: u8 = 24;
    let size = frames.first()?.size;
    let mut dark = Mask::filled(size, true);
    for frame in frames.iter().filter(|f| f.size == size) {
        for (d, p) in dark.data.iter_mut().zip(&frame.rgb) {
            *d &= p.iter().all(|&v| v < DARK);
        }
    }
    if dark.coverage() < 0.005 {
        return None;
    }
    let mut valid = dilate(&dark, margin);
    valid.data.iter_mut().for_each(|v| *v = !*v);
    Some(valid)
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

    #[test]
    fn dilation_grows_a_square() {
        let mut mask = Mask::filled([7, 5], false);
        mask.data[2 * 7 + 3] = true;
        let grown = dilate(&mask, 1);
        assert_eq!(grown.data.iter().filter(|&&v| v).count(), 9);
        assert!(grown.at(2, 1) && grown.at(4, 3) && !grown.at(5, 2));
    }

    #[test]
    fn the_viewport_is_what_is_ever_lit() {
        let mut rgb = vec![[0, 0, 0]; 20 * 10];
        (0..10).for_each(|y| (0..10).for_each(|x| rgb[y * 20 + x] = [90, 10, 10]));
        let frames = [Frame { name: "a".into(), size: [20, 10], rgb }];
        let view = viewport(&frames, 2).unwrap();
        assert!(view.at(7, 5) && !view.at(8, 5) && !view.at(15, 5));
    }
}
