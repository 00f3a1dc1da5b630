//! A bright plate before a dark wall, for tests.

use super::depth_map::DepthMap;
use super::labels::{Labelling, Parting};
use super::seeds::Seeds;
use crate::camera::{CameraModel, Lens, PosedFrame};
use crate::geometry::Isometry;
use crate::image::Frame;

pub(super) const SIZE: [usize; 2] = [120, 90];
pub(super) const WALL: f64 = 60.0;
/// Depth and half the side of the plate, length units.
pub(super) const PLATE: [f64; 2] = [40.0, 9.0];

pub(super) fn camera() -> CameraModel {
    CameraModel { size: SIZE, focal: [100.0; 2], centre: [59.5, 44.5], lens: Lens::default() }
}

/// A camera that looks along z, moved sideways.
pub(super) fn pose(i: usize) -> Isometry {
    let [x, y] = [[-6.0, 0.0], [-3.0, 2.0], [0.0, 0.0], [3.0, -2.0], [6.0, 0.0]][i];
    Isometry::translation(-x, -y, 0.0)
}

/// Whether the plate is what a pixel shows, or a pixel less than `fat` px beside.
pub(super) fn plate(i: usize, pixel: usize, fat: f64) -> bool {
    let [u, v] = [(pixel % SIZE[0]) as f64 - 59.5, (pixel / SIZE[0]) as f64 - 44.5];
    let centre = pose(i).translation.vector * (100.0 / PLATE[0]);
    let half = PLATE[1] * 100.0 / PLATE[0] + fat;
    (u - centre.x).abs() <= half && (v - centre.y).abs() <= half
}

/// A bright plate before a dark wall, with depth that is the plate's for `fat` px too far.
pub(super) fn scene(fat: f64, near: f64) -> (Vec<Frame>, Vec<DepthMap>) {
    let n = SIZE[0] * SIZE[1];
    let frame = |i: usize| {
        let rgb = (0..n).map(|p| [if plate(i, p, 0.0) { 180 } else { 60 + (p % 5) as u8 }; 3]);
        Frame { name: format!("{i}"), size: SIZE, rgb: rgb.collect() }
    };
    let map = |i: usize| DepthMap {
        camera: camera(),
        pose: pose(i),
        depth: (0..n).map(|p| if plate(i, p, fat) { near } else { WALL } as f32).collect(),
        normal: vec![[0.0, 0.0, -1.0]; n],
        sigma: vec![0.05; n],
        confidence: vec![1.0; n],
    };
    (0..5).map(|i| (frame(i), map(i))).unzip()
}

pub(super) fn posed<'a>(frames: &'a [Frame], camera: &'a CameraModel) -> Vec<PosedFrame<'a>> {
    let one = |(i, frame)| PosedFrame { frame, camera, pose: pose(i), valid: None, organ: None };
    frames.iter().enumerate().map(one).collect()
}

pub(super) fn parted(views: &[PosedFrame], maps: &[DepthMap], seeds: &Seeds) -> Labelling {
    Parting::new(views, maps, seeds, &[]).best()
}
