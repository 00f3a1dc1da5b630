//! The one font of all figures: Arimo, as wide as Arial, Helvetica and Liberation Sans
//! (`data/font`).

use std::sync::LazyLock;
use ttf_parser::{Face, GlyphId, OutlineBuilder};
use zeno::{Command, PathBuilder};

/// The font file.
pub const FILE: &[u8] = include_bytes!("../../data/font/Arimo.ttf");
/// What SVG asks for: all of the same widths.
pub const FAMILY: &str = "Arimo,'Liberation Sans',Arial,Helvetica,sans-serif";

/// The parsed font. The file is part of the program, and a test reads it.
pub static FACE: LazyLock<Face<'static>> =
    LazyLock::new(|| Face::parse(FILE, 0).expect("the font of the program is a font"));

/// The glyph of a letter; of one that the font lacks, that of `?`.
pub fn glyph(letter: char) -> GlyphId {
    FACE.glyph_index(letter).or_else(|| FACE.glyph_index('?')).unwrap_or_default()
}

/// How far a glyph moves the pen, in thousandths of the size.
pub fn advance(glyph: GlyphId) -> f64 {
    let units = f64::from(FACE.units_per_em());
    1000.0 * f64::from(FACE.glyph_hor_advance(glyph).unwrap_or(0)) / units
}

/// Width of a text of a size.
pub fn width(text: &str, size: f64) -> f64 {
    text.chars().map(|c| advance(glyph(c))).sum::<f64>() * size / 1000.0
}

/// The outline of a text of a size: right and up from the pen's start, on the baseline.
pub fn outline(text: &str, size: f64) -> Vec<Command> {
    let scale = (size / f64::from(FACE.units_per_em())) as f32;
    let mut pen = Pen { path: Vec::new(), scale, x: 0.0 };
    for letter in text.chars() {
        let glyph = glyph(letter);
        FACE.outline_glyph(glyph, &mut pen);
        pen.x += (advance(glyph) * size / 1000.0) as f32;
    }
    pen.path
}

struct Pen {
    path: Vec<Command>,
    scale: f32,
    x: f32,
}

impl Pen {
    fn at(&self, x: f32, y: f32) -> [f32; 2] {
        [self.x + self.scale * x, self.scale * y]
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        let at = self.at(x, y);
        self.path.move_to(at);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let at = self.at(x, y);
        self.path.line_to(at);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let (control, at) = (self.at(x1, y1), self.at(x, y));
        self.path.quad_to(control, at);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let (first, second, at) = (self.at(x1, y1), self.at(x2, y2), self.at(x, y));
        self.path.curve_to(first, second, at);
    }

    fn close(&mut self) {
        self.path.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_are_those_of_helvetica() {
        // Adobe's metrics of Helvetica, thousandths.
        for (letter, thousandths) in
            [('A', 667.0), ('i', 222.0), ('m', 833.0), ('0', 556.0), (' ', 278.0)]
        {
            assert!((advance(glyph(letter)) - thousandths).abs() < 0.6, "{letter}");
        }
        assert!((width("im", 10.0) - 10.55).abs() < 0.02);
    }

    #[test]
    fn every_letter_that_figures_use_has_a_form() {
        let used = (33..127u8).map(char::from).chain("±×µ°≥≤−–λσ²→".chars());
        for letter in used {
            assert!(FACE.glyph_index(letter).is_some(), "{letter}");
            assert!(!outline(&letter.to_string(), 10.0).is_empty(), "{letter}");
        }
        assert_eq!(glyph('漢'), glyph('?'));
    }
}
