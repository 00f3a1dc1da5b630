//! Where the values of a chart lie.

use super::{FLOOR, HEIGHT, LEFT, Plot, RIGHT, Series, TEXT, TOP, WIDTH};
use crate::sheet::colours::round_up;
use crate::sheet::{Anchor, Ink, Item};

/// From values to the drawing.
pub struct Axes {
    pub x: [f64; 2],
    y: [f64; 2],
    pub decades: bool,
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
            true => {
                // Six decades at most: what is smaller does not matter.
                let low = ends.iter().copied().fold(high, f64::min).max(1e-6 * high);
                let [low, high] = [low.log10().floor(), high.log10().ceil()];
                [low, high.max(low + 1.0)]
            }
        };
        let x = match plot.ticks.len() {
            0 => [0.0, round_up(all().map(|p| p.0).fold(1e-9, f64::max))],
            n => [-0.3, n as f64 - 0.7],
        };
        Self { x, y, decades: plot.decades }
    }

    pub fn x(&self, v: f64) -> f64 {
        LEFT + (WIDTH - LEFT - RIGHT) * (v - self.x[0]) / (self.x[1] - self.x[0]).max(1e-9)
    }

    pub fn y(&self, v: f64) -> f64 {
        let v = if self.decades { v.max(1e-300).log10().max(self.y[0]) } else { v };
        FLOOR - (FLOOR - TOP) * (v - self.y[0]) / (self.y[1] - self.y[0])
    }

    /// Places and names of the horizontal lines.
    pub fn levels(&self) -> Vec<(f64, String)> {
        if self.decades {
            let step = ((self.y[1] - self.y[0]) / 6.0).ceil().max(1.0) as usize;
            let levels = (self.y[0] as i32..=self.y[1] as i32).step_by(step);
            return levels.map(|k| (10f64.powi(k), power(k))).collect();
        }
        let level = |k| self.y[1] * f64::from(k) / 4.0;
        (0..=4).map(|k| (level(k), tick(level(k), self.y[1]))).collect()
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
            label(self.x(i as f64), FLOOR + 17.0, name);
        }
        for k in (0..=4).filter(|_| plot.ticks.is_empty()) {
            let v = self.x[1] * f64::from(k) / 4.0;
            label(self.x(v), FLOOR + 17.0, &tick(v, self.x[1]));
        }
        label(0.5 * (LEFT + WIDTH), HEIGHT - 6.0, plot.against);
        items
    }
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
