//! Where the values of a chart lie.

use super::{FLAT, FLOOR, HEIGHT, LEFT, Plot, RIGHT, Series, TEXT, TOP, WIDTH, known};
use crate::sheet::colours::round_up;
use crate::sheet::{Anchor, Ink, Item, font};

/// Behind a span.
const SHADE: Ink = Ink::Rgb([234, 236, 240]);
/// Distance from the axis and height of the strip under it.
const STRIP: [f64; 2] = [1.0, 5.0];

/// From values to the drawing.
pub struct Axes {
    pub x: [f64; 2],
    y: [f64; 2],
    pub decades: bool,
    pub decades_along: bool,
    /// Where the axis lies, and how high all of it is.
    pub floor: f64,
    pub height: f64,
    flat: bool,
}

impl Axes {
    pub fn of(plot: &Plot, series: &[Series]) -> Self {
        let all = || series.iter().flat_map(|s| &s.points);
        let ends = all().map(|p| p.1).chain(series.iter().flat_map(|s| s.whiskers.iter().copied()));
        let ends: Vec<f64> =
            ends.filter(|v| v.is_finite() && (!plot.decades || *v > 0.0)).collect();
        let high = ends.iter().copied().fold(1e-9, f64::max);
        let y = match plot.decades {
            false => [0.0, round_up(high)],
            true => decades(ends.iter().copied(), high),
        };
        let far = all().map(|p| p.0).fold(1e-9, f64::max);
        let decades_along = plot.decades_along && plot.ticks.is_empty();
        let x = match plot.ticks.len() {
            0 if decades_along => decades(all().map(|p| p.0).filter(|x| *x > 0.0), far),
            0 => [0.0, round_up(far)],
            n => [-0.3, n as f64 - 0.7],
        };
        let flat = plot.flat;
        let (floor, height) = if flat { (FLAT[0], FLAT[0] + FLAT[1]) } else { (FLOOR, HEIGHT) };
        Self { x, y, decades: plot.decades, decades_along, floor, height, flat }
    }

    pub fn x(&self, v: f64) -> f64 {
        let v = if self.decades_along { v.max(1e-300).log10().max(self.x[0]) } else { v };
        LEFT + (WIDTH - LEFT - RIGHT) * (v - self.x[0]) / (self.x[1] - self.x[0]).max(1e-9)
    }

    pub fn y(&self, v: f64) -> f64 {
        let v = if self.decades { v.max(1e-300).log10().max(self.y[0]) } else { v };
        self.floor - (self.floor - TOP) * (v - self.y[0]) / (self.y[1] - self.y[0])
    }

    /// Places and names of the horizontal lines.
    pub fn levels(&self) -> Vec<(f64, String)> {
        if self.decades {
            return powers(self.y);
        }
        let top = self.y[1];
        match self.flat {
            true => [0.0, 0.5 * top, top].map(|v| (v, tick(v, top))).to_vec(),
            false => steps(top),
        }
    }

    pub fn grid(&self, plot: &Plot) -> Vec<Item> {
        let mut items = Vec::new();
        for (v, name) in self.levels() {
            let y = self.y(v);
            items.push(Item::line(vec![[LEFT, y], [WIDTH - RIGHT, y]], 0.8, Ink::Grid));
            items.push(Item::text([LEFT - 6.0, y + 4.0], Anchor::End, TEXT, name));
        }
        let mut label = |x: f64, y: f64, name: &str| {
            items.push(Item::text([x, y], Anchor::Middle, TEXT, name));
        };
        let every = plot.ticks.len().div_ceil(12).max(1);
        for (i, name) in plot.ticks.iter().enumerate().step_by(every) {
            label(self.x(i as f64), self.floor + 17.0, name);
        }
        let along: Vec<(f64, String)> = match (plot.ticks.is_empty(), self.decades_along) {
            (false, _) => Vec::new(),
            (true, true) => powers(self.x),
            (true, false) => steps(self.x[1]),
        };
        for (v, name) in &along {
            label(self.x(*v), self.floor + 17.0, name);
        }
        if !self.flat {
            label(0.5 * (LEFT + WIDTH), self.height - 6.0, plot.against);
        }
        items
    }

    /// Shades behind everything, and their names above where they do not meet.
    pub fn spans(&self, plot: &Plot) -> Vec<Item> {
        let (mut shades, mut names, mut free) = (Vec::new(), Vec::new(), LEFT);
        for span in plot.spans {
            let [a, b] = self.around(span.ends);
            shades.push(Item::block([a, TOP], [b - a, self.floor - TOP], SHADE));
            let wide = font::width(&span.name, 0.8 * TEXT);
            if a >= free && a + wide <= WIDTH {
                let name = span.name.as_str();
                names.push(Item::text([a, TOP - 3.0], Anchor::Start, 0.8 * TEXT, name));
                free = a + wide + 0.5 * TEXT;
            }
        }
        shades.extend(names);
        shades
    }

    /// A strip under the axis, a colour for every status; one block for each run of the same.
    pub fn strip(&self, plot: &Plot) -> Vec<Item> {
        let run = |run: &[(f64, String)]| {
            let [a, b] = self.around([run[0].0, run[run.len() - 1].0]);
            Item::block(
                [a, self.floor + STRIP[0]],
                [b - a, STRIP[1]],
                Ink::Status(known(&run[0].1).0),
            )
        };
        plot.strip.chunk_by(|a, b| a.1 == b.1).map(run).collect()
    }

    /// From half a place before the first to half a place behind the last, within the axes.
    fn around(&self, [first, last]: [f64; 2]) -> [f64; 2] {
        [self.x(first - 0.5).max(LEFT), self.x(last + 0.5).min(WIDTH - RIGHT)]
    }
}

/// From zero to a round number in three to five steps of one digit.
fn steps(top: f64) -> Vec<(f64, String)> {
    let one_digit = |n: &i32| {
        let step = top / f64::from(*n);
        let scaled = step / 10f64.powf(step.log10().floor());
        (scaled - scaled.round()).abs() < 1e-6
    };
    let count = [4, 3, 5].into_iter().find(one_digit).unwrap_or(4);
    let level = |k: i32| top * f64::from(k) / f64::from(count);
    (0..=count).map(|k| (level(k), tick(level(k), top))).collect()
}

/// First and last exponent of the decades that hold all values.
fn decades(values: impl Iterator<Item = f64>, high: f64) -> [f64; 2] {
    // Six decades at most: what is smaller does not matter.
    let low = values.fold(high, f64::min).max(1e-6 * high);
    let [low, high] = [low.log10().floor(), high.log10().ceil()];
    [low, high.max(low + 1.0)]
}

/// Powers of ten from one exponent to another, seven at most, and their names.
fn powers([low, high]: [f64; 2]) -> Vec<(f64, String)> {
    let step = ((high - low) / 6.0).ceil().max(1.0) as usize;
    (low as i32..=high as i32).step_by(step).map(|k| (10f64.powi(k), power(k))).collect()
}

/// A power of ten.
fn power(k: i32) -> String {
    match k {
        -3..=4 => format!("{}", 10f64.powi(k)),
        _ => format!("1e{k}"),
    }
}

pub fn tick(v: f64, top: f64) -> String {
    let least = (1.0 - (top / 4.0).log10().floor()).clamp(0.0, 6.0) as i32;
    // A quarter of a round number may have one digit more.
    let exact =
        |d: &i32| (v * 10f64.powi(*d)).fract().min(1.0 - (v * 10f64.powi(*d)).fract()) < 1e-6;
    let digits = (least..least + 2).find(exact).unwrap_or(least) as usize;
    let text = format!("{v:.digits$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_string(),
        false => text,
    }
}
