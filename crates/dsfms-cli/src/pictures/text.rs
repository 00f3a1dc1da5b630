//! Letters on a picture: the public-domain 7x13 of X11's misc-fixed, ASCII only.

use image::RgbImage;

/// One line a character: the character, a space, 13 rows of 7 bits in hexadecimal.
const FONT: &str = include_str!("font_7x13.txt");
/// Width of every letter, px.
pub const WIDTH: u32 = 7;
/// Height of every letter, px.
pub const HEIGHT: u32 = 13;

/// Write from the left end, `y` the upper edge; what lies outside the picture is dropped and letters
/// without a form become `?`.
pub fn text(canvas: &mut RgbImage, x: i64, y: i64, words: &str, colour: [u8; 3]) {
    for (i, letter) in words.chars().enumerate() {
        let form = form(letter).or_else(|| form('?')).unwrap_or_default();
        for (row, bits) in form.iter().enumerate() {
            for column in (0..i64::from(WIDTH)).filter(|c| bits >> (6 - c) & 1 == 1) {
                let at = (x + i as i64 * i64::from(WIDTH) + column, y + row as i64);
                put(canvas, at, colour);
            }
        }
    }
}

/// Width of a text, px.
pub fn width(words: &str) -> i64 {
    words.chars().count() as i64 * i64::from(WIDTH)
}

fn put(canvas: &mut RgbImage, (x, y): (i64, i64), colour: [u8; 3]) {
    if let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y))
        && let Some(pixel) = canvas.get_pixel_mut_checked(x, y)
    {
        pixel.0 = colour;
    }
}

fn form(letter: char) -> Option<[u8; 13]> {
    let line = FONT.lines().nth((letter as usize).checked_sub(32)?)?;
    let hex = line.get(2..28)?;
    let mut rows = [0; 13];
    for (i, row) in rows.iter_mut().enumerate() {
        *row = u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).ok()?;
    }
    Some(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_printable_letter_has_its_own_form() {
        let forms: Vec<_> = (33..127u8).map(|c| form(c as char).unwrap()).collect();
        for (i, a) in forms.iter().enumerate() {
            assert!(a.iter().any(|&row| row != 0) && !forms[..i].contains(a));
        }
        assert!(FONT.lines().enumerate().all(|(i, l)| l.starts_with((i as u8 + 32) as char)));
    }

    #[test]
    fn letters_outside_the_picture_are_dropped() {
        let mut canvas = RgbImage::new(10, 10);
        text(&mut canvas, -3, -4, "Wé", [255; 3]);
        assert!(canvas.pixels().any(|p| p.0 == [255; 3]));
    }
}
