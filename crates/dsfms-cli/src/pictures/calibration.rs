//! A calibration to look at: the corners found in an image, and what is left of all of them.

use super::TEXT;
use crate::draw::{dot, line, picture};
use crate::sheet::colours::{round_down, series};
use crate::sheet::{Anchor, Ink, Item, Place, Sheet, font, raster};
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
    let words = format!("{count} corners, rms {rms:.3} px, residuals ×{magnified:.0}");
    labelled(&mut canvas, &words);
    canvas
}

/// Words on a white strip in the upper left corner, as large as the picture asks for.
fn labelled(canvas: &mut RgbImage, words: &str) {
    let size = TEXT.max(f64::from(canvas.width()) / 64.0);
    let strip = [font::width(words, size) + size, 1.6 * size];
    let items = [
        Item::block([0.0, 0.0], strip, Ink::Rgb([255; 3])),
        Item::text([0.5 * size, 1.15 * size], Anchor::Start, size, words),
    ];
    raster::draw(canvas, &items, 1.0);
}

/// A round factor that makes the large residuals about [`REACH`] long.
fn magnification<'a>(residuals: impl Iterator<Item = &'a Vector2>) -> f64 {
    let mut lengths: Vec<f64> = residuals.map(|r| r.norm()).collect();
    lengths.sort_by(f64::total_cmp);
    let large = lengths.get(lengths.len() * 95 / 100).copied().unwrap_or(1.0).max(1e-6);
    round_down(REACH / large)
}

/// Left: where the corners of all images lie, with magnified residuals. Right: the residuals
/// themselves around zero.
pub fn residuals(calibration: &Calibration) -> RgbImage {
    const WIDTH: f64 = 800.0;
    const TOP: f64 = 40.0;
    const MARGIN: f64 = 20.0;
    let [w, h] = calibration.camera.size.map(|n| n as f64);
    let scale = WIDTH / w;
    let high = (h * scale).max(360.0).round();
    let image = Area { at: [MARGIN, TOP], size: [WIDTH, h * scale] };
    let cloud = Area { at: [WIDTH + 3.0 * MARGIN, TOP], size: [high, high] };
    let size = [cloud.at[0] + high + MARGIN, TOP + high + 2.0 * MARGIN];
    let mut sheet = Sheet::in_pixels(size[0] as u32, size[1] as u32);
    sheet.items.extend(coverage(image, calibration, scale));
    sheet.items.extend(scatter(cloud, calibration));
    raster::pixels(&sheet, 1.0)
}

/// A place on the sheet.
#[derive(Clone, Copy)]
struct Area {
    at: Place,
    size: Place,
}

impl Area {
    /// A point from fractions of the area, v downwards.
    fn point(&self, u: f64, v: f64) -> Place {
        [self.at[0] + u * self.size[0], self.at[1] + v * self.size[1]]
    }

    fn title(&self, words: String) -> Item {
        Item::text([self.at[0], self.at[1] - 12.0], Anchor::Start, TEXT, words)
    }
}

fn colour(k: usize) -> Ink {
    Ink::Rgb(series(k))
}

fn coverage(area: Area, calibration: &Calibration, scale: f64) -> Vec<Item> {
    let mut items = vec![Item::frame(area.at, area.size, 1.0, Ink::Text)];
    let magnified = magnification(calibration.views.iter().flat_map(|v| &v.residuals));
    let on = |p: Point2| [area.at[0] + p.x * scale, area.at[1] + p.y * scale];
    let [cx, cy] = calibration.camera.centre;
    let [x, y] = on(Point2::new(cx, cy));
    for [dx, dy] in [[8.0, 0.0], [0.0, 8.0]] {
        let arm = vec![[x - dx, y - dy], [x + dx, y + dy]];
        items.push(Item::line(arm, 1.5, Ink::Text));
    }
    for (k, view) in calibration.views.iter().enumerate() {
        for (corner, residual) in view.corners.iter().zip(&view.residuals) {
            let at = on(corner.pixel);
            let end = [at[0] + residual.x * magnified, at[1] + residual.y * magnified];
            items.push(Item::Disc { at, radius: 1.6, ink: colour(k) });
            items.push(Item::line(vec![at, end], 1.0, colour(k)));
        }
    }
    let n = calibration.views.len();
    let words = format!("corners of {n} images, residuals ×{magnified:.0}; cross: principal point");
    items.push(area.title(words));
    items
}

fn scatter(area: Area, calibration: &Calibration) -> Vec<Item> {
    let mut items = vec![Item::frame(area.at, area.size, 1.0, Ink::Text)];
    let rms = calibration.rms_px();
    // Nearly all of a Gaussian cloud; the rest is drawn on the rim.
    let full = round_down((4.5 * rms).max(1e-6));
    for k in 1..4 {
        let t = f64::from(k) / 4.0;
        for ends in
            [[area.point(t, 0.0), area.point(t, 1.0)], [area.point(0.0, t), area.point(1.0, t)]]
        {
            items.push(Item::line(ends.to_vec(), 1.0, Ink::Grid));
        }
    }
    for (k, view) in calibration.views.iter().enumerate() {
        for r in &view.residuals {
            let [u, v] = [r.x, r.y].map(|d| (0.5 + 0.5 * d / full).clamp(0.0, 1.0));
            items.push(Item::Disc { at: area.point(u, v), radius: 2.0, ink: colour(k) });
        }
    }
    items.push(area.title(format!("residuals ±{full} px, rms {rms:.3} px")));
    for (u, anchor, words) in
        [(0.0, Anchor::Start, format!("−{full}")), (1.0, Anchor::End, format!("{full} px"))]
    {
        let [x, y] = area.point(u, 1.0);
        items.push(Item::text([x, y + 1.2 * TEXT], anchor, TEXT, words));
    }
    items
}
