//! Results of a live run on standard output: a line of JSON a frame, its vertices behind it where
//! they are asked for.

use crate::poses::rows;
use crate::reasons::sentences;
use dsfms::geometry::Point3;
use dsfms::pipeline::CameraSight;
use dsfms::track::{TrackStatus, Tracked};
use serde::Serialize;
use std::io::{self, ErrorKind, Write};

/// A line of JSON.
#[derive(Serialize)]
struct Line {
    frame: usize,
    status: TrackStatus,
    reasons: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pose: Option<[[f64; 4]; 4]>,
    /// By what lies around the organ.
    #[serde(skip_serializing_if = "Option::is_none")]
    camera: Option<Camera>,
    #[serde(skip_serializing_if = "Option::is_none")]
    residual_px: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    reprojection_px: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    photometric: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    agreement: Option<f64>,
    /// Frames dropped since the line before.
    dropped: usize,
    ms: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    vertices_bytes: Option<usize>,
}

/// The camera, whatever the organ does.
#[derive(Serialize)]
struct Camera {
    pose: [[f64; 4]; 4],
    matches: usize,
    residual_px: f64,
    uncertainty: f64,
}

impl From<CameraSight> for Camera {
    fn from(sight: CameraSight) -> Self {
        let CameraSight { pose, matches, residual_px, uncertainty } = sight;
        Self { pose: rows(&pose), matches, residual_px, uncertainty }
    }
}

/// What one frame gave.
#[derive(Clone, Copy)]
pub struct ToldFrame<'a> {
    pub number: usize,
    pub tracked: &'a Tracked,
    pub dropped: usize,
    pub ms: f64,
    /// `Some` where vertices are asked for; of a lost frame none.
    pub vertices: Option<Option<&'a [Point3]>>,
}

/// Write line and vertices at once; a reader that closed the pipe is no error.
pub fn tell(told: &ToldFrame, out: &mut impl Write) -> anyhow::Result<()> {
    match out.write_all(&message(told)?).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}

fn message(told: &ToldFrame) -> io::Result<Vec<u8>> {
    let surface = told.tracked.surface.as_ref();
    let vertices = told.vertices.map(|shape| shape.unwrap_or_default());
    let line = Line {
        frame: told.number,
        status: told.tracked.status,
        reasons: sentences(&told.tracked.reasons),
        pose: surface.map(|s| rows(&s.pose)),
        camera: told.tracked.camera.map(Camera::from),
        residual_px: surface.map(|s| s.residual_px),
        reprojection_px: surface.map(|s| s.reprojection_px),
        photometric: surface.and_then(|s| s.photometric),
        agreement: surface.map(|s| s.agreement),
        dropped: told.dropped,
        ms: told.ms,
        vertices_bytes: vertices.map(|v| 12 * v.len()),
    };
    let mut bytes = serde_json::to_vec(&line)?;
    bytes.push(b'\n');
    for p in vertices.unwrap_or_default() {
        for c in [p.x, p.y, p.z] {
            bytes.extend((c as f32).to_le_bytes());
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use dsfms::verdict::Reason;

    #[test]
    fn vertices_follow_their_line() {
        let tracked = Tracked {
            status: TrackStatus::Lost,
            reasons: vec![Reason::NoSurface { why: "why\nnot".to_owned().into() }],
            surface: None,
            camera: None,
            answered: false,
            stages: Vec::new(),
        };
        let shape = [Point3::new(1.0, -2.0, 0.5), Point3::new(3.0, 4.0, 5.0)];
        let told =
            |vertices| ToldFrame { number: 7, tracked: &tracked, dropped: 2, ms: 1.5, vertices };
        let mut out = Vec::new();
        tell(&told(Some(Some(&shape))), &mut out).unwrap();
        let end = out.iter().position(|&b| b == b'\n').unwrap();
        let line: serde_json::Value = serde_json::from_slice(&out[..end]).unwrap();
        assert_eq!((line["frame"].as_u64(), line["dropped"].as_u64()), (Some(7), Some(2)));
        assert_eq!(line["vertices_bytes"].as_u64(), Some(24));
        assert_eq!(out.len() - end - 1, 24);
        assert_eq!(out[end + 5..end + 9], (-2f32).to_le_bytes());
        let text = |vertices| String::from_utf8(message(&told(vertices)).unwrap()).unwrap();
        assert!(text(Some(None)).contains("\"vertices_bytes\":0"));
        assert!(!text(None).contains("vertices_bytes") && text(None).lines().count() == 1);
    }
}
