//! Rows, pictures and the film of a tracked video.

use crate::draw;
use crate::outputs::quoted;
use crate::reasons::joined;
use dsfms::camera::CameraModel;
use dsfms::image::Frame;
use dsfms::register::scene::visibility;
use dsfms::template::Template;
use dsfms::track::{Origin, TrackStatus, Tracked};
use dsfms::video::watched::Watched;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// How long ffmpeg may take nothing of the film: the last pictures are coded when all are taken,
/// large ones slowly.
const FILM_SILENCE: Duration = Duration::from_secs(300);

/// First line of `summary.csv`.
pub const COLUMNS: &str = "frame,input,status,way,reasons,matches,matches_kept,residual_px,\
                           reprojection_px,photometric,depth,agreement,places,camera_matches,camera_px,camera_open,dropped,ms,prepare_ms,\
                           surroundings_ms,follow_ms,find_ms,pose_ms,\
                           register_ms,joint_ms,look_ms,seek_ms\n";

/// Stages in the order of the columns.
const STAGES: [&str; 9] =
    ["prepare", "surroundings", "follow", "find", "pose", "register", "joint", "look", "seek"];

/// A row of `summary.csv`.
pub fn row(number: usize, input: &str, tracked: &Tracked, dropped: usize, ms: f64) -> String {
    let (status, reasons) = (tracked.status.label(), quoted(&joined(&tracked.reasons)));
    let name = quoted(input);
    let measured = tracked.surface.as_ref().map_or([",", ",,,,,,,,,"].map(String::from), |s| {
        let way = if s.origin == Origin::Found { "found" } else { "followed" };
        let (total, kept) = (s.matches.len(), s.matches_kept());
        let photometric = s.photometric.map_or(String::new(), |p| format!("{p:.4}"));
        let figures = format!(
            ",{total},{kept},{:.3},{:.3},{photometric},{:.3},{:.3},{},",
            s.residual_px, s.reprojection_px, s.depth_uncertainty, s.agreement, s.places
        );
        [format!("{way},"), figures]
    });
    let [way, figures] = measured;
    let camera = tracked.camera.map_or(",,,".to_owned(), |camera| {
        format!("{},{:.3},{:.4},", camera.matches, camera.residual_px, camera.uncertainty)
    });
    let mut text =
        format!("{number},{name},{status},{way}{reasons}{figures}{camera}{dropped},{ms:.1}");
    for stage in STAGES {
        let seconds: f64 =
            tracked.stages.iter().filter(|s| s.0 == stage).fold(0.0, |sum, s| sum + s.1);
        // Writing to a string cannot fail.
        let _ = write!(text, ",{:.1}", 1e3 * seconds);
    }
    text.push('\n');
    text
}

/// The frame with the surface, under a bar of the status' colour.
pub fn picture(
    template: &Template,
    camera: &CameraModel,
    frame: &Frame,
    tracked: &Tracked,
) -> image::RgbImage {
    let mut picture = match &tracked.surface {
        Some(s) => {
            let mesh = &template.mesh;
            let visible = visibility(camera, mesh, &s.vertices);
            let topology = &mesh.topology;
            draw::overlay::overlay(frame, camera, topology, &s.vertices, &visible, &s.matches)
        }
        None => draw::picture(frame),
    };
    let colour = match tracked.status {
        TrackStatus::Ok => [40, 200, 90],
        TrackStatus::Degraded => [240, 180, 30],
        TrackStatus::Lost => [220, 40, 40],
    };
    let bar = (picture.height() / 60).max(2);
    for y in 0..bar.min(picture.height()) {
        for x in 0..picture.width() {
            picture.put_pixel(x, y, image::Rgb(colour));
        }
    }
    picture
}

/// `OUT/overlay.mp4` of pictures, in their order; the error says why there is none.
pub fn film(folder: &Path, pictures: &[PathBuf], rate: f64) -> Result<(), String> {
    // Under its name only when it is complete; the ending tells ffmpeg the format.
    let partial = folder.join(format!(".partial-{}-overlay.mp4", std::process::id()));
    let whole = folder.join("overlay.mp4");
    let said = tempfile::NamedTempFile::new().map_err(|error| error.to_string())?;
    let mut command = Command::new("ffmpeg");
    command
        .args(["-y", "-v", "error", "-f", "image2pipe", "-framerate", &rate.to_string()])
        .args(["-c:v", "png", "-i", "-", "-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2"])
        .args(["-pix_fmt", "yuv420p"])
        .arg(&partial)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(said.reopen().map_err(|error| error.to_string())?);
    let child =
        Watched::spawn(&mut command, FILM_SILENCE).map_err(|_| "needs ffmpeg".to_owned())?;
    if let Some(mut input) = child.input() {
        let feed = |path| std::fs::read(path).and_then(|bytes| input.write_all(&bytes));
        // Where ffmpeg stopped reading, it says below why.
        let _ = pictures.iter().try_for_each(feed);
    }
    let ended = child.finish().map_err(|error| error.to_string())?;
    if ended.is_some_and(|status| status.success()) {
        return std::fs::rename(&partial, &whole).map_err(|error| error.to_string());
    }
    // It may not have come to write anything.
    let _ = std::fs::remove_file(&partial);
    if ended.is_none() {
        return Err(format!(
            "was not made; ffmpeg took nothing for {} s, and it was ended",
            FILM_SILENCE.as_secs()
        ));
    }
    let said = std::fs::read_to_string(said.path()).unwrap_or_default();
    Err(format!("was not made; ffmpeg says: {}", said.lines().last().unwrap_or("nothing")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use dsfms::verdict::Reason;

    #[test]
    fn a_row_has_as_many_fields_as_there_are_columns() {
        let tracked = Tracked {
            status: TrackStatus::Lost,
            reasons: vec![Reason::NotFinite, Reason::Black { brightest: 3 }],
            surface: None,
            camera: None,
            answered: false,
            stages: vec![("find", 0.25)],
        };
        let line = row(3, "frame_003", &tracked, 2, 250.0);
        assert_eq!(line.matches(',').count(), COLUMNS.matches(',').count(), "{line}");
        let place = |name: &str| COLUMNS.trim().split(',').position(|c| c == name).unwrap();
        let fields: Vec<&str> = line.trim().split(',').collect();
        assert_eq!((fields[place("dropped")], fields[place("find_ms")]), ("2", "250.0"));
        assert_eq!(
            (fields[place("reasons")], fields[place("ms")]),
            (
                "some vertices are not finite; the frame is black (brightest pixel 3 of 255)",
                "250.0"
            )
        );
    }
}
