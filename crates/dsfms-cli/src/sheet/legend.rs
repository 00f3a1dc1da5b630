//! Bars that say what colours and lengths mean.

use super::{Anchor, Ink, Item, Place, colours};
use image::{Rgb, RgbImage};

/// A colour bar, lying or upright, with its ticks: where (0 to 1) and their words.
pub struct ColourBar<'a> {
    /// Upper left corner.
    pub at: Place,
    /// Width and height; the longer side is the scale.
    pub size: Place,
    /// Colour at 0 to 1.
    pub colour: &'a dyn Fn(f64) -> [u8; 3],
    /// Places and words.
    pub ticks: &'a [(f64, String)],
    /// Size of the words.
    pub text: f64,
}

impl ColourBar<'_> {
    /// What it is made of: words lie under a lying bar and right of an upright one.
    pub fn items(&self) -> Vec<Item> {
        const STEPS: u32 = 256;
        let ([x, y], [w, h]) = (self.at, self.size);
        let upright = h > w;
        let colour = |k: u32| Rgb((self.colour)(f64::from(k) / f64::from(STEPS - 1)));
        let picture = match upright {
            true => RgbImage::from_fn(1, STEPS, |_, k| colour(STEPS - 1 - k)),
            false => RgbImage::from_fn(STEPS, 1, |k, _| colour(k)),
        };
        let pen = self.text / 16.0;
        let mut items = vec![
            Item::Picture { at: self.at, size: self.size, picture },
            Item::frame(self.at, self.size, pen, Ink::Text),
        ];
        for (t, words) in self.ticks {
            let (from, to, word, anchor) = match upright {
                true => {
                    let v = y + (1.0 - t) * h;
                    let (from, to) = ([x + w, v], [x + w + 0.3 * self.text, v]);
                    (from, to, [to[0] + 0.25 * self.text, v + 0.36 * self.text], Anchor::Start)
                }
                false => {
                    let u = x + t * w;
                    let (from, to) = ([u, y + h], [u, y + h + 0.3 * self.text]);
                    (from, to, [u, to[1] + 0.95 * self.text], Anchor::Middle)
                }
            };
            items.push(Item::line(vec![from, to], pen, Ink::Text));
            items.push(Item::text(word, anchor, self.text, words.as_str()));
        }
        items
    }
}

/// A round length, at most `longest` units long on the sheet: a line with its length under it.
/// `scale` is units of the sheet per length unit.
pub fn scale_bar([x, y]: Place, longest: f64, scale: f64, unit: &str, text: f64) -> Vec<Item> {
    let length = colours::round_down(longest / scale);
    let end = x + length * scale;
    let pen = text / 8.0;
    let words = format!("{length} {unit}");
    vec![
        Item::line(vec![[x, y], [end, y]], pen, Ink::Text),
        Item::text([x, y + 1.2 * text], Anchor::Start, text, words),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_bar_is_as_long_as_it_says() {
        let items = scale_bar([10.0, 5.0], 30.0, 0.8, "mm", 8.0);
        let [Item::Line { points, .. }, Item::Text { text, .. }] = &items[..] else { panic!() };
        assert_eq!((points[1][0] - points[0][0], text.as_str()), (16.0, "20 mm"));
    }
}
