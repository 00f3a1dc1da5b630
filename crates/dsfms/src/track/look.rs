//! What a shape of the template should look like, and where it has texture to hold on to.

use super::flow::{Pyramid, RADIUS, correlation};
use super::reduce::LUMA;
use crate::camera::CameraModel;
use crate::geometry::{Point2, Point3};
use crate::image::{Mask, Plane};
use crate::mesh::Mesh;
use crate::raster::{rasterize, visible_vertices};
use crate::template::SurfaceTexels;
use rayon::prelude::*;

/// Sizes of the image that patches are followed through.
pub const LEVELS: usize = 3;

/// One anchor is sought in every square of this side, px of the working image.
const CELL: usize = 14;

/// Anchors at most.
const MOST: usize = 320;

/// The working image is halved until its diagonal is no longer than this, px.
const DIAGONAL: f64 = 1000.0;

/// The photograph is halved as long as its finest blur keeps this standard deviation, px.
const LEAST_BLUR: f64 = 1.5;

/// The sizes at which a frame is looked at: coarse enough to be fast.
#[derive(Clone, Debug)]
pub struct Working {
    /// Camera of the working image, at whose size patches are compared.
    pub camera: CameraModel,
    pub(super) halvings: u32,
    /// Camera of the photograph, from which shading is read.
    pub(super) photo: CameraModel,
    pub(super) photo_halvings: u32,
}

impl Working {
    /// For frames of this camera; `blur`: the finest at which shading is read, of the diagonal.
    pub fn of(camera: &CameraModel, blur: f64) -> Self {
        let diagonal = |camera: &CameraModel| (camera.size[0] as f64).hypot(camera.size[1] as f64);
        let halve = |mut halved: CameraModel, enough: &dyn Fn(f64) -> bool| {
            let mut times = 0;
            while !enough(diagonal(&halved)) {
                (halved, times) = (halved.halved(), times + 1);
            }
            (halved, times)
        };
        let (working, halvings) = halve(camera.clone(), &|d| d <= DIAGONAL);
        let (photo, photo_halvings) = halve(camera.clone(), &|d| 0.5 * d * blur < LEAST_BLUR);
        Self { camera: working, halvings, photo, photo_halvings }
    }

    /// Pixel of the frame at a pixel of the working image.
    pub fn to_frame(&self, p: Point2) -> Point2 {
        let scale = f64::from(1u32 << self.halvings);
        p.map(|c| (c + 0.5) * scale - 0.5)
    }
}

/// A frame at working size: square root of linear light, whose noise is even, and what of it may be
/// used.
pub struct Seen {
    /// Brightness and its halves.
    pub pyramid: Pyramid,
    /// `true` where the organ may be seen and no highlight is near.
    pub usable: Mask,
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

/// The albedo of a shape as the working camera would see it.
pub struct Look {
    /// Brightness and its halves; the mean where there is no surface.
    pub render: Pyramid,
    /// Places to compare.
    pub anchors: Vec<Anchor>,
    /// Vertices that the working camera sees.
    pub visible: Vec<bool>,
}

impl Look {
    /// Render a shape (camera axes).
    pub fn new(working: &Working, rest: &Mesh, shape: &[Point3], albedo: &SurfaceTexels) -> Self {
        let raster = rasterize(&working.camera, &rest.topology, shape);
        let tolerance = 0.5 * rest.mean_edge_length();
        let visible = visible_vertices(&working.camera, &rest.topology, shape, &raster, tolerance);
        let value = |face: usize, b: [f64; 3]| {
            let texel = albedo.index(face, b);
            let rgb = albedo.value[texel];
            let known = albedo.views.get(texel).is_none_or(|&n| n > 0);
            let bright: f32 = (0..3).map(|c| LUMA[c] * rgb[c].max(0.0).sqrt()).sum();
            (known, bright)
        };
        let pixels = raster.render((false, f32::NAN), value);
        let surface = pixels.iter().filter(|p| !p.1.is_nan());
        let (sum, count) = surface.fold((0.0, 0.0), |(s, n), p| (s + p.1, n + 1.0));
        let mean = sum / f32::max(count, 1.0);
        let data = pixels.iter().map(|p| if p.1.is_nan() { mean } else { p.1 }).collect();
        let known = Mask { size: raster.size, data: pixels.iter().map(|p| p.0).collect() };
        let render = Pyramid::new(Plane { size: raster.size, data }, LEVELS);
        let corners = corners(&render.levels[0], &known);
        let anchors = corners.into_iter().filter_map(|[x, y]| {
            let (face, barycentric) = raster.surface(x, y)?;
            Some(Anchor { face, barycentric, pixel: Point2::new(x as f64, y as f64) })
        });
        Self { anchors: anchors.collect(), render, visible }
    }

    /// How many of the anchors whose surroundings may be used the frame agrees with, to a pixel, and
    /// how many there are: `[agreeing, usable]`.
    pub fn agreement(&self, seen: &Seen, least: f64) -> [usize; 2] {
        let frame = &seen.pyramid.levels[0];
        let agrees = |a: &Anchor| -> Option<bool> {
            whole(&seen.usable, a.pixel).then_some(())?;
            let best = (0..9).filter_map(|k| {
                let shift = nalgebra::Vector2::new(f64::from(k % 3 - 1), f64::from(k / 3 - 1));
                correlation(&self.render.levels[0], a.pixel, frame, a.pixel + shift)
            });
            Some(best.fold(-1.0, f64::max) >= least)
        };
        let all: Vec<Option<bool>> = self.anchors.par_iter().map(agrees).collect();
        [all.iter().filter(|a| **a == Some(true)).count(), all.iter().flatten().count()]
    }
}

/// Whether the middle, the corners and the sides of a patch lie in a mask.
pub fn whole(mask: &Mask, at: Point2) -> bool {
    let r = f64::from(RADIUS);
    [-r, 0.0, r]
        .iter()
        .all(|dy| [-r, 0.0, r].iter().all(|dx| mask.at_pixel(&Point2::new(at.x + dx, at.y + dy))))
}

/// The place with the most texture in its weakest direction of every cell, best first.
fn corners(plane: &Plane, known: &Mask) -> Vec<[usize; 2]> {
    let [w, h] = plane.size;
    let margin = RADIUS as usize + 2;
    let cells: Vec<[usize; 2]> = (margin..h.saturating_sub(margin))
        .step_by(CELL)
        .flat_map(|y| (margin..w.saturating_sub(margin)).step_by(CELL).map(move |x| [x, y]))
        .collect();
    let best_of = |&[x0, y0]: &[usize; 2]| -> Option<(f32, [usize; 2])> {
        let places = (y0..(y0 + CELL).min(h - margin))
            .step_by(3)
            .flat_map(|y| (x0..(x0 + CELL).min(w - margin)).step_by(3).map(move |x| [x, y]));
        let inside = |&[x, y]: &[usize; 2]| whole(known, Point2::new(x as f64, y as f64));
        let scored = places.filter(inside).map(|p| (texture(plane, p), p));
        scored.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))
    };
    let mut found: Vec<(f32, [usize; 2])> = cells.par_iter().filter_map(best_of).collect();
    found.retain(|c| c.0 > 1e-6);
    found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    found.truncate(MOST);
    found.into_iter().map(|c| c.1).collect()
}

/// Smaller eigenvalue of the structure tensor over half a patch.
fn texture(plane: &Plane, [x, y]: [usize; 2]) -> f32 {
    let reach = RADIUS as usize / 2;
    let (mut a, mut b, mut c) = (0.0, 0.0, 0.0);
    for v in y - reach..=y + reach {
        for u in x - reach..=x + reach {
            let dx = plane.at(u + 1, v) - plane.at(u - 1, v);
            let dy = plane.at(u, v + 1) - plane.at(u, v - 1);
            (a, b, c) = (a + dx * dx, b + dx * dy, c + dy * dy);
        }
    }
    0.5 * (a + c - ((a - c).powi(2) + 4.0 * b * b).sqrt())
}
