//! A wavy patch photographed from several sides under a known light, for the tests of this folder.

use super::albedo::AlbedoOptions;
use super::photometric::{AlbedoView, ObservationBounds};
use super::spots::{smoothed_normals, surface_point};
use crate::camera::{CameraModel, PosedFrame};
use crate::geometry::{Isometry, Point3, Vector3};
use crate::image::{Frame, ToneCurve};
use crate::light::{Coat, LightModel};
use crate::mesh::{Mesh, Topology};
use crate::raster::rasterize;
use std::sync::Arc;

pub(super) const SIZE: [usize; 2] = [96, 72];

pub(super) struct Picture {
    pub frame: Frame,
    pub tone: [f32; 256],
    pub camera: CameraModel,
    pub pose: Isometry,
}

impl Picture {
    pub(super) fn view(&self) -> AlbedoView<'_> {
        AlbedoView { posed: self.posed(), tone: &self.tone, gain: 1.0 }
    }

    pub(super) fn posed(&self) -> PosedFrame<'_> {
        PosedFrame::new(&self.frame, &self.camera, self.pose)
    }
}

pub(super) fn patch() -> Mesh {
    const N: u32 = 17;
    let at = |i: u32| -20.0 + 40.0 * f64::from(i) / f64::from(N - 1);
    let positions = (0..N * N)
        .map(|k| (at(k % N), at(k / N)))
        .map(|(x, y)| Point3::new(x, y, 3.0 * (0.15 * x).sin() * (0.2 * y).cos()))
        .collect();
    let cell = |k: u32| [[k, k + N, k + 1], [k + 1, k + N, k + N + 1]];
    let faces = (0..(N - 1) * (N - 1)).flat_map(|c| cell(c / (N - 1) * N + c % (N - 1))).collect();
    let topology = Arc::new(Topology::new((N * N) as usize, faces).unwrap());
    Mesh { topology, positions }
}

pub(crate) fn true_albedo(p: &Point3) -> [f64; 3] {
    let a = 0.4 + 0.1 * (0.3 * p.x).sin();
    [a, 0.8 * a, 0.5 * a]
}

/// Bounds that suit so small a picture, without any highlight in it.
pub(super) fn bounds() -> ObservationBounds {
    ObservationBounds { contour_px: 2.0, halo_px: 2.0, specular_deg: 0.0, ..Default::default() }
}

/// Five views, tilted by 17 degrees to all sides, at different distances.
pub(super) fn pictures(mesh: &Mesh, light: &LightModel, gains: [f64; 5]) -> Vec<Picture> {
    pictures_of(mesh, light, AlbedoOptions::default().coat(), gains)
}

/// The same of other tissue or through another lens.
pub(crate) fn pictures_of(
    mesh: &Mesh,
    light: &LightModel,
    coat: Coat,
    gains: [f64; 5],
) -> Vec<Picture> {
    let tilts = [[0.0, 0.0], [0.3, 0.0], [-0.3, 0.1], [0.1, 0.3], [0.0, -0.3]];
    let distances = [45.0, 50.0, 60.0, 48.0, 55.0];
    (0..5)
        .map(|i| {
            let axis = Vector3::new(tilts[i][0], tilts[i][1], 0.0);
            let pose = Isometry::new(Vector3::new(0.0, 0.0, distances[i]), axis);
            picture(mesh, light, coat, pose, gains[i])
        })
        .collect()
}

fn picture(mesh: &Mesh, light: &LightModel, coat: Coat, pose: Isometry, gain: f64) -> Picture {
    let camera = CameraModel::pinhole(SIZE, [90.0; 2], [47.0, 36.0]);
    let positions: Vec<_> = mesh.positions.iter().map(|p| pose * p).collect();
    let raster = rasterize(&camera, &mesh.topology, &positions);
    let normals = smoothed_normals(mesh, 0);
    let tone = ToneCurve::Srgb.table();
    let encode = |light: f64| tone.partition_point(|&t| f64::from(t) < light).min(255) as u8;
    let rgb = raster.render([0; 3], |face, w| {
        let Some((p, n)) = surface_point(mesh, &normals, face, w) else { return [0; 3] };
        let (point, normal) = (pose * p, pose * n);
        let light = gain * coat.shade(light, &point, &normal).value;
        true_albedo(&p).map(|a| encode(a * light))
    });
    let frame = Frame { name: "picture".into(), size: SIZE, rgb };
    Picture { frame, tone, camera, pose }
}
