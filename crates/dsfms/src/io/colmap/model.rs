//! A sparse model in memory.

use crate::camera::CameraModel;
use crate::geometry::{Isometry, Point2, Point3};

/// A sparse model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ColmapModel {
    /// Cameras.
    pub cameras: Vec<ColmapCamera>,
    /// Registered images.
    pub images: Vec<ColmapImage>,
    /// Points of the scene.
    pub points: Vec<ColmapPoint>,
}

/// One camera.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapCamera {
    /// `CAMERA_ID`.
    pub id: u32,
    /// Intrinsics.
    pub camera: CameraModel,
}

/// One registered image.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapImage {
    /// `IMAGE_ID`.
    pub id: u32,
    /// `CAMERA_ID`.
    pub camera: u32,
    /// File name, folders included.
    pub name: String,
    /// `camera_from_world`.
    pub pose: Isometry,
    /// Its 2D points with the id of their 3D point.
    pub points: Vec<(Point2, Option<u64>)>,
}

/// One point of the scene.
#[derive(Clone, Debug, PartialEq)]
pub struct ColmapPoint {
    /// `POINT3D_ID`.
    pub id: u64,
    /// Position in world axes.
    pub position: Point3,
    /// Encoded colour.
    pub rgb: [u8; 3],
    /// Mean reprojection error, px.
    pub error_px: f64,
    /// `IMAGE_ID` and index into that image's points.
    pub track: Vec<(u32, u32)>,
}
