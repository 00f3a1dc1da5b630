//! Small pictures of a result: the mesh over its image, and a shaded view from the side.

use dsfms::camera::{Camera, CameraModel, Lens};
use dsfms::geometry::{Isometry, Point2, Point3, Vector3};
use dsfms::image::Frame;
use dsfms::mesh::Topology;
use dsfms::mesh::normals::vertex_normals;
use dsfms::raster::{Raster, rasterize};
use dsfms::register::Match;
use image::RgbImage;

/// Kept matches.
const KEPT: [u8; 3] = [40, 220, 90];
/// Matches that were refused.
const REJECTED: [u8; 3] = [235, 40, 40];
const WIRE: [u8; 3] = [90, 210, 255];
/// Turn of the side view about the image's vertical axis, degrees.
const SIDE_DEG: f64 = 65.0;

/// The frame as an image that can be drawn on.
pub fn picture(frame: &Frame) -> RgbImage {
    let [w, h] = frame.size;
    RgbImage::from_fn(w as u32, h as u32, |x, y| image::Rgb(frame.rgb[y as usize * w + x as usize]))
}

/// The mesh's visible edges and the matches over the frame. `vertices` in camera axes.
pub fn overlay(
    frame: &Frame,
    camera: &CameraModel,
    topology: &Topology,
    vertices: &[Point3],
    visible: &[bool],
    matches: &[(Match, bool)],
) -> RgbImage {
    let mut canvas = picture(frame);
    let pixels: Vec<Option<Point2>> =
        vertices.iter().map(|p| camera.project(p).map(|q| q.pixel)).collect();
    for &[a, b] in &topology.edges {
        let (a, b) = (a as usize, b as usize);
        if !(visible[a] && visible[b]) {
            continue;
        }
        if let (Some(p), Some(q)) = (pixels[a], pixels[b]) {
            line(&mut canvas, p, q, WIRE, 0.55);
        }
    }
    for (m, kept) in matches {
        dot(&mut canvas, m.pixel, 3.5, [0, 0, 0], 0.7);
        dot(&mut canvas, m.pixel, 2.5, if *kept { KEPT } else { REJECTED }, 1.0);
    }
    canvas
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

/// Background of drawn views.
pub const PAPER: [u8; 3] = [246, 247, 249];
/// A surface without colours of its own.
pub const CLAY: [u8; 3] = [208, 178, 168];

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

    fn turned(&self, p: &Point3) -> Point3 {
        Point3::from(self.turn * (p - self.centre) + Vector3::z() * self.distance)
    }

    /// A length at the middle of the surface, px per length unit.
    pub fn scale(&self) -> f64 {
        self.camera.focal[0] / self.distance
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

/// Colour of an error between 0 (dark blue) and `full` (yellow).
pub fn error_colour(error: f64, full: f64) -> [u8; 3] {
    ramp(&CIVIDIS, error / full)
}

/// Perceptually uniform, also in grey and with colour-blind eyes (Nuñez et al. 2018).
pub const CIVIDIS: [[u8; 3]; 10] = [
    [0, 34, 78],
    [18, 53, 112],
    [59, 73, 108],
    [87, 93, 109],
    [112, 113, 115],
    [138, 134, 120],
    [165, 156, 116],
    [195, 179, 105],
    [225, 204, 85],
    [254, 232, 56],
];

/// Colour at `t` in `[0, 1]`, linear between evenly spaced stops.
pub fn ramp(stops: &[[u8; 3]], t: f64) -> [u8; 3] {
    let last = stops.len() - 1;
    let t = if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) } * last as f64;
    let k = (t as usize).min(last.saturating_sub(1));
    let u = t - k as f64;
    std::array::from_fn(|c| {
        let [a, b] = [stops[k], stops[k + 1]].map(|s| f64::from(s[c]));
        ((1.0 - u) * a + u * b).round() as u8
    })
}

/// Mix a colour into a pixel; outside the picture nothing happens.
pub fn blend(canvas: &mut RgbImage, x: i64, y: i64, colour: [u8; 3], alpha: f64) {
    if x < 0 || y < 0 || x >= i64::from(canvas.width()) || y >= i64::from(canvas.height()) {
        return;
    }
    let pixel = canvas.get_pixel_mut(x as u32, y as u32);
    for (value, c) in pixel.0.iter_mut().zip(colour) {
        *value = (f64::from(*value) * (1.0 - alpha) + f64::from(c) * alpha).round() as u8;
    }
}

/// An anti-aliased line one pixel wide: along its longer axis, the two pixels across it share the
/// opacity by their distance.
pub fn line(canvas: &mut RgbImage, from: Point2, to: Point2, colour: [u8; 3], opacity: f64) {
    let reach = 4.0 * f64::from(canvas.width().max(canvas.height()));
    if [from, to].iter().any(|p| !(p.x.abs() < reach && p.y.abs() < reach)) {
        return;
    }
    let d = to - from;
    let steep = d.y.abs() > d.x.abs();
    let along = |p: Point2| if steep { (p.y, p.x) } else { (p.x, p.y) };
    let (mut a, mut b) = (along(from), along(to));
    if a.0 > b.0 {
        std::mem::swap(&mut a, &mut b);
    }
    let slope = if b.0 > a.0 { (b.1 - a.1) / (b.0 - a.0) } else { 0.0 };
    for s in a.0.round() as i64..=b.0.round() as i64 {
        let t = a.1 + slope * (s as f64 - a.0);
        let low = t.floor();
        for (c, weight) in [(low, 1.0 - (t - low)), (low + 1.0, t - low)] {
            let (x, y) = if steep { (c as i64, s) } else { (s, c as i64) };
            blend(canvas, x, y, colour, opacity * weight);
        }
    }
}

/// A filled disc with a soft rim.
pub fn dot(canvas: &mut RgbImage, at: Point2, radius: f64, colour: [u8; 3], opacity: f64) {
    if !(at.x.is_finite() && at.y.is_finite()) {
        return;
    }
    let reach = radius.ceil() as i64 + 1;
    let (cx, cy) = (at.x.round() as i64, at.y.round() as i64);
    for y in cy - reach..=cy + reach {
        for x in cx - reach..=cx + reach {
            let distance = (Point2::new(x as f64, y as f64) - at).norm();
            let cover = (radius + 0.5 - distance).clamp(0.0, 1.0);
            if cover > 0.0 {
                blend(canvas, x, y, colour, opacity * cover);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slanted_line_is_opaque_across() {
        let mut canvas = RgbImage::new(20, 20);
        line(&mut canvas, Point2::new(2.0, 3.3), Point2::new(17.0, 9.1), [255; 3], 1.0);
        for x in 2..=17 {
            let column: u32 = (0..20).map(|y| u32::from(canvas.get_pixel(x, y).0[0])).sum();
            assert!((254..=256).contains(&column), "{column} at {x}");
        }
    }

    #[test]
    fn points_outside_are_no_trouble() {
        let mut canvas = RgbImage::new(8, 8);
        line(&mut canvas, Point2::new(-1e30, f64::NAN), Point2::new(4.0, 4.0), [255; 3], 1.0);
        dot(&mut canvas, Point2::new(-3.0, 20.0), 2.0, [255; 3], 1.0);
        assert!(canvas.pixels().all(|p| p.0 == [0; 3]));
    }

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
}
