//! Samples inside faces: what one shape makes of a photograph at one blur.

use super::Photograph;
use super::glare::{NoiseOptions, weigh};
use super::joint::JointOptions;
use super::look::{Look, LookOptions, diagonal};
use crate::energy::Brightness;
use crate::energy::photometric::Sample;
use crate::geometry::Point3;
use crate::image::ColorImage;
use crate::mesh::Mesh;
use crate::raster::Raster;
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
) -> Look<'a> {
    let diagonal = diagonal(photo.picture.linear.size);
    let blur = blur * diagonal;
    let seen = LookOptions {
        blur,
        grazing: options.grazing,
        contour: options.contour_blurs * blur,
        halo: options.halo * diagonal,
        mirror_deg: options.specular_deg,
        colour: options.colour,
    };
    Look::new(photo, rest, shape, seen)
}

/// What a look leaves for the solve.
pub(super) struct Seen {
    pub(super) image: ColorImage,
    pub(super) samples: Vec<Sample>,
    /// Robust ratio of image to prediction, the start of the gain.
    pub(super) log_gain: f64,
}

impl Seen {
    pub(super) fn of(look: Look, options: &JointOptions) -> Self {
        let faces = &look.rest.topology.faces;
        let fine = 3 * faces_drawn(&look.raster, faces.len()) > options.max_samples;
        let inside = if fine { &CENTRE[..] } else { &INSIDE };
        let one = |f: usize, b: [f64; 3]| {
            let (point, pixel, normal) = look.on_face(faces[f], b)?;
            Some(((f as u32, b), look.at(&point, &pixel, &normal)?))
        };
        let all = (0..faces.len() * inside.len()).into_par_iter();
        let found = all.filter_map(|i| one(i / inside.len(), inside[i % inside.len()]));
        let (places, channels): (Vec<_>, Vec<_>) = found.unzip();
        let noise = NoiseOptions {
            relative: options.sigma_relative,
            absolute: options.sigma_absolute,
            colour: options.colour,
        };
        let weighed = weigh(&channels, &noise);
        let sample = |(i, brightness): (usize, Brightness)| {
            let (face, barycentric) = places[i];
            Sample { face, barycentric, brightness }
        };
        let samples = weighed.brightness.into_iter().map(sample).collect();
        Self { image: look.image, samples, log_gain: weighed.log_gain }
    }
}

/// Number of faces with at least one pixel.
fn faces_drawn(raster: &Raster, faces: usize) -> usize {
    let mut drawn = vec![false; faces];
    let seen = raster.face.iter().filter(|&&f| f != u32::MAX);
    seen.for_each(|&f| drawn[f as usize] = true);
    drawn.iter().filter(|&&d| d).count()
}
