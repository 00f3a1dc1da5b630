//! `dsfms calibrate`: pictures of a chessboard to a camera file.

use crate::args::Global;
use crate::exit::{Outcome, Usage};
use crate::inputs::{self, Source};
use crate::outputs::{check_folder, write_json, write_png};
use crate::pictures::calibration as pictures;
use crate::place::{self, mark};
use crate::progress::Reporter;
use crate::stdout::to_stdout;
use anyhow::Context;
use clap::Args;
use dsfms::calibrate::{Board, CalibrateOptions, Calibration, calibrate};
use dsfms::guard;
use dsfms::image::Frame;
use dsfms::image::names::EXTENSIONS;
use dsfms::io::camera::{CameraFile, write_camera};
use dsfms::pipeline::Progress;
use dsfms::video::SelectOptions;
use serde_json::json;
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  # A board of 15 x 11 squares has 14 x 10 inner corners
  dsfms calibrate chessboard/ --board 14x10 --square 3mm -o camera.json
  # Some images show only a part of the board
  dsfms calibrate chessboard/*.png --board 14x10 --square 3mm --partial \\
      -o camera.json

Ten or more sharp images, the board tilted by 20 to 45 degrees in different
directions, its corners reaching into every part of the image. Beside
camera.json a folder camera.calibration/ is written: report.json (residuals of
every image, standard deviations and covariance of the intrinsics),
residuals.png, and the corners found in every image. A camera file that is
there is replaced where camera.calibration/dsfms.json says that it is ours.";

/// Intrinsics and distortion from images of a chessboard.
#[derive(Debug, Args)]
#[command(after_long_help = EXAMPLES)]
pub struct CalibrateArgs {
    /// Folder of images, image files, or one video.
    #[arg(value_name = "IMAGES", required = true)]
    images: Vec<PathBuf>,
    /// Inner corners along both sides of the board: where four squares meet, not the squares.
    #[arg(help_heading = "Board", long, value_name = "COLUMNSxROWS", value_parser = board_size)]
    board: [usize; 2],
    /// Side of one square, as 3mm or 0.3cm; a plain number is mm.
    #[arg(help_heading = "Board", long, value_name = "LENGTH", value_parser = length_mm)]
    square: f64,
    /// Estimate the third radial coefficient too.
    #[arg(help_heading = "Lens", long)]
    third_radial: bool,
    /// Hold the tangential distortion at zero.
    #[arg(help_heading = "Lens", long)]
    no_tangential: bool,
    /// Use images that show only a part of the board, from 4x4 corners on.
    #[arg(help_heading = "Lens", long)]
    partial: bool,
    /// Camera file to write.
    #[arg(
        help_heading = "Output",
        short,
        long,
        value_name = "FILE",
        default_value = "camera.json"
    )]
    output: PathBuf,
}

/// Corners along both sides, `14x10`.
pub fn board_size(text: &str) -> Result<[usize; 2], String> {
    let expected = || format!("{text:?}; expected two counts of inner corners, as 10x7");
    let (columns, rows) = text.split_once(['x', 'X', '×']).ok_or_else(expected)?;
    let count = |word: &str| word.trim().parse::<usize>().map_err(|_| expected());
    Ok([count(columns)?, count(rows)?])
}

/// A length in mm: `3mm`, `0.3cm`, `0.003m` or `3`.
pub fn length_mm(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let units = [("mm", 1.0), ("cm", 10.0), ("m", 1000.0), ("", 1.0)];
    let (number, factor) = units
        .iter()
        .find_map(|(unit, factor)| Some((text.strip_suffix(unit)?, factor)))
        .unwrap_or((text, &1.0));
    match number.trim().parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value * factor),
        _ => Err(format!("{text:?}; expected a positive length, as 3mm")),
    }
}

/// Run the command.
pub fn run(args: &CalibrateArgs, global: &Global, reporter: &Reporter) -> anyhow::Result<Outcome> {
    let folder = args.output.with_extension("calibration");
    let image = args.output.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if EXTENSIONS.contains(&image.as_str()) {
        let output = args.output.display();
        return Err(Usage(format!("-o {output}: expected a camera file, as camera.json")).into());
    }
    check_ours(args, &folder)?;
    let frames = frames(args, reporter)?;
    let board = Board { corners: args.board, square: args.square };
    let options = CalibrateOptions {
        third_radial: args.third_radial,
        tangential: !args.no_tangential,
        partial: args.partial,
    };
    reporter.step("board and intrinsics", 0, 1);
    let found = calibrate(&frames, &board, &options)?;
    reporter.step("board and intrinsics", 1, 1);
    let file =
        CameraFile { camera: found.camera.clone(), tone: None, light: None, vignetting: None };
    mark::claim(&folder, "calibrate")?;
    write_camera(&args.output, &file)?;
    write_pictures(&folder, &frames, &found)?;
    write_json(&folder.join("report.json"), &report(&frames, &board, &found))?;
    reporter.finish();
    warnings(&frames, &found).iter().for_each(|w| reporter.warn(w));
    if !global.quiet {
        to_stdout(&table(&frames, &found))?;
    }
    Ok(if found.rejected.is_empty() { Outcome::Ok } else { Outcome::Degraded })
}

/// Refuse to replace a camera file, or what lies in the folder about it, that no calibration of
/// ours wrote.
fn check_ours(args: &CalibrateArgs, folder: &Path) -> anyhow::Result<()> {
    place::keep_inputs(&args.output, args.images.iter().map(PathBuf::as_path))?;
    let ours = |name: &str| ["report.json", "residuals.png", "corners"].contains(&name);
    mark::check_names(folder, &["calibrate"], "-o", ours)?;
    if args.output.is_file() && !mark::is_marked(folder, &["calibrate"]) {
        anyhow::bail!(
            "{} is there, and no {} beside it says that it is of an older calibration; choose another name \
             with -o, or remove it",
            args.output.display(),
            folder.join(mark::MARK).display()
        );
    }
    check_folder(folder)
}

fn frames(args: &CalibrateArgs, reporter: &Reporter) -> anyhow::Result<Vec<Frame>> {
    let chosen = SelectOptions::default();
    let purpose = inputs::Purpose::Template(&chosen);
    let sources = inputs::sources(&args.images, purpose, reporter)?;
    let paths: Vec<&Path> = sources.iter().filter_map(Source::path).collect();
    place::keep_inputs(&args.output, paths.iter().copied())?;
    // The same picture twice tells nothing more, and makes the uncertainty too small.
    let mut known = BTreeSet::new();
    if let Some(path) = paths.iter().find(|path| !known.insert(place::real(path))) {
        return Err(Usage(format!("{} is given twice", path.display())).into());
    }
    let mut frames = Vec::new();
    for source in &sources {
        match source.frame() {
            Ok(frame) => frames.push(frame),
            Err(error) => reporter.warn(&format!("left out: {error}")),
        }
    }
    if frames.is_empty() {
        anyhow::bail!("none of the images can be read");
    }
    Ok(frames)
}

fn write_pictures(folder: &Path, frames: &[Frame], found: &Calibration) -> anyhow::Result<()> {
    let corners = folder.join("corners");
    std::fs::create_dir_all(&corners)
        .with_context(|| format!("cannot create {}", corners.display()))?;
    let own: BTreeSet<&str> = found.views.iter().map(|v| frames[v.frame].name.as_str()).collect();
    remove_older(folder, &corners, &own)?;
    for view in &found.views {
        let frame = &frames[view.frame];
        write_png(&corners.join(format!("{}.png", frame.name)), &pictures::corners(frame, view))?;
    }
    write_png(&folder.join("residuals.png"), &pictures::residuals(found))
}

/// Remove the pictures that the report of an earlier run names, and that this one does not write
/// anew.
fn remove_older(folder: &Path, corners: &Path, own: &BTreeSet<&str>) -> anyhow::Result<()> {
    let report = folder.join("report.json");
    let Ok(text) = guard::read_text_at_most(&report, guard::MOST_JSON_BYTES) else {
        return Ok(());
    };
    let older: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
    let images = older["images"].as_array().into_iter().flatten();
    let names = images.filter_map(|image| image["image"].as_str()).filter(|n| !own.contains(n));
    let files: BTreeSet<String> = names.map(|name| format!("{name}.png")).collect();
    // Of files that lie here: a report may name any.
    for entry in std::fs::read_dir(corners)?.flatten() {
        if files.contains(&*entry.file_name().to_string_lossy()) {
            let path = entry.path();
            std::fs::remove_file(&path)
                .with_context(|| format!("cannot remove {} of an older run", path.display()))?;
        }
    }
    Ok(())
}

fn report(frames: &[Frame], board: &Board, found: &Calibration) -> serde_json::Value {
    let images = found.views.iter().map(|view| {
        let corner = |(c, r): (&dsfms::calibrate::BoardCorner, &dsfms::geometry::Vector2)| {
            json!({ "grid": c.grid, "pixel": [c.pixel.x, c.pixel.y], "residual": [r.x, r.y] })
        };
        let rotation = view.pose.rotation.to_rotation_matrix();
        let t = view.pose.translation.vector;
        json!({
            "image": frames[view.frame].name,
            "rms_px": view.rms_px(),
            "largest_px": view.largest_px(),
            "camera_from_board": {
                "R": (0..3).map(|i| [0, 1, 2].map(|j| rotation[(i, j)])).collect::<Vec<_>>(),
                "t": [t.x, t.y, t.z],
            },
            "corners": view.corners.iter().zip(&view.residuals).map(corner).collect::<Vec<_>>(),
        })
    });
    let rejected = found.rejected.iter();
    let rejected =
        rejected.map(|(i, why)| json!({ "image": frames[*i].name, "reason": why.to_string() }));
    json!({
        "board": board,
        "size": found.camera.size,
        "rms_px": found.rms_px(),
        "intrinsics": found.estimates,
        "covariance": found.covariance,
        "images": images.collect::<Vec<_>>(),
        "rejected": rejected.collect::<Vec<_>>(),
    })
}

fn table(frames: &[Frame], found: &Calibration) -> String {
    let mut text = String::new();
    for e in &found.estimates {
        let digits = if e.value.abs() > 10.0 { 2 } else { 5 };
        let spread = match e.deviation > 0.0 {
            true => format!("+- {:.digits$}", e.deviation),
            false => "fixed".into(),
        };
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{:<4}{:>12.digits$} {spread}", e.name, e.value);
    }
    let _ = writeln!(text, "\n{:<32}{:>8}{:>9}{:>9}", "image", "corners", "rms px", "max px");
    for view in &found.views {
        let name = &frames[view.frame].name;
        let (n, rms, max) = (view.corners.len(), view.rms_px(), view.largest_px());
        let _ = writeln!(text, "{name:<32}{n:>8}{rms:>9.3}{max:>9.3}");
    }
    for (i, why) in &found.rejected {
        let _ = writeln!(text, "{:<32}rejected: {why}", frames[*i].name);
    }
    let _ = writeln!(text, "{:<40}{:>9.3}", "all", found.rms_px());
    text
}

/// What makes a calibration doubtful.
fn warnings(frames: &[Frame], found: &Calibration) -> Vec<String> {
    let mut out = Vec::new();
    let rms = found.rms_px();
    if rms > 1.0 {
        out.push(format!(
            "residuals of {rms:.2} px rms are large; is the board flat and in focus?"
        ));
    }
    for view in found.views.iter().filter(|v| v.rms_px() > 3.0 * rms) {
        let (name, own) = (&frames[view.frame].name, view.rms_px());
        out.push(format!("image {name} fits badly ({own:.2} px rms); leave it out and compare"));
    }
    let focal = found.estimates[0];
    let relative = focal.deviation / focal.value;
    if relative > 0.01 {
        out.push(format!(
            "the focal length is known to {:.1} % only; add images with more tilt",
            100.0 * relative
        ));
    }
    if found.views.len() < 10 {
        out.push(format!("{} images; 10 or more are advised", found.views.len()));
    }
    let reach = reach(found);
    if reach < 0.7 {
        out.push(format!(
            "the corners reach {:.0} % of the way to the image corners; distortion beyond is extrapolated",
            100.0 * reach
        ));
    }
    out
}

/// Distance of the outermost corner from the image centre, relative to half the diagonal.
fn reach(found: &Calibration) -> f64 {
    let [w, h] = found.camera.size.map(|n| 0.5 * (n as f64 - 1.0));
    let corners = found.views.iter().flat_map(|v| &v.corners);
    let far = corners.map(|c| (c.pixel.x - w).hypot(c.pixel.y - h)).fold(0.0, f64::max);
    far / w.hypot(h)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_and_board_sizes() {
        assert_eq!(length_mm("3mm"), Ok(3.0));
        assert_eq!(length_mm(" 0.5 cm"), Ok(5.0));
        assert_eq!(length_mm("2.5"), Ok(2.5));
        assert!(length_mm("-3mm").is_err() && length_mm("three").is_err());
        assert_eq!(board_size("10x7"), Ok([10, 7]));
        assert!(board_size("10").unwrap_err().contains("10x7"));
    }
}
