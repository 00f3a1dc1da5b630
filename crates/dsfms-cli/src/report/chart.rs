//! Charts as inline SVG; colours come from the page's style sheet.

use super::embed::escape;

const WIDTH: f64 = 560.0;

/// One bar.
pub struct Bar {
    pub label: String,
    pub value: f64,
    /// Drawn in the accent colour.
    pub strong: bool,
}

/// Horizontal bars with their values; colours come from the page's style sheet.
pub fn bars(title: &str, unit: &str, bars: &[Bar]) -> String {
    const ROW: usize = 34;
    let longest = bars.iter().map(|b| b.label.chars().count()).max().unwrap_or(0);
    let left = (8.0 * longest as f64 + 14.0).clamp(90.0, 260.0);
    let largest = bars.iter().map(|b| b.value).fold(1e-12, f64::max);
    let height = ROW * bars.len() + 6;
    let mut svg = format!(
        "<svg class=\"chart\" role=\"img\" viewBox=\"0 0 {WIDTH} {height}\" \
         xmlns=\"http://www.w3.org/2000/svg\"><title>{}</title>",
        escape(title)
    );
    for (i, bar) in bars.iter().enumerate() {
        let y = i * ROW + 4;
        let length = (WIDTH - left - 90.0) * bar.value / largest;
        let class = if bar.strong { "bar strong" } else { "bar" };
        let (text, end) = (y + 18, left + length + 8.0);
        svg += &format!(
            "<text x=\"{:.0}\" y=\"{text}\" text-anchor=\"end\">{}</text>\
             <rect class=\"{class}\" x=\"{left}\" y=\"{y}\" width=\"{length:.1}\" height=\"26\" rx=\"3\"/>\
             <text x=\"{end:.1}\" y=\"{text}\">{:.2} {unit}</text>",
            left - 8.0,
            escape(&bar.label),
            bar.value
        );
    }
    svg + "</svg>"
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
}

const HEIGHT: f64 = 250.0;
const LEFT: f64 = 52.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 14.0;
const FLOOR: f64 = HEIGHT - 44.0;
/// More points than this have no markers.
const MARKED: usize = 80;
/// More points than this are thinned: of each group the largest stays.
const MOST_POINTS: usize = 400;

/// From values to the drawing.
struct Axes {
    x: [f64; 2],
    y: [f64; 2],
    decades: bool,
}

impl Axes {
    fn of(plot: &Plot, series: &[Series]) -> Self {
        let all = || series.iter().flat_map(|s| &s.points);
        let ends = all().map(|p| p.1).chain(series.iter().flat_map(|s| s.whiskers.iter().copied()));
        let ends: Vec<f64> =
            ends.filter(|v| v.is_finite() && (!plot.decades || *v > 0.0)).collect();
        let high = ends.iter().copied().fold(1e-9, f64::max);
        let y = match plot.decades {
            false => [0.0, nice(high)],
            true => {
                // Six decades at most: what is smaller does not matter.
                let low = ends.iter().copied().fold(high, f64::min).max(1e-6 * high);
                let [low, high] = [low.log10().floor(), high.log10().ceil()];
                [low, high.max(low + 1.0)]
            }
        };
        let x = match plot.ticks.len() {
            0 => [0.0, nice(all().map(|p| p.0).fold(1e-9, f64::max))],
            n => [-0.3, n as f64 - 0.7],
        };
        Self { x, y, decades: plot.decades }
    }

    fn x(&self, v: f64) -> f64 {
        LEFT + (WIDTH - LEFT - RIGHT) * (v - self.x[0]) / (self.x[1] - self.x[0]).max(1e-9)
    }

    fn y(&self, v: f64) -> f64 {
        let v = if self.decades { v.max(1e-300).log10().max(self.y[0]) } else { v };
        FLOOR - (FLOOR - TOP) * (v - self.y[0]) / (self.y[1] - self.y[0])
    }

    /// Places and names of the horizontal lines.
    fn levels(&self) -> Vec<(f64, String)> {
        if self.decades {
            let step = ((self.y[1] - self.y[0]) / 6.0).ceil().max(1.0) as usize;
            let levels = (self.y[0] as i32..=self.y[1] as i32).step_by(step);
            return levels.map(|k| (10f64.powi(k), power(k))).collect();
        }
        let level = |k| self.y[1] * f64::from(k) / 4.0;
        (0..=4).map(|k| (level(k), tick(level(k), self.y[1]))).collect()
    }

    fn grid(&self, plot: &Plot) -> String {
        let mut svg = String::new();
        for (v, name) in self.levels() {
            svg += &format!(
                "<line class=\"grid-line\" x1=\"{LEFT}\" x2=\"{:.1}\" y1=\"{1:.1}\" y2=\"{1:.1}\"/>\
                 <text x=\"{2:.1}\" y=\"{3:.1}\" text-anchor=\"end\">{name}</text>",
                WIDTH - RIGHT,
                self.y(v),
                LEFT - 6.0,
                self.y(v) + 4.0
            );
        }
        let every = plot.ticks.len().div_ceil(12).max(1);
        for (i, name) in plot.ticks.iter().enumerate().step_by(every) {
            svg += &label(self.x(i as f64), FLOOR + 17.0, name);
        }
        for k in (0..=4).filter(|_| plot.ticks.is_empty()) {
            let v = self.x[1] * f64::from(k) / 4.0;
            svg += &label(self.x(v), FLOOR + 17.0, &tick(v, self.x[1]));
        }
        svg + &label(0.5 * (LEFT + WIDTH), HEIGHT - 6.0, plot.against)
    }

    /// The line of the `k`th series.
    fn line(&self, k: usize, series: &Series) -> String {
        let shown = |p: &&(f64, f64)| p.1.is_finite() && (!self.decades || p.1 > 0.0);
        let points: Vec<(f64, f64)> = series.points.iter().filter(shown).copied().collect();
        let points = thinned(&points);
        let path: Vec<String> =
            points.iter().map(|p| format!("{:.1},{:.1}", self.x(p.0), self.y(p.1))).collect();
        let values: Vec<String> = points.iter().map(|p| format!("{}:{:.4e}", p.0, p.1)).collect();
        let values = format!(
            " data-label=\"{}\" data-points=\"{}\"",
            escape(&series.label),
            values.join(" ")
        );
        let mut svg = format!(
            "<polyline class=\"line s{}\" points=\"{}\"{}/>",
            k % 6,
            path.join(" "),
            values
        );
        for p in points.iter().filter(|_| points.len() <= MARKED) {
            svg += &marker(k, self.x(p.0), self.y(p.1));
        }
        for (p, end) in series.points.iter().zip(&series.whiskers) {
            if end.is_finite() && p.1.is_finite() {
                // Side by side where series share their places.
                let x = self.x(p.0) + 2.5 * (k as f64 - 2.0);
                let (from, to) = (self.y(p.1), self.y(*end));
                svg += &format!(
                    "<path class=\"whisker s{}\" d=\"M{x:.1} {from:.1}V{to:.1}\"/>",
                    k % 6
                );
            }
        }
        svg
    }
}

/// Lines with markers. Series differ in colour, dash and marker, so that print and colour-blind
/// eyes tell them apart.
pub fn lines(plot: &Plot, series: &[Series]) -> String {
    let axes = Axes::of(plot, series);
    let [value, against] = [plot.value, plot.against].map(escape);
    let said =
        said([TOP, FLOOR], axes.x, (!plot.ticks.is_empty()).then_some(plot.ticks), plot.by_frame);
    let mut svg = format!(
        "<figure class=\"plot\"><svg class=\"chart\" role=\"img\" aria-label=\"{value} by {against}\" \
         viewBox=\"0 0 {WIDTH} {HEIGHT}\" {said} data-against=\"{against}\" \
         xmlns=\"http://www.w3.org/2000/svg\">{}",
        axes.grid(plot)
    );
    for (k, s) in series.iter().enumerate() {
        svg += &axes.line(k, s);
    }
    svg += &format!("</svg><figcaption>{value}<span class=\"keys\">");
    for (k, s) in series.iter().enumerate().filter(|(_, s)| !s.label.is_empty()) {
        svg += &format!(
            "<span class=\"key\"><svg viewBox=\"0 0 30 12\" aria-hidden=\"true\"><line class=\"line s{}\" \
             x1=\"1\" x2=\"29\" y1=\"6\" y2=\"6\"/>{}</svg>{}</span>",
            k % 6,
            marker(k, 15.0, 6.0),
            escape(&s.label)
        );
    }
    svg + "</span></figcaption></figure>"
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

/// Of more than [`MOST_POINTS`] points, the largest of each group.
fn thinned(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let group = points.len().div_ceil(MOST_POINTS).max(1);
    let largest = |g: &[(f64, f64)]| g.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1));
    points.chunks(group).filter_map(largest).collect()
}

/// A strip along the frames: ok low, degraded halfway, anything else full height. `names` of the
/// frames; none where they are 0, 1, ….
pub fn status_strip(title: &str, statuses: &[&str], names: Option<&[String]>) -> String {
    const TALL: f64 = 34.0;
    let count = statuses.len().max(1) as f64;
    let runs: Vec<String> = statuses
        .chunk_by(|a, b| a == b)
        .map(|run| format!("{}:{}", escape(run[0]), run.len()))
        .collect();
    let mut svg = format!(
        "<figure class=\"plot\"><svg class=\"chart strip\" role=\"img\" aria-label=\"{}\" \
         viewBox=\"0 0 {WIDTH} 62\" {} data-against=\"frame\" data-runs=\"{}\" \
         xmlns=\"http://www.w3.org/2000/svg\">",
        escape(title),
        said([4.0, 4.0 + TALL], [0.0, count], names, true),
        runs.join(" ")
    );
    let wide = (WIDTH - LEFT - RIGHT) / count;
    let mut start = 0;
    for run in statuses.chunk_by(|a, b| a == b) {
        let (class, share) = match run[0] {
            "ok" => ("ok", 0.3),
            "degraded" => ("degraded", 0.65),
            _ => ("failed", 1.0),
        };
        svg += &format!(
            "<rect class=\"status {class}\" x=\"{:.2}\" y=\"{:.1}\" width=\"{:.2}\" height=\"{:.1}\"/>",
            LEFT + wide * start as f64,
            4.0 + TALL * (1.0 - share),
            wide * run.len() as f64,
            TALL * share
        );
        start += run.len();
    }
    let last = statuses.len().saturating_sub(1);
    svg += &label(LEFT, 56.0, "0");
    svg += &label(WIDTH - RIGHT - 8.0, 56.0, &last.to_string());
    svg += &label(0.5 * (LEFT + WIDTH), 56.0, "place in the sequence");
    svg + &format!(
        "</svg><figcaption>{}<span class=\"keys\"><span class=\"ok\">▂ ok</span>\
         <span class=\"degraded\">▅ degraded</span><span class=\"failed\">█ lost or failed</span></span>\
         </figcaption></figure>",
        escape(title)
    )
}

fn label(x: f64, y: f64, text: &str) -> String {
    let text = escape(text);
    format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"middle\">{text}</text>")
}

fn marker(k: usize, x: f64, y: f64) -> String {
    let class = format!("marker s{}", k % 6);
    match k % 4 {
        0 => format!("<circle class=\"{class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.6\"/>"),
        1 => format!(
            "<rect class=\"{class}\" x=\"{:.1}\" y=\"{:.1}\" width=\"6.6\" height=\"6.6\"/>",
            x - 3.3,
            y - 3.3
        ),
        2 => format!("<path class=\"{class}\" d=\"M{x:.1} {:.1}l4.2 7.2h-8.4z\"/>", y - 4.4),
        _ => format!(
            "<path class=\"{class}\" d=\"M{x:.1} {:.1}l4.4 4.4l-4.4 4.4l-4.4 -4.4z\"/>",
            y - 4.4
        ),
    }
}

/// The next 1, 1.5, 2, 3, 4, 5, 6 or 8 times a power of ten.
pub fn nice(v: f64) -> f64 {
    let decade = 10f64.powf(v.log10().floor());
    let step = [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0]
        .into_iter()
        .find(|s| s * decade >= v * (1.0 - 1e-9));
    step.unwrap_or(10.0) * decade
}

/// A power of ten.
fn power(k: i32) -> String {
    match k {
        -3..=4 => format!("{}", 10f64.powi(k)),
        _ => format!("1e{k}"),
    }
}

fn tick(v: f64, top: f64) -> String {
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

#[cfg(test)]
mod tests;
