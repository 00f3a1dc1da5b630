//! Lines with markers. Series differ in colour, dash and marker, so that print and colour-blind
//! eyes tell them apart.

use super::axes::Axes;
use super::{Chart, Key, Plot, STATUSES, Series, TOP, said};
use crate::report::embed::escape;
use crate::sheet::{Ink, Item, Place};

/// More points than this have no markers.
const MARKED: usize = 80;
/// More points than this are thinned: of each group the largest stays.
pub const MOST_POINTS: usize = 400;
/// Dashes of the series on paper, as the style sheet of a page has them.
const DASHES: [&[f64]; 6] =
    [&[2.0, 3.0], &[7.0, 4.0], &[10.0, 3.0, 2.0, 3.0], &[], &[4.0, 2.0], &[]];

/// A line chart of a page.
pub fn lines(plot: &Plot, series: &[Series]) -> String {
    line_chart(plot, series).page()
}

/// A line chart, for a page or for paper.
pub fn line_chart(plot: &Plot, series: &[Series]) -> Chart {
    let axes = Axes::of(plot, series);
    let places = (!plot.ticks.is_empty()).then_some(plot.ticks);
    let where_ = said([TOP, axes.floor], axes.x, places, plot.by_frame);
    let mut items = axes.spans(plot);
    items.extend(axes.grid(plot));
    items.extend(axes.strip(plot));
    for (k, s) in series.iter().enumerate() {
        items.extend(line(&axes, k, s));
    }
    let key = |(k, s): (usize, &Series)| {
        let sign =
            vec![stroke(k, vec![[1.0, 6.0], [29.0, 6.0]], String::new()), marker(k, [15.0, 6.0])];
        Key { sign, words: s.label.clone(), class: "" }
    };
    Chart {
        height: axes.height,
        items,
        caption: plot.value.into(),
        keys: series
            .iter()
            .enumerate()
            .filter(|(_, s)| !s.label.is_empty())
            .map(key)
            .chain(STATUSES.iter().filter(|_| !plot.strip.is_empty()).map(status_key))
            .collect(),
        said: format!("{where_} data-against=\"{}\"", escape(plot.against)),
        class: "chart",
    }
}

fn status_key(&(name, words, _): &(&'static str, &str, f64)) -> Key {
    let sign = vec![Item::block([9.0, 3.0], [12.0, 6.0], Ink::Status(name))];
    Key { sign, words: words.into(), class: name }
}

/// The line of the `k`th series.
fn line(axes: &Axes, k: usize, series: &Series) -> Vec<Item> {
    let shown = |p: &&(f64, f64)| {
        p.1.is_finite() && (!axes.decades || p.1 > 0.0) && (!axes.decades_along || p.0 > 0.0)
    };
    let points: Vec<(f64, f64)> = series.points.iter().filter(shown).copied().collect();
    let points = thinned(&points);
    let path: Vec<Place> = points.iter().map(|p| [axes.x(p.0), axes.y(p.1)]).collect();
    let values: Vec<String> = points.iter().map(|p| format!("{}:{:.4e}", p.0, p.1)).collect();
    let label = escape(&series.label);
    let said = format!(" data-label=\"{label}\" data-points=\"{}\"", values.join(" "));
    let mut items = Vec::new();
    for (p, end) in series.points.iter().zip(&series.whiskers) {
        if end.is_finite() && shown(&p) {
            // Side by side where series share their places.
            let x = axes.x(p.0) + 2.5 * (k as f64 - 2.0);
            let points = vec![[x, axes.y(p.1)], [x, axes.y(*end)]];
            items.push(Item::line(points, 1.2, Ink::Whisker(k)));
        }
    }
    let marked = path.len() <= MARKED;
    let markers: Vec<Item> = path.iter().filter(|_| marked).map(|&at| marker(k, at)).collect();
    items.push(stroke(k, path, said));
    items.extend(markers);
    items
}

fn stroke(k: usize, points: Vec<Place>, said: String) -> Item {
    Item::Line { points, width: 1.8, dash: DASHES[k % DASHES.len()], ink: Ink::Line(k), said }
}

fn marker(k: usize, [x, y]: Place) -> Item {
    let ink = Ink::Marker(k);
    let around = |corners: &[Place]| {
        let points = corners.iter().map(|[dx, dy]| [x + dx, y + dy]).collect();
        Item::Area { points, ink }
    };
    match k % 4 {
        0 => Item::Disc { at: [x, y], radius: 3.6, ink },
        1 => Item::block([x - 3.3, y - 3.3], [6.6, 6.6], ink),
        2 => around(&[[0.0, -4.4], [4.2, 2.8], [-4.2, 2.8]]),
        _ => around(&[[0.0, -4.4], [4.4, 0.0], [0.0, 4.4], [-4.4, 0.0]]),
    }
}

/// Of more than [`MOST_POINTS`] points, the largest of each group.
pub fn thinned(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let group = points.len().div_ceil(MOST_POINTS).max(1);
    let largest = |g: &[(f64, f64)]| g.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1));
    points.chunks(group).filter_map(largest).collect()
}
