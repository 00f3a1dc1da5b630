//! Camera poses as files have them.

use dsfms::geometry::Isometry;
use serde::Serialize;

/// A pose of a `poses.json`, as `--poses` reads it: `X_camera = R X_world + t`.
#[derive(Clone, Debug, Serialize)]
pub struct ImagePose {
    image: String,
    #[serde(rename = "R")]
    rotation: [[f64; 3]; 3],
    #[serde(rename = "t")]
    translation: [f64; 3],
}

impl ImagePose {
    /// `camera_from_world` of a picture.
    pub fn of(image: String, pose: &Isometry) -> Self {
        let (r, t) = (pose.rotation.to_rotation_matrix(), pose.translation.vector);
        let rotation = std::array::from_fn(|i| std::array::from_fn(|j| r[(i, j)]));
        Self { image, rotation, translation: t.into() }
    }
}

/// A motion as 4 x 4, row by row.
pub fn rows(pose: &Isometry) -> [[f64; 4]; 4] {
    let matrix = pose.to_homogeneous();
    std::array::from_fn(|r| std::array::from_fn(|c| matrix[(r, c)]))
}
