//! `dsfms synth --chessboard`: pictures to calibrate with, and the camera that took them.

use super::claim::Claim;
use crate::args::Global;
use crate::commands::experiment::pace::Paced;
use crate::draw::picture;
use crate::exit::{Outcome, Usage};
use crate::outputs::{prepare_folder, write_json, write_png};
use crate::poses::ImagePose;
use crate::progress::Reporter;
use crate::stdout::to_stdout;
use dsfms::camera::CameraModel;
use dsfms::image::ToneCurve;
use dsfms::io::camera::{CameraFile, write_camera};
use dsfms::pipeline::Progress;
use dsfms::synth::{Chessboard, ChessboardOptions};
use serde_json::json;
use std::fmt::Write;
use std::path::Path;

/// Make the pictures; those that lie in the folder already are kept.
pub fn make(
    options: &ChessboardOptions,
    folder: &Path,
    global: &Global,
    reporter: &Reporter,
) -> anyhow::Result<Outcome> {
    let scene =
        Chessboard::new(options).map_err(|error| Usage(format!("--chessboard: {error}")))?;
    let truth = folder.join("truth");
    let parameters = json!({
        "board": options.board,
        "size": options.size,
        "pictures": options.pictures,
        "seed": options.seed,
    });
    let board = Claim { name: "board.json", parameters, other: "other pictures" };
    let numbered = |name: &str| name.starts_with("board_") && name.ends_with(".png");
    board.take(folder, |name| name == "truth" || numbered(name))?;
    prepare_folder(&truth)?;
    let progress = Paced::new(reporter);
    for k in 0..options.pictures {
        progress.step("pictures", k, options.pictures);
        let path = folder.join(format!("board_{k:03}.png"));
        if !path.exists() {
            write_png(&path, &picture(&scene.photograph(k)))?;
        }
    }
    progress.step("pictures", options.pictures, options.pictures);
    let (camera, tone) = (scene.camera.clone(), Some(ToneCurve::Srgb));
    let file = CameraFile { camera, tone, light: None, vignetting: None };
    write_camera(&truth.join("camera.json"), &file)?;
    let named = |(k, pose)| ImagePose::of(format!("board_{k:03}"), pose);
    let poses = scene.poses.iter().enumerate().map(named);
    write_json(&truth.join("poses.json"), &poses.collect::<Vec<_>>())?;
    reporter.finish();
    if !global.quiet {
        to_stdout(&summary(options.pictures, &scene.camera))?;
    }
    Ok(Outcome::Ok)
}

/// The true camera in the lines of `dsfms calibrate`, which gives the last of them as fixed.
fn summary(pictures: usize, camera: &CameraModel) -> String {
    let names = ["fx", "fy", "cx", "cy"];
    let values = camera.focal.into_iter().chain(camera.centre);
    let mut text = format!("{pictures} pictures by the camera\n");
    for (name, value) in names.into_iter().zip(values).chain(camera.lens.coefficients()) {
        let digits = if value.abs() > 10.0 { 2 } else { 5 };
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{name:<4}{value:>12.digits$}");
    }
    text
}
