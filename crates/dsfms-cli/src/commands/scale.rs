//! Known distances on the command line: they make a template metric.

use super::calibrate::length_mm;
use crate::exit::Usage;
use crate::progress::Reporter;
use clap::Args;
use dsfms::geometry::Point2;
use dsfms::pipeline::Progress;
use dsfms::template::scale::{PickedPoint, Scale, ScaleReference};

/// Distances that the user knows.
#[derive(Debug, Args)]
pub struct ScaleArgs {
    /// Two points of the tissue, each FRAME:X,Y in px (or a vertex number), and their distance, as
    /// 35mm; may be given several times.
    #[arg(help_heading = "Scale and calibration", 
        long,
        num_args = 3,
        value_names = ["POINT", "POINT", "DISTANCE"],
        action = clap::ArgAction::Append,
        conflicts_with = "mesh"
    )]
    scale_reference: Vec<String>,
    /// Two frames and how far the camera moved between them, as 12mm; may be given several times.
    #[arg(help_heading = "Scale and calibration", 
        long,
        num_args = 3,
        value_names = ["FRAME", "FRAME", "DISTANCE"],
        action = clap::ArgAction::Append,
        conflicts_with = "mesh"
    )]
    camera_step: Vec<String>,
}

impl ScaleArgs {
    /// Whether any reference names a place in a frame.
    pub fn names_pixels(&self) -> bool {
        !self.scale_reference.is_empty()
    }

    /// The references in the order given, points first.
    pub fn references(&self) -> Result<Vec<ScaleReference>, Usage> {
        let length = |text: &String, option: &str| {
            length_mm(text).map_err(|problem| Usage(format!("--{option}: {problem}")))
        };
        let mut out = Vec::new();
        for triple in self.scale_reference.chunks_exact(3) {
            out.push(ScaleReference::Points {
                from: picked(&triple[0])?,
                to: picked(&triple[1])?,
                millimetres: length(&triple[2], "scale-reference")?,
            });
        }
        for triple in self.camera_step.chunks_exact(3) {
            out.push(ScaleReference::CameraStep {
                frames: [triple[0].clone(), triple[1].clone()],
                millimetres: length(&triple[2], "camera-step")?,
            });
        }
        Ok(out)
    }
}

/// `FRAME:X,Y`, or the number of a vertex.
fn picked(text: &str) -> Result<PickedPoint, Usage> {
    if let Ok(vertex) = text.parse() {
        return Ok(PickedPoint::Vertex(vertex));
    }
    let point = text.rsplit_once(':').and_then(|(frame, pixel)| {
        let (x, y) = pixel.split_once(',')?;
        let number = |w: &str| w.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        let pixel = Point2::new(number(x)?, number(y)?);
        Some(PickedPoint::Pixel { frame: frame.to_string(), pixel })
    });
    point.ok_or_else(|| {
        Usage(format!("--scale-reference: {text:?}; expected FRAME:X,Y (px) or a vertex number"))
    })
}

/// Say what was applied, and where the references disagree.
pub fn report(scale: &Scale, reporter: &Reporter) {
    reporter.say(&format!("scale: one unit of the reconstruction is {:.5} mm", scale.factor));
    let (low, high) =
        scale.each.iter().fold((f64::INFINITY, 0.0), |(l, h): (f64, f64), &f| (l.min(f), h.max(f)));
    if high > 1.05 * low {
        let each: Vec<String> = scale.each.iter().map(|f| format!("{f:.4}")).collect();
        reporter.warn(&format!(
            "the known distances disagree by {:.0} %: {} mm per unit; their geometric mean is used",
            100.0 * (high / low - 1.0),
            each.join(", ")
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_pixels_or_vertices() {
        assert_eq!(picked("12").unwrap(), PickedPoint::Vertex(12));
        let pixel = Point2::new(3.5, 40.0);
        let frame = "C:frame_3.png".to_string();
        assert_eq!(picked("C:frame_3.png:3.5,40").unwrap(), PickedPoint::Pixel { frame, pixel });
        assert!(picked("frame_3").unwrap_err().0.contains("FRAME:X,Y"));
    }
}
