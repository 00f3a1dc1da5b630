//! The nodes of the depth map: a coarse pixel lattice over the organ.

use super::error::SfsError;
use super::input::SfsInput;
use super::options::SfsOptions;
use crate::camera::Camera;
use crate::geometry::{Point2, Point3, Vector3, area_normal, median};
use crate::image::{Mask, Plane, distance::distance_to, filter::blur_masked};
use crate::light::{Light, LightModel};
use crate::raster::Raster;
use crate::template::texel_fill::render_albedo;

/// Fewest nodes that make a shape.
const MIN_NODES: usize = 20;

/// Nodes, triangles and what the image says at each triangle.
pub(super) struct PixelGrid {
    /// Pixel of the first lattice point.
    origin: [usize; 2],
    /// Lattice spacing, px.
    step: usize,
    /// Columns and rows of the lattice.
    size: [usize; 2],
    /// Node of every lattice point; `u32::MAX` off the organ.
    node: Vec<u32>,
    /// Sightline of every node, scaled to z = 1.
    pub sightlines: Vec<Vector3>,
    /// Distance of every node to the border of the organ over the largest such distance.
    pub inwardness: Vec<f64>,
    /// Whether a node lies at the border.
    pub border: Vec<bool>,
    /// Lattice triangles with three nodes.
    pub cells: Vec<PixelCell>,
    /// Triples of consecutive nodes along rows and columns.
    pub triples: Vec<[u32; 3]>,
    /// Angle between neighbouring sightlines, rad.
    pub angular_step: f64,
    /// Mean depth of the rigid template.
    pub mean_depth: f64,
    /// Brightness of unit albedo under unit shading.
    pub gain: f64,
    /// Median brightness of the cells.
    pub median_brightness: f64,
}

/// A triangle of the depth map that the image may judge.
pub(super) struct PixelCell {
    /// Its nodes, such that the normal `(b − a) × (c − a)` points to the camera.
    pub nodes: [u32; 3],
    /// Mean brightness.
    pub brightness: f64,
    /// Mean albedo.
    pub albedo: f64,
}

impl PixelGrid {
    pub(super) fn new(
        input: &SfsInput,
        raster: &Raster,
        posed: &[Point3],
        light: &LightModel,
        options: &SfsOptions,
    ) -> Result<Self, SfsError> {
        let too_small = |found| SfsError::TooSmall { found, needed: MIN_NODES };
        let region = raster.silhouette();
        let (origin, extent) = bounding_box(&region).ok_or(too_small(0))?;
        let step = extent[0].max(extent[1]).div_ceil(options.nodes_across).max(1);
        let size = extent.map(|e| e / step + 1);
        let depths = raster.depth.iter().filter(|d| d.is_finite());
        let mean_depth = depths.clone().sum::<f64>() / depths.count() as f64;
        let mut grid = Self {
            origin,
            step,
            size,
            node: vec![u32::MAX; size[0] * size[1]],
            sightlines: Vec::new(),
            inwardness: Vec::new(),
            border: Vec::new(),
            cells: Vec::new(),
            triples: Vec::new(),
            angular_step: step as f64 / input.camera.focal[0],
            mean_depth,
            gain: 1.0,
            median_brightness: 1.0,
        };
        grid.place_nodes(input, &region);
        grid.mark_border();
        let measured = Measured::new(input, raster, posed, light, step, options);
        grid.place_cells(&measured);
        if grid.cells.len() < MIN_NODES {
            return Err(too_small(grid.cells.len()));
        }
        grid.gain = measured.gain;
        let mut brightness: Vec<f64> = grid.cells.iter().map(|c| c.brightness).collect();
        grid.median_brightness = median(&mut brightness).unwrap_or(1.0).max(1e-6);
        Ok(grid)
    }

    fn pixel(&self, i: usize, j: usize) -> [usize; 2] {
        [self.origin[0] + i * self.step, self.origin[1] + j * self.step]
    }

    fn place_nodes(&mut self, input: &SfsInput, region: &Mask) {
        let inside = distance_to(&region.complement());
        let deepest = inside.data.iter().copied().fold(1.0, f32::max);
        for j in 0..self.size[1] {
            for i in 0..self.size[0] {
                let [x, y] = self.pixel(i, j);
                if x >= region.size[0] || y >= region.size[1] || !region.at(x, y) {
                    continue;
                }
                let pixel = Point2::new(x as f64, y as f64);
                let Some(ray) = input.camera.unproject(&pixel).filter(|r| r.z > 0.0) else {
                    continue;
                };
                self.node[j * self.size[0] + i] = self.sightlines.len() as u32;
                self.sightlines.push(ray / ray.z);
                self.inwardness.push(f64::from(inside.at(x, y) / deepest));
            }
        }
    }

    /// Node at a lattice point, if there is one.
    fn at(&self, i: isize, j: isize) -> Option<u32> {
        let [w, h] = self.size.map(|s| s as isize);
        let inside = i >= 0 && j >= 0 && i < w && j < h;
        inside.then(|| self.node[(j * w + i) as usize]).filter(|&n| n != u32::MAX)
    }

    fn mark_border(&mut self) {
        self.border = vec![false; self.sightlines.len()];
        for j in 0..self.size[1] as isize {
            for i in 0..self.size[0] as isize {
                let Some(node) = self.at(i, j) else { continue };
                for (di, dj) in [(1, 0), (0, 1)] {
                    match [self.at(i - di, j - dj), self.at(i + di, j + dj)] {
                        [Some(a), Some(b)] => self.triples.push([a, node, b]),
                        _ => self.border[node as usize] = true,
                    }
                }
            }
        }
    }

    fn place_cells(&mut self, measured: &Measured) {
        for j in 0..self.size[1] {
            for i in 0..self.size[0] {
                let (x, y) = (i as isize, j as isize);
                let [a, b, c, d] =
                    [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(u, v)| self.at(x + u, y + v));
                let near = measured.at(self.pixel(i, j), self.step / 3);
                let far = measured.at(self.pixel(i, j), self.step - self.step / 3);
                // Both wound so that the normal has negative z in camera axes (y down).
                self.push_cell([a, c, b], near);
                self.push_cell([b, c, d], far);
            }
        }
    }

    fn push_cell(&mut self, nodes: [Option<u32>; 3], measured: Option<(f64, f64)>) {
        if let ([Some(a), Some(b), Some(c)], Some((brightness, albedo))) = (nodes, measured) {
            self.cells.push(PixelCell { nodes: [a, b, c], brightness, albedo });
        }
    }

    /// ln depth at a pixel, bilinear over the nodes around it that exist; `None` without any.
    pub(super) fn interpolate(&self, log_depth: &[f64], p: &Point2) -> Option<f64> {
        let u = (p.x - self.origin[0] as f64) / self.step as f64;
        let v = (p.y - self.origin[1] as f64) / self.step as f64;
        let (i, j) = (u.floor(), v.floor());
        let (mut sum, mut total) = (0.0, 0.0);
        for (di, dj) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let weight = (1.0 - (u - i - di).abs()) * (1.0 - (v - j - dj).abs());
            if let Some(node) = self.at((i + di) as isize, (j + dj) as isize) {
                sum += weight * log_depth[node as usize];
                total += weight;
            }
        }
        (total > 1e-6).then(|| sum / total)
    }
}

/// Brightness and albedo smoothed to the lattice, and the gain that links them.
struct Measured {
    brightness: Plane,
    albedo: Plane,
    trusted: Mask,
    gain: f64,
}

impl Measured {
    fn new(
        input: &SfsInput,
        raster: &Raster,
        posed: &[Point3],
        light: &LightModel,
        step: usize,
        options: &SfsOptions,
    ) -> Self {
        let region = raster.silhouette();
        let trusted = region.and(input.usable).minus(&input.saturated.dilate(options.halo_px));
        let sigma = 0.5 * step as f64;
        let grey = match input.albedo {
            Some(texels) => render_albedo(raster, texels).0.grey(),
            None => Plane::filled(region.size, 1.0),
        };
        let (brightness, _) = blur_masked(input.grey, &trusted, sigma);
        let (albedo, _) = blur_masked(&grey, &region, sigma);
        let shading = raster.render(0.0, |face, w| {
            let corners = input.mesh.topology.faces[face].map(|v| &posed[v as usize]);
            let [a, b, c] = corners;
            let normal = area_normal(a, b, c).try_normalize(0.0).unwrap_or_default();
            light.shade(&crate::geometry::point_at(corners, w), &normal).value
        });
        let mut ratios: Vec<f64> = (0..shading.len())
            .filter(|&i| trusted.data[i] && shading[i] > 0.2)
            .map(|i| f64::from(brightness.data[i]) / (shading[i] * f64::from(albedo.data[i])))
            .filter(|r| r.is_finite())
            .collect();
        let gain = median(&mut ratios).unwrap_or(1.0);
        Self { brightness, albedo, trusted, gain }
    }

    /// Brightness and albedo at a pixel offset diagonally; `None` where not to be trusted.
    fn at(&self, [x, y]: [usize; 2], offset: usize) -> Option<(f64, f64)> {
        let (x, y) = (x + offset, y + offset);
        let [w, h] = self.trusted.size;
        let albedo = (x < w && y < h && self.trusted.at(x, y)).then(|| self.albedo.at(x, y))?;
        (albedo > 1e-4).then(|| (f64::from(self.brightness.at(x, y)), f64::from(albedo)))
    }
}

fn bounding_box(mask: &Mask) -> Option<([usize; 2], [usize; 2])> {
    let w = mask.size[0];
    let on = mask.data.iter().enumerate().filter(|(_, v)| **v).map(|(i, _)| [i % w, i / w]);
    let first = on.clone().next()?;
    let (low, high) = on.fold((first, first), |(low, high), p| {
        let lower = [low[0].min(p[0]), low[1].min(p[1])];
        (lower, [high[0].max(p[0]), high[1].max(p[1])])
    });
    Some((low, [high[0] - low[0] + 1, high[1] - low[1] + 1]))
}
