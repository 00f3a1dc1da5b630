//! Images as another camera at the same place would have taken them: no point of the scene has to be
//! known, as the sightlines stay.

use super::{Camera, CameraModel};
use crate::geometry::Point2;
use crate::image::{Frame, Mask};
use rayon::prelude::*;

/// A frame of `from` as `to` would have taken it (encoded values, the mean over each pixel's footprint),
/// and where `from` shows anything; black elsewhere.
pub fn resampled(frame: &Frame, from: &CameraModel, to: &CameraModel) -> (Frame, Mask) {
    let finer = (0..2).map(|k| from.focal[k] / to.focal[k]).fold(1.0, f64::max);
    let taps = (finer.ceil() as usize).clamp(1, 8);
    let pixel = |i: usize| -> Option<[u8; 3]> {
        let mut sum = [0.0; 3];
        for tap in 0..taps * taps {
            let offset = |k: usize| (k as f64 + 0.5) / taps as f64 - 0.5;
            let [x, y] = [(i % to.size[0]) as f64, (i / to.size[0]) as f64];
            let at = Point2::new(x + offset(tap % taps), y + offset(tap / taps));
            let rgb = bilinear(frame, &moved(&at, from, to)?)?;
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

/// Where `from` sees what `to` sees at a pixel.
fn moved(at: &Point2, from: &CameraModel, to: &CameraModel) -> Option<Point2> {
    Some(from.project(&to.unproject(at)?.into())?.pixel)
}

/// `None` outside the pixel centres.
fn bilinear(frame: &Frame, p: &Point2) -> Option<[f64; 3]> {
    let [w, h] = frame.size;
    let inside = p.x >= 0.0 && p.y >= 0.0 && p.x <= w as f64 - 1.0 && p.y <= h as f64 - 1.0;
    if !inside {
        return None;
    }
    let (x, y) = (p.x as usize, p.y as usize);
    let (u, v) = (p.x - x as f64, p.y - y as f64);
    let at = |x: usize, y: usize| frame.rgb[y.min(h - 1) * w + x.min(w - 1)].map(f64::from);
    let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
    let mix = |k: usize| (1.0 - u) * a[k] + u * b[k];
    let low = |k: usize| (1.0 - u) * c[k] + u * d[k];
    Some([0, 1, 2].map(|k| (1.0 - v) * mix(k) + v * low(k)))
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
    fn bilinear_by_hand() {
        let rgb = [[0, 40, 80], [100, 40, 80], [200, 0, 80], [60, 0, 180]].to_vec();
        let frame = Frame { name: "f".into(), size: [2, 2], rgb };
        assert_eq!(bilinear(&frame, &Point2::new(0.25, 0.0)), Some([25.0, 40.0, 80.0]));
        assert_eq!(bilinear(&frame, &Point2::new(0.25, 0.75)), Some([130.0, 10.0, 98.75]));
        assert_eq!(bilinear(&frame, &Point2::new(1.0, 1.0)), Some([60.0, 0.0, 180.0]));
        assert_eq!(bilinear(&frame, &Point2::new(1.01, 1.0)), None);
        assert_eq!(bilinear(&frame, &Point2::new(0.5, -0.01)), None);
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
