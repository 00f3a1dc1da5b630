//! The only file that touches kornia: CLAHE and the five-point solver.

use crate::geometry::Vector3;
use crate::image::Plane;
use kornia_3d::pose::essential_5pt;
use kornia_algebra::Vec2F64;
use kornia_image::{Image, ImageSize};
use kornia_imgproc::clahe::clahe;
use nalgebra::Matrix3;

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
