//! A plate laid out and drawn, in points.

use super::layout::{
    Arrangement, ArrangementKind, Layout, Room, looks_across, surfaces_across, turntable,
    views_across,
};
use super::panel::{Layer, Shown, Surface, UNSEEN, View, panel, window};
use super::surfaces::{limit, mean};
use crate::draw::{CIVIDIS, Window, ramp};
use crate::sheet::legend::{ColourBar, scale_bar};
use crate::sheet::{Anchor, Ink, Item, POINT, Place, Sheet, font};
use crate::structures::COLOURS;
use dsfms::io::mesh::MeshUnit;
use dsfms::template::Template;

use rayon::prelude::*;

/// Size of the letters, pt: between the captions (9) and the subscripts (6) of Springer's LNCS.
const TEXT: f64 = 8.0;
const LINE: f64 = 1.4 * TEXT;
const GAP: f64 = 4.0;
/// Most height for a width of one: a page has room for a caption and text beside it.
const TALLEST: f64 = 1.0;
/// Height of the legend.
const LEGEND: f64 = 2.1 * LINE;

/// What is drawn.
pub struct Plate<'a> {
    pub surfaces: &'a [Surface],
    pub layers: &'a [Layer],
    pub views: &'a [View],
    /// The views are all around.
    pub turning: bool,
    pub template: Option<&'a Template>,
    /// Width of the sheet, mm, and pixels of the panels per inch.
    pub width_mm: f64,
    pub dpi: f64,
    /// End of the colour scale, where it is given.
    pub max: Option<f64>,
}

/// One way to look at all surfaces.
struct Look<'a> {
    layer: Layer,
    view: &'a View,
    window: Window,
}

impl Plate<'_> {
    /// The sheet.
    pub fn sheet(&self) -> Sheet {
        let looks = self.looks();
        let layout = self.layout(&looks);
        let bound = limit(self.surfaces, self.max);
        let mut items = self.panels(&layout, &looks, bound.0);
        items.extend(self.titles(&layout, &looks));
        let legend = Legend { plate: self, layout: &layout, looks: &looks, bound };
        let width = (self.width_mm / POINT).min(layout.size[0].max(0.6 * self.width_mm / POINT));
        items.extend(legend.items(width));
        let size = [width, layout.size[1] + GAP + LEGEND];
        let names: Vec<&str> = self.surfaces.iter().map(|s| s.name.as_str()).collect();
        Sheet { size, unit_mm: POINT, title: names.join(", "), items }
    }

    fn looks(&self) -> Vec<Look<'_>> {
        let windows: Vec<Window> = self.views.iter().map(|v| window(self.surfaces, v)).collect();
        let of = |&layer: &Layer| {
            let views = self.views.iter().zip(windows.clone());
            views.map(move |(view, window)| Look { layer, view, window }).collect::<Vec<_>>()
        };
        self.layers.iter().flat_map(of).collect()
    }

    /// Of the arrangements, the one that shows the surfaces largest.
    fn layout(&self, looks: &[Look]) -> Layout {
        let sizes: Vec<[f64; 2]> = looks.iter().map(|l| l.window.size()).collect();
        let most = [self.width_mm / POINT, TALLEST * self.width_mm / POINT - GAP - LEGEND];
        let (s, l) = (self.surfaces.len(), looks.len());
        let ways: Vec<Arrangement> = match (self.turning, s) {
            (true, _) => {
                let mut way = turntable(s, self.layers.len(), self.views.len());
                way.lines.retain(|line| !line.iter().all(|cell| self.empty(cell, looks)));
                vec![way]
            }
            (false, 1) => {
                vec![views_across(self.layers.len(), self.views.len()), looks_across(s, l)]
            }
            (false, _) => vec![surfaces_across(s, l), looks_across(s, l)],
        };
        let fitted = ways.into_iter().map(|way| {
            let room = self.room(way.kind);
            way.fitted(&sizes, most, room)
        });
        let larger = |a: Layout, b: Layout| if b.scale > a.scale { b } else { a };
        // There is always one.
        fitted.reduce(larger).unwrap_or_else(|| {
            looks_across(s, l).fitted(&sizes, most, self.room(ArrangementKind::Looks))
        })
    }

    /// The error of the truth is no picture.
    fn empty(&self, cell: &[usize; 2], looks: &[Look]) -> bool {
        self.surfaces[cell[0]].is_truth && looks[cell[1]].layer == Layer::Error
    }

    fn room(&self, kind: ArrangementKind) -> Room {
        let many = self.surfaces.len() > 1 || (self.turning && self.layers.len() > 1);
        let left = if many || matches!(kind, ArrangementKind::Surfaces | ArrangementKind::Views) {
            LINE
        } else {
            0.0
        };
        let above = if kind == ArrangementKind::Turntable { 0.0 } else { LINE };
        let measured = self.measured() && kind != ArrangementKind::Turntable;
        let under = if kind == ArrangementKind::Turntable || measured { LINE } else { 0.0 };
        Room { left, above, under, gap: GAP }
    }

    /// There is a truth: errors are numbers.
    fn measured(&self) -> bool {
        self.surfaces.iter().any(|s| s.is_truth)
    }

    fn panels(&self, layout: &Layout, looks: &[Look], limit: f64) -> Vec<Item> {
        let mut cells = Vec::new();
        for (line, cells_of) in layout.arrangement.lines.iter().enumerate() {
            for (column, cell) in cells_of.iter().enumerate() {
                if !self.empty(cell, looks) {
                    cells.push((line, column, *cell));
                }
            }
        }
        let item = |&(line, column, [surface, look]): &(usize, usize, [usize; 2])| {
            let size = [layout.widths[line][column], layout.heights[line]];
            let dots = self.dpi / 72.0;
            let Look { layer, view, window } = looks[look];
            let shown = Shown {
                first: &self.surfaces[0],
                layer,
                view,
                window,
                size: size.map(|v| (v * dots).round().max(1.0) as u32),
                scale: layout.scale * dots,
                template: self.template,
                limit,
            };
            let at = [layout.lefts[line][column], layout.tops[line]];
            Item::Picture { at, size, picture: panel(&shown, &self.surfaces[surface]) }
        };
        cells.par_iter().map(item).collect()
    }

    /// What a look shows.
    fn words(&self, look: &Look) -> String {
        format!("{}, {}", self.layer(look), look.view.name)
    }

    fn layer(&self, look: &Look) -> &'static str {
        match look.layer {
            Layer::Shape => "shape",
            Layer::Albedo => "albedo",
            Layer::Error if self.measured() => "error",
            Layer::Error => "expected error",
        }
    }

    /// Names of columns and lines, and the mean error under every panel of errors.
    fn titles(&self, layout: &Layout, looks: &[Look]) -> Vec<Item> {
        let mut items = Vec::new();
        let kind = layout.arrangement.kind;
        for (line, cells) in layout.arrangement.lines.iter().enumerate() {
            let (top, high) = (layout.tops[line], layout.heights[line]);
            for (column, &[s, l]) in cells.iter().enumerate() {
                let wide = layout.widths[line][column];
                let middle = layout.lefts[line][column] + 0.5 * wide;
                let mut put = |y: f64, words: &str| {
                    let size = TEXT * (wide / font::width(words, TEXT)).clamp(0.5, 1.0);
                    items.push(Item::text([middle, y], Anchor::Middle, size, words));
                };
                let (surface, look) = (&self.surfaces[s], &looks[l]);
                match kind {
                    ArrangementKind::Turntable => put(top + high + TEXT, &look.view.name),
                    ArrangementKind::Surfaces if line == 0 => put(top - 0.4 * TEXT, &surface.name),
                    ArrangementKind::Looks if line == 0 => put(top - 0.4 * TEXT, &self.words(look)),
                    ArrangementKind::Views if line == 0 => put(top - 0.4 * TEXT, &look.view.name),
                    _ => (),
                }
                let last_view = look.view.name == self.views[self.views.len() - 1].name;
                let counted =
                    kind != ArrangementKind::Turntable && look.layer == Layer::Error && last_view;
                if counted && self.measured() && !surface.is_truth {
                    put(top + high + TEXT, &format!("mean {:.2} {}", mean(surface), self.unit()));
                }
            }
            let name = match (kind, cells.first()) {
                (ArrangementKind::Surfaces, Some(c)) => self.words(&looks[c[1]]),
                (ArrangementKind::Looks, Some(c)) if self.surfaces.len() > 1 => {
                    self.surfaces[c[0]].name.clone()
                }
                (ArrangementKind::Views, Some(c)) => self.layer(&looks[c[1]]).into(),
                (ArrangementKind::Turntable, Some(c)) => self.turned(c, looks),
                _ => String::new(),
            };
            if !name.is_empty() {
                let size = TEXT * (high / font::width(&name, TEXT)).clamp(0.6, 1.0);
                let at = [0.8 * TEXT, top + 0.5 * high];
                items.push(Item::Text {
                    at,
                    anchor: Anchor::Middle,
                    size,
                    upright: true,
                    text: name,
                });
            }
        }
        items
    }

    /// Name of a line of a turntable.
    fn turned(&self, cell: &[usize; 2], looks: &[Look]) -> String {
        let layer = self.layer(&looks[cell[1]]);
        match (self.surfaces.len() > 1, self.layers.len() > 1) {
            (false, false) => String::new(),
            (false, true) => layer.into(),
            (true, false) => self.surfaces[cell[0]].name.clone(),
            (true, true) => format!("{}, {layer}", self.surfaces[cell[0]].name),
        }
    }

    fn unit(&self) -> &'static str {
        match self.surfaces[0].file.unit {
            Some(MeshUnit::Millimetre) => "mm",
            Some(MeshUnit::Centimetre) => "cm",
            Some(MeshUnit::Metre) => "m",
            Some(MeshUnit::TemplateUnit) | None => "units",
        }
    }
}

/// What lengths and colours mean: a line under the panels, the colour bar in the place of the
/// truth's error where there is one.
struct Legend<'a> {
    plate: &'a Plate<'a>,
    layout: &'a Layout,
    looks: &'a [Look<'a>],
    /// End of the colour scale, and whether a value lies beyond.
    bound: (f64, bool),
}

impl Legend<'_> {
    fn items(&self, width: f64) -> Vec<Item> {
        let y = self.layout.size[1] + GAP + 0.5 * TEXT;
        let unit = self.plate.unit();
        let longest = (0.22 * width).min(0.5 * self.layout.widths[0][0].max(40.0));
        let mut items = scale_bar([GAP, y], longest, self.layout.scale, unit, TEXT);
        let mut x = GAP + longest + 3.0 * TEXT;
        let mut swatch = |colour: [u8; 3], words: &str| {
            items.push(Item::block([x, y - 0.4 * TEXT], [TEXT, TEXT], Ink::Rgb(colour)));
            items.push(Item::text([x + 1.4 * TEXT, y + 0.45 * TEXT], Anchor::Start, TEXT, words));
            x += 3.0 * TEXT + font::width(words, TEXT);
        };
        let shape = self.plate.layers.contains(&Layer::Shape);
        let knows = |s: &Surface| s.file.attributes.contains_key("visible");
        if shape && self.plate.surfaces.iter().any(knows) {
            swatch(UNSEEN, "not seen");
        }
        let buried = self.plate.surfaces.iter().map(|s| s.structures.len()).max().unwrap_or(0);
        for k in 0..if shape { buried } else { 0 } {
            swatch(COLOURS[k % COLOURS.len()], &format!("structure {}", k + 1));
        }
        if self.plate.layers.contains(&Layer::Error) {
            let free = [0.75 * width - 3.5 * TEXT, y - 0.4 * TEXT];
            items.extend(self.bar(self.hole().unwrap_or((free, [0.25 * width, 0.9 * TEXT]))));
        }
        items
    }

    /// Where the errors of the truth would stand.
    fn hole(&self) -> Option<(Place, Place)> {
        let layout = self.layout;
        let mut low = [f64::INFINITY; 2];
        let mut high = [f64::NEG_INFINITY; 2];
        for (line, cells) in layout.arrangement.lines.iter().enumerate() {
            for (column, &[s, l]) in cells.iter().enumerate() {
                if self.plate.empty(&[s, l], self.looks) {
                    let at = [layout.lefts[line][column], layout.tops[line]];
                    let size = [layout.widths[line][column], layout.heights[line]];
                    low = [0, 1].map(|k| low[k].min(at[k]));
                    high = [0, 1].map(|k| high[k].max(at[k] + size[k]));
                }
            }
        }
        let size = [0, 1].map(|k| high[k] - low[k]);
        // Upright left of its words, or lying above them.
        let words = font::width("≥0.25 mm", TEXT) + TEXT;
        match size {
            [w, h] if w.is_finite() && h >= w && w > words + 8.0 => {
                let tall = (h - 2.0 * TEXT).min(90.0);
                Some(([low[0] + 0.5 * (w - words - 8.0), low[1] + 0.5 * (h - tall)], [8.0, tall]))
            }
            [w, h] if w > 60.0 && h > 3.0 * TEXT => {
                let long = (w - 3.0 * TEXT).min(150.0);
                Some(([low[0] + 0.5 * (w - long), low[1] + 0.5 * h - TEXT], [long, 8.0]))
            }
            _ => None,
        }
    }

    fn bar(&self, (at, size): (Place, Place)) -> Vec<Item> {
        let (limit, beyond) = self.bound;
        let unit = self.plate.unit();
        let end = format!("{}{limit} {unit}", if beyond { "≥" } else { "" });
        let short = |v: f64| format!("{}", (v * 1e6).round() / 1e6);
        let colour = |t: f64| ramp(&CIVIDIS, t);
        let ticks = [(0.0, "0".into()), (0.5, short(0.5 * limit)), (1.0, end)];
        ColourBar { at, size, colour: &colour, ticks: &ticks, text: TEXT }.items()
    }
}
