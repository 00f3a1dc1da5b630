//! What a shape of the template should look like, and where it has texture to hold on to.

use super::mips::Mips;
use crate::camera::CameraModel;
use crate::geometry::{Point2, Point3, Vector2};
use crate::image::corners::{CornerGrid, corners};
use crate::image::flow::{Pyramid, correlation, whole};
use crate::image::{Mask, Plane, diagonal};
use crate::mesh::Mesh;
use crate::raster::{rasterize, visible_vertices};
use crate::verdict::look::BLOCKS;
use rayon::prelude::*;
use std::sync::Arc;

/// Sizes of the image that patches are followed through.
pub const LEVELS: usize = 3;

/// Where anchors are sought, px of the working image: a place in every square of 10 px
/// (`docs/results/choices.md`, the video solve).
const GRID: CornerGrid = CornerGrid { cell: 10, stride: 4, most: 700 };

/// The working image is halved until its diagonal is no longer than this, px.
const DIAGONAL: f64 = 1000.0;
/// No side of a halved picture is shorter, px: on less there is nothing to look at.
const LEAST: usize = 16;

/// The sizes at which a frame is looked at: coarse enough to be fast.
#[derive(Clone, Debug)]
pub struct Working {
    /// Camera of the working image, at whose size patches are compared.
    pub camera: CameraModel,
    pub(super) halvings: u32,
    /// Camera of the photograph, from which shading is read.
    pub(super) photo: CameraModel,
    pub(super) photo_halvings: u32,
    /// Camera of the picture that the surface is compared with, no larger than the photograph.
    pub(super) compared: CameraModel,
    pub(super) compared_halvings: u32,
}

impl Working {
    /// For frames of this camera; `blur`: the finest at which shading is read, of the diagonal, and
    /// `least_px` what halving leaves of it at least, px.
    pub fn of(camera: &CameraModel, blur: f64, least_px: f64) -> Self {
        let halve = |mut halved: CameraModel, enough: &dyn Fn(f64) -> bool| {
            let mut times = 0;
            while !enough(diagonal(halved.size))
                && halved.size.iter().all(|&side| side >= 2 * LEAST)
            {
                (halved, times) = (halved.halved(), times + 1);
            }
            (halved, times)
        };
        let (working, halvings) = halve(camera.clone(), &|d| d <= DIAGONAL);
        let (photo, photo_halvings) = halve(camera.clone(), &|d| 0.5 * d * blur < least_px);
        let (compared, more) = halve(photo.clone(), &|d| d <= BLOCKS);
        let compared_halvings = photo_halvings + more;
        Self { camera: working, halvings, photo, photo_halvings, compared, compared_halvings }
    }

    /// Pixel of the working image at a pixel of the frame.
    pub fn of_frame(&self, p: Point2) -> Point2 {
        let scale = f64::from(1u32 << self.halvings);
        p.map(|c| (c + 0.5) / scale - 0.5)
    }

    /// Pixel of the frame at a pixel of the working image.
    pub fn to_frame(&self, p: Point2) -> Point2 {
        let scale = f64::from(1u32 << self.halvings);
        p.map(|c| (c + 0.5) * scale - 0.5)
    }
}

/// A frame at working size: square root of linear light, whose noise is even, and what of it may be
/// used.
#[derive(Clone)]
pub struct Seen {
    /// Brightness and its halves.
    pub pyramid: Arc<Pyramid>,
    /// `true` where the organ may be seen and no white pixel is near.
    pub usable: Mask,
    /// `true` where the organ may be seen.
    pub open: Mask,
}

/// A textured place of the template.
#[derive(Clone, Copy, Debug)]
pub struct Anchor {
    /// Face of the template.
    pub face: u32,
    /// Barycentrics on it.
    pub barycentric: [f64; 3],
    /// Where the rendered shape shows it, px of the working image.
    pub pixel: Point2,
}

/// The brightness of a shape as the working camera would see it.
pub struct Look {
    /// Brightness and its halves; the mean where there is no surface.
    pub render: Pyramid,
    /// Places to compare.
    pub anchors: Vec<Anchor>,
    /// Vertices that the working camera sees.
    pub visible: Vec<bool>,
}

impl Look {
    /// Render a shape (camera axes; `lit`: the diffuse shading of its vertices).
    pub(super) fn new(
        working: &Working,
        rest: &Mesh,
        shape: &[Point3],
        lit: &[f64],
        albedo: &Mips,
    ) -> Self {
        let topology = &rest.topology;
        let raster = rasterize(&working.camera, topology, shape);
        let edge = rest.mean_edge_length();
        let visible = visible_vertices(&working.camera, topology, shape, &raster, 0.5 * edge);
        let level = albedo.for_edge(edge_px(&working.camera, edge, shape));
        let value = |face: usize, b: [f64; 3]| {
            let corners = topology.faces[face];
            let shade: f64 = (0..3).map(|k| b[k] * lit[corners[k] as usize]).sum();
            let texel = level.texels.index(face, b);
            let bright = level.bright[texel];
            let known = !bright.is_nan();
            (known, if known { bright * shade.sqrt() as f32 } else { f32::NAN })
        };
        let pixels = raster.render((false, f32::NAN), value);
        let surface = pixels.iter().filter(|p| !p.1.is_nan());
        let (sum, count) = surface.fold((0.0, 0.0), |(s, n), p| (s + p.1, n + 1.0));
        let mean = sum / f32::max(count, 1.0);
        let data = pixels.iter().map(|p| if p.1.is_nan() { mean } else { p.1 }).collect();
        let known = Mask { size: raster.size, data: pixels.iter().map(|p| p.0).collect() };
        let render = Pyramid::new(Plane { size: raster.size, data }, LEVELS);
        let corners = corners(&render.levels[0], &known, &GRID);
        let anchors = corners.into_iter().filter_map(|[x, y]| {
            let (face, barycentric) = raster.surface(x, y)?;
            Some(Anchor { face, barycentric, pixel: Point2::new(x as f64, y as f64) })
        });
        Self { anchors: anchors.collect(), render, visible }
    }

    /// How many of the anchors whose surroundings may be used the frame agrees with, to a pixel,
    /// and how many there are: `[agreeing, usable]`.
    pub fn agreement(&self, seen: &Seen, least: f64) -> [usize; 2] {
        let frame = &seen.pyramid.levels[0];
        let agrees = |a: &Anchor| -> Option<bool> {
            whole(&seen.usable, a.pixel).then_some(())?;
            // The centre first: where that agrees, as it mostly does, it is enough.
            Some([4, 1, 3, 5, 7, 0, 2, 6, 8].into_iter().any(|k| {
                let shift = Vector2::new(f64::from(k % 3 - 1), f64::from(k / 3 - 1));
                correlation(&self.render.levels[0], a.pixel, frame, a.pixel + shift)
                    .is_some_and(|alike| alike >= least)
            }))
        };
        let all: Vec<Option<bool>> = self.anchors.par_iter().map(agrees).collect();
        [all.iter().filter(|a| **a == Some(true)).count(), all.iter().flatten().count()]
    }
}

/// Length of an edge on the image, px, where the shape is.
pub(super) fn edge_px(camera: &CameraModel, edge: f64, shape: &[Point3]) -> f64 {
    let depth = shape.iter().map(|p| p.z).sum::<f64>() / shape.len().max(1) as f64;
    edge * 0.5 * (camera.focal[0] + camera.focal[1]) / depth.max(1e-300)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halving_ends_before_nothing_is_left() {
        let camera = CameraModel::pinhole([1280, 720], [1000.0; 2], [639.5, 359.5]);
        let working = Working::of(&camera, 1.0, 1e-300);
        assert_eq!(working.photo.size, [40, 22]);
        assert_eq!(working.camera.size, [640, 360]);
    }
}
