//! COLMAP models: cameras, images with their points, and 3D points, as text or binary files.
//!
//! COLMAP's pixel centres lie at half integers; everything in memory here has them at integers.
//! COLMAP's image poses are `camera_from_world`, as ours. Rigs and frames of newer versions are
//! neither read nor written; COLMAP makes trivial ones of a model without them.

mod binary;
pub(super) mod camera;
mod model;
mod text;

use super::atomic::WriteError;
use super::error::InputError;
pub use model::{ColmapCamera, ColmapImage, ColmapModel, ColmapPoint};
use std::path::{Path, PathBuf};

/// How a model is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Format {
    /// `cameras.txt`, `images.txt`, `points3D.txt`.
    #[default]
    Text,
    /// `cameras.bin`, `images.bin`, `points3D.bin`.
    Binary,
}

/// The file of a folder that holds `cameras`, `images` or `points3D`: binary before text, as COLMAP
/// itself chooses.
pub(super) fn file_in(folder: &Path, part: &str) -> Result<PathBuf, InputError> {
    ["bin", "txt"]
        .map(|e| folder.join(format!("{part}.{e}")))
        .into_iter()
        .find(|p| p.is_file())
        .ok_or_else(|| InputError::Empty {
            path: folder.into(),
            expected: format!("expected {part}.bin or {part}.txt of a COLMAP model"),
        })
}

/// Read the model of a folder; `points3D` may be missing. Every reference from an image to a point
/// and back is checked.
///
/// # Errors
/// A file that is missing or damaged, or a reference to what is not there.
pub fn read_model(folder: &Path) -> Result<ColmapModel, InputError> {
    let images = file_in(folder, "images")?;
    let points = file_in(folder, "points3D").ok();
    let model = ColmapModel {
        cameras: read_cameras(&file_in(folder, "cameras")?)?,
        images: read_images(&images)?,
        points: points.as_deref().map(read_points).transpose()?.unwrap_or_default(),
    };
    check(&model, &images, points.as_deref().unwrap_or(&images))?;
    Ok(model)
}

/// Cameras of `cameras.bin` or `cameras.txt`.
///
/// # Errors
/// A file that is missing or damaged.
pub fn read_cameras(path: &Path) -> Result<Vec<ColmapCamera>, InputError> {
    if is_binary(path) { binary::read_cameras(path) } else { text::read_cameras(path) }
}

/// Images of `images.bin` or `images.txt`.
///
/// # Errors
/// A file that is missing or damaged.
pub fn read_images(path: &Path) -> Result<Vec<ColmapImage>, InputError> {
    if is_binary(path) { binary::read_images(path) } else { text::read_images(path) }
}

/// Points of `points3D.bin` or `points3D.txt`.
///
/// # Errors
/// A file that is missing or damaged.
pub fn read_points(path: &Path) -> Result<Vec<ColmapPoint>, InputError> {
    if is_binary(path) { binary::read_points(path) } else { text::read_points(path) }
}

pub(super) fn is_binary(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("bin"))
}

/// Write a model into a folder, which is created where missing.
///
/// # Errors
/// A folder or file that cannot be written.
pub fn write_model(folder: &Path, model: &ColmapModel, format: Format) -> Result<(), WriteError> {
    match format {
        Format::Text => text::write(folder, model),
        Format::Binary => binary::write(folder, model),
    }
}

fn check(model: &ColmapModel, images: &Path, points: &Path) -> Result<(), InputError> {
    let mut cameras: Vec<u32> = model.cameras.iter().map(|c| c.id).collect();
    cameras.sort_unstable();
    let mut order: Vec<(u32, usize)> =
        model.images.iter().map(|i| (i.id, i.points.len())).collect();
    order.sort_unstable();
    for image in &model.images {
        if cameras.binary_search(&image.camera).is_err() {
            let problem = format!("names camera {}, which the model does not have", image.camera);
            return Err(InputError::field(images, format!("image {}", image.id), problem));
        }
    }
    for point in &model.points {
        for &(image, index) in &point.track {
            let place = order.binary_search_by_key(&image, |o| o.0).ok();
            if place.is_none_or(|k| index as usize >= order[k].1) {
                let problem = format!(
                    "its track names point {index} of image {image}, which the model does not have"
                );
                return Err(InputError::field(points, format!("point {}", point.id), problem));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
