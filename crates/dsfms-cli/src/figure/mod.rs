//! A sheet of pictures, labels and a colour bar, as PNG or SVG. In SVG the text stays text.

pub mod panel;

use crate::outputs::encode_png;
use crate::report::embed::{base64, escape};
use image::RgbImage;
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

/// Height of the text, px.
pub const TEXT: u32 = 24;
const INK: [u8; 3] = [25, 28, 32];

/// Where a text starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    Start,
    Middle,
    End,
}

/// What lies on a sheet; px, origin top left.
pub enum Item {
    Picture {
        at: [u32; 2],
        picture: RgbImage,
    },
    /// One line whose top is at `at[1]`.
    Text {
        at: [u32; 2],
        anchor: Anchor,
        text: String,
    },
    /// A horizontal line, 3 px.
    Rule {
        at: [u32; 2],
        width: u32,
    },
}

/// A white page.
pub struct Sheet {
    pub size: [u32; 2],
    pub items: Vec<Item>,
}

impl Sheet {
    /// The pixels.
    pub fn pixels(&self) -> RgbImage {
        let mut page = RgbImage::from_pixel(self.size[0], self.size[1], image::Rgb([255; 3]));
        for item in &self.items {
            match item {
                Item::Picture { at, picture } => {
                    image::imageops::replace(&mut page, picture, at[0].into(), at[1].into());
                }
                Item::Text { at, anchor, text } => write(&mut page, *at, *anchor, text),
                Item::Rule { at, width } => {
                    let line = RgbImage::from_pixel(*width, 3, image::Rgb(INK));
                    image::imageops::replace(&mut page, &line, at[0].into(), at[1].into());
                }
            }
        }
        page
    }

    /// The drawing; pictures inside it as PNG.
    pub fn svg(&self) -> anyhow::Result<String> {
        let [w, h] = self.size;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\" \
             font-family=\"Helvetica,Arial,sans-serif\" font-size=\"{}\">\
             <rect width=\"{w}\" height=\"{h}\" fill=\"#fff\"/>\n",
            TEXT - 2
        );
        for item in &self.items {
            svg += &match item {
                Item::Picture { at: [x, y], picture } => {
                    let (w, h) = picture.dimensions();
                    let data = base64(&encode_png(picture)?);
                    format!(
                        "<image x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\" \
                         href=\"data:image/png;base64,{data}\"/>\n"
                    )
                }
                Item::Text { at: [x, y], anchor, text } => {
                    let anchor = format!("{anchor:?}").to_lowercase();
                    let base = y + TEXT - 6;
                    let text = escape(text);
                    format!("<text x=\"{x}\" y=\"{base}\" text-anchor=\"{anchor}\">{text}</text>\n")
                }
                Item::Rule { at: [x, y], width } => {
                    format!("<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"3\"/>\n")
                }
            };
        }
        Ok(svg + "</svg>\n")
    }
}

/// Width of a text in PNG, px.
pub fn text_width(text: &str) -> u32 {
    text.chars().count() as u32 * get_raster_width(FontWeight::Regular, RasterHeight::Size24) as u32
}

fn write(page: &mut RgbImage, [x, y]: [u32; 2], anchor: Anchor, text: &str) {
    let width = text_width(text);
    let mut left = match anchor {
        Anchor::Start => x,
        Anchor::Middle => x.saturating_sub(width / 2),
        Anchor::End => x.saturating_sub(width),
    };
    for c in text.chars() {
        // The font has the basic Latin letters.
        let glyph = get_raster(c, FontWeight::Regular, RasterHeight::Size24)
            .or_else(|| get_raster('?', FontWeight::Regular, RasterHeight::Size24));
        let Some(glyph) = glyph else { continue };
        for (row, line) in (y..).zip(glyph.rows()) {
            for (column, &cover) in (left..).zip(line.iter()) {
                let Some(pixel) = page.get_pixel_mut_checked(column, row) else { continue };
                let t = f64::from(cover) / 255.0;
                for (value, ink) in pixel.0.iter_mut().zip(INK) {
                    *value = (f64::from(*value) * (1.0 - t) + f64::from(ink) * t) as u8;
                }
            }
        }
        left += glyph.width() as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet(text: &str) -> Sheet {
        let item = Item::Text { at: [100, 4], anchor: Anchor::Middle, text: text.into() };
        Sheet { size: [200, 32], items: vec![item] }
    }

    #[test]
    fn text_is_dark_on_white_and_centred() {
        let page = sheet("HHHH").pixels();
        let dark: Vec<u32> =
            (0..200).filter(|&x| (0..32).any(|y| page.get_pixel(x, y).0[0] < 90)).collect();
        let middle = f64::from(dark[0] + dark[dark.len() - 1]) / 2.0;
        assert!((middle - 100.0).abs() < 4.0 && dark.len() > 20, "{dark:?}");
    }

    #[test]
    fn markup_in_a_label_stays_text() {
        assert!(sheet("<&>").svg().unwrap().contains("&lt;&amp;&gt;"));
    }
}
