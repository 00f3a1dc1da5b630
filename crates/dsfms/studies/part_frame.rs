//! Which pixels of a single frame show the organ: the labelling of a template (`dense/labels.rs`)
//! where nothing is known of depth, so that colour, edges and what is clicked decide alone.
//!
//!     cargo run --release --example part_frame -- IMAGE [--organ X,Y]... [--other X,Y]... [--contour IMAGE] [--out PNG]
//!
//! Without a click the middle of the frame is organ to begin with. Prints the organ's share of the
//! frame and how clearly its border is marked; of the yellow lines of the contour image (an outline
//! drawn by hand, as of P2ILF) how far they lie from the border found, px. PNG gets the border.

use dsfms::camera::{CameraModel, PosedFrame};
use dsfms::dense::{DepthMap, Parting, Seeds, outlines};
use dsfms::geometry::{Isometry, Point2, Point3};
use dsfms::image::{Frame, Mask};
use dsfms::io::images::read_frame;
use std::error::Error;
use std::path::{Path, PathBuf};

/// The frame is halved so often for the labels: its depth map would be.
const HALVINGS: usize = 2;

fn main() -> Result<(), Box<dyn Error>> {
    let (mut image, mut contour, mut out) = (None, None, None);
    let (mut organ, mut other) = (Vec::new(), Vec::new());
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("{word} needs a value"));
        match word.as_str() {
            "--organ" => organ.push(place(&value()?)?),
            "--other" => other.push(place(&value()?)?),
            "--contour" => contour = Some(PathBuf::from(value()?)),
            "--out" => out = Some(PathBuf::from(value()?)),
            _ => image = Some(PathBuf::from(word)),
        }
    }
    let frame = read_frame(&image.ok_or("usage: part_frame IMAGE [--organ X,Y]...")?)?;
    let mask = part(&frame, &organ, &other);
    let border = mask.minus(&mask.erode(1.5));
    if let Some(path) = contour.filter(|_| border.data.contains(&true)) {
        let drawn = read_frame(&path)?;
        let mut off = distances(&drawn, &border);
        off.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| off[(share * (off.len() - 1) as f64) as usize];
        println!("drawn line to border: {:.1} px in the median, {:.1} at 90 %", at(0.5), at(0.9));
    }
    match out {
        Some(path) => draw(&frame, &mask, &path),
        None => Ok(()),
    }
}

fn place(text: &str) -> Result<Point2, Box<dyn Error>> {
    let (x, y) = text.split_once(',').ok_or(format!("{text}: expected X,Y"))?;
    Ok(Point2::new(x.parse()?, y.parse()?))
}

/// Where the organ is, on the pixels of the frame.
fn part(frame: &Frame, organ: &[Point2], other: &[Point2]) -> Mask {
    let [w, h] = frame.size.map(|n| n as f64);
    let camera = CameraModel::pinhole(frame.size, [w; 2], [0.5 * w - 0.5, 0.5 * h - 0.5]);
    let grid = (0..HALVINGS).fold(camera.clone(), |camera, _| camera.halved());
    // A plane: depth neither joins nor parts.
    let count = grid.size[0] * grid.size[1];
    let map = DepthMap {
        camera: grid,
        pose: Isometry::identity(),
        depth: vec![1.0; count],
        normal: vec![[0.0, 0.0, -1.0]; count],
        sigma: vec![f32::INFINITY; count],
        confidence: vec![0.0; count],
    };
    let at = |p: &Point2| {
        let [cx, cy] = camera.centre;
        Point3::new((p.x - cx) / w, (p.y - cy) / w, 1.0)
    };
    let on_plane = |places: &[Point2]| places.iter().map(at).collect();
    let seeds = Seeds { organ: on_plane(organ), other: on_plane(other) };
    let views = [PosedFrame::new(frame, &camera, Isometry::identity())];
    let maps = [map];
    let found = Parting::new(&views, &maps, &seeds, &[]).best();
    let mask = outlines(&found.masks, &views, &maps).remove(0);
    let share = 100.0 * mask.coverage();
    println!("organ: {share:.0} % of the frame; marked {:.0} %", 100.0 * found.marked);
    mask
}

/// Of every yellow pixel of a drawing the distance to a border, px.
fn distances(drawn: &Frame, border: &Mask) -> Vec<f64> {
    let w = border.size[0];
    let pixels = |of: &dyn Fn(usize) -> bool| -> Vec<Point2> {
        let all = (0..border.data.len()).filter(|&i| of(i));
        all.map(|i| Point2::new((i % w) as f64, (i / w) as f64)).collect()
    };
    let yellow = |i: usize| drawn.rgb[i][0] > 200 && drawn.rgb[i][1] > 200 && drawn.rgb[i][2] < 80;
    let (lines, border) = (pixels(&yellow), pixels(&|i| border.data[i]));
    let nearest = |p: &Point2| border.iter().map(|q| (p - q).norm()).fold(f64::INFINITY, f64::min);
    lines.iter().step_by(50).map(nearest).collect()
}

fn draw(frame: &Frame, mask: &Mask, path: &Path) -> Result<(), Box<dyn Error>> {
    let border = mask.dilate(2.5).minus(&mask.erode(2.5));
    let of = |(&border, &rgb)| if border { [0, 255, 0] } else { rgb };
    let rgb = border.data.iter().zip(&frame.rgb).map(of).collect::<Vec<[u8; 3]>>().concat();
    let [w, h] = frame.size.map(|n| n as u32);
    Ok(image::save_buffer(path, &rgb, w, h, image::ColorType::Rgb8)?)
}
