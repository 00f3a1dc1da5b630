//! The only file that touches kornia: SIFT, CLAHE and the five-point solver.
//!
//! What is corrected here: kornia (like OpenCV's default) upsamples by two with pixel *areas*
//! aligned and forgets it in the keypoint positions, which are a quarter of a pixel too large in
//! x and y. Everything returned follows our convention, pixel centres at integers.

use crate::geometry::{Point2, Vector3};
use crate::image::Plane;
use kornia_3d::pose::essential_5pt;
use kornia_algebra::Vec2F64;
use kornia_image::{Image, ImageSize};
use kornia_imgproc::clahe::clahe;
use kornia_imgproc::features::{FirstOctave, SiftConfig, SiftWorkspace, sift_detect_and_compute};
use nalgebra::Matrix3;

/// One SIFT keypoint with its descriptor.
#[derive(Clone, Debug)]
pub struct Keypoint {
    /// Position, px.
    pub point: Point2,
    /// Standard deviation of the Gaussian at which it was found, px.
    pub scale: f32,
    /// Dominant gradient direction, radians, clockwise from +x (y points down).
    pub angle: f32,
    /// Contrast of the extremum.
    pub response: f32,
    /// SIFT histogram, as kornia scales it (0 to 255).
    pub descriptor: [f32; 128],
}

/// Contrast-limited adaptive histogram equalisation of a grey image in `[0, 1]`; the image itself
/// where it is too small to tile.
pub fn equalise(grey: &Plane, clip: f64, tiles: usize) -> Plane {
    let size = ImageSize { width: grey.size[0], height: grey.size[1] };
    let bytes = grey.data.iter().map(|v| (v * 255.0).round().clamp(0.0, 255.0) as u8).collect();
    let equalised = Image::<u8, 1>::new(size, bytes).and_then(|source| {
        let mut target = Image::<u8, 1>::from_size_val(size, 0)?;
        clahe(&source, &mut target, clip, (tiles, tiles))?;
        Ok(target)
    });
    match equalised {
        Ok(image) => Plane {
            size: grey.size,
            data: image.as_slice().iter().map(|&v| v as f32 / 255.0).collect(),
        },
        Err(_) => grey.clone(),
    }
}

/// SIFT keypoints of a grey image in `[0, 1]`, the image doubled first; in kornia's order (by x,
/// then y), the same at any thread count; of more than `most` the strongest (and all that tie with the
/// last of them). Empty for an image that is too small.
pub fn sift(grey: &Plane, contrast_threshold: f64, most: usize) -> Vec<Keypoint> {
    /// Half a pixel of the doubled image, in pixels of the original.
    const UPSAMPLING_SHIFT: f64 = 0.25;
    let source: Vec<f32> = grey.data.iter().map(|v| v * 255.0).collect();
    let config = SiftConfig { contrast_threshold, n_features: most, ..Default::default() };
    let [w, h] = grey.size;
    let mut workspace = SiftWorkspace::new();
    let found = sift_detect_and_compute(
        &mut workspace,
        &source,
        w,
        h,
        &config,
        FirstOctave::Double,
        usize::MAX,
        // Rows summed by symmetric pairs: half the work, rounded otherwise than OpenCV does.
        true,
    );
    let Ok(found) = found else { return Vec::new() };
    let (descriptors, _) = found.descriptors.as_chunks::<128>();
    let keypoint = |(k, d): (&kornia_imgproc::features::SiftKeypoint, &[f32; 128])| Keypoint {
        point: Point2::new(k.x as f64 - UPSAMPLING_SHIFT, k.y as f64 - UPSAMPLING_SHIFT),
        scale: 0.5 * k.size,
        angle: k.angle.to_radians(),
        response: k.response,
        descriptor: *d,
    };
    found.keypoints.iter().zip(descriptors).map(keypoint).collect()
}

/// Essential matrices `E` with `bᵢᵀ E aᵢ = 0` for five pairs of sightlines (Nistér 2004), none
/// for rays that do not point forward.
pub fn five_point(a: &[Vector3; 5], b: &[Vector3; 5]) -> Vec<Matrix3<f64>> {
    if a.iter().chain(b).any(|ray| ray.z <= 1e-6) {
        return Vec::new();
    }
    let flat = |rays: &[Vector3; 5]| rays.map(|r| Vec2F64::new(r.x / r.z, r.y / r.z));
    let matrix = |m: kornia_algebra::Mat3F64| Matrix3::from_column_slice(&m.to_cols_array());
    essential_5pt(&flat(a), &flat(b))
        .into_iter()
        .map(matrix)
        .filter(|e| e.iter().all(|v| v.is_finite()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blob_is_found_where_it_is() {
        let size = [64, 48];
        let (cx, cy) = (30.3, 21.6);
        let value = |i: usize| {
            let (x, y) = ((i % 64) as f64 - cx, (i / 64) as f64 - cy);
            (0.2 + 0.6 * (-(x * x + y * y) / (2.0 * 9.0)).exp()) as f32
        };
        let plane = Plane { size, data: (0..64 * 48).map(value).collect() };
        let best = sift(&plane, 0.01, 1000)
            .into_iter()
            .min_by(|a, b| {
                let d = |k: &Keypoint| (k.point - Point2::new(cx, cy)).norm();
                d(a).total_cmp(&d(b))
            })
            .unwrap();
        assert!((best.point - Point2::new(cx, cy)).norm() < 0.03, "{:?}", best.point);
    }
}
