//! Axes, colour bars and colours that pictures share.

use super::text::{self, text};
use crate::draw::line;
use dsfms::geometry::Point2;
use image::RgbImage;

pub const PAPER: [u8; 3] = [246, 247, 249];
pub const INK: [u8; 3] = [40, 44, 52];
pub const GRID: [u8; 3] = [196, 200, 206];

/// A place on a canvas, px.
#[derive(Clone, Copy, Debug)]
pub struct Area {
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub height: u32,
}

impl Area {
    /// A point from fractions of the area, v downwards.
    pub fn at(&self, u: f64, v: f64) -> Point2 {
        Point2::new(
            f64::from(self.x) + u * f64::from(self.width - 1),
            f64::from(self.y) + v * f64::from(self.height - 1),
        )
    }
}

/// The outline of an area.
pub fn frame(canvas: &mut RgbImage, area: Area, colour: [u8; 3]) {
    let corners = [area.at(0.0, 0.0), area.at(1.0, 0.0), area.at(1.0, 1.0), area.at(0.0, 1.0)];
    for k in 0..4 {
        line(canvas, corners[k], corners[(k + 1) % 4], colour, 1.0);
    }
}

/// An upright colour bar with labelled ticks at fractions from the bottom.
pub fn colour_bar(
    canvas: &mut RgbImage,
    area: Area,
    colour: impl Fn(f64) -> [u8; 3],
    ticks: &[(f64, String)],
) {
    let last = f64::from(area.height - 1);
    for y in 0..area.height {
        let c = colour(1.0 - f64::from(y) / last);
        for x in 0..area.width {
            canvas.put_pixel(area.x + x, area.y + y, image::Rgb(c));
        }
    }
    frame(canvas, area, INK);
    for (at, label) in ticks {
        let p = area.at(1.0, 1.0 - at);
        line(canvas, p, Point2::new(p.x + 5.0, p.y), INK, 1.0);
        let y = p.y as i64 - i64::from(text::HEIGHT) / 2;
        text(canvas, p.x as i64 + 8, y, label, INK);
    }
}

/// A length of 1, 2 or 5 times a power of ten that is at most `largest` (positive).
pub fn round_length(largest: f64) -> f64 {
    let power = 10.0_f64.powf(largest.log10().floor());
    [5.0, 2.0, 1.0].iter().map(|m| m * power).find(|v| *v <= largest).unwrap_or(power)
}

/// Colour `k` of a cycle that colour-blind eyes tell apart (Okabe and Ito).
pub fn series(k: usize) -> [u8; 3] {
    const CYCLE: [[u8; 3]; 7] = [
        [0, 114, 178],
        [213, 94, 0],
        [0, 158, 115],
        [204, 121, 167],
        [230, 159, 0],
        [86, 180, 233],
        [90, 90, 90],
    ];
    CYCLE[k % CYCLE.len()]
}

/// From blue (−1) over white to red (1).
pub fn diverging(t: f64) -> [u8; 3] {
    const BLUE: [f64; 3] = [33.0, 102.0, 172.0];
    const WHITE: [f64; 3] = [247.0, 247.0, 247.0];
    const RED: [f64; 3] = [178.0, 24.0, 43.0];
    let (end, u) = if t < 0.0 { (BLUE, -t) } else { (RED, t) };
    let u = u.clamp(0.0, 1.0);
    std::array::from_fn(|c| ((1.0 - u) * WHITE[c] + u * end[c]) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_lengths_are_one_two_five() {
        for (largest, round) in [(0.3, 0.2), (1.0, 1.0), (7.3, 5.0), (99.0, 50.0)] {
            assert!((round_length(largest) - round).abs() < 1e-12 * round);
        }
    }
}
