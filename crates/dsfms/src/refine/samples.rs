//! Samples inside faces: what one shape makes of a photograph at one blur.

use super::Photograph;
use super::field::GainField;
use super::glare::{Channels, weigh};
use super::joint_options::JointOptions;
use super::look::FrameLook;
use crate::energy::photometric::{Gain, Sample};
use crate::energy::{Brightness, Lift};
use crate::geometry::{GRAIN, Point2, Point3, Vector3, turn_between};
use crate::image::{ColorImage, diagonal};
use crate::mesh::Mesh;
use crate::mesh::normals::vertex_normals;
use crate::raster::Raster;
use crate::register::Body;
use rayon::prelude::*;

/// Barycentrics of the samples of a face.
const INSIDE: [[f64; 3]; 3] = [
    [2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0],
    [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0],
    [1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0],
];

/// The one sample of a face on a fine mesh.
const CENTRE: [[f64; 3]; 1] = [[1.0 / 3.0; 3]];

/// The photograph with the surface at `shape` (camera axes); `blur` as a fraction of the image
/// diagonal.
pub(super) fn look<'a>(
    photo: &'a Photograph<'a>,
    rest: &'a Mesh,
    shape: &'a [Point3],
    blur: f64,
    options: &JointOptions,
) -> FrameLook<'a> {
    let diagonal = diagonal(photo.picture.linear.size);
    FrameLook::new(photo, rest, shape, options.image.look(blur * diagonal, diagonal))
}

/// What a look leaves for the solve.
pub(super) struct ImageSamples {
    pub(super) image: ColorImage,
    pub(super) samples: Vec<Sample>,
    /// Robust ratio of image to prediction, the start of the gain.
    pub(super) log_gain: f64,
}

impl ImageSamples {
    /// `shape`: the mesh that is solved on, which carries the full mesh that the look is at.
    pub(super) fn of(
        look: FrameLook,
        body: &Body,
        shape: &[Point3],
        options: &JointOptions,
    ) -> Self {
        let places = match body.is_carried() {
            true => at_vertices(&look, body, shape, options),
            false => inside_faces(&look, options),
        };
        let (places, channels): (Vec<_>, Vec<_>) = places.into_iter().unzip();
        let weighed = weigh(&channels, &options.image.noise());
        let sample = |(i, brightness): (usize, Brightness)| {
            let Place { face, barycentric, lift } = places[i];
            Sample { face, barycentric, brightness, lift, gain: Gain::GLOBAL }
        };
        let samples = weighed.brightness.into_iter().map(sample).collect();
        Self { image: look.image, samples, log_gain: weighed.log_gain }
    }

    /// The same with a gain that varies over the surface.
    pub(super) fn smoothed(mut self, body: &Body, field: &GainField) -> Self {
        let rest = &body.scene().rest.positions;
        for sample in &mut self.samples {
            let (nodes, shares) = field.at(&body.point((sample.face, sample.barycentric), rest));
            sample.gain = Gain::smooth(nodes.map(|k| k + 2), shares);
        }
        self
    }
}

/// Where a sample lies on the mesh that is solved on, and how the full mesh lies to that.
struct Place {
    face: u32,
    barycentric: [f64; 3],
    lift: Lift,
}

/// Samples inside the faces of a mesh that is solved on itself.
fn inside_faces(look: &FrameLook, options: &JointOptions) -> Vec<(Place, Channels)> {
    let faces = &look.rest.topology.faces;
    let fine = 3 * faces_drawn(&look.raster, faces.len()) > options.max_samples;
    let inside = if fine { &CENTRE[..] } else { &INSIDE };
    let one = |f: usize, barycentric: [f64; 3]| {
        let (point, pixel, normal) = look.on_face(faces[f], barycentric)?;
        let place = Place { face: f as u32, barycentric, lift: Lift::NONE };
        Some((place, look.at(&point, &pixel, &normal)?))
    };
    let all = (0..faces.len() * inside.len()).into_par_iter();
    all.filter_map(|i| one(i / inside.len(), inside[i % inside.len()])).collect()
}

/// Samples at the vertices of a full mesh that a control mesh carries; of very many one in several.
fn at_vertices(
    look: &FrameLook,
    body: &Body,
    shape: &[Point3],
    options: &JointOptions,
) -> Vec<(Place, Channels)> {
    let topology = &body.scene().rest.topology;
    let normals = vertex_normals(topology, shape);
    let seen = |v: usize| {
        let pixel = look.project(&look.shape[v])?;
        look.seen(&look.shape[v], &pixel, &look.normals[v])?;
        Some((v, pixel))
    };
    let placed = |(v, pixel): &(usize, Point2)| {
        let (v, point, normal) = (*v, look.shape[*v], look.normals[*v]);
        let channels = look.at(&point, pixel, &normal)?;
        let (face, barycentric) = body.place(v)?;
        let corners = topology.faces[face as usize].map(|k| k as usize);
        let under: Vector3 = corners.iter().zip(barycentric).map(|(&k, b)| normals[k] * b).sum();
        let turn = turn_between(&under, &normal)?;
        let lift = Lift { offset: point - body.point((face, barycentric), shape), turn };
        Some((Place { face, barycentric, lift }, channels))
    };
    let inner = |v: &usize| !look.rest.topology.boundary[*v];
    let all = (0..look.shape.len()).into_par_iter().with_min_len(GRAIN);
    let found: Vec<_> = all.filter(inner).filter_map(seen).collect();
    let every = found.len().div_ceil(options.max_samples.max(1)).max(1);
    let some: Vec<_> = found.into_iter().step_by(every).collect();
    some.par_iter().with_min_len(GRAIN).filter_map(placed).collect()
}

/// Number of faces with at least one pixel.
fn faces_drawn(raster: &Raster, faces: usize) -> usize {
    let mut drawn = vec![false; faces];
    let seen = raster.face.iter().filter(|&&f| f != u32::MAX);
    seen.for_each(|&f| drawn[f as usize] = true);
    drawn.iter().filter(|&&d| d).count()
}
