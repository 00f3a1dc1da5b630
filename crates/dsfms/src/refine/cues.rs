//! What an image says of shape besides its brightness: the organ's outline, and highlights.

use super::Photograph;
use super::contour::silhouette;
use super::joint_options::JointOptions;
use super::look::FrameLook;
use crate::camera::CameraModel;
use crate::energy::{Silhouette, Specular};
use crate::geometry::{Point3, Vector3, median};
use crate::raster::visible_vertices;
use crate::register::Body;

/// Bounds of the spread of the normals of a highlight, degrees: what highlights on wet tissue show
/// (`docs/results/choices.md`, highlights).
const LOBE_DEG: [f64; 2] = [4.0, 15.0];

/// The cues of one photograph at one shape.
pub(super) struct Cues<'a> {
    /// Where an organ mask tells the outline.
    pub(super) contour: Option<Silhouette<'a, CameraModel>>,
    /// Under a near light.
    pub(super) highlights: Option<Specular>,
    /// Vertices that the camera sees.
    visible: usize,
}

impl<'a> Cues<'a> {
    /// `look`: at the full mesh, which `shape`, the mesh that is solved on, carries.
    pub(super) fn of(
        look: &FrameLook,
        body: &Body,
        shape: &[Point3],
        photo: &Photograph<'a>,
        options: &JointOptions,
    ) -> Self {
        let (camera, raster) = (photo.camera, &look.raster);
        let topology = &look.rest.topology;
        let of = |outline| {
            silhouette(camera, body, [look.shape, shape], raster, outline, options.silhouette_px)
        };
        let visible = visible_vertices(camera, topology, look.shape, raster, look.tolerance);
        let near = photo.light.light.tells_distance();
        let highlights = near.then(|| {
            let found = look.highlights(&visible);
            let lobe = lobe(&found, &look.normals);
            let number = |(v, normal)| Some((body.number(v)?, normal));
            let vertices: Vec<(u32, Vector3)> = found.into_iter().filter_map(number).collect();
            Specular::new(&body.scene().rest.topology, &vertices, lobe)
        });
        let count = |v: &usize| visible[*v] && body.number(*v as u32).is_some();
        let visible = (0..visible.len()).filter(count).count();
        Self { contour: photo.outline.map(of), highlights, visible }
    }

    /// Points of the contour, and vertices that the camera sees.
    pub(super) fn counts(&self) -> [usize; 2] {
        [self.contour.as_ref().map_or(0, |contour| contour.points.len()), self.visible]
    }
}

/// Spread of the normals of a highlight about the mirror direction, rad: the lobe of the tissue as
/// far as it saturates, which a shape near the truth shows.
fn lobe(highlights: &[(u32, Vector3)], normals: &[Vector3]) -> f64 {
    let angle = |(v, h): &(u32, Vector3)| h.cross(&normals[*v as usize]).norm().min(1.0).asin();
    let mut angles: Vec<f64> = highlights.iter().map(angle).collect();
    let [least, most] = LOBE_DEG.map(f64::to_radians);
    median(&mut angles).unwrap_or(most).clamp(least, most)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lobe_is_the_spread_of_the_normals_within_bounds() {
        let h = -Vector3::z();
        let turned = |deg: f64| {
            let angle = deg.to_radians();
            Vector3::new(angle.sin(), 0.0, -angle.cos())
        };
        let found = |deg: f64| {
            lobe(&[(0, h), (1, h), (2, h)], &[turned(0.5 * deg), turned(deg), turned(2.0 * deg)])
        };
        assert!((found(8.0) - 8_f64.to_radians()).abs() < 1e-12);
        assert!((found(1.0) - 4_f64.to_radians()).abs() < 1e-12);
        assert!((found(30.0) - 15_f64.to_radians()).abs() < 1e-12);
        assert!((lobe(&[], &[]) - 15_f64.to_radians()).abs() < 1e-12);
    }
}
