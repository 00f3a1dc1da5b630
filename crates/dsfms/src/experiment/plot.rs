//! Errors against extension as SVG: the mean of every method as a line, its 90th percentile thin.

use super::{Metric, Row};
use std::fmt::Write;

const SIZE: [f64; 2] = [640.0, 400.0];
/// Left, top, right, bottom.
const MARGIN: [f64; 4] = [64.0, 44.0, 96.0, 52.0];
/// Colours that colour-blind eyes tell apart (Okabe and Ito).
const COLOURS: [&str; 7] =
    ["#555555", "#E69F00", "#0072B2", "#009E73", "#D55E00", "#CC79A7", "#56B4E9"];

/// One plot: the rows of one noise level.
pub fn plot(metric: Metric, rows: &[&Row]) -> String {
    let mut arms: Vec<&str> = Vec::new();
    rows.iter().for_each(|r| {
        if !arms.contains(&r.arm.as_str()) {
            arms.push(&r.arm);
        }
    });
    let axes = PlotAxes::of(metric, rows);
    let mut svg = axes.frame(metric);
    let mut ends = Vec::new();
    for (k, arm) in arms.iter().enumerate() {
        let line: Vec<&Row> = rows.iter().copied().filter(|r| r.arm == *arm).collect();
        let mean = |r: &Row| r.errors[metric.index].mean;
        let p90 = |r: &Row| r.errors[metric.index].p90;
        let colour = COLOURS[k % COLOURS.len()];
        svg += &axes.line(
            &line,
            p90,
            colour,
            "stroke-width=\"1\" stroke-dasharray=\"4 3\" opacity=\"0.75\"",
        );
        svg += &axes.line(&line, mean, colour, "stroke-width=\"2.2\"");
        for r in &line {
            let (x, y) = (axes.x(r.cell.extension), axes.y(mean(r)));
            let _ =
                write!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.2\" fill=\"{colour}\"/>");
        }
        if let Some(last) = line.last().filter(|r| mean(r).is_finite()) {
            ends.push((axes.y(mean(last)), *arm, colour));
        }
    }
    svg += &labels(ends, axes.x(axes.right));
    svg + "</svg>\n"
}

/// Ranges of the two axes.
struct PlotAxes {
    left: f64,
    right: f64,
    top: f64,
    step: f64,
    extensions: Vec<f64>,
}

impl PlotAxes {
    fn of(metric: Metric, rows: &[&Row]) -> Self {
        let mut extensions: Vec<f64> = rows.iter().map(|r| r.cell.extension).collect();
        extensions.sort_by(f64::total_cmp);
        extensions.dedup();
        let largest = rows
            .iter()
            .map(|r| r.errors[metric.index])
            .flat_map(|e| [e.mean, e.p90])
            .filter(|v| v.is_finite())
            .fold(1e-6, f64::max);
        let step = round_step(largest / 5.0);
        let (first, last) = (extensions.first().copied(), extensions.last().copied());
        let (left, right) = (first.unwrap_or(0.0), last.unwrap_or(1.0));
        let right = if right > left { right } else { left + 1.0 };
        Self { left, right, top: (largest / step).ceil() * step, step, extensions }
    }

    fn x(&self, extension: f64) -> f64 {
        let t = (extension - self.left) / (self.right - self.left);
        MARGIN[0] + t * (SIZE[0] - MARGIN[0] - MARGIN[2])
    }

    fn y(&self, error: f64) -> f64 {
        SIZE[1] - MARGIN[3] - error / self.top * (SIZE[1] - MARGIN[1] - MARGIN[3])
    }

    /// Background, grid, axes and titles.
    fn frame(&self, metric: Metric) -> String {
        let [w, h] = SIZE;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" \
             font-family=\"sans-serif\" font-size=\"12\" role=\"img\">\n<title>{title}</title>\
             <rect width=\"{w}\" height=\"{h}\" fill=\"white\"/>\
             <text x=\"{left}\" y=\"22\" font-size=\"14\" font-weight=\"bold\">{title}</text>\n",
            title = metric.title,
            left = MARGIN[0],
        );
        let (x0, x1) = (self.x(self.left), self.x(self.right));
        for k in 0..=(self.top / self.step).round() as usize {
            let value = k as f64 * self.step;
            let (y, digits) = (self.y(value), decimals(self.step));
            let _ = writeln!(
                svg,
                "<line x1=\"{x0:.1}\" x2=\"{x1:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\" stroke=\"#ddd\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"#333\">{value:.digits$}</text>",
                x0 - 8.0,
                y + 4.0,
            );
        }
        for &extension in &self.extensions {
            let _ = write!(
                svg,
                "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#333\">{extension}</text>",
                self.x(extension),
                h - MARGIN[3] + 18.0
            );
        }
        let (cx, cy) = (0.5 * (x0 + x1), 0.5 * (self.y(0.0) + self.y(self.top)));
        let _ = writeln!(
            svg,
            "<text x=\"{cx:.1}\" y=\"{:.1}\" text-anchor=\"middle\">extension, % (solid: mean, dashed: 90th percentile)</text>\
             <text transform=\"translate(18 {cy:.1}) rotate(-90)\" text-anchor=\"middle\">error, {}</text>",
            h - 14.0,
            metric.unit
        );
        svg
    }

    fn line(
        &self,
        rows: &[&Row],
        value: impl Fn(&Row) -> f64,
        colour: &str,
        style: &str,
    ) -> String {
        let at = |r: &&&Row| value(r).is_finite();
        let points: Vec<String> = rows
            .iter()
            .filter(at)
            .map(|r| format!("{:.1},{:.1}", self.x(r.cell.extension), self.y(value(r))))
            .collect();
        let points = points.join(" ");
        format!("<polyline points=\"{points}\" fill=\"none\" stroke=\"{colour}\" {style}/>\n")
    }
}

/// The arms' names beside the ends of their lines, pushed apart where they would overlap.
fn labels(mut ends: Vec<(f64, &str, &str)>, x: f64) -> String {
    const LINE: f64 = 15.0;
    ends.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut text = String::new();
    let mut lowest = f64::NEG_INFINITY;
    // Room for all of them above the lower end of the picture.
    let count = ends.len();
    for (k, (y, arm, colour)) in ends.into_iter().enumerate() {
        let room = SIZE[1] - MARGIN[3] - LINE * (count - 1 - k) as f64;
        let y = y.max(lowest + LINE).min(room.max(lowest + LINE));
        lowest = y;
        let (x, y) = (x + 10.0, y + 4.0);
        let _ = writeln!(
            text,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" fill=\"{colour}\" font-weight=\"bold\">{arm}</text>"
        );
    }
    text
}

/// 1, 2 or 5 times a power of ten, at least `least`.
fn round_step(least: f64) -> f64 {
    let power = 10f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|&s| s >= least).unwrap_or(power)
}

fn decimals(step: f64) -> usize {
    (-step.log10().floor()).max(0.0) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_round() {
        for (least, step, digits) in
            [(0.13, 0.2, 1), (0.2, 0.2, 1), (3.1, 5.0, 0), (60.0, 100.0, 0)]
        {
            assert!((round_step(least) - step).abs() < 1e-12, "{least}");
            assert_eq!(decimals(step), digits);
        }
    }

    #[test]
    fn labels_do_not_overlap() {
        let text =
            labels(vec![(100.0, "a", "red"), (101.0, "b", "blue"), (400.0, "c", "grey")], 0.0);
        let ys: Vec<f64> = text
            .lines()
            .map(|l| l.split("y=\"").nth(1).unwrap().split('"').next().unwrap().parse().unwrap())
            .collect();
        assert!(ys.windows(2).all(|w| w[1] - w[0] >= 14.9), "{ys:?}");
        assert!(ys.iter().all(|&y| y < SIZE[1]));
    }
}
