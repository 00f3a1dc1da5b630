//! What a registered frame says about the brightness of one surface point, and when it must not be
//! believed: saturation and its halo, the specular lobe, grazing light, predicted contours,
//! occlusion, masks.

use crate::camera::{Camera, CameraModel, PosedFrame};
use crate::geometry::{Point2, Point3, Vector3};
use crate::image::{Bilinear, Mask, distance::distance_to, nearest_pixel, saturation};
use crate::light::{Light, LightModel};
use crate::mesh::Mesh;
use crate::options::{from_zero, positive};
use crate::raster::{OCCLUSION_TOLERANCE, Raster, rasterize};
use serde::{Deserialize, Serialize};

/// One registered exploration frame, as the photometric steps need it.
#[derive(Clone, Copy, Debug)]
pub struct AlbedoView<'a> {
    /// The frame as it was decoded (a fifth of what it would take in linear light), its camera,
    /// `camera_from_template`, and where the organ may be measured: inside both masks.
    pub posed: PosedFrame<'a>,
    /// Linear light of every encoded value ([`ToneCurve::table`](crate::image::ToneCurve::table)).
    pub tone: &'a [f32; 256],
    /// First guess of the exposure gain, e.g. from the file's exposure data; 1 when nothing is
    /// known.
    pub gain: f64,
}

/// When an observation counts. Other values are not measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ObservationBounds {
    /// Distance from saturated pixels, px, to be out of their halo.
    pub halo_px: f64,
    /// Distance from predicted contours (silhouettes and depth jumps), px.
    pub contour_px: f64,
    /// Depth jump between neighbouring pixels that counts as a contour, relative to the depth.
    pub relative_jump: f64,
    /// Distance from masked pixels, px.
    pub mask_px: f64,
    /// Angle in degrees between the normal and that of a mirror reflection.
    pub specular_deg: f64,
    /// Smallest cosine between the normal and the directions to light and camera. Beyond 60
    /// degrees (0.5) light from all around and the film on the tissue weigh in.
    pub grazing_cos: f64,
    /// Darkest usable channel mean, linear; below it quantisation rules.
    pub darkest: f64,
    /// Brightest usable channel, linear; above it a single channel may be clipped.
    pub brightest: f64,
}

impl Default for ObservationBounds {
    fn default() -> Self {
        Self {
            halo_px: 12.0,
            contour_px: 4.0,
            relative_jump: 0.02,
            mask_px: 2.0,
            specular_deg: 20.0,
            grazing_cos: 0.5,
            darkest: 0.005,
            brightest: 0.97,
        }
    }
}

impl ObservationBounds {
    /// Whether all are numbers that can be bounds.
    pub(super) fn are_valid(&self) -> bool {
        let Self { halo_px, contour_px, mask_px, specular_deg, grazing_cos, .. } = *self;
        from_zero(&[halo_px, contour_px, mask_px, specular_deg, grazing_cos, self.darkest])
            && positive(&[self.relative_jump, self.brightest])
    }
}

/// What is checked where options have such bounds.
pub(super) const VALID_BOUNDS: &str =
    "numbers: relative_jump and brightest positive, the others 0 or more";

/// Brightness of one surface point in one frame.
#[derive(Clone, Copy, Debug)]
pub struct SpotObservation {
    /// Index of the view.
    pub view: usize,
    /// The surface point in camera axes.
    pub point: Point3,
    /// Its unit normal in camera axes.
    pub normal: Vector3,
    /// Linear RGB of the image there.
    pub rgb: [f64; 3],
    /// Cosine towards the camera times cosine towards the light.
    pub weight: f64,
}

impl SpotObservation {
    /// Mean of the three channels.
    pub fn grey(&self) -> f64 {
        (self.rgb[0] + self.rgb[1] + self.rgb[2]) / 3.0
    }
}

/// A view with what decides whether a pixel may be used: 4 bytes a pixel, as all views of a long
/// exploration are held at once.
pub(super) struct PreparedView<'a> {
    view: &'a AlbedoView<'a>,
    /// Depth of the surface at every pixel; minus infinity where the pixel must not be used.
    depth: Vec<f32>,
    /// Length of a pixel on every face; infinite where the view does not show it.
    pub footprint: Vec<f64>,
}

impl<'a> PreparedView<'a> {
    pub(super) fn new(mesh: &Mesh, view: &'a AlbedoView<'a>, bounds: &ObservationBounds) -> Self {
        let PosedFrame { camera, pose, .. } = view.posed;
        let positions: Vec<_> = mesh.positions.iter().map(|p| pose * p).collect();
        let raster = rasterize(camera, &mesh.topology, &positions);
        let usable = usable_pixels(view, &raster, bounds);
        let depth = |(&z, usable)| if usable { z as f32 } else { f32::NEG_INFINITY };
        let footprint = footprints(camera, &raster, mesh.topology.faces.len());
        Self { view, depth: raster.depth.iter().zip(usable).map(depth).collect(), footprint }
    }

    /// A direction of the template frame in camera axes.
    pub(super) fn turned(&self, direction: &Vector3) -> Vector3 {
        self.view.posed.pose * direction
    }

    /// What this view says about a surface point given in the template frame.
    pub(super) fn observe(
        &self,
        index: usize,
        point: &Point3,
        normal: &Vector3,
        light: &LightModel,
        bounds: &ObservationBounds,
    ) -> Option<SpotObservation> {
        let point = self.view.posed.pose * point;
        let normal = self.view.posed.pose * normal;
        // Most views see most of the surface from behind or not at all: the cheapest question
        // first.
        let seen = -normal.dot(&point.coords) / point.coords.norm();
        if seen.is_nan() || seen < bounds.grazing_cos {
            return None;
        }
        let camera = self.view.posed.camera;
        let pixel = camera.project(&point)?.pixel;
        let [x, y] = nearest_pixel(&pixel, camera.size)?;
        let surface = f64::from(self.depth[y * camera.size[0] + x]);
        if point.z > surface + OCCLUSION_TOLERANCE * point.z {
            return None;
        }
        let half = light.mirror_normal(&point);
        let lit = normal.dot(&towards_light(&half, &point));
        if lit < bounds.grazing_cos || half.dot(&normal) > bounds.specular_deg.to_radians().cos() {
            return None;
        }
        let rgb = sample_rgb(self.view, &pixel)?;
        let brightest = rgb[0].max(rgb[1]).max(rgb[2]);
        let grey = (rgb[0] + rgb[1] + rgb[2]) / 3.0;
        if !(grey >= bounds.darkest && brightest <= bounds.brightest) {
            return None;
        }
        Some(SpotObservation { view: index, point, normal, rgb, weight: lit * seen })
    }
}

/// Direction to the light: the mirror normal halves the angle between it and that to the camera.
fn towards_light(half: &Vector3, point: &Point3) -> Vector3 {
    let to_camera = -point.coords.normalize();
    half * (2.0 * half.dot(&to_camera)) - to_camera
}

fn usable_pixels(view: &AlbedoView, raster: &Raster, bounds: &ObservationBounds) -> Vec<bool> {
    let contour = distance_to(&raster.discontinuities(bounds.relative_jump));
    let saturated = distance_to(&saturation(view.posed.frame));
    let away = |mask: Option<&Mask>| mask.map(|mask| distance_to(&mask.complement()));
    let masked = [away(view.posed.valid), away(view.posed.organ)];
    (0..contour.data.len())
        .map(|i| {
            contour.data[i] >= bounds.contour_px as f32
                && saturated.data[i] >= bounds.halo_px as f32
                && masked.iter().flatten().all(|d| d.data[i] >= bounds.mask_px as f32)
        })
        .collect()
}

/// Length of a pixel on each face, where it is shown.
fn footprints(camera: &CameraModel, raster: &Raster, faces: usize) -> Vec<f64> {
    let mut footprint = vec![f64::INFINITY; faces];
    let focal = camera.focal[0].max(camera.focal[1]);
    for (&face, depth) in raster.face.iter().zip(&raster.depth) {
        if face != u32::MAX {
            let best = &mut footprint[face as usize];
            *best = best.min(depth / focal);
        }
    }
    footprint
}

/// Bilinear RGB in linear light; `None` outside the rectangle of pixel centres.
fn sample_rgb(view: &AlbedoView, p: &Point2) -> Option<[f64; 3]> {
    let frame = view.posed.frame;
    let four = Bilinear::at(p, frame.size)?;
    Some(four.colour(|i| frame.rgb[i].map(|v| view.tone[v as usize])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Isometry;
    use crate::image::Frame;
    use crate::light::{PointLight, Spot};

    #[test]
    fn the_way_to_the_light() {
        let light = LightModel::Point(PointLight {
            positions: vec![Point3::new(0.0, -3.0, 0.0)],
            reference_distance: 50.0,
            spot: Spot::Isotropic,
        });
        let (point, normal) = (Point3::new(4.0, 2.0, 40.0), Vector3::new(0.1, 0.3, -0.9));
        let normal = normal.normalize();
        let expected = (Point3::new(0.0, -3.0, 0.0) - point).normalize().dot(&normal);
        let found = normal.dot(&towards_light(&light.mirror_normal(&point), &point));
        assert!((found - expected).abs() < 1e-12);
    }

    #[test]
    fn bilinear_colour_by_hand() {
        let rgb = vec![[0; 3], [255, 0, 0], [0, 128, 0], [0, 0, 64]];
        let frame = Frame { name: "f".into(), size: [2, 2], rgb };
        let tone = std::array::from_fn(|v| v as f32 / 64.0);
        let camera = CameraModel::pinhole([2, 2], [1.0; 2], [0.5; 2]);
        let posed = PosedFrame::new(&frame, &camera, Isometry::identity());
        let view = AlbedoView { posed, tone: &tone, gain: 1.0 };
        let at = |x, y| sample_rgb(&view, &Point2::new(x, y));
        assert_eq!(at(0.5, 0.5), Some([255.0 / 256.0, 0.5, 0.25]));
        assert_eq!(at(1.0, 1.0), Some([0.0, 0.0, 1.0]));
        assert_eq!(at(1.1, 1.0), None);
    }
}
