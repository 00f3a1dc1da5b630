//! Images as another camera at the same place would have taken them: no point of the scene has to
//! be known, as the sightlines stay.

use super::{Camera, CameraModel};
use crate::geometry::Point2;
use crate::image::{Bilinear, Frame, Mask};
use rayon::prelude::*;

/// A frame of `from` as `to` would have taken it (encoded values, the mean over each pixel's
/// footprint), and where `from` shows anything; black elsewhere.
pub fn resampled(frame: &Frame, from: &CameraModel, to: &CameraModel) -> (Frame, Mask) {
    let finer = (0..2).map(|k| from.focal[k] / to.focal[k]).fold(1.0, f64::max);
    let taps = (finer.ceil() as usize).clamp(1, 8);
    let pixel = |i: usize| -> Option<[u8; 3]> {
        let mut sum = [0.0; 3];
        for tap in 0..taps * taps {
            let offset = |k: usize| (k as f64 + 0.5) / taps as f64 - 0.5;
            let [x, y] = [(i % to.size[0]) as f64, (i / to.size[0]) as f64];
            let at = Point2::new(x + offset(tap % taps), y + offset(tap / taps));
            let rgb = Bilinear::at(&moved(&at, from, to)?, frame.size)?.colour(|i| frame.rgb[i]);
            (0..3).for_each(|c| sum[c] += rgb[c]);
        }
        Some(sum.map(|v| (v / (taps * taps) as f64).round() as u8))
    };
    let count = to.size[0] * to.size[1];
    let found: Vec<Option<[u8; 3]>> = (0..count).into_par_iter().map(pixel).collect();
    let shown = Mask { size: to.size, data: found.iter().map(Option::is_some).collect() };
    let rgb = found.into_iter().map(Option::unwrap_or_default).collect();
    (Frame { name: frame.name.clone(), size: to.size, rgb }, shown)
}

/// A mask of `from` as `to` would have it; `false` where `from` shows nothing.
pub fn resampled_mask(mask: &Mask, from: &CameraModel, to: &CameraModel) -> Mask {
    let value = |i: usize| {
        let at = Point2::new((i % to.size[0]) as f64, (i / to.size[0]) as f64);
        moved(&at, from, to).is_some_and(|p| mask.at_pixel(&p))
    };
    let data = (0..to.size[0] * to.size[1]).into_par_iter().map(value).collect();
    Mask { size: to.size, data }
}

/// Where `from` sees what `to`, at the same place, sees at a pixel.
pub(crate) fn moved(at: &Point2, from: &CameraModel, to: &CameraModel) -> Option<Point2> {
    Some(from.project(&to.unproject(at)?.into())?.pixel)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Lens;

    fn camera(size: [usize; 2], focal: f64, lens: Lens) -> CameraModel {
        let centre = size.map(|n| 0.5 * n as f64 - 0.5);
        CameraModel { size, focal: [focal; 2], centre, lens }
    }

    /// Brightness linear in the sightline's slope.
    fn taken(camera: &CameraModel) -> Frame {
        let [w, h] = camera.size;
        let rgb = (0..w * h)
            .map(|i| {
                let ray = camera.unproject(&Point2::new((i % w) as f64, (i / w) as f64)).unwrap();
                let value = |t: f64| (128.0 + 200.0 * t).round().clamp(0.0, 255.0) as u8;
                [value(ray.x / ray.z), value(ray.y / ray.z), 77]
            })
            .collect();
        Frame { name: "f".into(), size: camera.size, rgb }
    }

    #[test]
    fn a_zoomed_and_distorted_frame_is_what_the_other_camera_takes() {
        let lens = Lens::BrownConrady { k: [-0.1, 0.0, 0.0], p: [0.0; 2] };
        let (from, to) = (camera([90, 70], 150.0, lens), camera([60, 50], 60.0, Lens::Pinhole));
        let (found, shown) = resampled(&taken(&from), &from, &to);
        let expected = taken(&to);
        assert_eq!((found.size, found.name.as_str()), ([60, 50], "f"));
        for (i, (a, b)) in found.rgb.iter().zip(&expected.rgb).enumerate() {
            if shown.data[i] {
                assert!((0..3).all(|c| a[c].abs_diff(b[c]) <= 2), "{i}: {a:?} {b:?}");
            } else {
                assert_eq!(*a, [0; 3]);
            }
        }
        // A focal length 2.5 times as long and a frame 1.5 times as wide: about 0.6 of the width.
        let row = &shown.data[25 * 60..26 * 60];
        let width = row.iter().filter(|s| **s).count();
        assert!((33..40).contains(&width), "{width}");
        let mut mask = Mask::filled([90, 70], true);
        (0..70).for_each(|y| (0..45).for_each(|x| mask.data[y * 90 + x] = false));
        let half = resampled_mask(&mask, &from, &to);
        assert!(!half.at(28, 25) && half.at(31, 25) && !half.at(2, 25));
    }
}
