//! What is told of a frame.

use crate::commands::track::outputs;
use crate::reasons::joined;
use clap::ValueEnum;
use dsfms::camera::CameraModel;
use dsfms::geometry::Point3;
use dsfms::image::Frame;
use dsfms::io::igtl::{
    Head, ImagePlacement, StatusCode, image, status, string, surface, transform,
};
use dsfms::template::Template;
use dsfms::track::{TrackStatus, Tracked};
use std::time::SystemTime;

/// Names of our devices: `FromToTo` for transforms, as in 3D Slicer.
pub mod device {
    /// STATUS.
    pub const STATUS: &str = "dsfms";
    /// STRING, a line of JSON.
    pub const VERDICT: &str = "Verdict";
    /// TRANSFORM.
    pub const POSE: &str = "TemplateToCamera";
    /// TRANSFORM, by what lies around the organ.
    pub const CAMERA: &str = "SurroundingsToCamera";
    /// POLYDATA.
    pub const SURFACE: &str = "Organ";
    /// IMAGE.
    pub const PICTURE: &str = "Laparoscope";
}

/// The picture lies so many radii of the template before the camera: behind the organ, mostly.
const PICTURE_RADII: f64 = 4.0;

/// What is sent as IMAGE.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Picture {
    /// The frame as it came.
    Frame,
    /// The frame with the surface.
    Overlay,
    /// Nothing.
    None,
}

/// One frame, on its way to the thread that writes messages.
pub struct Snapshot {
    /// When the frame came.
    pub time: SystemTime,
    /// Where pictures are sent.
    pub frame: Option<Frame>,
    pub tracked: Tracked,
    /// Camera axes; `None` where lost.
    pub shape: Option<Vec<Point3>>,
    /// The verdict as JSON.
    pub verdict: String,
}

/// Writes the messages of frames.
pub struct Messages {
    template: Template,
    camera: CameraModel,
    picture: Picture,
    plane: ImagePlacement,
}

impl Messages {
    pub fn new(template: &Template, camera: &CameraModel, picture: Picture) -> Self {
        let plane = plane(camera, PICTURE_RADII * radius(&template.mesh.positions));
        Self { template: template.clone(), camera: camera.clone(), picture, plane }
    }

    /// All messages of a frame, the light ones first: a receiver knows what to think of a surface
    /// before it has it.
    pub fn bundle(&self, told: &Snapshot) -> Vec<u8> {
        let head = |device| Head { device, time: Some(told.time) };
        let Tracked { status: of, reasons, surface: found, .. } = &told.tracked;
        let code = match of {
            TrackStatus::Ok => StatusCode::Ok,
            TrackStatus::Degraded => StatusCode::UnknownError,
            TrackStatus::Lost => StatusCode::NotFound,
        };
        let text = joined(reasons);
        let mut out = status(head(device::STATUS), code, *of as i64, of.label(), &text);
        out.extend(string(head(device::VERDICT), &told.verdict));
        if let Some(found) = found {
            out.extend(transform(head(device::POSE), &found.pose));
        }
        if let Some(camera) = &told.tracked.camera {
            out.extend(transform(head(device::CAMERA), &camera.pose));
        }
        // Of a lost frame no points, so that no old surface stays in view.
        let (shape, faces) = match &told.shape {
            Some(shape) => (shape.as_slice(), self.template.mesh.topology.faces.as_slice()),
            None => (&[][..], &[][..]),
        };
        let number = |seen: &bool| f32::from(u8::from(*seen));
        let seen = found.iter().map(|s| ("visible", s.visible.iter().map(number).collect()));
        out.extend(surface(head(device::SURFACE), shape, faces, &seen.collect::<Vec<_>>()));
        if let Some(frame) = &told.frame {
            let head = head(device::PICTURE);
            out.extend(match self.picture {
                Picture::Overlay => image(head, &self.overlay(frame, told), &self.plane),
                _ => image(head, frame, &self.plane),
            });
        }
        out
    }

    fn overlay(&self, frame: &Frame, told: &Snapshot) -> Frame {
        let drawn = outputs::picture(&self.template, &self.camera, frame, &told.tracked);
        let rgb = drawn.pixels().map(|p| p.0).collect();
        Frame { name: String::new(), size: frame.size, rgb }
    }
}

/// Half the diagonal of the bounding box.
fn radius(points: &[Point3]) -> f64 {
    let Some(first) = points.first() else { return 0.0 };
    let (low, high) =
        points.iter().fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p)));
    0.5 * (high - low).norm()
}

/// The frame as a picture across the camera's axis: seen from the camera it covers what it shows
/// (lens distortion aside).
fn plane(camera: &CameraModel, depth: f64) -> ImagePlacement {
    let [fx, fy] = camera.focal.map(|f| depth / f);
    let middle = |k: usize| (camera.size[k] as f64 - 1.0) / 2.0 - camera.centre[k];
    let centre = [middle(0) * fx, middle(1) * fy, depth].map(|v| v as f32);
    ImagePlacement { axes: [[fx as f32, 0.0, 0.0], [0.0, fy as f32, 0.0], [0.0, 0.0, 1.0]], centre }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dsfms::camera::{Camera, Lens};

    #[test]
    fn the_picture_lies_where_its_pixels_are_seen() {
        let camera = CameraModel {
            size: [64, 48],
            focal: [60.0, 50.0],
            centre: [30.0, 25.0],
            lens: Lens::Pinhole,
        };
        let plane = plane(&camera, 80.0);
        for pixel in [[0.0, 0.0], [63.0, 0.0], [10.0, 47.0]] {
            let from_centre = [pixel[0] - 31.5, pixel[1] - 23.5];
            let place: Vec<f64> = (0..3)
                .map(|k| {
                    let [i, j, _] = plane.axes.map(|axis| f64::from(axis[k]));
                    f64::from(plane.centre[k]) + from_centre[0] * i + from_centre[1] * j
                })
                .collect();
            let seen = camera.project(&Point3::new(place[0], place[1], place[2])).unwrap().pixel;
            assert!((seen.x - pixel[0]).abs() < 1e-4 && (seen.y - pixel[1]).abs() < 1e-4);
        }
    }
}
