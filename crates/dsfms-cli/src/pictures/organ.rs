//! Which part of the frames was taken for the organ.

use crate::outputs::{prepare_folder, write_png};
use dsfms::image::{Frame, Mask};
use dsfms::pipeline::FoundOrgan;
use image::imageops::{FilterType, overlay, resize};
use image::{Rgb, RgbImage};
use std::path::Path;

/// Frames in the picture, its columns, and the width of one, px.
const SHOWN: usize = 9;
const COLUMNS: u32 = 3;
const WIDTH: u32 = 420;
const OUTLINE: [u8; 3] = [0, 158, 115];
/// Half the width of the outline, px of the frame, of the frame's width.
const HALF: f64 = 0.003;

/// Write `organ_masks/NAME.png`, one a frame (white = organ), and `pictures/organ.png`, some of them at a glance.
pub fn write_organ(organ: &FoundOrgan, frames: &[Frame], template: &Path) -> anyhow::Result<()> {
    let (folder, pictures) = (template.join("organ_masks"), template.join("pictures"));
    prepare_folder(&folder)?;
    prepare_folder(&pictures)?;
    for (name, mask) in &organ.masks {
        write_png(&folder.join(format!("{name}.png")), &black_and_white(mask))?;
    }
    let every = organ.masks.len().div_ceil(SHOWN).max(1);
    let shown = organ.masks.iter().step_by(every).filter_map(|(name, mask)| {
        let frame = frames.iter().find(|f| f.name == *name)?;
        let height = WIDTH * frame.size[1] as u32 / frame.size[0] as u32;
        Some(resize(&outlined(frame, mask), WIDTH, height, FilterType::Triangle))
    });
    let shown: Vec<RgbImage> = shown.collect();
    let Some(first) = shown.first() else { return Ok(()) };
    let (height, rows) = (first.height(), (shown.len() as u32).div_ceil(COLUMNS));
    let mut sheet = RgbImage::from_pixel(COLUMNS * WIDTH, rows * height, Rgb([255; 3]));
    for (k, picture) in (0..).zip(&shown) {
        let (x, y) = (k % COLUMNS * WIDTH, k / COLUMNS * height);
        overlay(&mut sheet, picture, i64::from(x), i64::from(y));
    }
    write_png(&pictures.join("organ.png"), &sheet)
}

fn black_and_white(mask: &Mask) -> RgbImage {
    let [w, h] = mask.size.map(|n| n as u32);
    let value = |x: u32, y: u32| if mask.at(x as usize, y as usize) { 255 } else { 0 };
    RgbImage::from_fn(w, h, |x, y| Rgb([value(x, y); 3]))
}

/// The frame, darker outside of the mask, with its outline.
fn outlined(frame: &Frame, mask: &Mask) -> RgbImage {
    let half = (HALF * frame.size[0] as f64).max(1.0);
    let rim = mask.dilate(half).minus(&mask.erode(half));
    let [w, h] = frame.size;
    RgbImage::from_fn(w as u32, h as u32, |x, y| {
        let (x, y) = (x as usize, y as usize);
        let own = frame.rgb[y * w + x];
        Rgb(match (rim.at(x, y), mask.at(x, y)) {
            (true, _) => OUTLINE,
            (_, true) => own,
            (_, false) => own.map(|v| v / 2),
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_organ_is_as_bright_as_in_the_frame_and_the_rest_is_darker() {
        let size = [60, 40];
        let frame = Frame { name: "a".into(), size, rgb: vec![[200, 100, 60]; 2400] };
        let inside = |i: usize| (20..40).contains(&(i % 60)) && (10..30).contains(&(i / 60));
        let mask = Mask { size, data: (0..2400).map(inside).collect() };
        let folder = tempfile::tempdir().unwrap();
        let organ = FoundOrgan {
            masks: vec![("a".into(), mask.clone())],
            stepping: 1.0,
            marked: 1.0,
            taken: true,
        };
        write_organ(&organ, std::slice::from_ref(&frame), folder.path()).unwrap();
        let at = |picture: &RgbImage, x, y| picture.get_pixel(x, y).0;
        let drawn = outlined(&frame, &mask);
        assert_eq!([at(&drawn, 30, 20), at(&drawn, 5, 5)], [[200, 100, 60], [100, 50, 30]]);
        assert_eq!(at(&drawn, 20, 20), OUTLINE);
        let file = image::open(folder.path().join("organ_masks/a.png")).unwrap().to_rgb8();
        assert_eq!([at(&file, 30, 20), at(&file, 5, 5)], [[255; 3], [0; 3]]);
        assert!(folder.path().join("pictures/organ.png").exists());
    }
}
