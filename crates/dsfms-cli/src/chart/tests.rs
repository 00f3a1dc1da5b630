use super::axes::{Axes, tick};
use super::lines::{MOST_POINTS, thinned};
use super::*;

#[test]
fn ticks_have_no_needless_digits() {
    assert_eq!((tick(0.5, 2.0).as_str(), tick(25.0, 100.0).as_str()), ("0.5", "25"));
    assert_eq!((tick(3.75, 15.0).as_str(), tick(0.225, 0.3).as_str()), ("3.75", "0.225"));
}

#[test]
fn steps_of_an_axis_have_one_digit() {
    for (top, words) in [
        (0.8, "0 0.2 0.4 0.6 0.8"),
        (1.0, "0 0.2 0.4 0.6 0.8 1"),
        (15.0, "0 5 10 15"),
        (300.0, "0 100 200 300"),
        (0.06, "0 0.02 0.04 0.06"),
    ] {
        let plot = Plot::default();
        let series = [Series { points: vec![(0.0, top)], ..Default::default() }];
        let levels = Axes::of(&plot, &series).levels();
        let names: Vec<&str> = levels.iter().map(|level| level.1.as_str()).collect();
        assert_eq!(names.join(" "), words);
    }
}

#[test]
fn names_cannot_break_a_plot() {
    let series = [Series { label: "<b>".into(), points: vec![(0.0, 1.0)], ..Default::default() }];
    let ticks = ["<i>".to_string()];
    let plot = Plot { value: "<u>", against: "<s>", ticks: &ticks, ..Default::default() };
    let svg = lines(&plot, &series);
    for tag in ["<b>", "<i>", "<u>", "<s>"] {
        assert!(!svg.contains(tag), "{tag}");
    }
}

#[test]
fn the_page_can_read_the_values_of_a_chart() {
    let points = vec![(0.0, 1.25), (1.0, f64::NAN), (2.0, 3.0)];
    let series = [Series { label: "a\"b".into(), points, ..Default::default() }];
    let ticks = ["frame_3".to_string(), "x\"y".into(), "5".into()];
    let plot =
        Plot { value: "v", against: "frame", ticks: &ticks, by_frame: true, ..Default::default() };
    let svg = lines(&plot, &series);
    for text in [
        "data-box=\"52,548,14,206\" data-span=\"-0.3,2.3\"",
        "data-places=\"[&quot;frame_3&quot;,&quot;x\\&quot;y&quot;,&quot;5&quot;]\"",
        "data-by=\"frame\"",
        "data-label=\"a&quot;b\" data-points=\"0:1.2500e0 2:3.0000e0\"",
    ] {
        assert!(svg.contains(text), "{text}: {svg}");
    }
}

#[test]
fn decades_are_evenly_spaced() {
    let plot = Plot { decades: true, ..Default::default() };
    let points = vec![(0.0, 0.01), (1.0, 100.0), (2.0, 0.0)];
    let axes = Axes::of(&plot, &[Series { points, ..Default::default() }]);
    assert_eq!((axes.y(0.01), axes.y(100.0)), (FLOOR, TOP));
    assert!((axes.y(1.0) - 0.5 * (FLOOR + TOP)).abs() < 1e-9);
    assert_eq!(axes.levels().len(), 5);
}

#[test]
fn decades_along_the_axis_leave_out_what_is_not_positive() {
    let plot = Plot { decades_along: true, ..Default::default() };
    let points = vec![(0.0, 1.0), (0.01, 2.0), (100.0, 3.0)];
    let series = [Series { points, ..Default::default() }];
    let axes = Axes::of(&plot, &series);
    assert!((axes.x(1.0) - 0.5 * (LEFT + WIDTH - RIGHT)).abs() < 1e-9);
    assert_eq!(lines(&plot, &series).matches("<circle").count(), 2);
}

#[test]
fn a_peak_survives_thinning() {
    let mut points: Vec<(f64, f64)> = (0..5000).map(|i| (f64::from(i), 1.0)).collect();
    points[3217].1 = 9.0;
    let thin = thinned(&points);
    assert!(thin.len() <= MOST_POINTS && thin.contains(&(3217.0, 9.0)));
    assert_eq!(thinned(&points[..300]), points[..300]);
}

#[test]
fn runs_of_a_status_are_one_bar() {
    let strip = status_strip("Status", &["ok", "ok", "lost", "ok"], None);
    // Three runs and three keys.
    assert_eq!(strip.matches("<polygon").count(), 6);
    assert!(strip.contains("data-runs=\"ok:2 lost:1 ok:1\""), "{strip}");
    assert!(strip.contains("status failed"));
}

#[test]
fn a_chart_on_paper_is_the_chart_of_the_page_with_its_words_above() {
    let series = |label: &str| Series {
        label: label.into(),
        points: vec![(0.0, 1.0)],
        ..Default::default()
    };
    let plot = Plot { value: "error, mm", against: "extension, %", ..Default::default() };
    let chart = line_chart(&plot, &[series("dsfm"), series("joint")]);
    let (page, sheet) = (chart.page(), chart.paper());
    let paper = svg::paper(&sheet).unwrap();
    for word in ["error, mm", "extension, %", "dsfm", "joint"] {
        assert!(page.contains(word) && paper.contains(word), "{word}");
    }
    assert!(paper.contains("width=\"122.00mm\"") && !paper.contains("class="), "{paper}");
    assert!(page.contains("class=\"marker s1\"") && !page.contains("font-size"), "{page}");
}
