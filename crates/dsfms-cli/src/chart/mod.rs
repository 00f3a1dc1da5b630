//! Charts: laid out once, as items of a sheet; on a page of a report as inline SVG, on paper as a
//! sheet of their own.

mod axes;
mod lines;

pub use lines::{line_chart, lines};

use crate::report::embed::escape;
use crate::sheet::{Anchor, Ink, Item, Place, Sheet, font, svg};

/// Width of a chart, in its own unit.
pub const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 250.0;
const LEFT: f64 = 52.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 14.0;
const FLOOR: f64 = HEIGHT - 44.0;
/// The same of a flat chart, and what lies under it.
const FLAT: [f64; 2] = [68.0, 24.0];
/// Size of the letters; a page says its own.
const TEXT: f64 = 12.0;
/// Width of a chart on paper, mm: that of a text of Springer's LNCS.
const PAPER_MM: f64 = 122.0;

/// One bar.
pub struct Bar {
    pub label: String,
    pub value: f64,
    /// Drawn in the accent colour.
    pub strong: bool,
}

/// One line of a plot.
#[derive(Clone, Debug, Default)]
pub struct Series {
    pub label: String,
    /// Place and value.
    pub points: Vec<(f64, f64)>,
    /// Ends of thin bars that stand on the points; empty = none.
    pub whiskers: Vec<f64>,
}

/// A plot's words and axes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Plot<'a> {
    /// What is drawn, with its unit.
    pub value: &'a str,
    /// What it is drawn against.
    pub against: &'a str,
    /// Names of the places 0, 1, …; empty = places are numbers.
    pub ticks: &'a [String],
    /// The places are frames: the line of the current one is shown, a click goes to one.
    pub by_frame: bool,
    /// Decades upwards instead of a line from zero; values that are not positive are left out.
    pub decades: bool,
    /// Decades along the axis, of places that are numbers.
    pub decades_along: bool,
    /// Shaded spans.
    pub spans: &'a [Span],
    /// A quarter of the height, with three levels, for a strip beside something else.
    pub flat: bool,
    /// Places that have a status, drawn as a strip under the axis.
    pub strip: &'a [(f64, String)],
}

/// A span along the axis that has a name.
#[derive(Clone, Debug)]
pub struct Span {
    pub name: String,
    /// First and last place.
    pub ends: [f64; 2],
}

/// Name, words and height of every status.
const STATUSES: [(&str, &str, f64); 3] =
    [("ok", "ok", 0.3), ("degraded", "degraded", 0.65), ("failed", "lost or failed", 1.0)];

/// One of [`STATUSES`].
fn known(status: &str) -> &'static (&'static str, &'static str, f64) {
    STATUSES.iter().find(|s| s.0 == status).unwrap_or(&STATUSES[2])
}

/// A chart, laid out.
pub struct Chart {
    height: f64,
    items: Vec<Item>,
    /// What is drawn, for the caption.
    caption: String,
    /// What stands for what.
    keys: Vec<Key>,
    /// Attributes of the `svg` on a page, for its script.
    said: String,
    /// Classes of the `svg` on a page.
    class: &'static str,
}

/// A sign of 30 by 12 and its words.
struct Key {
    sign: Vec<Item>,
    words: String,
    /// Class of the words on a page.
    class: &'static str,
}

impl Chart {
    /// A figure of a page: its colours come from the style sheet, its values are in attributes.
    pub fn page(&self) -> String {
        let Self { height, caption, said, class, .. } = self;
        let caption = escape(caption);
        let mut html = format!(
            "<figure class=\"plot\"><svg class=\"{class}\" role=\"img\" aria-label=\"{caption}\" \
             viewBox=\"0 0 {WIDTH} {height}\" {said} xmlns=\"http://www.w3.org/2000/svg\">{}</svg>\
             <figcaption>{caption}<span class=\"keys\">",
            svg::page(&self.items)
        );
        for key in &self.keys {
            html += &format!(
                "<span class=\"key {}\"><svg viewBox=\"0 0 30 12\" aria-hidden=\"true\">{}</svg>{}</span>",
                key.class,
                svg::page(&key.sign),
                escape(&key.words)
            );
        }
        html + "</span></figcaption></figure>"
    }

    /// A sheet for print: the caption above the chart, the keys beside it or in lines under it.
    pub fn paper(&self) -> Sheet {
        const LINE: f64 = 1.5 * TEXT;
        let mut items = vec![Item::text([LEFT, LINE], Anchor::Start, TEXT, self.caption.as_str())];
        let wide = |key: &Key| 36.0 + font::width(&key.words, TEXT) + TEXT;
        let (mut x, mut y) = (LEFT + font::width(&self.caption, TEXT) + 3.0 * TEXT, LINE);
        let all: f64 = self.keys.iter().map(wide).sum();
        // None is parted from the others where one line holds them.
        if x + all > WIDTH && LEFT + all <= WIDTH {
            (x, y) = (LEFT, y + LINE);
        }
        for key in &self.keys {
            let wide = wide(key);
            if x + wide > WIDTH {
                (x, y) = (LEFT, y + LINE);
            }
            let sign = key.sign.iter().map(|item| item.clone().moved([x, y - 10.0]));
            items.extend(sign);
            items.push(Item::text([x + 36.0, y], Anchor::Start, TEXT, key.words.as_str()));
            x += wide;
        }
        let above = y + 0.5 * TEXT;
        items.extend(self.items.iter().map(|item| item.clone().moved([0.0, above])));
        let size = [WIDTH, above + self.height];
        Sheet { size, unit_mm: PAPER_MM / WIDTH, title: self.caption.clone(), items }
    }
}

/// Horizontal bars with their values, for a page.
pub fn bars(title: &str, unit: &str, bars: &[Bar]) -> String {
    const ROW: f64 = 34.0;
    const TALL: f64 = 26.0;
    let longest = bars.iter().map(|b| b.label.chars().count()).max().unwrap_or(0);
    let left = (8.0 * longest as f64 + 14.0).clamp(90.0, 260.0);
    let largest = bars.iter().map(|b| b.value).fold(1e-12, f64::max);
    let mut items = Vec::new();
    for (i, bar) in bars.iter().enumerate() {
        let y = ROW * i as f64 + 4.0;
        let length = (WIDTH - left - 90.0) * bar.value / largest;
        let words = format!("{:.2} {unit}", bar.value);
        items.push(Item::text([left - 8.0, y + 18.0], Anchor::End, 14.0, bar.label.as_str()));
        items.push(Item::block([left, y], [length, TALL], Ink::Bar(bar.strong)));
        items.push(Item::text([left + length + 8.0, y + 18.0], Anchor::Start, 14.0, words));
    }
    format!(
        "<svg class=\"chart\" role=\"img\" viewBox=\"0 0 {WIDTH} {}\" xmlns=\"http://www.w3.org/2000/svg\">\
         <title>{}</title>{}</svg>",
        ROW * bars.len() as f64 + 6.0,
        escape(title),
        svg::page(&items)
    )
}

/// A strip along the frames, for a page: ok low, degraded halfway, anything else full height.
/// `names` of the frames; none where they are 0, 1, ….
pub fn status_strip(title: &str, statuses: &[&str], names: Option<&[String]>) -> String {
    const TALL: f64 = 34.0;
    let count = statuses.len().max(1) as f64;
    let wide = (WIDTH - LEFT - RIGHT) / count;
    let part = |[x, width]: Place, floor: f64, tall: f64, status: &str| {
        let (name, _, share) = known(status);
        let high = tall * share;
        Item::block([x, floor - high], [width, high], Ink::Status(name))
    };
    let runs: Vec<&[&str]> = statuses.chunk_by(|a, b| a == b).collect();
    let mut items = Vec::new();
    let mut start = 0;
    for run in &runs {
        let place = [LEFT + wide * start as f64, wide * run.len() as f64];
        items.push(part(place, 4.0 + TALL, TALL, run[0]));
        start += run.len();
    }
    let last = statuses.len().saturating_sub(1).to_string();
    let middle = 0.5 * (LEFT + WIDTH);
    for (x, words) in
        [(LEFT, "0"), (WIDTH - RIGHT - 8.0, last.as_str()), (middle, "place in the sequence")]
    {
        items.push(Item::text([x, 56.0], Anchor::Middle, TEXT, words));
    }
    let key = |&(class, words, _): &(&'static str, &str, f64)| {
        let sign = vec![part([9.0, 12.0], 12.0, 12.0, class)];
        Key { sign, words: words.into(), class }
    };
    let runs: Vec<String> = runs.iter().map(|r| format!("{}:{}", escape(r[0]), r.len())).collect();
    let axes = said([4.0, 4.0 + TALL], [0.0, count], names, true);
    let said = format!("{axes} data-against=\"frame\" data-runs=\"{}\"", runs.join(" "));
    let keys = STATUSES.iter().map(key).collect();
    let class = "chart strip";
    Chart { height: 62.0, items, caption: title.into(), keys, said, class }.page()
}

/// What the page's script must know of a chart: where it lies, and what its places mean.
fn said(high: [f64; 2], span: [f64; 2], places: Option<&[String]>, by_frame: bool) -> String {
    let places = places.map_or(String::new(), |names| {
        let names = serde_json::Value::from(names).to_string();
        format!(" data-places=\"{}\"", escape(&names))
    });
    format!(
        "data-box=\"{LEFT},{},{},{}\" data-span=\"{},{}\"{places}{}",
        WIDTH - RIGHT,
        high[0],
        high[1],
        span[0],
        span[1],
        if by_frame { " data-by=\"frame\"" } else { "" }
    )
}

#[cfg(test)]
mod tests;
