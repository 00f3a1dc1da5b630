//! A sheet of pictures, lines, areas and text: what every chart, plate and picture with letters is
//! made of.
//!
//! One drawing, three files: SVG, in which text stays text ([`svg`]); PDF with the font inside
//! ([`pdf`]); pixels ([`raster`]). On a page of a report the same items take their colours from its
//! style sheet.

pub mod colours;
pub mod font;
pub mod legend;
pub mod pdf;
pub mod raster;
pub mod svg;

use image::RgbImage;

/// A place on a sheet: right, down, in the sheet's unit.
pub type Place = [f64; 2];

/// Where a text starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// At its left end.
    Start,
    /// In its middle.
    Middle,
    /// At its right end.
    End,
}

/// A colour by what it is for: a page's style sheet knows the names, paper the values
/// ([`colours`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ink {
    /// Text, axes and frames.
    Text,
    /// Lines of a grid.
    Grid,
    /// The line of series `k`.
    Line(usize),
    /// The markers of series `k`.
    Marker(usize),
    /// The whiskers of series `k`.
    Whisker(usize),
    /// A bar, and one that stands out.
    Bar(bool),
    /// A part of a status strip: `ok`, `degraded`, `failed`.
    Status(&'static str),
    /// This colour.
    Rgb([u8; 3]),
}

/// What lies on a sheet, from the lowest to the highest.
#[derive(Clone, Debug)]
pub enum Item {
    /// A picture; `at` its upper left corner.
    Picture { at: Place, size: Place, picture: RgbImage },
    /// One line of text; `at` on its baseline. An upright one reads upwards.
    Text { at: Place, anchor: Anchor, size: f64, upright: bool, text: String },
    /// A line through points. `said` are further attributes on a page.
    Line { points: Vec<Place>, width: f64, dash: &'static [f64], ink: Ink, said: String },
    /// A filled polygon.
    Area { points: Vec<Place>, ink: Ink },
    /// A filled disc.
    Disc { at: Place, radius: f64, ink: Ink },
}

impl Item {
    /// A text that lies.
    pub fn text(at: Place, anchor: Anchor, size: f64, text: impl Into<String>) -> Self {
        Self::Text { at, anchor, size, upright: false, text: text.into() }
    }

    /// A solid line.
    pub fn line(points: Vec<Place>, width: f64, ink: Ink) -> Self {
        Self::Line { points, width, dash: &[], ink, said: String::new() }
    }

    /// A filled rectangle.
    pub fn block([x, y]: Place, [w, h]: Place, ink: Ink) -> Self {
        Self::Area { points: vec![[x, y], [x + w, y], [x + w, y + h], [x, y + h]], ink }
    }

    /// The outline of a rectangle.
    pub fn frame([x, y]: Place, [w, h]: Place, width: f64, ink: Ink) -> Self {
        let points = vec![[x, y], [x + w, y], [x + w, y + h], [x, y + h], [x, y]];
        Self::line(points, width, ink)
    }

    /// The same elsewhere.
    pub fn moved(mut self, [dx, dy]: Place) -> Self {
        let shift = |p: &mut Place| *p = [p[0] + dx, p[1] + dy];
        match &mut self {
            Self::Picture { at, .. } | Self::Text { at, .. } | Self::Disc { at, .. } => shift(at),
            Self::Line { points, .. } | Self::Area { points, .. } => {
                points.iter_mut().for_each(shift)
            }
        }
        self
    }
}

/// A white page.
#[derive(Clone, Debug)]
pub struct Sheet {
    /// Width and height, in the sheet's unit.
    pub size: Place,
    /// Millimetres of paper that the unit is.
    pub unit_mm: f64,
    /// What is shown, for readers that do not see it.
    pub title: String,
    /// What lies on it.
    pub items: Vec<Item>,
}

/// Points (1/72 inch), the unit of plates, in mm.
pub const POINT: f64 = 25.4 / 72.0;
/// Pixels of a screen (1/96 inch), the unit of pictures, in mm.
pub const PIXEL: f64 = 25.4 / 96.0;

impl Sheet {
    /// A sheet in pixels: one unit of it is one pixel of [`raster::pixels`] at scale 1.
    pub fn in_pixels(width: u32, height: u32) -> Self {
        let size = [f64::from(width), f64::from(height)];
        Self { size, unit_mm: PIXEL, title: String::new(), items: Vec::new() }
    }

    /// Put a picture, a pixel a unit.
    pub fn put(&mut self, [x, y]: [u32; 2], picture: RgbImage) {
        let size = [f64::from(picture.width()), f64::from(picture.height())];
        self.items.push(Item::Picture { at: [f64::from(x), f64::from(y)], size, picture });
    }

    /// Write a line of text, `at` on its baseline.
    pub fn write(&mut self, at: Place, anchor: Anchor, size: f64, text: impl Into<String>) {
        self.items.push(Item::text(at, anchor, size, text));
    }
}
