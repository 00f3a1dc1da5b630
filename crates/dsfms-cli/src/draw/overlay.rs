//! The result over its frame: the mesh, what hides it, the matches by how far they are off.

use super::{picture, ramp};
use crate::sheet::colours::round_up;
use crate::sheet::legend::ColourBar;
use crate::sheet::{Anchor, Ink, Item, Place, font, raster};
use dsfms::camera::{Camera, CameraModel};
use dsfms::geometry::{Point2, Point3, Vector3};
use dsfms::image::{Frame, Mask, Outline};
use dsfms::mesh::Topology;
use dsfms::register::Match;
use image::RgbImage;
use zeno::PathBuilder;

const WIRE: [u8; 3] = [90, 210, 255];
/// Kept matches, from on the surface to far off it; those of the viewer.
const RESIDUAL: [[u8; 3]; 3] = [[40, 215, 192], [255, 210, 63], [255, 90, 54]];
const REFUSED: [u8; 3] = [255, 102, 196];
const RIM: [u8; 3] = [20, 22, 26];
/// Outline of what hides the organ, and of the organ.
pub const INSTRUMENT: [u8; 3] = [255, 145, 20];
pub const ORGAN: [u8; 3] = [245, 245, 245];

/// Thickness of lines, px: one where the diagonal has 1600 px or less, and in proportion above.
fn pen(size: [usize; 2]) -> f64 {
    ((size[0] as f64).hypot(size[1] as f64) / 1600.0).max(1.0)
}

/// Pixel centres lie at integers, on a sheet at halves.
fn on_sheet(pixel: Point2) -> Place {
    [pixel.x + 0.5, pixel.y + 0.5]
}

/// The mesh's visible edges and the matches over the frame. `vertices` in camera axes.
pub fn overlay(
    frame: &Frame,
    camera: &CameraModel,
    topology: &Topology,
    vertices: &[Point3],
    visible: &[bool],
    matches: &[(Match, bool)],
) -> RgbImage {
    let mut canvas = picture(frame);
    let pen = pen(frame.size);
    let pixels: Vec<Option<Place>> = vertices
        .iter()
        .map(|p| camera.project(p).map(|q| on_sheet(q.pixel)))
        .map(|p| p.filter(|p| p.iter().zip(frame.size).all(|(v, n)| v.abs() < 4.0 * n as f64)))
        .collect();
    let mut edges = Vec::new();
    for &[a, b] in &topology.edges {
        let (a, b) = (a as usize, b as usize);
        if let (true, true, Some(p), Some(q)) = (visible[a], visible[b], pixels[a], pixels[b]) {
            edges.extend(raster::polyline(&[p, q], 1.0, false));
        }
    }
    raster::stroke(&mut canvas, &edges, pen, &[], WIRE, 0.6);
    draw_matches(&mut canvas, camera, (topology, vertices), matches, pen);
    canvas
}

/// The outline found in a frame, where it is known, inside of the organ.
pub fn found_outline(canvas: &mut RgbImage, outline: &Outline, colour: [u8; 3]) {
    let (size, pen) = (outline.distance.size, pen(outline.distance.size) as f32);
    for (i, distance) in outline.distance.data.iter().enumerate() {
        let [x, y] = [i % size[0], i / size[0]];
        let on_line = (-1.5 * pen..0.0).contains(distance);
        if on_line && outline.known_at(&Point2::new(x as f64, y as f64)) {
            super::blend(canvas, x as i64, y as i64, colour, 0.9);
        }
    }
}

/// The outline of a mask, inside of it.
pub fn outline(canvas: &mut RgbImage, mask: &Mask, colour: [u8; 3]) {
    let reach = (1.5 * pen(mask.size)).round().max(1.0) as i64;
    let [w, h] = mask.size.map(|n| n as i64);
    let outside = |x: i64, y: i64| {
        (0..w).contains(&x) && (0..h).contains(&y) && !mask.at(x as usize, y as usize)
    };
    let around = [[1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [1, -1], [-1, 1], [-1, -1]];
    for (y, x) in (0..h).flat_map(|y| (0..w).map(move |x| (y, x))) {
        let rim = || around.iter().any(|[dx, dy]| outside(x + dx * reach, y + dy * reach));
        if mask.at(x as usize, y as usize) && rim() {
            super::blend(canvas, x, y, colour, 0.9);
        }
    }
}

/// Where the surface has a match, px.
fn carried(
    camera: &CameraModel,
    topology: &Topology,
    vertices: &[Point3],
    m: &Match,
) -> Option<Point2> {
    let face = topology.faces.get(m.face as usize)?;
    let corners = face.iter().zip(m.barycentric);
    let point: Vector3 = corners.map(|(&v, b)| b * vertices[v as usize].coords).sum();
    Some(camera.project(&Point3::from(point))?.pixel)
}

/// Kept: discs coloured by their distance from the surface, with a line to it. Refused: crosses.
fn draw_matches(
    canvas: &mut RgbImage,
    camera: &CameraModel,
    (topology, vertices): (&Topology, &[Point3]),
    matches: &[(Match, bool)],
    pen: f64,
) {
    if matches.is_empty() {
        return;
    }
    let mut kept: Vec<(Point2, Point2, f64)> = Vec::new();
    let mut refused = Vec::new();
    for (m, is_kept) in matches {
        if *is_kept {
            let surface = carried(camera, topology, vertices, m).unwrap_or(m.pixel);
            kept.push((m.pixel, surface, (surface - m.pixel).norm()));
        } else {
            let (arm, [x, y]) = (3.5 * pen, on_sheet(m.pixel));
            for [dx, dy] in [[arm, arm], [arm, -arm]] {
                let ends = [[x - dx, y - dy], [x + dx, y + dy]];
                refused.extend(raster::polyline(&ends, 1.0, false));
            }
        }
    }
    raster::stroke(canvas, &refused, 3.0 * pen, &[], RIM, 0.8);
    raster::stroke(canvas, &refused, 1.6 * pen, &[], REFUSED, 1.0);
    // The farthest lie on top.
    kept.sort_by(|a, b| a.2.total_cmp(&b.2));
    let full = limit(&kept);
    for (at, surface, residual) in &kept {
        let colour = ramp(&RESIDUAL, residual / full);
        let [at, surface] = [at, surface].map(|p| on_sheet(*p));
        let line = raster::polyline(&[at, surface], 1.0, false);
        raster::stroke(canvas, &line, 2.4 * pen, &[], RIM, 0.8);
        raster::stroke(canvas, &line, 1.2 * pen, &[], colour, 1.0);
        for (radius, colour) in [(3.4 * pen, RIM), (2.5 * pen, colour)] {
            let mut disc = Vec::new();
            disc.add_circle(at.map(|v| v as f32), radius as f32);
            raster::fill(canvas, &disc, colour, 1.0);
        }
    }
    legend(canvas, full, (!kept.is_empty(), !refused.is_empty()), pen);
}

/// The end of the scale, px: a round number that nine tenths of the kept stay below.
fn limit(ascending: &[(Point2, Point2, f64)]) -> f64 {
    let rank = ascending.len().saturating_sub(1) * 9 / 10;
    round_up(ascending.get(rank).map_or(1.0, |m| m.2).max(1.0))
}

/// What the matches' colours mean, on a white strip in the lower left corner.
fn legend(canvas: &mut RgbImage, full: f64, (kept, refused): (bool, bool), pen: f64) {
    let size = 11.0 * pen;
    let high = 2.0 * size;
    let top = f64::from(canvas.height()) - high;
    let base = top + 1.35 * size;
    let (words, end) = ("matches: 0", format!("≥{full} px off"));
    let bar = [6.0 * size, 0.7 * size];
    let mut x = 0.5 * size;
    let mut items = Vec::new();
    let say = |items: &mut Vec<Item>, x: &mut f64, words: &str| {
        items.push(Item::text([*x, base], Anchor::Start, size, words));
        *x += font::width(words, size) + 0.5 * size;
    };
    if kept {
        say(&mut items, &mut x, words);
        let at = [x, base - bar[1]];
        let colour = |t: f64| ramp(&RESIDUAL, t);
        items.extend(ColourBar { at, size: bar, colour: &colour, ticks: &[], text: size }.items());
        x += bar[0] + 0.5 * size;
        say(&mut items, &mut x, &end);
    }
    if refused {
        let [r, y] = [0.3 * size, base - 0.35 * size];
        for s in [r, -r] {
            let ends = vec![[x + r - s, y - r], [x + r + s, y + r]];
            items.push(Item::line(ends, 1.6 * pen, Ink::Rgb(REFUSED)));
        }
        x += 1.1 * size;
        say(&mut items, &mut x, "refused");
    }
    if x > f64::from(canvas.width()) {
        return;
    }
    raster::draw(canvas, &[Item::block([0.0, top], [x, high], Ink::Rgb([255; 3]))], 1.0);
    raster::draw(canvas, &items, 1.0);
}

#[cfg(test)]
mod tests {
    use super::*;
    use dsfms::camera::Lens;

    /// A square before the camera, and what is drawn of it on black of a size.
    fn drawn(size: [usize; 2], matches: &[(Match, bool)]) -> RgbImage {
        let frame = Frame { name: "f".into(), size, rgb: vec![[0; 3]; size[0] * size[1]] };
        let centre = size.map(|n| 0.5 * n as f64);
        let focal = [size[0] as f64; 2];
        let camera = CameraModel { size, focal, centre, lens: Lens::default() };
        let vertices: Vec<Point3> =
            [[-3., -3., 10.], [3., -3., 10.], [3., 3., 10.], [-3., 3., 10.]]
                .map(Point3::from)
                .to_vec();
        let topology = Topology::new(4, vec![[0, 2, 1], [0, 3, 2]]).unwrap();
        overlay(&frame, &camera, &topology, &vertices, &[true; 4], matches)
    }

    #[test]
    fn lines_are_thicker_on_larger_frames() {
        let lit = |size: [usize; 2]| -> f64 {
            let page = drawn(size, &[]);
            // Down the middle of the left half: the upper edge and the lower, and the diagonal.
            let x = (0.3 * size[0] as f64) as u32;
            (0..page.height()).map(|y| f64::from(page.get_pixel(x, y).0[2]) / 153.0).sum()
        };
        let (small, large) = (lit([400, 400]), lit([3200, 3200]));
        assert!(large > 2.4 * small && large < 3.3 * small, "{small} {large}");
    }

    #[test]
    fn a_match_is_coloured_by_how_far_it_is_off() {
        let on =
            |x: f64| Match { face: 0, barycentric: [0.5, 0.5, 0.0], pixel: Point2::new(x, 200.0) };
        // The middle of the square is at 200, 200.
        let near = drawn([400, 400], &[(on(200.0), true)]);
        let seen = near.get_pixel(200, 200).0;
        assert!(seen[1] > 200 && seen[0] < 80, "{seen:?}");
        let far = drawn([400, 400], &[(on(160.0), true)]);
        let seen = far.get_pixel(160, 200).0;
        assert!(seen[0] > 240 && seen[1] < 200, "{seen:?}");
        let refused = drawn([400, 400], &[(on(160.0), false)]);
        assert_eq!(refused.get_pixel(160, 200).0, REFUSED);
    }

    #[test]
    fn a_mask_is_outlined() {
        let size = [40, 30];
        let inside = |i: usize| (10..30).contains(&(i % 40)) && (10..20).contains(&(i / 40));
        let mask = Mask { size, data: (0..1200).map(inside).collect() };
        let mut canvas = RgbImage::new(40, 30);
        outline(&mut canvas, &mask, [255; 3]);
        let lit = |x, y| canvas.get_pixel(x, y).0[0] > 200;
        assert!(
            lit(10, 15) && lit(29, 15) && lit(20, 10) && !lit(20, 15) && !lit(5, 5) && !lit(9, 15)
        );
    }

    #[test]
    fn a_found_outline_is_drawn_where_it_is_known() {
        let size = [80, 60];
        let columns = |kept: std::ops::Range<usize>| Mask {
            size,
            data: (0..80 * 60)
                .map(|i| kept.contains(&(i % 80)) && (10..50).contains(&(i / 80)))
                .collect(),
        };
        let found = Outline::new(&columns(20..60), Some(&columns(60..70)));
        let mut canvas = RgbImage::new(80, 60);
        found_outline(&mut canvas, &found, [255; 3]);
        let lit = |x, y| canvas.get_pixel(x, y).0[0] > 200;
        assert!(lit(20, 30) && lit(40, 10) && !lit(40, 30) && !lit(18, 30));
        // Beside the instrument the organ goes on.
        assert!(!lit(59, 30) && !lit(69, 30));
    }
}
