//! Which vertices may speak of shading, which mirror the light, and what albedo they have.

use super::RefineOptions;
use crate::camera::{Camera, CameraModel};
use crate::energy::diffuse::DiffuseVertex;
use crate::geometry::{Point3, Vector3, point_at};
use crate::image::filter::blur_masked;
use crate::image::{Mask, Plane};
use crate::light::{Light, LightModel};
use crate::mesh::{Mesh, Topology};
use crate::mesh::normals::vertex_normals;
use crate::raster::{Raster, rasterize, regions::distance_to, visible_vertices};
use crate::template::SurfaceTexels;

/// The photometric side of one frame.
#[derive(Clone, Copy, Debug)]
pub struct Photograph<'a> {
    /// Camera of the frame.
    pub camera: &'a CameraModel,
    /// Grey image in linear light.
    pub grey: &'a Plane,
    /// `true` at saturated pixels.
    pub saturated: &'a Mask,
    /// `true` where the organ may be seen (no instrument, inside the organ mask if there is one).
    pub usable: &'a Mask,
    /// Light of the frame.
    pub light: &'a LightModel,
    /// Albedo of the template.
    pub albedo: &'a SurfaceTexels,
    /// Expected log gain; 0 when template and frame share their exposure.
    pub expected_log_gain: Option<f64>,
}

/// What one shape makes of a photograph.
#[derive(Clone, Debug)]
pub struct Evidence {
    /// Image smoothed within what is usable.
    pub image: Plane,
    /// The diffuse vertices `𝒟ᵥ`.
    pub diffuse: Vec<DiffuseVertex>,
    /// The specular vertices `𝒮ᵥ` with their mirror normals.
    pub specular: Vec<(u32, Vector3)>,
    /// Vertices the camera sees.
    pub visible: Vec<bool>,
    /// Robust ratio of image to prediction, the start of the gain.
    pub log_gain: f64,
}

/// Look at the photograph with the surface at `shape` (camera axes).
pub fn gather(
    photo: &Photograph,
    rest: &Mesh,
    shape: &[Point3],
    options: &RefineOptions,
) -> Evidence {
    let raster = rasterize(photo.camera, &rest.topology, shape);
    // Half a mean edge is what the z-buffer may be off at a slanted face.
    let tolerance = 0.5 * rest.mean_edge_length();
    let visible = visible_vertices(photo.camera, &rest.topology, shape, &raster, tolerance);
    let diagonal = diagonal(photo.grey);
    let normals = vertex_normals(&rest.topology, shape);
    let mirror_deg = if options.literal { 0.0 } else { options.specular_deg };
    let surface = Surface { topology: &rest.topology, shape, normals: &normals, raster: &raster };
    let clear = clear_mask(photo, &surface, options.halo * diagonal, mirror_deg);
    let sigma = options.blur * diagonal;
    let (image, _) = blur_masked(photo.grey, &clear, sigma);
    let (albedo, support) = blur_masked(&render_albedo(&raster, photo.albedo), &clear, sigma);
    let contour = distance_to(&raster.discontinuities(0.05));
    let (mut diffuse, mut specular, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
    for v in (0..shape.len()).filter(|&v| visible[v] && !rest.topology.boundary[v]) {
        let Some(projection) = photo.camera.project(&shape[v]) else { continue };
        let pixel = projection.pixel;
        if photo.saturated.at_pixel(&pixel) {
            if photo.usable.at_pixel(&pixel) {
                specular.push((v as u32, photo.light.mirror_normal(&shape[v])));
            }
            continue;
        }
        let shade = photo.light.shade(&shape[v], &normals[v]).value;
        let cosine = -normals[v].dot(&shape[v].coords.normalize());
        let i = pixel.y.round() as usize * image.size[0] + pixel.x.round() as usize;
        let near_contour = (contour[i] as f64) < options.contour_blurs * sigma;
        let excluded = cosine < options.grazing || near_contour;
        if !clear.at_pixel(&pixel) || support.data[i] < 0.5 || (excluded && !options.literal) {
            continue;
        }
        let Some((alpha, _)) = albedo.sample(&pixel) else { continue };
        let Some((intensity, _)) = image.sample(&pixel) else { continue };
        if alpha * shade > 1e-4 && intensity > 0.0 {
            ratios.push((intensity / (alpha * shade)).ln());
        }
        diffuse.push(DiffuseVertex { vertex: v as u32, albedo: alpha, sigma: intensity });
    }
    let (log_gain, spread) = centre_and_spread(&mut ratios);
    let noise = Noise::measured(spread, options.sigma_relative, options.sigma_absolute);
    diffuse.iter_mut().for_each(|d| d.sigma = noise.at(d.sigma));
    Evidence { image, diffuse, specular, visible, log_gain }
}

/// Image diagonal, px.
pub(super) fn diagonal(plane: &Plane) -> f64 {
    (plane.size[0] as f64).hypot(plane.size[1] as f64)
}

/// A shape as the camera sees it.
pub(super) struct Surface<'a> {
    pub(super) topology: &'a Topology,
    pub(super) shape: &'a [Point3],
    /// Of the vertices.
    pub(super) normals: &'a [Vector3],
    pub(super) raster: &'a Raster,
}

/// Surface pixels whose brightness is diffuse: usable, albedo known, not saturated nor in a halo,
/// nor, in a frame with highlights, within `mirror_deg` of the mirror direction. What is left out
/// here must not reach its neighbours through a blur.
pub(super) fn clear_mask(
    photo: &Photograph,
    surface: &Surface,
    halo: f64,
    mirror_deg: f64,
) -> Mask {
    let near_highlight = distance_to(photo.saturated);
    let highlights = photo.saturated.data.iter().any(|&s| s);
    let glossy = if highlights { mirror_deg.to_radians().cos() } else { f64::INFINITY };
    let known = surface.raster.render(false, |face, b| {
        let corners = surface.topology.faces[face].map(|v| v as usize);
        let point = point_at(corners.map(|v| &surface.shape[v]), b);
        let normal = corners.iter().zip(b).map(|(&v, w)| surface.normals[v] * w).sum::<Vector3>();
        let mirror = photo.light.mirror_normal(&point).dot(&normal) > glossy * normal.norm();
        photo.albedo.views[photo.albedo.index(face, b)] > 0 && !mirror
    });
    let data = (0..known.len())
        .map(|i| known[i] && photo.usable.data[i] && near_highlight[i] as f64 > halo)
        .collect();
    Mask { size: surface.raster.size, data }
}

pub(super) fn render_albedo(raster: &Raster, texels: &SurfaceTexels) -> Plane {
    let grey = |rgb: [f32; 3]| (rgb[0] + rgb[1] + rgb[2]) / 3.0;
    let data = raster.render(0.0, |face, b| grey(texels.at(face, b)));
    Plane { size: raster.size, data }
}

/// Noise of the image model: an absolute part, linear light, and one proportional to brightness.
pub(super) struct Noise {
    absolute: f64,
    relative: f64,
}

impl Noise {
    /// The relative part as the samples spread about their median, within bounds.
    pub(super) fn measured(spread: f64, [least, most]: [f64; 2], absolute: f64) -> Self {
        Self { absolute, relative: spread.clamp(least, most) }
    }

    /// Standard deviation at a brightness.
    pub(super) fn at(&self, intensity: f64) -> f64 {
        self.absolute.hypot(self.relative * intensity)
    }
}

/// Median, and standard deviation of a normal distribution with the same median absolute deviation.
pub(super) fn centre_and_spread(values: &mut [f64]) -> (f64, f64) {
    let centre = median(values);
    let mut deviations: Vec<f64> = values.iter().map(|v| (v - centre).abs()).collect();
    (centre, 1.4826 * median(&mut deviations))
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
