//! COLMAP's `cameras.txt` and `cameras.bin`; the files themselves are read by [`super::super::colmap`].

use super::super::colmap::{ColmapCamera, read_cameras};
use super::super::error::InputError;
use super::CameraFile;
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
            "cameras {first} and {} differ; all frames must come from one camera, so keep one",
            other.id
        );
        return Err(InputError::format(path, problem));
    }
    Ok(CameraFile { camera: camera.clone(), tone: None, light: None })
}
