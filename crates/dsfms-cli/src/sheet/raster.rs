//! A sheet as pixels, edges smoothed by how much of a pixel is covered.

use super::{Anchor, Item, Place, Sheet, colours, font};
use image::{Rgb, RgbImage};
use zeno::{Command, Join, Mask, PathBuilder, Stroke, Style, Transform};

/// The pixels at a scale, pixels per unit of the sheet.
pub fn pixels(sheet: &Sheet, scale: f64) -> RgbImage {
    let [w, h] = sheet.size.map(|v| (v * scale).round().clamp(1.0, 60_000.0) as u32);
    let mut page = RgbImage::from_pixel(w, h, Rgb([255; 3]));
    draw(&mut page, &sheet.items, scale);
    page
}

/// Items over a picture, at a scale, pixels per unit of theirs.
pub fn draw(page: &mut RgbImage, items: &[Item], scale: f64) {
    for item in items {
        match item {
            Item::Picture { at, size, picture } => place(page, *at, *size, picture, scale),
            Item::Text { at, anchor, size, upright, text } => {
                let path = lettering(*at, *anchor, *size, *upright, text, scale);
                fill(page, &path, colours::INK, 1.0);
            }
            Item::Line { points, width, dash, ink, .. } => {
                let dash: Vec<f32> = dash.iter().map(|d| (d * scale) as f32).collect();
                let path = polyline(points, scale, false);
                stroke(page, &path, width * scale, &dash, colours::of(*ink), 1.0);
            }
            Item::Area { points, ink } => {
                fill(page, &polyline(points, scale, true), colours::of(*ink), 1.0);
            }
            Item::Disc { at, radius, ink } => {
                let mut path = Vec::new();
                path.add_circle(at.map(|v| (v * scale) as f32), (radius * scale) as f32);
                fill(page, &path, colours::of(*ink), 1.0);
            }
        }
    }
}

fn place(page: &mut RgbImage, at: Place, size: Place, picture: &RgbImage, scale: f64) {
    let [x, y] = at.map(|v| (v * scale).round() as i64);
    let [w, h] = size.map(|v| (v * scale).round().max(1.0) as u32);
    if picture.dimensions() == (w, h) {
        image::imageops::replace(page, picture, x, y);
    } else {
        let filter = image::imageops::FilterType::Triangle;
        image::imageops::replace(page, &image::imageops::resize(picture, w, h, filter), x, y);
    }
}

/// The outline of a text in pixels.
fn lettering(
    at: Place,
    anchor: Anchor,
    size: f64,
    upright: bool,
    text: &str,
    scale: f64,
) -> Vec<Command> {
    let left = match anchor {
        Anchor::Start => 0.0,
        Anchor::Middle => -0.5 * font::width(text, size),
        Anchor::End => -font::width(text, size),
    };
    let left = (left * scale) as f32;
    let [x, y] = at.map(|v| (v * scale) as f32);
    // Letters are drawn up, pictures down; an upright text reads upwards.
    let to_page = match upright {
        false => Transform::new(1.0, 0.0, 0.0, -1.0, x + left, y),
        true => Transform::new(0.0, -1.0, -1.0, 0.0, x, y - left),
    };
    font::outline(text, size * scale).iter().map(|c| c.transform(&to_page)).collect()
}

/// A path through points; those that are no numbers break it.
pub fn polyline(points: &[Place], scale: f64, closed: bool) -> Vec<Command> {
    let mut path = Vec::new();
    let mut first = true;
    for p in points {
        let p = p.map(|v| (v * scale) as f32);
        match (p.iter().all(|v| v.is_finite()), first) {
            (false, _) => first = true,
            (true, true) => {
                path.move_to(p);
                first = false;
            }
            (true, false) => {
                path.line_to(p);
            }
        }
    }
    if closed && !path.is_empty() {
        path.close();
    }
    path
}

/// Fill a path (pixels) with a colour; the path covers itself once.
pub fn fill(page: &mut RgbImage, path: &[Command], colour: [u8; 3], opacity: f64) {
    paint(page, path, zeno::Fill::NonZero.into(), colour, opacity);
}

/// Draw along a path (pixels) with a round pen of a width, px.
pub fn stroke(
    page: &mut RgbImage,
    path: &[Command],
    width: f64,
    dash: &[f32],
    colour: [u8; 3],
    opacity: f64,
) {
    let mut pen = Stroke::new(width as f32);
    pen.join(Join::Round).dash(dash, 0.0);
    paint(page, path, pen.into(), colour, opacity);
}

fn paint(page: &mut RgbImage, path: &[Command], style: Style, colour: [u8; 3], opacity: f64) {
    if path.is_empty() {
        return;
    }
    // The mask has the size of the page, or less where the path is small; what lies outside is
    // dropped.
    let bounds = zeno::bounds(path, style, None);
    let low = [bounds.min.x, bounds.min.y].map(|v| v.floor().max(0.0) as u32);
    let ends = [bounds.max.x, bounds.max.y].map(|v| v.ceil().max(0.0));
    let size = [page.width(), page.height()];
    let high: [u32; 2] = std::array::from_fn(|k| (ends[k] as u32 + 1).min(size[k]));
    if low[0] >= high[0] || low[1] >= high[1] {
        return;
    }
    let (w, h) = (high[0] - low[0], high[1] - low[1]);
    let mut cover = vec![0u8; w as usize * h as usize];
    Mask::new(path)
        .style(style)
        .offset([-(low[0] as f32), -(low[1] as f32)])
        .size(w, h)
        .render_into(&mut cover, None);
    for (k, cover) in (0..).zip(&cover).filter(|(_, c)| **c > 0) {
        let t = opacity * f64::from(*cover) / 255.0;
        let pixel = page.get_pixel_mut(low[0] + k % w, low[1] + k / w);
        for (value, c) in pixel.0.iter_mut().zip(colour) {
            *value = (f64::from(*value) * (1.0 - t) + f64::from(c) * t).round() as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Ink;
    use super::*;

    fn dark(page: &RgbImage) -> Vec<[u32; 2]> {
        page.enumerate_pixels().filter(|p| p.2.0[0] < 90).map(|p| [p.0, p.1]).collect()
    }

    #[test]
    fn text_is_dark_on_white_and_centred() {
        let mut sheet = Sheet::in_pixels(200, 60);
        sheet.write([100.0, 30.0], Anchor::Middle, 24.0, "HHHH");
        let seen = dark(&pixels(&sheet, 1.0));
        let ends = |k: usize| {
            let all = || seen.iter().map(|p| p[k]);
            [all().min().unwrap(), all().max().unwrap()]
        };
        let ([left, right], [top, bottom]) = (ends(0), ends(1));
        assert!((f64::from(left + right) / 2.0 - 100.0).abs() < 2.0, "{left} {right}");
        // Capitals are 0.69 of the size high, and stand on the line.
        assert!(bottom.abs_diff(29) <= 1 && (bottom - top).abs_diff(16) <= 1, "{top} {bottom}");
    }

    #[test]
    fn an_upright_text_reads_upwards() {
        let mut sheet = Sheet::in_pixels(40, 100);
        let text = "H.".to_string();
        sheet.items.push(Item::Text {
            at: [30.0, 90.0],
            anchor: Anchor::Start,
            size: 30.0,
            upright: true,
            text,
        });
        let seen = dark(&pixels(&sheet, 1.0));
        // The full stop is above the H, near the line.
        let stop: Vec<_> = seen.iter().filter(|p| p[1] < 66).collect();
        assert!(!stop.is_empty() && stop.iter().all(|p| p[0] > 24 && p[0] < 31), "{stop:?}");
    }

    #[test]
    fn a_line_is_as_wide_as_said_and_scales() {
        let mut sheet = Sheet::in_pixels(20, 20);
        sheet.items.push(Item::line(vec![[10.0, -5.0], [10.0, 30.0]], 3.0, Ink::Rgb([0; 3])));
        for scale in [1.0, 4.0] {
            let page = pixels(&sheet, scale);
            let row: f64 = (0..page.width())
                .map(|x| 1.0 - f64::from(page.get_pixel(x, page.height() / 2).0[0]) / 255.0)
                .sum();
            assert!((row - 3.0 * scale).abs() < 0.1 * scale, "{row} at {scale}");
        }
    }

    #[test]
    fn what_is_outside_or_no_number_is_no_trouble() {
        let mut page = RgbImage::new(8, 8);
        let path = polyline(&[[-1e30, f64::NAN], [4.0, -90.0], [40.0, -80.0]], 1.0, false);
        stroke(&mut page, &path, 2.0, &[], [255; 3], 1.0);
        assert!(page.pixels().all(|p| p.0 == [0; 3]));
    }
}
