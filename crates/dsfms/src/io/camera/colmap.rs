//! COLMAP's `cameras.txt` and `cameras.bin`; the files themselves are read by
//! [`super::super::colmap`].

use super::super::colmap::{ColmapCamera, ColmapImage, file_in, read_cameras, read_images};
use super::super::error::InputError;
use super::super::poses::position_of;
use super::file::CameraFile;
use crate::camera::CameraModel;
use std::path::Path;

/// The first camera of the file; several must be equal.
pub(super) fn read(path: &Path) -> Result<CameraFile, InputError> {
    let cameras = read_cameras(path)?;
    let Some(ColmapCamera { id: first, camera }) = cameras.first() else {
        return Err(InputError::format(
            path,
            "no camera in the file; expected JSON, OpenCV YAML, or COLMAP's CAMERA_ID MODEL WIDTH HEIGHT PARAMS",
        ));
    };
    if let Some(other) = cameras.iter().find(|c| c.camera != *camera) {
        let problem = format!(
            "cameras {first} and {} differ; keep one, or, for a template, give the folder of the model, whose images say which is theirs",
            other.id
        );
        return Err(InputError::format(path, problem));
    }
    Ok(CameraFile { camera: camera.clone(), tone: None, light: None, vignetting: None })
}

/// The cameras of a COLMAP model whose images have different ones.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageCameras {
    /// The camera of most images; of equals the first.
    pub common: CameraModel,
    images: Vec<(String, CameraModel)>,
}

impl ImageCameras {
    /// The camera of a frame (stem or file name), found as poses are; the [common](Self::common)
    /// one where the model does not hold it.
    pub fn of(&self, frame: &str) -> &CameraModel {
        let names: Vec<&str> = self.images.iter().map(|(name, _)| name.as_str()).collect();
        position_of(&names, frame).map_or(&self.common, |i| &self.images[i].1)
    }
}

/// The cameras of the images of a COLMAP model in a folder; `None` where all are equal, or where
/// the path is no folder.
///
/// # Errors
/// A file of the model that is missing or malformed; an image whose camera is missing; a camera
/// with intrinsics that cannot be.
pub fn read_image_cameras(folder: &Path) -> Result<Option<ImageCameras>, InputError> {
    if !folder.is_dir() {
        return Ok(None);
    }
    let path = file_in(folder, "cameras")?;
    let cameras = read_cameras(&path)?;
    if cameras.windows(2).all(|pair| pair[0].camera == pair[1].camera) {
        return Ok(None);
    }
    let mut images = Vec::new();
    let mut uses = vec![0; cameras.len()];
    for ColmapImage { name, camera, .. } in read_images(&file_in(folder, "images")?)? {
        let Some(own) = cameras.iter().position(|c| c.id == camera) else {
            let problem = format!("has no camera {camera}, which image {name} names");
            return Err(InputError::format(&path, problem));
        };
        cameras[own]
            .camera
            .validate()
            .map_err(|source| InputError::Camera { path: path.clone(), source })?;
        uses[own] += 1;
        images.push((name, cameras[own].camera.clone()));
    }
    // Of cameras that serve as many images the first.
    let most = (0..cameras.len()).rev().max_by_key(|&c| uses[c]).unwrap_or(0);
    Ok(Some(ImageCameras { common: cameras[most].camera.clone(), images }))
}
