//! Rows to CSV and Markdown.

use super::{Errors, Plan, Row};
use std::fmt::Write;

/// An error as tables and plots show it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Metric {
    /// Place in [`Errors::NAMES`].
    pub index: usize,
    /// Title.
    pub title: &'static str,
    /// Unit.
    pub unit: &'static str,
}

impl Metric {
    /// All errors.
    pub const ALL: [Self; 6] = [
        Self { index: 0, title: "RMS 3D error, whole surface", unit: "mm" },
        Self { index: 1, title: "RMS 3D error in the deformed zone", unit: "mm" },
        Self { index: 2, title: "RMS edge-length error, whole surface", unit: "mm" },
        Self { index: 3, title: "RMS edge-length error in the deformed zone", unit: "mm" },
        Self { index: 4, title: "RMS reprojection error, whole surface", unit: "px" },
        Self { index: 5, title: "RMS reprojection error in the deformed zone", unit: "px" },
    ];

    /// Short name, as files and columns carry it.
    pub fn name(self) -> &'static str {
        Errors::NAMES[self.index]
    }
}

/// All figures but the times, which are never the same twice.
pub fn table_csv(rows: &[Row]) -> String {
    let mut text = "extension,noise,arm,cases,lost,amplitude,mean_extension".to_owned();
    for name in Errors::NAMES {
        let _ = write!(text, ",{name}_mean,{name}_p90,{name}_to_rigid,{name}_to_dsfm");
    }
    text += ",failures\n";
    for r in rows {
        let c = &r.cell;
        let [amplitude, mean] = [r.amplitude, r.mean_extension].map(|v| number(Some(v)));
        let _ = write!(
            text,
            "{},{},{},{},{},{amplitude},{mean}",
            c.extension, c.noise, r.arm, r.count, r.lost
        );
        for (k, e) in r.errors.iter().enumerate() {
            for value in
                [Some(e.mean), Some(e.p90), r.to_rigid.map(|t| t[k]), r.to_dsfm.map(|t| t[k])]
            {
                let _ = write!(text, ",{}", number(value));
            }
        }
        let _ = writeln!(text, ",{}", number(r.failures));
    }
    text
}

/// Time of every method on one thread.
pub fn times_csv(rows: &[Row]) -> String {
    let mut text = "extension,noise,arm,seconds_mean,seconds_p90\n".to_owned();
    for r in rows {
        let (c, s) = (&r.cell, &r.seconds);
        let _ = writeln!(text, "{},{},{},{:.4},{:.4}", c.extension, c.noise, r.arm, s.mean, s.p90);
    }
    text
}

fn number(value: Option<f64>) -> String {
    value.filter(|v| v.is_finite()).map_or(String::new(), |v| format!("{v:.4}"))
}

/// Tables for people: one per error and noise, `mean (90th percentile)`, and the ratios.
pub fn markdown(plan: &Plan, rows: &[Row]) -> String {
    let p = &plan.protocol;
    let place = if p.everywhere { "over the whole surface" } else { "outside the deformed zone" };
    let mut text = format!(
        "{} cases a cell, organ {}, {} vertices, {:?} light, {} matches {place}, seed {}. \
         Extension: {:?} relative edge-length change in the deformed zone. \
         Mean (90th percentile) over the cases; absolute errors, nothing aligned.\n",
        plan.count, plan.organ, p.vertices, p.light, p.matches, p.seed, p.extension_of
    );
    for &noise in &plan.noises {
        let cell_rows: Vec<&Row> = rows.iter().filter(|r| r.cell.noise == noise).collect();
        for metric in Metric::ALL {
            let title = format!("{} ({}), match noise {noise} px", metric.title, metric.unit);
            text += &pivot(&title, &cell_rows, |r| {
                let e = r.errors[metric.index];
                format!("{:.3} ({:.3})", e.mean, e.p90)
            });
        }
        let ratio = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.2}"));
        let title = |what: &str| format!("{what}, match noise {noise} px");
        text += &pivot(&title("Zone error relative to the rigid pose"), &cell_rows, |r| {
            ratio(r.to_rigid.map(|t| t[1]))
        });
        text += &pivot(&title("Zone error relative to DSfM"), &cell_rows, |r| {
            ratio(r.to_dsfm.map(|t| t[1]))
        });
        text += &pivot(&title("Whole-surface error relative to DSfM"), &cell_rows, |r| {
            ratio(r.to_dsfm.map(|t| t[0]))
        });
        text += &pivot(&title("Edge-length error relative to DSfM"), &cell_rows, |r| {
            ratio(r.to_dsfm.map(|t| t[2]))
        });
        text +=
            &pivot(&title("Failures (zone error above DSfM's, or no surface)"), &cell_rows, |r| {
                r.failures.map_or("-".to_owned(), |f| format!("{:.1} %", 100.0 * f))
            });
    }
    text
}

/// A table with one line per extension and one column per arm.
fn pivot(title: &str, rows: &[&Row], value: impl Fn(&Row) -> String) -> String {
    let mut arms: Vec<&str> = Vec::new();
    let mut extensions: Vec<f64> = Vec::new();
    for r in rows {
        if !arms.contains(&r.arm.as_str()) {
            arms.push(&r.arm);
        }
        if !extensions.contains(&r.cell.extension) {
            extensions.push(r.cell.extension);
        }
    }
    let mut text = format!("\n### {title}\n\n| extension | mean change | amplitude mm |");
    arms.iter().for_each(|arm| text += &format!(" {arm} |"));
    text += "\n| --- | --- | --- |";
    arms.iter().for_each(|_| text += " --- |");
    text.push('\n');
    for extension in extensions {
        let line: Vec<&&Row> = rows.iter().filter(|r| r.cell.extension == extension).collect();
        let [amplitude, mean] =
            line.first().map_or([f64::NAN; 2], |r| [r.amplitude, r.mean_extension]);
        text += &format!("| {extension} % | {mean:.1} % | {amplitude:.1} |");
        for arm in &arms {
            let found = line.iter().find(|r| r.arm == *arm);
            text += &format!(" {} |", found.map_or("-".to_owned(), |r| value(r)));
        }
        text.push('\n');
    }
    text
}
