//! A calibration to look at: the corners found in an image, and what is left of all of them.

use super::plot::{Area, GRID, INK, PAPER, frame, round_length, series};
use super::text::text;
use crate::draw::{dot, line, picture};
use dsfms::calibrate::{BoardView, Calibration};
use dsfms::geometry::{Point2, Vector2};
use dsfms::image::Frame;
use image::RgbImage;

/// Longest arrow or cloud radius, px of the picture.
const REACH: f64 = 40.0;

/// The corners over their image: joined row by row, the residual of each as a magnified arrow.
pub fn corners(image: &Frame, view: &BoardView) -> RgbImage {
    let mut canvas = picture(image);
    for (row, pair) in view.corners.windows(2).map(|p| (p[0].grid[1], p)) {
        let same = pair[1].grid[1] == row;
        line(&mut canvas, pair[0].pixel, pair[1].pixel, series(row), if same { 0.9 } else { 0.3 });
    }
    let magnified = magnification(view.residuals.iter());
    for (corner, residual) in view.corners.iter().zip(&view.residuals) {
        let own = if corner.grid == [0, 0] { [255, 220, 0] } else { series(corner.grid[1]) };
        dot(&mut canvas, corner.pixel, 3.0, [0, 0, 0], 0.8);
        dot(&mut canvas, corner.pixel, 2.0, own, 1.0);
        line(&mut canvas, corner.pixel, corner.pixel + residual * magnified, [255, 40, 40], 1.0);
    }
    let (rms, count) = (view.rms_px(), view.corners.len());
    let words = format!("{count} corners, rms {rms:.3} px, residuals x{magnified:.0}");
    shadowed(&mut canvas, 8, 8, &words);
    canvas
}

fn shadowed(canvas: &mut RgbImage, x: i64, y: i64, words: &str) {
    text(canvas, x + 1, y + 1, words, [0; 3]);
    text(canvas, x, y, words, [255; 3]);
}

/// A round factor that makes the large residuals about [`REACH`] long.
fn magnification<'a>(residuals: impl Iterator<Item = &'a Vector2>) -> f64 {
    let mut lengths: Vec<f64> = residuals.map(|r| r.norm()).collect();
    lengths.sort_by(f64::total_cmp);
    let large = lengths.get(lengths.len() * 95 / 100).copied().unwrap_or(1.0).max(1e-6);
    round_length(REACH / large)
}

/// Left: where the corners of all images lie, with magnified residuals. Right: the residuals
/// themselves around zero.
pub fn residuals(calibration: &Calibration) -> RgbImage {
    const WIDTH: f64 = 800.0;
    const TOP: u32 = 40;
    const MARGIN: u32 = 20;
    let [w, h] = calibration.camera.size.map(|n| n as f64);
    let scale = WIDTH / w;
    let high = (h * scale).max(360.0) as u32;
    let image = Area { x: MARGIN, y: TOP, width: WIDTH as u32, height: (h * scale) as u32 };
    let cloud = Area { x: image.x + image.width + 2 * MARGIN, y: TOP, width: high, height: high };
    let size = (cloud.x + cloud.width + MARGIN, TOP + high + 2 * MARGIN);
    let mut canvas = RgbImage::from_pixel(size.0, size.1, image::Rgb(PAPER));
    coverage(&mut canvas, image, calibration, scale);
    scatter(&mut canvas, cloud, calibration);
    canvas
}

fn coverage(canvas: &mut RgbImage, area: Area, calibration: &Calibration, scale: f64) {
    frame(canvas, area, INK);
    let magnified = magnification(calibration.views.iter().flat_map(|v| &v.residuals));
    let on = |p: Point2| Point2::from(p.coords * scale + area.at(0.0, 0.0).coords);
    let [cx, cy] = calibration.camera.centre;
    let centre = on(Point2::new(cx, cy));
    for arm in [Vector2::new(8.0, 0.0), Vector2::new(0.0, 8.0)] {
        line(canvas, centre - arm, centre + arm, INK, 1.0);
    }
    for (k, view) in calibration.views.iter().enumerate() {
        for (corner, residual) in view.corners.iter().zip(&view.residuals) {
            let p = on(corner.pixel);
            dot(canvas, p, 1.2, series(k), 0.9);
            line(canvas, p, p + residual * magnified, series(k), 0.8);
        }
    }
    let n = calibration.views.len();
    let words = format!("corners of {n} images, residuals x{magnified:.0}; cross: principal point");
    text(canvas, i64::from(area.x), 14, &words, INK);
}

fn scatter(canvas: &mut RgbImage, area: Area, calibration: &Calibration) {
    frame(canvas, area, INK);
    let rms = calibration.rms_px();
    // Nearly all of a Gaussian cloud; the rest is drawn on the rim.
    let full = round_length((4.5 * rms).max(1e-6));
    for k in 1..4 {
        let t = f64::from(k) / 4.0;
        line(canvas, area.at(t, 0.0), area.at(t, 1.0), GRID, 1.0);
        line(canvas, area.at(0.0, t), area.at(1.0, t), GRID, 1.0);
    }
    for (k, view) in calibration.views.iter().enumerate() {
        for r in &view.residuals {
            let [u, v] = [r.x, r.y].map(|d| (0.5 + 0.5 * d / full).clamp(0.0, 1.0));
            dot(canvas, area.at(u, v), 1.5, series(k), 0.7);
        }
    }
    let words = format!("residuals +-{full} px, rms {rms:.3} px");
    text(canvas, i64::from(area.x), 14, &words, INK);
    text(canvas, i64::from(area.x), i64::from(area.y + area.height) + 4, &format!("-{full}"), INK);
    let right = format!("{full} px");
    let x = i64::from(area.x + area.width) - super::text::width(&right);
    text(canvas, x, i64::from(area.y + area.height) + 4, &right, INK);
}
