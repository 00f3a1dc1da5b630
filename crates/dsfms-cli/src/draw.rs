//! Drawing on pixels: frames, shaded surfaces, colours of errors. Lines, areas and text are items
//! of a sheet ([`crate::sheet`]).

pub mod overlay;
mod side_view;

pub use side_view::{SideView, Window};

use dsfms::geometry::Point2;
use dsfms::image::Frame;
use image::RgbImage;

/// The frame as an image that can be drawn on.
pub fn picture(frame: &Frame) -> RgbImage {
    let [w, h] = frame.size;
    RgbImage::from_fn(w as u32, h as u32, |x, y| image::Rgb(frame.rgb[y as usize * w + x as usize]))
}

/// Background of drawn views.
pub const PAPER: [u8; 3] = [246, 247, 249];
/// A surface without colours of its own.
pub const CLAY: [u8; 3] = [208, 178, 168];

/// Colour of an error between 0 (dark blue) and `full` (yellow).
pub fn error_colour(error: f64, full: f64) -> [u8; 3] {
    ramp(&CIVIDIS, error / full)
}

/// Perceptually uniform, also in grey and with colour-blind eyes (Nuñez et al. 2018).
pub const CIVIDIS: [[u8; 3]; 10] = [
    [0, 34, 78],
    [18, 53, 112],
    [59, 73, 108],
    [87, 93, 109],
    [112, 113, 115],
    [138, 134, 120],
    [165, 156, 116],
    [195, 179, 105],
    [225, 204, 85],
    [254, 232, 56],
];

/// Colour at `t` in `[0, 1]`, linear between evenly spaced stops.
pub fn ramp(stops: &[[u8; 3]], t: f64) -> [u8; 3] {
    let last = stops.len() - 1;
    let t = if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) } * last as f64;
    let k = (t as usize).min(last.saturating_sub(1));
    let u = t - k as f64;
    std::array::from_fn(|c| {
        let [a, b] = [stops[k], stops[k + 1]].map(|s| f64::from(s[c]));
        ((1.0 - u) * a + u * b).round() as u8
    })
}

/// Mix a colour into a pixel; outside the picture nothing happens.
pub fn blend(canvas: &mut RgbImage, x: i64, y: i64, colour: [u8; 3], alpha: f64) {
    if x < 0 || y < 0 || x >= i64::from(canvas.width()) || y >= i64::from(canvas.height()) {
        return;
    }
    let pixel = canvas.get_pixel_mut(x as u32, y as u32);
    for (value, c) in pixel.0.iter_mut().zip(colour) {
        *value = (f64::from(*value) * (1.0 - alpha) + f64::from(c) * alpha).round() as u8;
    }
}

/// An anti-aliased line one pixel wide: along its longer axis, the two pixels across it share the
/// opacity by their distance.
pub fn line(canvas: &mut RgbImage, from: Point2, to: Point2, colour: [u8; 3], opacity: f64) {
    let reach = 4.0 * f64::from(canvas.width().max(canvas.height()));
    if [from, to].iter().any(|p| !(p.x.abs() < reach && p.y.abs() < reach)) {
        return;
    }
    let d = to - from;
    let steep = d.y.abs() > d.x.abs();
    let along = |p: Point2| if steep { (p.y, p.x) } else { (p.x, p.y) };
    let (mut a, mut b) = (along(from), along(to));
    if a.0 > b.0 {
        std::mem::swap(&mut a, &mut b);
    }
    let slope = if b.0 > a.0 { (b.1 - a.1) / (b.0 - a.0) } else { 0.0 };
    for s in a.0.round() as i64..=b.0.round() as i64 {
        let t = a.1 + slope * (s as f64 - a.0);
        let low = t.floor();
        for (c, weight) in [(low, 1.0 - (t - low)), (low + 1.0, t - low)] {
            let (x, y) = if steep { (c as i64, s) } else { (s, c as i64) };
            blend(canvas, x, y, colour, opacity * weight);
        }
    }
}

/// A filled disc with a soft rim.
pub fn dot(canvas: &mut RgbImage, at: Point2, radius: f64, colour: [u8; 3], opacity: f64) {
    if !(at.x.is_finite() && at.y.is_finite()) {
        return;
    }
    let reach = radius.ceil() as i64 + 1;
    let (cx, cy) = (at.x.round() as i64, at.y.round() as i64);
    for y in cy - reach..=cy + reach {
        for x in cx - reach..=cx + reach {
            let distance = (Point2::new(x as f64, y as f64) - at).norm();
            let cover = (radius + 0.5 - distance).clamp(0.0, 1.0);
            if cover > 0.0 {
                blend(canvas, x, y, colour, opacity * cover);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slanted_line_is_opaque_across() {
        let mut canvas = RgbImage::new(20, 20);
        line(&mut canvas, Point2::new(2.0, 3.3), Point2::new(17.0, 9.1), [255; 3], 1.0);
        for x in 2..=17 {
            let column: u32 = (0..20).map(|y| u32::from(canvas.get_pixel(x, y).0[0])).sum();
            assert!((254..=256).contains(&column), "{column} at {x}");
        }
    }

    #[test]
    fn points_outside_are_no_trouble() {
        let mut canvas = RgbImage::new(8, 8);
        line(&mut canvas, Point2::new(-1e30, f64::NAN), Point2::new(4.0, 4.0), [255; 3], 1.0);
        dot(&mut canvas, Point2::new(-3.0, 20.0), 2.0, [255; 3], 1.0);
        assert!(canvas.pixels().all(|p| p.0 == [0; 3]));
    }
}
