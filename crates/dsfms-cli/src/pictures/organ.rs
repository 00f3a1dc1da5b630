//! Which part of the frames was taken for the organ.

use crate::commands::template::LETTERS;
use crate::outputs::{prepare_folder, write_png};
use dsfms::dense::Border;
use dsfms::geometry::Point2;
use dsfms::image::{Frame, Mask};
use dsfms::pipeline::{FoundOrgan, OrganGuess};
use image::imageops::{FilterType, overlay, resize};
use image::{Rgb, RgbImage};
use std::path::Path;

/// Frames in the picture, its columns, and the width of one, px.
const SHOWN: usize = 9;
const COLUMNS: u32 = 3;
const WIDTH: u32 = 420;
/// Of an outline that is clearly marked, and of one that is a guess.
const SURE: [u8; 3] = [0, 158, 115];
const UNSURE: [u8; 3] = [220, 50, 32];
/// Added to a part that may be the organ.
const TINT: [u8; 3] = [0, 60, 90];
/// Half the width of the outline, px of the frame, of the frame's width.
const HALF: f64 = 0.003;

/// Write `organ_masks/NAME.png`, one a frame (white = organ), and `pictures/organ.png`, some of
/// them at a glance. Where it is open what is meant, of every part `organ_masks_a/` and
/// `pictures/organ_a.png`, with other letters.
pub fn write_organ(organ: &FoundOrgan, frames: &[Frame], template: &Path) -> anyhow::Result<()> {
    if !organ.open() {
        return write_guess(&organ.guess, "", frames, template);
    }
    for (letter, guess) in LETTERS.into_iter().zip(organ.guesses()) {
        write_guess(guess, &format!("_{letter}"), frames, template)?;
    }
    Ok(())
}

fn write_guess(
    guess: &OrganGuess,
    ending: &str,
    frames: &[Frame],
    template: &Path,
) -> anyhow::Result<()> {
    let folder = template.join(format!("organ_masks{ending}"));
    let pictures = template.join("pictures");
    prepare_folder(&folder)?;
    prepare_folder(&pictures)?;
    for (name, mask) in &guess.masks {
        write_png(&folder.join(format!("{name}.png")), &black_and_white(mask))?;
    }
    let tint = if ending.is_empty() { [0; 3] } else { TINT };
    let (all, most) = (guess.masks.len(), SHOWN.min(guess.masks.len()));
    let shown = (0..most).map(|k| k * all / most).filter_map(|i| {
        let ((name, mask), border) = (&guess.masks[i], guess.borders.get(i)?);
        let frame = frames.iter().find(|f| f.name == *name)?;
        let height = WIDTH * frame.size[1] as u32 / frame.size[0] as u32;
        let drawn = outlined(frame, mask, border, tint);
        Some(resize(&drawn, WIDTH, height, FilterType::Triangle))
    });
    let shown: Vec<RgbImage> = shown.collect();
    let Some(first) = shown.first() else { return Ok(()) };
    let (height, rows) = (first.height(), (shown.len() as u32).div_ceil(COLUMNS));
    let mut sheet = RgbImage::from_pixel(COLUMNS * WIDTH, rows * height, Rgb([255; 3]));
    for (k, picture) in (0..).zip(&shown) {
        let (x, y) = (k % COLUMNS * WIDTH, k / COLUMNS * height);
        overlay(&mut sheet, picture, i64::from(x), i64::from(y));
    }
    write_png(&pictures.join(format!("organ{ending}.png")), &sheet)
}

fn black_and_white(mask: &Mask) -> RgbImage {
    let [w, h] = mask.size.map(|n| n as u32);
    let value = |x: u32, y: u32| if mask.at(x as usize, y as usize) { 255 } else { 0 };
    RgbImage::from_fn(w, h, |x, y| Rgb([value(x, y); 3]))
}

/// The frame, darker outside of the mask, with its outline from [`UNSURE`] to [`SURE`] as the
/// border is marked.
fn outlined(frame: &Frame, mask: &Mask, border: &[Border], tint: [u8; 3]) -> RgbImage {
    let half = (HALF * frame.size[0] as f64).max(1.0);
    let rim = mask.dilate(half).minus(&mask.erode(half));
    let [w, h] = frame.size;
    RgbImage::from_fn(w as u32, h as u32, |x, y| {
        let (x, y) = (x as usize, y as usize);
        let own = frame.rgb[y * w + x];
        Rgb(match (rim.at(x, y), mask.at(x, y)) {
            (true, _) => colour(border, &Point2::new(x as f64, y as f64)),
            (_, true) => std::array::from_fn(|c| own[c].saturating_add(tint[c])),
            (_, false) => own.map(|v| v / 2),
        })
    })
}

/// The colour of the outline at a pixel: by the place of the border that is nearest.
fn colour(border: &[Border], pixel: &Point2) -> [u8; 3] {
    let far = |b: &Border| (b.pixel - pixel).norm_squared();
    let nearest = border.iter().min_by(|a, b| far(a).total_cmp(&far(b)));
    let sure = nearest.map_or(1.0, |b| b.confidence.clamp(0.0, 1.0));
    let mixed = |c: usize| sure * f64::from(SURE[c]) + (1.0 - sure) * f64::from(UNSURE[c]);
    std::array::from_fn(|c| mixed(c).round() as u8)
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
        let border = |x: f64, confidence| Border { pixel: Point2::new(x, 20.0), confidence };
        let guess = OrganGuess {
            masks: vec![("a".into(), mask.clone())],
            borders: vec![vec![border(20.0, 1.0), border(40.0, 0.0)]],
            stepping: 1.0,
            marked: 1.0,
            click: None,
        };
        let mut organ = FoundOrgan { guess, taken: true, others: Vec::new() };
        write_organ(&organ, std::slice::from_ref(&frame), folder.path()).unwrap();
        let at = |picture: &RgbImage, x, y| picture.get_pixel(x, y).0;
        let drawn = outlined(&frame, &mask, &organ.guess.borders[0], [0; 3]);
        assert_eq!([at(&drawn, 30, 20), at(&drawn, 5, 5)], [[200, 100, 60], [100, 50, 30]]);
        assert_eq!([at(&drawn, 20, 20), at(&drawn, 40, 20)], [SURE, UNSURE]);
        let tinted = outlined(&frame, &mask, &[], TINT);
        assert_eq!([at(&tinted, 30, 20), at(&tinted, 20, 20)], [[200, 160, 150], SURE]);
        let file = image::open(folder.path().join("organ_masks/a.png")).unwrap().to_rgb8();
        assert_eq!([at(&file, 30, 20), at(&file, 5, 5)], [[255; 3], [0; 3]]);
        assert!(folder.path().join("pictures/organ.png").exists());
        // Where it is open what is meant, every part has a letter.
        organ.taken = false;
        organ.others = vec![organ.guess.clone()];
        let open = tempfile::tempdir().unwrap();
        write_organ(&organ, std::slice::from_ref(&frame), open.path()).unwrap();
        for name in ["organ_masks_a/a.png", "organ_masks_b/a.png", "pictures/organ_b.png"] {
            assert!(open.path().join(name).exists(), "{name}");
        }
        assert!(!open.path().join("pictures/organ.png").exists());
    }
}
