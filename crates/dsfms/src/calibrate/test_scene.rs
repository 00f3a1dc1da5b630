//! Pictures of a chessboard for the tests of this stage.

use super::target::Board;
use crate::camera::{Camera, CameraModel, Lens};
use crate::geometry::{Isometry, Point2, Vector3};
use crate::image::Plane;
use crate::image::filter::blur;
use std::sync::LazyLock;

pub(super) fn board() -> Board {
    Board { corners: [7, 5], square: 3.0 }
}

pub(super) fn camera() -> CameraModel {
    CameraModel {
        size: [260, 200],
        focal: [240.0, 243.0],
        centre: [127.0, 103.0],
        lens: Lens::BrownConrady { k: [-0.22, 0.08, 0.0], p: [0.002, -0.001] },
    }
}

/// `camera_from_board`, the board in different places and tilts.
pub(super) fn poses() -> Vec<Isometry> {
    [
        ([-9.0, -6.0, 32.0], [0.5, 0.1, 0.1]),
        ([-10.0, -4.0, 34.0], [-0.4, 0.4, -0.3]),
        ([-7.0, -8.0, 33.0], [0.2, -0.55, 0.2]),
        ([-12.0, -7.0, 36.0], [-0.5, -0.1, 0.0]),
        ([2.0, -10.0, 40.0], [0.3, 0.3, 1.4]),
    ]
    .map(|(t, r)| Isometry::new(Vector3::from(t), Vector3::from(r)))
    .to_vec()
}

/// Black and white squares in a white margin on grey, with a gradient of light and a soft lens.
pub(super) fn picture(pose: &Isometry) -> Plane {
    let [w, h] = camera().size;
    let (back, inverse) = (pose.translation.vector, pose.rotation.inverse());
    let origin = inverse * -back;
    let light = |x: usize, ray: &Vector3| -> f32 {
        let ray = inverse * ray;
        let hit = origin - ray * (origin.z / ray.z);
        let (u, v) = (hit.x / 3.0 + 1.0, hit.y / 3.0 + 1.0);
        let inside = |m: f64| (-m..8.0 + m).contains(&u) && (-m..6.0 + m).contains(&v);
        let shade = 0.6 + 0.4 * x as f32 / w as f32;
        let dark = inside(0.0) && (u.floor() + v.floor()) as i64 % 2 == 0;
        shade
            * if dark {
                0.1
            } else if inside(1.0) {
                0.9
            } else {
                0.4
            }
    };
    let pixel = |i: usize| RAYS[i].iter().map(|ray| light(i % w, ray)).sum::<f32>() / 9.0;
    blur(&Plane { size: [w, h], data: (0..w * h).map(pixel).collect() }, 0.7)
}

/// Nine sightlines of every pixel: they are the same for all poses, and take long to invert.
static RAYS: LazyLock<Vec<[Vector3; 9]>> = LazyLock::new(|| {
    let camera = camera();
    let [w, h] = camera.size;
    let ray = |i: usize, k: usize| {
        let (dx, dy) = ((k % 3) as f64 / 3.0 - 1.0 / 3.0, (k / 3) as f64 / 3.0 - 1.0 / 3.0);
        camera.unproject(&Point2::new((i % w) as f64 + dx, (i / w) as f64 + dy)).unwrap()
    };
    (0..w * h).map(|i| std::array::from_fn(|k| ray(i, k))).collect()
});
