//! Charts as inline SVG; colours come from the page's style sheet.

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
    const LEFT: f64 = 90.0;
    let largest = bars.iter().map(|b| b.value).fold(1e-12, f64::max);
    let height = ROW * bars.len() + 6;
    let mut svg = format!(
        "<svg class=\"chart\" role=\"img\" viewBox=\"0 0 {WIDTH} {height}\" \
         xmlns=\"http://www.w3.org/2000/svg\"><title>{title}</title>"
    );
    for (i, bar) in bars.iter().enumerate() {
        let y = i * ROW + 4;
        let length = (WIDTH - LEFT - 90.0) * bar.value / largest;
        let class = if bar.strong { "bar strong" } else { "bar" };
        let (text, end) = (y + 18, LEFT + length + 8.0);
        svg += &format!(
            "<text x=\"{:.0}\" y=\"{text}\" text-anchor=\"end\">{}</text>\
             <rect class=\"{class}\" x=\"{LEFT}\" y=\"{y}\" width=\"{length:.1}\" height=\"26\" rx=\"3\"/>\
             <text x=\"{end:.1}\" y=\"{text}\">{:.2} {unit}</text>",
            LEFT - 8.0,
            bar.label,
            bar.value
        );
    }
    svg + "</svg>"
}

/// One line of a plot.
pub struct Series {
    pub label: String,
    /// Place and value.
    pub points: Vec<(f64, f64)>,
}

const HEIGHT: f64 = 250.0;
const LEFT: f64 = 52.0;
const TOP: f64 = 14.0;
const FLOOR: f64 = HEIGHT - 44.0;

/// Lines with markers over named places (`ticks[i]` at `x = i`), or over numbers where there are no
/// names. Series differ in colour, dash and marker, so that print and colour-blind eyes tell them
/// apart.
pub fn lines(y_title: &str, x_title: &str, ticks: &[String], series: &[Series]) -> String {
    let all = || series.iter().flat_map(|s| &s.points);
    let top = nice(all().map(|p| p.1).fold(1e-9, f64::max));
    let low = if ticks.is_empty() { 0.0 } else { -0.3 };
    let high = match ticks.len() {
        0 => nice(all().map(|p| p.0).fold(1e-9, f64::max)),
        n => n as f64 - 0.7,
    };
    let x = |v: f64| LEFT + (WIDTH - LEFT - 12.0) * (v - low) / (high - low).max(1e-9);
    let y = |v: f64| FLOOR - (FLOOR - TOP) * v / top;
    let mut svg = format!(
        "<figure class=\"plot\"><svg class=\"chart\" role=\"img\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" \
         xmlns=\"http://www.w3.org/2000/svg\"><title>{y_title} by {x_title}</title>"
    );
    for k in 0..=4 {
        let v = top * f64::from(k) / 4.0;
        svg += &format!(
            "<line class=\"grid-line\" x1=\"{LEFT}\" x2=\"{:.1}\" y1=\"{1:.1}\" y2=\"{1:.1}\"/>\
             <text x=\"{2:.1}\" y=\"{3:.1}\" text-anchor=\"end\">{4}</text>",
            WIDTH - 12.0,
            y(v),
            LEFT - 6.0,
            y(v) + 4.0,
            tick(v, top)
        );
    }
    let every = ticks.len().div_ceil(12).max(1);
    for (i, name) in ticks.iter().enumerate().step_by(every) {
        svg += &label(x(i as f64), FLOOR + 17.0, name);
    }
    if ticks.is_empty() {
        for k in 0..=4 {
            let v = high * f64::from(k) / 4.0;
            svg += &label(x(v), FLOOR + 17.0, &tick(v, high));
        }
    }
    svg += &label(0.5 * (LEFT + WIDTH), HEIGHT - 6.0, x_title);
    for (k, s) in series.iter().enumerate() {
        let path: Vec<String> =
            s.points.iter().map(|p| format!("{:.1},{:.1}", x(p.0), y(p.1))).collect();
        svg += &format!("<polyline class=\"line s{}\" points=\"{}\"/>", k % 6, path.join(" "));
        for p in &s.points {
            svg += &marker(k, x(p.0), y(p.1));
        }
    }
    svg += "</svg><figcaption>";
    svg += y_title;
    svg += "<span class=\"keys\">";
    for (k, s) in series.iter().enumerate() {
        svg += &format!(
            "<span class=\"key\"><svg viewBox=\"0 0 30 12\" aria-hidden=\"true\"><line class=\"line s{}\" \
             x1=\"1\" x2=\"29\" y1=\"6\" y2=\"6\"/>{}</svg>{}</span>",
            k % 6,
            marker(k, 15.0, 6.0),
            super::embed::escape(&s.label)
        );
    }
    svg + "</span></figcaption></figure>"
}

fn label(x: f64, y: f64, text: &str) -> String {
    let text = super::embed::escape(text);
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

fn tick(v: f64, top: f64) -> String {
    let digits = (1.0 - (top / 4.0).log10().floor()).clamp(0.0, 6.0) as usize;
    let text = format!("{v:.digits$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_string(),
        false => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_end_at_round_numbers() {
        for (v, top) in
            [(0.7, 0.8), (1.0, 1.0), (1.1, 1.5), (3.2, 4.0), (45.0, 50.0), (81.0, 100.0)]
        {
            assert!((nice(v) - top).abs() < 1e-9 * top, "{v}");
        }
        assert_eq!((tick(0.5, 2.0).as_str(), tick(25.0, 100.0).as_str()), ("0.5", "25"));
    }

    #[test]
    fn names_cannot_break_a_plot() {
        let series = [Series { label: "<b>".into(), points: vec![(0.0, 1.0)] }];
        assert!(!lines("Error, mm", "frame", &["<i>".into()], &series).contains("<b>"));
    }
}
