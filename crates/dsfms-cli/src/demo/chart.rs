//! A bar chart as inline SVG.

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
    const WIDTH: f64 = 560.0;
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
