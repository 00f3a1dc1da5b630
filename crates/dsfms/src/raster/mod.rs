//! Z-buffer rasteriser: depth, face and barycentrics of every pixel; vertex visibility.
//!
//! The corners of a face are projected by the full camera model and joined by straight image
//! lines, between which `1/z` is linear: exact for a pinhole, and for a distorted lens exact up to
//! the bend of one edge (of the order of a hundredth of a pixel for edges of ten pixels).

mod coverage;
pub mod regions;

use crate::camera::{Camera, CameraModel};
use crate::geometry::{GRAIN, Point2, Point3, area_normal, point_at};
use crate::image::{Mask, nearest_pixel};
use crate::mesh::Topology;
use coverage::{ScreenCorners, ScreenFace, screen_faces};
use rayon::prelude::*;

/// Rows rendered by one task; fixed, so that the result never depends on the number of threads.
const BAND_ROWS: usize = 32;

/// A point counts as seen within this of the z-buffer, relative to its depth: more than a z-buffer
/// is off by on the slope of a face, less than the next fold of an organ lies behind.
pub(crate) const OCCLUSION_TOLERANCE: f64 = 0.01;

/// What the camera sees of a surface, per pixel, row major.
#[derive(Clone, Debug)]
pub struct Raster {
    /// Width and height in px.
    pub size: [usize; 2],
    /// Depth z of the nearest surface point, length units; infinity where there is none.
    pub depth: Vec<f64>,
    /// Its face; `u32::MAX` where there is none.
    pub face: Vec<u32>,
    /// Its barycentrics on the face (perspective-correct: they weight 3D corners).
    pub barycentric: Vec<[f64; 3]>,
}

/// Render the surface (positions in camera axes) at every pixel centre; both sides of a face are
/// drawn. Faces with a corner that does not project are skipped.
///
/// A pixel centre on an edge belongs to the faces on both sides of it, so a closed surface has no
/// cracks; of several faces at the same depth the one with the smallest index is kept.
#[doc(alias = "z-buffer")]
pub fn rasterize(camera: &CameraModel, topology: &Topology, positions: &[Point3]) -> Raster {
    let size = camera.size();
    let n = size[0] * size[1];
    let mut raster = Raster {
        size,
        depth: vec![f64::INFINITY; n],
        face: vec![u32::MAX; n],
        barycentric: vec![[0.0; 3]; n],
    };
    if n == 0 {
        return raster;
    }
    let corner = |p: &Point3| camera.project(p).map(|q| (q.pixel, 1.0 / p.z));
    let corners: Vec<_> = positions.par_iter().with_min_len(GRAIN).map(corner).collect();
    let faces = screen_faces(topology, &corners, size);
    let in_bands = by_band(&faces, size[1]);
    let chunk = BAND_ROWS * size[0];
    raster
        .depth
        .par_chunks_mut(chunk)
        .zip(raster.face.par_chunks_mut(chunk))
        .zip(raster.barycentric.par_chunks_mut(chunk))
        .enumerate()
        .for_each(|(band, ((depth, face), barycentric))| {
            let rows = [band * BAND_ROWS, band * BAND_ROWS + depth.len() / size[0]];
            let mut band_rows = Band { rows, width: size[0], depth, face, barycentric };
            for face in in_bands[band].iter().map(|&f| &faces[f as usize]) {
                if let Some(on) = ScreenCorners::of(topology.faces[face.index as usize], &corners) {
                    band_rows.draw(face, &on);
                }
            }
        });
    raster
}

/// The faces that every band of rows may show, in their order.
fn by_band(faces: &[ScreenFace], height: usize) -> Vec<Vec<u32>> {
    let mut bands = vec![Vec::new(); height.div_ceil(BAND_ROWS)];
    for (f, face) in faces.iter().enumerate() {
        let [first, last] = face.y.map(|y| y as usize / BAND_ROWS);
        bands[first..=last].iter_mut().for_each(|band| band.push(f as u32));
    }
    bands
}

/// A run of rows that one task fills.
struct Band<'a> {
    rows: [usize; 2],
    width: usize,
    depth: &'a mut [f64],
    face: &'a mut [u32],
    barycentric: &'a mut [[f64; 3]],
}

impl Band<'_> {
    fn draw(&mut self, face: &ScreenFace, corners: &ScreenCorners) {
        let [first, last] = face.y.map(|y| y as usize);
        for y in first.max(self.rows[0])..=last.min(self.rows[1] - 1) {
            let (row, start) = (corners.row(y as f64), (y - self.rows[0]) * self.width);
            let columns =
                (face.x[0]..=face.x[1]).map(|x| (start + x as usize, row.at(f64::from(x))));
            // A row meets a triangle in one run.
            let run = columns.skip_while(|c| c.1.is_none());
            for (i, here) in run.map_while(|(i, here)| Some((i, here?))) {
                if here.depth < self.depth[i] {
                    self.depth[i] = here.depth;
                    self.face[i] = face.index;
                    self.barycentric[i] = here.barycentric();
                }
            }
        }
    }
}

impl Raster {
    /// Face and barycentrics at column `x`, row `y`; `None` where there is no surface.
    pub fn surface(&self, x: usize, y: usize) -> Option<(u32, [f64; 3])> {
        let i = y * self.size[0] + x;
        (self.face[i] != u32::MAX).then(|| (self.face[i], self.barycentric[i]))
    }

    /// Face and barycentrics at the pixel nearest to `p`; `None` outside the image or the surface.
    pub(crate) fn surface_at(&self, p: &Point2) -> Option<(u32, [f64; 3])> {
        let [x, y] = nearest_pixel(p, self.size)?;
        self.surface(x, y)
    }

    /// The surface point nearest pixel `p` shows, in the frame of `positions` (camera axes, or the
    /// template's own frame: barycentrics do not care); `None` outside the image or the surface.
    pub fn point(&self, p: &Point2, topology: &Topology, positions: &[Point3]) -> Option<Point3> {
        let (face, weights) = self.surface_at(p)?;
        let corners = topology.faces[face as usize].map(|v| &positions[v as usize]);
        Some(point_at(corners, weights))
    }

    /// Any function of the surface as an image: `value(face, barycentric)` where there is surface,
    /// `background` elsewhere; row major.
    pub fn render<T: Copy + Send + Sync>(
        &self,
        background: T,
        value: impl Fn(usize, [f64; 3]) -> T + Sync,
    ) -> Vec<T> {
        (0..self.face.len())
            .into_par_iter()
            .map(|i| match self.face[i] {
                u32::MAX => background,
                face => value(face as usize, self.barycentric[i]),
            })
            .collect()
    }

    /// Barycentrics of the middles of a pixel's four quarters, on the face of its centre and as far
    /// as its neighbours tell; the pixel by its index, where there is surface.
    pub fn quarters(&self, i: usize) -> [[f64; 3]; 4] {
        let (width, b) = (self.size[0], self.barycentric[i]);
        let column = i % width;
        let across = self.slope(i, 1, column > 0, column + 1 < width);
        let down = self.slope(i, width, i >= width, i + width < self.face.len());
        let at = |x: f64, y: f64| [0, 1, 2].map(|k| b[k] + 0.25 * (x * across[k] + y * down[k]));
        [at(-1.0, -1.0), at(1.0, -1.0), at(-1.0, 1.0), at(1.0, 1.0)]
    }

    /// Change of the barycentrics from one pixel to the next; 0 where no neighbour shows the face.
    fn slope(&self, i: usize, step: usize, before: bool, after: bool) -> [f64; 3] {
        let same = |j: usize| self.face[j] == self.face[i];
        let between =
            |a: usize, b: usize| [0, 1, 2].map(|k| self.barycentric[b][k] - self.barycentric[a][k]);
        if after && same(i + step) {
            between(i, i + step)
        } else if before && same(i - step) {
            between(i - step, i)
        } else {
            [0.0; 3]
        }
    }

    /// [`Raster::render`] of a function of the barycentrics that [`Raster::quarters`] gives.
    pub(crate) fn render_quarters<T: Copy + Send + Sync>(
        &self,
        background: T,
        value: impl Fn(usize, [[f64; 3]; 4]) -> T + Sync,
    ) -> Vec<T> {
        (0..self.face.len())
            .into_par_iter()
            .map(|i| match self.face[i] {
                u32::MAX => background,
                face => value(face as usize, self.quarters(i)),
            })
            .collect()
    }

    /// `true` where there is surface.
    pub fn silhouette(&self) -> Mask {
        Mask { size: self.size, data: self.face.iter().map(|&f| f != u32::MAX).collect() }
    }
}

/// Which vertices the camera sees: projected inside the image, some face around them turned to the
/// camera, and not behind the z-buffer by more than `tolerance` length units.
pub fn visible_vertices(
    camera: &CameraModel,
    topology: &Topology,
    positions: &[Point3],
    raster: &Raster,
    tolerance: f64,
) -> Vec<bool> {
    let faces_camera = |face: &[u32; 3]| {
        let [a, b, c] = face.map(|v| &positions[v as usize]);
        area_normal(a, b, c).dot(&(a.coords + b.coords + c.coords)) < 0.0
    };
    let faces_camera: Vec<bool> =
        topology.faces.par_iter().with_min_len(GRAIN).map(faces_camera).collect();
    (0..positions.len())
        .into_par_iter()
        .map(|v| {
            topology.vertex_faces[v].iter().any(|&f| faces_camera[f as usize])
                && camera.project(&positions[v]).is_some_and(|p| {
                    unoccluded(topology, raster, v as u32, &p.pixel, positions[v].z - tolerance)
                })
        })
        .collect()
}

/// Whether nothing at the pixel is nearer than `limit`, or one of the four pixels around shows a
/// face of the vertex itself (at a grazing angle the nearest pixel alone would hide it).
fn unoccluded(topology: &Topology, raster: &Raster, vertex: u32, p: &Point2, limit: f64) -> bool {
    let [w, h] = raster.size.map(|s| s as f64);
    let (x, y) = (p.x.round(), p.y.round());
    if !(x >= 0.0 && y >= 0.0 && x < w && y < h) {
        return false;
    }
    if raster.depth[y as usize * raster.size[0] + x as usize] >= limit {
        return true;
    }
    [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].into_iter().any(|(dx, dy)| {
        let corner = Point2::new(p.x.floor() + dx, p.y.floor() + dy);
        raster
            .surface_at(&corner)
            .is_some_and(|(f, _)| topology.faces[f as usize].contains(&vertex))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Lens;

    pub(super) fn camera(size: [usize; 2]) -> CameraModel {
        CameraModel {
            size,
            focal: [40.0, 40.0],
            centre: [(size[0] / 2) as f64, (size[1] / 2) as f64],
            lens: Lens::Pinhole,
        }
    }

    /// A tilted quadrilateral `z = 10 + x` covering the image, and a small triangle before it.
    fn scene() -> (Topology, Vec<Point3>) {
        let at = |x: f64, y: f64| Point3::new(x, y, 10.0 + x);
        let mut points = vec![at(-5.0, -9.0), at(-5.0, 9.0), at(9.0, -9.0), at(9.0, 9.0)];
        points.extend([[0.0, 0.0], [0.0, 0.5], [0.5, 0.0]].map(|[x, y]| Point3::new(x, y, 5.0)));
        (Topology::new(7, vec![[0, 1, 2], [2, 1, 3], [4, 5, 6]]).unwrap(), points)
    }

    #[test]
    fn depth_of_a_tilted_plane_is_exact() {
        let (topology, points) = scene();
        let camera = camera([33, 31]);
        let raster = rasterize(&camera, &topology, &points);
        for (x, y) in [(3, 4), (30, 5), (12, 28)] {
            let u = (x as f64 - 16.0) / 40.0; // x = u z and z = 10 + x
            assert!((raster.depth[y * 33 + x] - 10.0 / (1.0 - u)).abs() < 1e-9);
            let pixel = Point2::new(x as f64, y as f64);
            let p = raster.point(&pixel, &topology, &points).unwrap();
            assert!((camera.project(&p).unwrap().pixel - pixel).norm() < 1e-9);
        }
        assert!(raster.silhouette().data.iter().all(|&v| v), "no cracks along the diagonal");
    }

    #[test]
    fn quarters_surround_the_centre_of_a_pixel() {
        let (topology, points) = scene();
        let camera = camera([33, 31]);
        let raster = rasterize(&camera, &topology, &points);
        let pixel_of = |face: u32, b: [f64; 3]| {
            let corners = topology.faces[face as usize].map(|v| &points[v as usize]);
            camera.project(&point_at(corners, b)).unwrap().pixel
        };
        let (x, y) = (30, 5);
        let (face, _) = raster.surface(x, y).unwrap();
        let quarters = raster.quarters(y * 33 + x).map(|b| pixel_of(face, b));
        let offsets = [[-0.25, -0.25], [0.25, -0.25], [-0.25, 0.25], [0.25, 0.25]];
        for (at, [dx, dy]) in quarters.iter().zip(offsets) {
            let expected = Point2::new(x as f64 + dx, y as f64 + dy);
            assert!((at - expected).norm() < 0.02, "{at} {expected}");
        }
        // The mean of what is linear is that of the centre.
        let columns = raster.render_quarters(f64::NAN, |face, quarters| {
            quarters.map(|b| pixel_of(face as u32, b).x).iter().sum::<f64>() / 4.0
        });
        assert!((columns[y * 33 + x] - x as f64).abs() < 0.02);
    }

    #[test]
    fn the_nearer_triangle_hides_what_lies_behind() {
        let (topology, mut points) = scene();
        let camera = camera([33, 31]);
        let raster = rasterize(&camera, &topology, &points);
        assert_eq!(raster.surface(17, 16).unwrap().0, 2);
        assert!((raster.depth[16 * 33 + 17] - 5.0).abs() < 1e-12);
        // A vertex of the plane moved behind the triangle is hidden, the triangle's own are seen.
        points[0] = Point3::new(0.2, 0.2, 10.2);
        let visible = visible_vertices(&camera, &topology, &points, &raster, 0.1);
        assert_eq!(visible[..2], [false, false], "hidden; outside the image");
        assert!(visible[4] && visible[5] && visible[6]);
    }

    #[test]
    fn an_empty_or_unprojectable_surface_gives_an_empty_raster() {
        let topology = Topology::new(3, vec![[0, 1, 2]]).unwrap();
        let behind = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[x, y]| Point3::new(x, y, -1.0));
        let raster = rasterize(&camera([8, 8]), &topology, &behind);
        assert!(raster.depth.iter().all(|d| d.is_infinite()));
        assert_eq!(raster.silhouette().coverage(), 0.0);
        assert_eq!(raster.surface_at(&Point2::new(-3.0, 1.0)), None);
    }
}
