//! Capital letters and digits for pictures, 5 × 7 dots each.

use image::{Rgb, RgbImage};

/// Rows from the top, five bits each, the leftmost highest.
const GLYPHS: [(char, [u8; 7]); 26] = [
    ('0', [14, 17, 19, 21, 25, 17, 14]),
    ('1', [4, 12, 4, 4, 4, 4, 14]),
    ('2', [14, 17, 1, 2, 4, 8, 31]),
    ('3', [31, 2, 4, 2, 1, 17, 14]),
    ('4', [2, 6, 10, 18, 31, 2, 2]),
    ('5', [31, 16, 30, 1, 1, 17, 14]),
    ('6', [6, 8, 16, 30, 17, 17, 14]),
    ('7', [31, 1, 2, 4, 8, 8, 8]),
    ('8', [14, 17, 17, 14, 17, 17, 14]),
    ('9', [14, 17, 17, 15, 1, 2, 12]),
    ('.', [0, 0, 0, 0, 0, 12, 12]),
    ('A', [14, 17, 17, 17, 31, 17, 17]),
    ('D', [28, 18, 17, 17, 17, 18, 28]),
    ('E', [31, 16, 16, 30, 16, 16, 31]),
    ('F', [31, 16, 16, 30, 16, 16, 16]),
    ('G', [14, 17, 16, 23, 17, 17, 15]),
    ('H', [17, 17, 17, 31, 17, 17, 17]),
    ('I', [14, 4, 4, 4, 4, 4, 14]),
    ('J', [7, 2, 2, 2, 2, 18, 12]),
    ('M', [17, 27, 21, 21, 17, 17, 17]),
    ('N', [17, 17, 25, 21, 19, 17, 17]),
    ('O', [14, 17, 17, 17, 17, 17, 14]),
    ('R', [30, 17, 17, 30, 20, 18, 17]),
    ('S', [15, 16, 16, 14, 1, 1, 30]),
    ('T', [31, 4, 4, 4, 4, 4, 4]),
    ('U', [17, 17, 17, 17, 17, 17, 14]),
];

/// Write at the upper left corner of the text, dots of `scale` px; small letters become capitals, and
/// what has no glyph leaves a gap.
pub fn write(canvas: &mut RgbImage, text: &str, [x, y]: [u32; 2], scale: u32, colour: [u8; 3]) {
    for (i, letter) in text.chars().enumerate() {
        let letter = letter.to_ascii_uppercase();
        let Some((_, rows)) = GLYPHS.iter().find(|g| g.0 == letter) else { continue };
        let left = x + 6 * scale * i as u32;
        for dot in 0..35 * scale * scale {
            let (u, v) = (dot % (5 * scale), dot / (5 * scale));
            let lit = rows[(v / scale) as usize] >> (4 - u / scale) & 1 == 1;
            if lit && left + u < canvas.width() && y + v < canvas.height() {
                canvas.put_pixel(left + u, y + v, Rgb(colour));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_letter_dot_by_dot() {
        let mut canvas = RgbImage::new(12, 7);
        write(&mut canvas, "Ti", [0, 0], 1, [255; 3]);
        let row = |y: u32| -> String {
            (0..12).map(|x| if canvas.get_pixel(x, y).0[0] > 0 { '#' } else { '.' }).collect()
        };
        assert_eq!(row(0), "#####..###..");
        assert_eq!(row(3), "..#.....#...");
    }
}
