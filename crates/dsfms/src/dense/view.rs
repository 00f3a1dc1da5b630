//! What stereo sees of a frame: undistorted grey pyramids on pinhole grids.

use super::error::DenseError;
use crate::camera::{Camera, CameraModel, Lens, PosedFrame};
use crate::geometry::{Point2, Point3};
use crate::image::exposure::SATURATED;
use crate::image::{Frame, Mask};
use rayon::prelude::*;

/// Pyramid levels; 0 is the working resolution, 1 the grid of the depth maps.
pub(super) const LEVELS: usize = 4;
/// Widest half field of view kept when a lens is turned into a pinhole, as a tangent.
const MAX_TANGENT: f64 = 1.8;

/// One level: grey values, NaN where a pixel must not be used.
#[derive(Clone, Debug)]
pub(super) struct Image {
    pub size: [usize; 2],
    /// Pinhole `[fx, fy, cx, cy]`.
    pub k: [f64; 4],
    pub grey: Vec<f32>,
}

/// A frame at all levels, with its pose and outlines.
#[derive(Clone, Debug)]
pub(super) struct StereoPyramid<'a> {
    pub levels: Vec<Image>,
    pub posed: PosedFrame<'a>,
}

/// Scale from frame to working resolution that keeps the depth grids of all frames within
/// `max_pixels`; at most 1.
pub(super) fn working_scale(views: &[PosedFrame], max_pixels: usize) -> f64 {
    let pixels = |v: &PosedFrame| {
        let coverage = v.organ.map_or(1.0, Mask::coverage);
        v.camera.size[0] as f64 * v.camera.size[1] as f64 * coverage
    };
    let total: f64 = views.iter().map(|v| pixels(v) / 4.0).sum();
    (max_pixels as f64 / total.max(1.0)).sqrt().min(1.0)
}

impl<'a> StereoPyramid<'a> {
    /// Undistort, scale and halve; sizes are checked.
    pub(super) fn new(view: &PosedFrame<'a>, scale: f64) -> Result<Self, DenseError> {
        check_sizes(view)?;
        let target = pinhole(view, scale)?;
        let mut levels = vec![resample(view, &target)];
        for level in 1..LEVELS {
            let half = halved(&levels[level - 1]);
            levels.push(half);
        }
        Ok(Self { levels, posed: *view })
    }

    /// Camera of a level as a [`CameraModel`].
    pub(super) fn camera_of(&self, level: usize) -> CameraModel {
        let Image { size, k, .. } = &self.levels[level];
        CameraModel {
            size: *size,
            focal: [k[0], k[1]],
            centre: [k[2], k[3]],
            lens: Lens::default(),
        }
    }

    /// Whether a pixel of the depth grid lies in the masks (saturated ones do too).
    pub(super) fn valid_grid(&self, pixel: usize) -> bool {
        let Image { size, k, .. } = &self.levels[1];
        let (u, v) = ((pixel % size[0]) as f64, (pixel / size[0]) as f64);
        let ray = Point3::new((u - k[2]) / k[0], (v - k[3]) / k[1], 1.0);
        self.posed.usable_pixel(&ray).is_some()
    }
}

fn check_sizes(view: &PosedFrame) -> Result<(), DenseError> {
    let found = [
        ("image", Some(view.frame.size)),
        ("valid mask", view.valid.map(|m| m.size)),
        ("organ mask", view.organ.map(|m| m.size)),
    ];
    for (what, size) in found {
        if let Some(found) = size.filter(|s| *s != view.camera.size) {
            let frame = view.frame.name.clone();
            return Err(DenseError::SizeMismatch {
                frame,
                what,
                found,
                expected: view.camera.size,
            });
        }
    }
    Ok(())
}

/// The pinhole camera that holds what the lens sees, within [`MAX_TANGENT`].
fn pinhole(view: &PosedFrame, scale: f64) -> Result<Image, DenseError> {
    let camera = view.camera;
    let [w, h] = camera.size.map(|s| s as f64);
    let f = camera.focal.map(|f| f * scale);
    let image = |size: [f64; 2], c: [f64; 2]| {
        let size = size.map(|s| (s as usize).max(16));
        Image { size, k: [f[0], f[1], c[0], c[1]], grey: Vec::new() }
    };
    if camera.lens == Lens::default() {
        // A pixel's left edge stays where it is: (c + ½) scales, not c.
        let c = camera.centre.map(|c| (c + 0.5) * scale - 0.5);
        return Ok(image([(w * scale).round(), (h * scale).round()], c));
    }
    let no_ray = || DenseError::NoSightline { frame: view.frame.name.clone() };
    camera.unproject(&Point2::new(camera.centre[0], camera.centre[1])).ok_or_else(no_ray)?;
    let (mut low, mut high) = ([0.0f64; 2], [0.0f64; 2]);
    for s in 0..=64 {
        let t = s as f64 / 64.0;
        let (x, y) = (t * (w - 1.0), t * (h - 1.0));
        for p in [(x, 0.0), (x, h - 1.0), (0.0, y), (w - 1.0, y)] {
            let Some(ray) = camera.unproject(&Point2::new(p.0, p.1)) else { continue };
            for (axis, v) in [ray.x, ray.y].into_iter().enumerate() {
                let tangent = if ray.z > 0.0 { v / ray.z } else { v.signum() * MAX_TANGENT };
                low[axis] = low[axis].min(tangent.max(-MAX_TANGENT));
                high[axis] = high[axis].max(tangent.min(MAX_TANGENT));
            }
        }
    }
    let extent = [0, 1].map(|i| ((high[i] - low[i]) * f[i]).ceil() + 1.0);
    Ok(image(extent, [-low[0] * f[0], -low[1] * f[1]]))
}

/// Grey of the working image: the mean over the footprint of each pixel in the frame.
fn resample(view: &PosedFrame, target: &Image) -> Image {
    let source = usable_grey(view);
    let camera = view.camera;
    let [w, h] = target.size;
    let [fx, fy, cx, cy] = target.k;
    let taps = (camera.focal[0] / fx).ceil().max(1.0) as usize;
    let value = |x: usize, y: usize| {
        let (mut sum, mut count) = (0.0f32, 0usize);
        for tap in 0..taps * taps {
            let offset = |i: usize| (i as f64 + 0.5) / taps as f64 - 0.5;
            let (u, v) = (x as f64 + offset(tap % taps), y as f64 + offset(tap / taps));
            let ray = Point3::new((u - cx) / fx, (v - cy) / fy, 1.0);
            let Some(hit) = camera.project(&ray) else { continue };
            let sample = bilinear(&source, camera.size, hit.pixel.x as f32, hit.pixel.y as f32);
            if !sample.is_nan() {
                sum += sample;
                count += 1;
            }
        }
        if 2 * count > taps * taps { sum / count as f32 } else { f32::NAN }
    };
    let grey = (0..w * h).into_par_iter().map(|i| value(i % w, i / w)).collect();
    Image { size: target.size, k: target.k, grey }
}

/// Encoded luma of the frame, NaN at masked pixels and around saturated ones.
fn usable_grey(view: &PosedFrame) -> Vec<f32> {
    let mut grey = view.frame.luma().data;
    for mask in [view.valid, view.organ].into_iter().flatten() {
        grey.iter_mut().zip(&mask.data).filter(|(_, ok)| !**ok).for_each(|(g, _)| *g = f32::NAN);
    }
    let radius = 2 + view.frame.size[0] / 320;
    for (g, saturated) in grey.iter_mut().zip(saturated_ring(view.frame, radius)) {
        if saturated {
            *g = f32::NAN;
        }
    }
    grey
}

/// Whether the grey of a pixel is blind: two channels clipped. A clipped red alone is common on
/// bright tissue, and green, the larger part of grey, still shows its texture.
fn clipped(p: &[u8; 3]) -> bool {
    p.iter().filter(|&&v| v >= SATURATED).count() >= 2
}

/// Pixels within `radius` (a square) of a clipped one: the halo moves with the light too.
fn saturated_ring(frame: &Frame, radius: usize) -> Vec<bool> {
    let [w, h] = frame.size;
    let core: Vec<bool> = frame.rgb.iter().map(clipped).collect();
    let along_rows: Vec<bool> = (0..w * h)
        .map(|i| {
            let (x, y) = (i % w, i / w);
            (x.saturating_sub(radius)..(x + radius + 1).min(w)).any(|x| core[y * w + x])
        })
        .collect();
    (0..w * h)
        .map(|i| {
            let (x, y) = (i % w, i / w);
            (y.saturating_sub(radius)..(y + radius + 1).min(h)).any(|y| along_rows[y * w + x])
        })
        .collect()
}

/// Mean of 2x2 pixels; usable where at least two of them are.
fn halved(image: &Image) -> Image {
    let [w, h] = image.size;
    let size = [(w / 2).max(1), (h / 2).max(1)];
    let value = |x: usize, y: usize| {
        let four = [(0, 0), (1, 0), (0, 1), (1, 1)]
            .map(|(i, j)| image.grey[(2 * y + j).min(h - 1) * w + (2 * x + i).min(w - 1)]);
        let usable = four.iter().filter(|v| !v.is_nan()).count();
        let sum: f32 = four.iter().filter(|v| !v.is_nan()).sum();
        if usable >= 2 { sum / usable as f32 } else { f32::NAN }
    };
    let grey = (0..size[0] * size[1]).map(|i| value(i % size[0], i / size[0])).collect();
    let [fx, fy, cx, cy] = image.k;
    Image { size, k: [fx / 2.0, fy / 2.0, (cx - 0.5) / 2.0, (cy - 0.5) / 2.0], grey }
}

/// Bilinear value; NaN outside the pixel centres or next to a NaN.
#[inline]
pub(super) fn bilinear(data: &[f32], size: [usize; 2], x: f32, y: f32) -> f32 {
    let [w, h] = size;
    if !(x >= 0.0 && y >= 0.0 && x <= (w - 1) as f32 && y <= (h - 1) as f32) {
        return f32::NAN;
    }
    let (x0, y0) = ((x as usize).min(w.saturating_sub(2)), (y as usize).min(h.saturating_sub(2)));
    let (fx, fy) = (x - x0 as f32, y - y0 as f32);
    let (top, bottom) = (y0 * w + x0, (y0 + 1).min(h - 1) * w + x0);
    let next = usize::from(w > 1);
    let upper = data[top] + fx * (data[top + next] - data[top]);
    let lower = data[bottom] + fx * (data[bottom + next] - data[bottom]);
    upper + fy * (lower - upper)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Isometry, Vector3};

    fn camera(lens: Lens) -> CameraModel {
        CameraModel { size: [64, 48], focal: [60.0, 61.0], centre: [30.0, 25.0], lens }
    }

    #[test]
    fn a_level_sees_a_point_where_it_should() {
        let camera = camera(Lens::Pinhole);
        let frame = Frame { name: "f".into(), size: [64, 48], rgb: vec![[100; 3]; 64 * 48] };
        let view = PosedFrame {
            frame: &frame,
            camera: &camera,
            pose: Isometry::translation(0.0, 0.0, 1.0),
            valid: None,
            organ: None,
        };
        let pyramid = StereoPyramid::new(&view, 1.0).unwrap();
        assert_eq!(pyramid.levels[0].size, [64, 48]);
        assert_eq!(pyramid.levels[1].size, [32, 24]);
        // Two pixels at centres 30 and 31 become one at 15.
        assert!((pyramid.levels[1].k[2] - 14.75).abs() < 1e-12);
        assert!((pyramid.posed.centre().coords - Vector3::new(0.0, 0.0, -1.0)).norm() < 1e-12);
        assert!((pyramid.levels[2].grey[5] - 100.0 / 255.0).abs() < 1e-5);
    }

    #[test]
    fn saturation_takes_its_ring_with_it() {
        let mut rgb = vec![[100u8; 3]; 64 * 48];
        rgb[20 * 64 + 20] = [255, 252, 100];
        // Red alone is bright tissue.
        rgb[40 * 64 + 40] = [255, 180, 100];
        let frame = Frame { name: "f".into(), size: [64, 48], rgb };
        let ring = saturated_ring(&frame, 2);
        assert_eq!(ring.iter().filter(|&&s| s).count(), 25);
        assert!(ring[18 * 64 + 22] && !ring[17 * 64 + 20]);
    }

    #[test]
    fn a_mask_of_another_size_is_named() {
        let camera = camera(Lens::Pinhole);
        let frame = Frame { name: "f7".into(), size: [64, 48], rgb: vec![[9; 3]; 64 * 48] };
        let mask = Mask::filled([10, 10], true);
        let pose = Isometry::identity();
        let view =
            PosedFrame { frame: &frame, camera: &camera, pose, valid: None, organ: Some(&mask) };
        let error = StereoPyramid::new(&view, 1.0).unwrap_err().to_string();
        assert!(error.contains("f7") && error.contains("organ mask"), "{error}");
    }
}
