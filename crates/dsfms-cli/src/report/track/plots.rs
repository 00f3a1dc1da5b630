//! The charts of a video's report: of all frames, and of the latest beside the picture of a run
//! that goes on.

use super::{LATEST, TrackReport, TrackRow, status_name};
use crate::chart::{Plot, Series, lines, status_strip};

impl TrackReport<'_> {
    pub(super) fn sections(&self) -> String {
        let statuses: Vec<&str> = self.rows.iter().map(|r| r.status.label()).collect();
        let quality =
            |value: fn((usize, f64, f64)) -> f64| self.series("", move |r| r.quality.map(value));
        let plot = |value: &str, series: &[Series]| {
            lines(&Plot { value, against: "frame", by_frame: true, ..Default::default() }, series)
        };
        format!(
            "<h2>Frames</h2>{}<div class=\"plots\">{}{}{}{}</div>{}",
            status_strip("Status of every frame", &statuses, self.numbers().as_deref()),
            lines(
                &Plot {
                    value: "Time, ms",
                    against: "frame",
                    by_frame: true,
                    decades: true,
                    ..Default::default()
                },
                &self.timing()
            ),
            plot("Matches kept", &[quality(|q| q.0 as f64)]),
            plot("Median residual of the kept matches, px", &[quality(|q| q.1)]),
            plot("Share of textured places that look like the template", &[quality(|q| q.2)])
                + &self.expected(plot),
            self.events()
        )
    }

    /// Of the frames, where they are not 0, 1, ….
    fn numbers(&self) -> Option<Vec<String>> {
        let plain = self.rows.iter().enumerate().all(|(i, r)| r.number == i);
        (!plain).then(|| self.rows.iter().map(|r| r.number.to_string()).collect())
    }

    fn series(&self, label: &str, value: impl Fn(&TrackRow) -> Option<f64>) -> Series {
        let point = |r: &TrackRow| Some((r.number as f64, value(r)?));
        let points = self.rows.iter().filter_map(point).collect();
        Series { label: label.into(), points, ..Default::default() }
    }

    /// The whole frame and the four stages that take longest.
    fn timing(&self) -> Vec<Series> {
        let mut totals: Vec<(&str, f64)> = Vec::new();
        for (name, seconds) in self.rows.iter().flat_map(|r| &r.stages) {
            match totals.iter_mut().find(|t| t.0 == *name) {
                Some(total) => total.1 += seconds,
                None => totals.push((name, *seconds)),
            }
        }
        totals.sort_by(|a, b| b.1.total_cmp(&a.1));
        let stage = |name: &str| {
            let of = |r: &TrackRow| -> f64 {
                1e3 * r.stages.iter().filter(|s| s.0 == name).map(|s| s.1).sum::<f64>()
            };
            self.series(name, move |r| Some(of(r)))
        };
        let whole = self.series("whole frame", |r| Some(r.ms));
        std::iter::once(whole).chain(totals.iter().take(4).map(|t| stage(t.0))).collect()
    }

    /// The chart of the expected error, where it was asked for.
    fn expected(&self, plot: impl Fn(&str, &[Series]) -> String) -> String {
        let series = self.series("", |r| r.expected);
        if series.points.is_empty() {
            return String::new();
        }
        plot(&self.expected_words(), &[series])
    }

    fn expected_words(&self) -> String {
        format!("Expected error of what is seen, {}", self.base.unit)
    }

    /// Latency and expected error of the latest frames, with their status; the residual where no
    /// expected error was asked for.
    pub(super) fn curves(&self) -> String {
        let latest = &self.rows[self.rows.len().saturating_sub(LATEST)..];
        let ticks: Vec<String> = latest.iter().map(|r| r.number.to_string()).collect();
        let line = |label: &str, value: &dyn Fn(&TrackRow) -> Option<f64>| Series {
            label: label.into(),
            points: (0..)
                .zip(latest)
                .filter_map(|(i, r)| Some((f64::from(i), value(r)?)))
                .collect(),
            ..Default::default()
        };
        let strip: Vec<(f64, String)> =
            (0..).zip(latest).map(|(i, r)| (f64::from(i), status_name(r.status).into())).collect();
        let chart = |value: &str, strip, series: &[Series]| {
            let value = &format!("{value}; last {} frames", latest.len());
            let plot =
                Plot { value, against: "frame", ticks: &ticks, by_frame: true, ..Plot::default() };
            lines(&Plot { flat: true, strip, ..plot }, series)
        };
        let answers = line("from arrival to answer", &|r| r.answer_ms);
        let latency = match answers.points.is_empty() {
            true => vec![line("", &|r| Some(r.ms))],
            false => vec![line("solve", &|r| Some(r.ms)), answers],
        };
        let error = line("", &|r| r.expected);
        let (words, error) = match error.points.is_empty() {
            true => ("Median residual, px".into(), line("", &|r| r.quality.map(|q| q.1))),
            false => (self.expected_words(), error),
        };
        chart("Latency, ms", &[][..], &latency) + &chart(&words, &strip, &[error])
    }
}
