//! Charts side by side in `[0, 1]²`.

use crate::geometry::{Point2, Vector2};
use nalgebra::Matrix2;

/// Gap around each chart as a fraction of the whole: 4 px at 1024.
const MARGIN: f64 = 4.0 / 1024.0;

/// Lay out charts (lists of faces), each turned to its principal axes, in rows of falling height,
/// then scale everything alike.
pub(super) fn pack(corners: &mut [[Point2; 3]], charts: &[Vec<usize>]) {
    let mut boxes: Vec<(usize, Vector2)> =
        charts.iter().enumerate().map(|(c, faces)| (c, lay_down(corners, faces))).collect();
    boxes.sort_by(|a, b| b.1.y.total_cmp(&a.1.y).then(a.0.cmp(&b.0)));
    let widest = boxes.iter().map(|b| b.1.x).fold(0.0, f64::max);
    let total: f64 = boxes.iter().map(|b| b.1.x * b.1.y).sum();
    // Try a few row widths and keep the one that fills a square best.
    let widths = (0..12).map(|k| widest.max(total.sqrt() * (0.8 + 0.1 * k as f64)));
    let best = widths
        .map(|width| (side(&rows(&boxes, width), &boxes), width))
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((side, width)) = best else { return };
    let scale = (1.0 - 2.0 * MARGIN) / side.max(1e-300);
    for ((chart, _), origin) in boxes.iter().zip(rows(&boxes, width)) {
        for &f in &charts[*chart] {
            corners[f] = corners[f].map(|p| {
                ((p + origin) * scale + Vector2::repeat(MARGIN)).map(|x| x.clamp(0.0, 1.0))
            });
        }
    }
}

/// Lower left corners of the boxes in rows no wider than `width`.
fn rows(boxes: &[(usize, Vector2)], width: f64) -> Vec<Vector2> {
    let gap = if boxes.len() > 1 { MARGIN * width } else { 0.0 };
    let (mut at, mut height) = (Vector2::zeros(), 0.0f64);
    let mut origins = Vec::new();
    for (_, size) in boxes {
        if at.x > 0.0 && at.x + size.x > width * (1.0 + 1e-12) {
            at = Vector2::new(0.0, at.y + height + gap);
            height = 0.0;
        }
        origins.push(at);
        at.x += size.x + gap;
        height = height.max(size.y);
    }
    origins
}

/// Side of the square that holds all placed boxes.
fn side(origins: &[Vector2], boxes: &[(usize, Vector2)]) -> f64 {
    origins.iter().zip(boxes).map(|(o, (_, size))| (o + size).max()).fold(0.0, f64::max)
}

/// Turn a chart so that its longer principal axis is u, move it to the origin; its size.
fn lay_down(corners: &mut [[Point2; 3]], faces: &[usize]) -> Vector2 {
    let points = || faces.iter().flat_map(|&f| corners[f]);
    let count = (3 * faces.len()) as f64;
    let centre = points().map(|p| p.coords).sum::<Vector2>() / count;
    let spread: Matrix2<f64> =
        points().map(|p| (p.coords - centre) * (p.coords - centre).transpose()).sum();
    let angle = 0.5 * (2.0 * spread.m12).atan2(spread.m11 - spread.m22);
    let turn = nalgebra::Rotation2::new(-angle);
    let turned = |p: Point2| turn * (p - centre);
    let low = points().map(turned).fold(Vector2::repeat(f64::INFINITY), |m, p| m.inf(&p.coords));
    let high =
        points().map(turned).fold(Vector2::repeat(f64::NEG_INFINITY), |m, p| m.sup(&p.coords));
    for &f in faces {
        corners[f] = corners[f].map(|p| turned(p) - low);
    }
    high - low
}
