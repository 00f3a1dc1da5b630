//! Which vertices show shading, which mirror the light, and what albedo they have.

use super::glare::weigh;
use super::look::{FrameLook, LookOptions};
use super::{Photograph, RefineOptions};
use crate::camera::Camera;
use crate::energy::diffuse::DiffuseVertex;
use crate::geometry::{Point3, Vector3, turn_between};
use crate::image::{ColorImage, diagonal};
use crate::mesh::Mesh;
use crate::mesh::normals::vertex_normals;
use crate::raster::visible_vertices;
use crate::register::Body;
use nalgebra::Matrix3;

/// What one shape makes of a photograph.
#[derive(Clone, Debug)]
pub struct ShadingEvidence {
    /// Image smoothed within what is usable.
    pub image: ColorImage,
    /// The diffuse vertices `𝒟ᵥ`.
    pub diffuse: Vec<DiffuseVertex>,
    /// The specular vertices `𝒮ᵥ` with their mirror normals.
    pub specular: Vec<(u32, Vector3)>,
    /// Vertices the camera sees.
    pub visible: Vec<bool>,
    /// Robust ratio of image to prediction, the start of the gain.
    pub log_gain: f64,
}

impl ShadingEvidence {
    /// The vertices that the camera sees.
    pub(super) fn seen(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.visible.len() as u32).filter(|&v| self.visible[v as usize])
    }

    /// Their number; at least 1.
    pub(super) fn seen_count(&self) -> usize {
        self.seen().count().max(1)
    }
}

/// The photograph with the surface at `shape` (camera axes).
pub(super) fn look_at<'a>(
    photo: &'a Photograph,
    rest: &'a Mesh,
    shape: &'a [Point3],
    options: &RefineOptions,
) -> FrameLook<'a> {
    FrameLook::new(photo, rest, shape, look_options(photo, options))
}

/// What is seen with the surface at `shape` (camera axes) and with shading as it is at the
/// vertices, not blurred as the image is: the weights of the expected error are fitted to such
/// residuals.
pub(crate) fn gather_pointwise(
    photo: &Photograph,
    rest: &Mesh,
    shape: &[Point3],
    options: &RefineOptions,
) -> ShadingEvidence {
    let seen = LookOptions { blur_shade: false, ..look_options(photo, options) };
    gather_from(FrameLook::new(photo, rest, shape, seen), photo, options)
}

fn look_options(photo: &Photograph, options: &RefineOptions) -> LookOptions {
    let diagonal = diagonal(photo.picture.linear.size);
    options.image.look(options.blur * diagonal, diagonal)
}

/// What a look shows.
fn gather_from(look: FrameLook, photo: &Photograph, options: &RefineOptions) -> ShadingEvidence {
    let (rest, shape) = (look.rest, look.shape);
    let visible =
        visible_vertices(photo.camera, &rest.topology, shape, &look.raster, look.tolerance);
    let specular = look.highlights(&visible);
    let (mut vertices, mut channels) = (Vec::new(), Vec::new());
    for v in (0..shape.len()).filter(|&v| visible[v] && !rest.topology.boundary[v]) {
        let Some(pixel) = photo.camera.project(&shape[v]).map(|p| p.pixel) else { continue };
        if photo.picture.saturated.at_pixel(&pixel) {
            continue;
        }
        if let Some(found) = look.at(&shape[v], &pixel, &look.normals[v]) {
            vertices.push(v as u32);
            channels.push(found);
        }
    }
    let weighed = weigh(&channels, &options.image.noise());
    let turn = Matrix3::identity();
    let diffuse = |(i, brightness)| DiffuseVertex { vertex: vertices[i], brightness, turn };
    ShadingEvidence {
        diffuse: weighed.brightness.into_iter().map(diffuse).collect(),
        log_gain: weighed.log_gain,
        image: look.image,
        specular,
        visible,
    }
}

/// What is seen at the full mesh, on the mesh of `body` that is solved on and that carries it at
/// `shape`.
pub(super) fn gather_on(
    body: &Body,
    shape: &[Point3],
    photo: &Photograph,
    options: &RefineOptions,
) -> ShadingEvidence {
    let full = body.carried(shape);
    gather_on_from(look_at(photo, body.full().rest, &full, options), body, shape, photo, options)
}

/// [`gather_on`] from a look at the full mesh.
pub(super) fn gather_on_from(
    look: FrameLook,
    body: &Body,
    shape: &[Point3],
    photo: &Photograph,
    options: &RefineOptions,
) -> ShadingEvidence {
    let (full, rest) = (look.shape, body.scene().rest);
    let mut found = gather_from(look, photo, options);
    if !body.is_carried() {
        return found;
    }
    let normals = vertex_normals(&rest.topology, shape);
    let turned = vertex_normals(&body.full().rest.topology, full);
    let lifted = |seen: DiffuseVertex| {
        let vertex = body.number(seen.vertex)?;
        let (under, over) = (&normals[vertex as usize], &turned[seen.vertex as usize]);
        let turn = turn_between(under, over)?;
        Some(DiffuseVertex { vertex, turn, ..seen })
    };
    found.diffuse = found.diffuse.into_iter().filter_map(lifted).collect();
    let number = |(v, normal)| Some((body.number(v)?, normal));
    found.specular = found.specular.into_iter().filter_map(number).collect();
    found.visible = body.restricted(&found.visible).into_owned();
    found
}
