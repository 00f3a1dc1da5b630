//! The exploration as a COLMAP model.

use super::atomic::WriteError;
use super::colmap::{
    ColmapCamera, ColmapImage, ColmapModel, ColmapPoint, Format, read_images, read_points,
    write_model,
};
use super::error::InputError;
use super::template_error::TemplateFileError;
use crate::geometry::Point2;
use crate::template::{SparsePoint, Template};
use std::path::Path;

pub(super) fn write(folder: &Path, template: &Template) -> Result<(), WriteError> {
    write_model(folder, &colmap_model(template), Format::Text)
}

/// Camera, registered frames and sparse points of a template as a COLMAP model: images and points
/// count from 1, in the template's order. Without a camera it has none.
pub fn colmap_model(template: &Template) -> ColmapModel {
    let mut seen: Vec<Vec<(Point2, Option<u64>)>> = vec![Vec::new(); template.views.len()];
    let mut points = Vec::new();
    for (k, point) in template.points.iter().enumerate() {
        let id = k as u64 + 1;
        let mut track = Vec::new();
        for &(view, pixel) in &point.sightings {
            if let Some(own) = seen.get_mut(view as usize) {
                track.push((view + 1, own.len() as u32));
                own.push((pixel, Some(id)));
            }
        }
        let SparsePoint { position, rgb, error_px, .. } = *point;
        points.push(ColmapPoint { id, position, rgb, error_px, track });
    }
    let image = |(k, points): (usize, Vec<(Point2, Option<u64>)>)| ColmapImage {
        id: k as u32 + 1,
        camera: 1,
        name: template.views[k].name.clone(),
        pose: template.views[k].camera_from_template,
        points,
    };
    let cameras = template.camera.iter().map(|c| ColmapCamera { id: 1, camera: c.clone() });
    ColmapModel {
        cameras: cameras.collect(),
        images: seen.into_iter().enumerate().map(image).collect(),
        points,
    }
}

/// The sparse points of a template's own model; none where the folder has been removed.
pub(super) fn read(folder: &Path, views: usize) -> Result<Vec<SparsePoint>, TemplateFileError> {
    let (images, points) = (folder.join("images.txt"), folder.join("points3D.txt"));
    if !images.is_file() || !points.is_file() {
        return Ok(Vec::new());
    }
    let damaged =
        |path: &Path, reason: String| TemplateFileError::Damaged { path: path.into(), reason };
    let read = |error: InputError| damaged(folder, error.to_string());
    let seen = read_images(&images).map_err(read)?;
    if seen.len() != views {
        let path = images;
        return Err(TemplateFileError::Count {
            path,
            what: "images",
            expected: views,
            found: seen.len(),
        });
    }
    let sighting = |&(image, index): &(u32, u32)| {
        let view = image.checked_sub(1)?;
        let (pixel, _) = seen.get(view as usize)?.points.get(index as usize)?;
        Some((view, *pixel))
    };
    let of = |p: ColmapPoint| {
        let sightings: Option<Vec<_>> = p.track.iter().map(sighting).collect();
        let (position, rgb, error_px) = (p.position, p.rgb, p.error_px);
        sightings.map(|sightings| SparsePoint { position, rgb, error_px, sightings }).ok_or_else(
            || damaged(&points, format!("point {} names an image point that does not exist", p.id)),
        )
    };
    read_points(&points).map_err(read)?.into_iter().map(of).collect()
}
