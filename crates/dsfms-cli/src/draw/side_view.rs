//! A shaded view of a surface from a distance.

use super::{CLAY, PAPER};
use dsfms::camera::{CameraModel, Lens};
use dsfms::geometry::{Isometry, Point3, Vector3};
use dsfms::mesh::Topology;
use dsfms::mesh::normals::vertex_normals;
use dsfms::raster::{Raster, rasterize};
use image::RgbImage;

/// Turn of the side view about the image's vertical axis, degrees.
const SIDE_DEG: f64 = 65.0;

/// A rectangle across a view, right and down, in length units at the middle of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    pub low: [f64; 2],
    pub high: [f64; 2],
}

impl Window {
    /// Width and height.
    pub fn size(&self) -> [f64; 2] {
        [0, 1].map(|k| self.high[k] - self.low[k])
    }
}

/// A distant camera fixed by one surface, so that others can be drawn from the same place.
pub struct SideView {
    centre: Point3,
    camera: CameraModel,
    distance: f64,
    turn: Isometry,
}

/// Middle of the bounding box.
fn middle(vertices: &[Point3]) -> Point3 {
    let fold = |f: fn(&Vector3, &Vector3) -> Vector3| {
        vertices.iter().map(|p| p.coords).reduce(|a, b| f(&a, &b)).unwrap_or_default()
    };
    Point3::from(0.5 * (fold(Vector3::inf) + fold(Vector3::sup)))
}

fn turn(yaw: f64, pitch: f64) -> Isometry {
    Isometry::rotation(Vector3::x() * -pitch.to_radians())
        * Isometry::rotation(Vector3::y() * yaw.to_radians())
}

impl SideView {
    /// Look at the middle of `vertices` from the side, all of them in the picture.
    pub fn of(vertices: &[Point3], size: [usize; 2]) -> Self {
        Self::turned_by(vertices, size, SIDE_DEG, 0.0)
    }

    /// Look at the middle of `vertices` from where the camera is turned about it by `yaw` to the
    /// right (about the image's vertical axis) and by `pitch` upwards, degrees.
    pub fn turned_by(vertices: &[Point3], size: [usize; 2], yaw: f64, pitch: f64) -> Self {
        let centre = middle(vertices);
        let radius = vertices.iter().map(|p| (p - centre).norm()).fold(1e-9, f64::max);
        Self::fitted(vertices, size, yaw, pitch, radius)
    }

    /// The same with `reach` length units about the middle in the picture.
    pub fn fitted(vertices: &[Point3], size: [usize; 2], yaw: f64, pitch: f64, reach: f64) -> Self {
        let centre = middle(vertices);
        let radius = vertices.iter().map(|p| (p - centre).norm()).fold(1e-9, f64::max);
        let distance = 6.0 * radius;
        let focal = 0.47 * size[0].min(size[1]) as f64 * (distance - radius) / reach;
        let middle = [0.5 * (size[0] as f64 - 1.0), 0.5 * (size[1] as f64 - 1.0)];
        let camera =
            CameraModel { size, focal: [focal, focal], centre: middle, lens: Lens::default() };
        Self { centre, camera, distance, turn: turn(yaw, pitch) }
    }

    /// Half the side of the square about the middle that the surface fills in such a view.
    pub fn reach(vertices: &[Point3], yaw: f64, pitch: f64) -> f64 {
        let (centre, turn) = (middle(vertices), turn(yaw, pitch));
        let out = |p: &Point3| (turn * (p - centre)).xy().amax();
        vertices.iter().map(out).fold(1e-9, f64::max)
    }

    /// The window that surfaces fill, seen from where `first` fixes the viewer.
    pub fn window<'a>(
        first: &[Point3],
        surfaces: impl Iterator<Item = &'a [Point3]>,
        [yaw, pitch]: [f64; 2],
    ) -> Window {
        let view = Self::turned_by(first, [1, 1], yaw, pitch);
        let plane = |p: &Point3| {
            let p = view.turned(p);
            [p.x, p.y].map(|v| v * view.distance / p.z)
        };
        let mut window = Window { low: [f64::INFINITY; 2], high: [f64::NEG_INFINITY; 2] };
        for p in surfaces.flatten().map(plane) {
            for (k, v) in p.into_iter().enumerate() {
                window.low[k] = window.low[k].min(v);
                window.high[k] = window.high[k].max(v);
            }
        }
        window
    }

    /// Look through a window, `size` pixels for it, `scale` px per length unit at the middle of
    /// `first`.
    pub fn through(
        first: &[Point3],
        [yaw, pitch]: [f64; 2],
        window: Window,
        size: [usize; 2],
        scale: f64,
    ) -> Self {
        let mut view = Self::turned_by(first, size, yaw, pitch);
        view.camera.focal = [scale * view.distance; 2];
        let middle = |k: usize| 0.5 * (window.low[k] + window.high[k]);
        let centre = |k: usize| 0.5 * (size[k] as f64 - 1.0) - scale * middle(k);
        view.camera.centre = [centre(0), centre(1)];
        view
    }

    fn turned(&self, p: &Point3) -> Point3 {
        Point3::from(self.turn * (p - self.centre) + Vector3::z() * self.distance)
    }

    /// Which face is seen in every pixel, and how far.
    pub fn raster(&self, topology: &Topology, vertices: &[Point3]) -> Raster {
        let turned: Vec<Point3> = vertices.iter().map(|p| self.turned(p)).collect();
        rasterize(&self.camera, topology, &turned)
    }

    /// How much a normal faces this view, in `[0, 1]`, either way round.
    pub fn facing(&self, normal: &Vector3) -> f64 {
        (self.turn * normal).z.abs()
    }

    /// A shaded picture; `colour` per vertex, or one grey for all.
    pub fn render(
        &self,
        topology: &Topology,
        vertices: &[Point3],
        colour: Option<&[[u8; 3]]>,
    ) -> RgbImage {
        self.render_with(topology, vertices, PAPER, |face, w| {
            let mut base = [0.0; 3];
            for (&v, w) in topology.faces[face].iter().zip(w) {
                let c = colour.map_or(CLAY, |c| c[v as usize]);
                (0..3).for_each(|k| base[k] += w * f64::from(c[k]));
            }
            base
        })
    }

    /// A shaded picture; the colour (0 to 255) by face and barycentrics.
    pub fn render_with(
        &self,
        topology: &Topology,
        vertices: &[Point3],
        background: [u8; 3],
        colour: impl Fn(usize, [f64; 3]) -> [f64; 3],
    ) -> RgbImage {
        let turned: Vec<Point3> = vertices.iter().map(|p| self.turned(p)).collect();
        let normals = vertex_normals(topology, &turned);
        let raster = rasterize(&self.camera, topology, &turned);
        let shade = |i: usize| {
            let face = topology.faces.get(raster.face[i] as usize)?;
            let w = raster.barycentric[i];
            let normal: Vector3 = face.iter().zip(w).map(|(&v, w)| normals[v as usize] * w).sum();
            let facing = -normal.try_normalize(0.0)?.dot(&Vector3::new(0.25, 0.35, 0.9));
            let light = if facing >= 0.0 { 0.35 + 0.7 * facing } else { 0.35 - 0.15 * facing };
            let base = colour(raster.face[i] as usize, w);
            Some(base.map(|b| (b * light).clamp(0.0, 255.0) as u8))
        };
        let [w, h] = raster.size;
        RgbImage::from_fn(w as u32, h as u32, |x, y| {
            image::Rgb(shade(y as usize * w + x as usize).unwrap_or(background))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn side_view_shows_the_surface_from_the_side() {
        // A thin vertical plate facing the camera is narrow from the side.
        let corners = [[-5., -20., 80.], [5., -20., 80.], [5., 20., 80.], [-5., 20., 80.]];
        let vertices: Vec<Point3> = corners.iter().map(|c| Point3::from(*c)).collect();
        let topology = Topology::new(4, vec![[0, 2, 1], [0, 3, 2]]).unwrap();
        let view = SideView::of(&vertices, [100, 100]);
        let seen = view.render(&topology, &vertices, None);
        let paper = *seen.get_pixel(0, 0);
        let width = (0..100).filter(|&x| *seen.get_pixel(x, 50) != paper).count();
        let height = (0..100).filter(|&y| *seen.get_pixel(50, y) != paper).count();
        assert!((7..=12).contains(&width) && height > 70, "{width} x {height}");
    }

    #[test]
    fn a_window_holds_the_surface_and_no_more() {
        let vertices: Vec<Point3> =
            [[-5., -20., 80.], [9., -20., 85.], [9., 20., 80.], [-5., 20., 75.]]
                .map(Point3::from)
                .to_vec();
        let topology = Topology::new(4, vec![[0, 2, 1], [0, 3, 2]]).unwrap();
        for turned in [[0.0, 0.0], [40.0, 10.0]] {
            let window = SideView::window(&vertices, std::iter::once(&vertices[..]), turned);
            let scale = 4.0;
            let size = window.size().map(|v| (v * scale).round() as usize);
            let seen = SideView::through(&vertices, turned, window, size, scale)
                .render(&topology, &vertices, None);
            let paper = |x: u32, y: u32| seen.get_pixel(x, y).0 == PAPER;
            let [w, h] = size.map(|n| n as u32);
            // Every side of the picture is touched within two pixels.
            assert!((0..h).any(|y| !paper(1, y)) && (0..h).any(|y| !paper(w - 2, y)), "{turned:?}");
            assert!((0..w).any(|x| !paper(x, 1)) && (0..w).any(|x| !paper(x, h - 2)), "{turned:?}");
        }
    }
}
