//! The look of the surface in the frames themselves: from the best view of each face, and blended
//! over all views.

use crate::camera::{Camera, PosedFrame};
use crate::geometry::{Point3, area_normal, point_at};
use crate::image::{Bilinear, saturation};
use crate::mesh::Mesh;
use crate::raster::{OCCLUSION_TOLERANCE, rasterize};
use rayon::prelude::*;

/// Colours of surface points.
pub struct Texture<'a> {
    mesh: &'a Mesh,
    views: Vec<TexturedView<'a>>,
    /// Best view of every face.
    best: Vec<Option<u32>>,
}

struct TexturedView<'a> {
    view: PosedFrame<'a>,
    positions: Vec<Point3>,
    /// Depth of the surface at every pixel; minus infinity where the pixel must not be used.
    depth: Vec<f32>,
}

/// Least cosine between the normal and the sightline.
const MIN_COSINE: f64 = 0.2;
/// Sharpness of blending: the power of a view's resolution on the surface.
const BLEND_POWER: i32 = 2;

impl<'a> Texture<'a> {
    /// Prepare all views of a surface, `camera_from_template`; pixels outside their masks are not
    /// used.
    pub fn new(mesh: &'a Mesh, views: &[PosedFrame<'a>]) -> Self {
        let views: Vec<TexturedView> =
            views.par_iter().map(|v| TexturedView::new(mesh, *v)).collect();
        let best = (0..mesh.topology.faces.len()).into_par_iter().map(|f| best(&views, mesh, f));
        let best = best.collect();
        Self { mesh, views, best }
    }

    /// Encoded colour in the face's best view: the one of the highest resolution among those that
    /// see the whole face without glare. `None` where there is none.
    pub fn best(&self, face: usize, barycentric: [f64; 3]) -> Option<[u8; 3]> {
        let view = &self.views[self.best[face]? as usize];
        let colour = view.sample(self.mesh, face, barycentric)?.1;
        Some(colour.map(|v| v.round() as u8))
    }

    /// Encoded colour over all views that see the point without glare, by resolution; `None` where
    /// there is none.
    pub fn blended(&self, face: usize, barycentric: [f64; 3]) -> Option<[u8; 3]> {
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for (resolution, colour) in
            self.views.iter().filter_map(|v| v.sample(self.mesh, face, barycentric))
        {
            let weight = resolution.powi(BLEND_POWER);
            total += weight;
            (0..3).for_each(|c| sum[c] += weight * colour[c]);
        }
        (total > 0.0).then(|| sum.map(|v| (v / total).round() as u8))
    }
}

fn best(views: &[TexturedView], mesh: &Mesh, face: usize) -> Option<u32> {
    let inside = [[0.9, 0.05, 0.05], [0.05, 0.9, 0.05], [0.05, 0.05, 0.9], [1.0 / 3.0; 3]];
    let score = |view: &TexturedView| -> Option<f64> {
        let all: Option<Vec<f64>> =
            inside.iter().map(|&b| Some(view.sample(mesh, face, b)?.0)).collect();
        all.map(|all| all.iter().sum())
    };
    let scores = views.iter().enumerate().filter_map(|(i, v)| Some((score(v)?, i as u32)));
    // Of equal scores the first.
    scores.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1))).map(|s| s.1)
}

impl<'a> TexturedView<'a> {
    fn new(mesh: &Mesh, view: PosedFrame<'a>) -> Self {
        let positions: Vec<Point3> = mesh.positions.iter().map(|p| view.pose * p).collect();
        let raster = rasterize(view.camera, &mesh.topology, &positions);
        let saturated = saturation(view.frame);
        let masks = [view.valid, view.organ];
        let usable = |i: usize| masks.iter().flatten().all(|m| m.data[i]) && !saturated.data[i];
        let depth = |(i, &z): (usize, &f64)| if usable(i) { z as f32 } else { f32::NEG_INFINITY };
        let depth = raster.depth.iter().enumerate().map(depth).collect();
        Self { view, positions, depth }
    }

    /// Resolution (px² per area of the surface, up to the focal lengths) and encoded colour of a
    /// point, where this view sees it.
    fn sample(&self, mesh: &Mesh, face: usize, barycentric: [f64; 3]) -> Option<(f64, [f64; 3])> {
        let corners = mesh.topology.faces[face].map(|v| &self.positions[v as usize]);
        let point = point_at(corners, barycentric);
        let [a, b, c] = corners;
        let cosine = -area_normal(a, b, c).try_normalize(0.0)?.dot(&point.coords.normalize());
        let pixel = self.view.camera.project(&point)?.pixel;
        let size = self.view.camera.size;
        if cosine < MIN_COSINE {
            return None;
        }
        let four = Bilinear::at(&pixel, size)?;
        let nearest = pixel.y.round() as usize * size[0] + pixel.x.round() as usize;
        let seen = point.z <= f64::from(self.depth[nearest]) * (1.0 + OCCLUSION_TOLERANCE);
        seen.then(|| (cosine / (point.z * point.z), four.colour(|i| self.view.frame.rgb[i])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraModel;
    use crate::geometry::Isometry;
    use crate::image::Frame;
    use crate::mesh::shapes;

    #[test]
    fn the_nearer_view_wins_and_glare_is_left_out() {
        let p = |x: f64, y: f64| Point3::new(x, y, 10.0);
        let mesh = shapes::mesh(
            vec![p(-1., -1.), p(1., -1.), p(1., 1.), p(-1., 1.)],
            vec![[0, 2, 1], [0, 3, 2]],
        );
        let camera = CameraModel::pinhole([41, 41], [100.0; 2], [20.0; 2]);
        let plain = |value: u8| Frame {
            name: String::new(),
            size: [41, 41],
            rgb: vec![[value, 100, 100]; 41 * 41],
        };
        let (far, near) = (plain(50), plain(200));
        let mut glare = plain(200);
        glare.rgb.fill([255; 3]);
        let view = |frame, z| PosedFrame::new(frame, &camera, Isometry::translation(0.0, 0.0, z));
        let both = [view(&far, 10.0), view(&near, 0.0)];
        let centre = [1.0 / 3.0; 3];
        let texture = Texture::new(&mesh, &both);
        assert_eq!(texture.best(0, centre), Some([200, 100, 100]));
        // Weights 1 and 1/16 after squaring (10/20)².
        let mean = (200.0 + 50.0 / 16.0) / (1.0 + 1.0 / 16.0);
        assert_eq!(texture.blended(1, centre).unwrap()[0], f64::round(mean) as u8);
        let bright = [view(&far, 10.0), view(&glare, 0.0)];
        let texture = Texture::new(&mesh, &bright);
        assert_eq!(texture.best(0, centre), Some([50, 100, 100]));
        let none = [both[0]]
            .map(|v| PosedFrame { pose: Isometry::rotation(nalgebra::Vector3::x() * 3.0), ..v });
        assert_eq!(Texture::new(&mesh, &none).best(0, centre), None);
    }
}
