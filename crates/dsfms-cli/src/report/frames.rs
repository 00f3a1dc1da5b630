//! The report of reconstructed frames.

use super::Page;
use super::data::{PageData, ShownCamera, ShownFrame, unit_name};
use super::embed::escape;
use super::template::definition_list;
use crate::chart::{Bar, Plot, Series, bars, lines, status_strip};
use crate::outputs::FrameReport;
use dsfms::camera::CameraModel;
use dsfms::solver::Summary;
use dsfms::template::Template;

/// A frame's name and its report.
pub type Row = (String, FrameReport);

/// The page of `dsfms reconstruct`.
pub fn frames_page(
    template: (&str, &Template),
    camera: &CameraModel,
    method: &str,
    rows: &[Row],
    frames: Vec<ShownFrame>,
) -> anyhow::Result<Page> {
    let mut data = PageData::of_template(template.1, 1.0, unit_name(template.1.unit))?;
    data.camera = Some(ShownCamera::of(camera));
    data.methods = vec![method.into()];
    data.frames = frames;
    Ok(Page {
        title: format!("Reconstruction, {method}"),
        summary: summary(rows, template.0),
        sections: sections(method, rows),
        data,
        curves: String::new(),
    })
}

/// How the frames ended, in words.
fn summary(rows: &[Row], template: &str) -> String {
    let count = |status: &str| rows.iter().filter(|(_, r)| r.status == status).count();
    let seconds: f64 = rows.iter().map(|(_, r)| r.seconds).sum();
    let (ok, degraded, failed) = (count("ok"), count("degraded"), count("failed"));
    definition_list(&[
        ("Template", template.to_string()),
        ("Frames", format!("{ok} ok, {degraded} degraded, {failed} failed")),
        ("Time", format!("{seconds:.1} s for all frames, summed")),
    ])
}

/// Status, matches, time and costs of one method's frames.
fn sections(method: &str, rows: &[Row]) -> String {
    let mut html = format!("<h2>Frames: {method}</h2>");
    if rows.len() > 1 {
        let statuses: Vec<&str> = rows.iter().map(|(_, r)| r.status).collect();
        let names: Vec<String> = rows.iter().map(|(n, _)| short(n)).collect();
        html += &status_strip("Status of every frame", &statuses, Some(&names));
    }
    html += &status_table(rows);
    if rows.len() > 1 {
        html += &timing(rows);
    }
    html += &costs(method, rows);
    html
}

fn status_table(rows: &[Row]) -> String {
    let mut html = String::from(
        "<div class=\"scroll\" tabindex=\"0\"><table><caption>Status of every frame</caption><thead><tr>\
         <th scope=\"col\">frame</th><th scope=\"col\">status</th><th scope=\"col\">matches kept</th>\
         <th scope=\"col\">vertices seen</th><th scope=\"col\">gain</th><th scope=\"col\">time, s</th>\
         <th scope=\"col\" class=\"text\">remarks</th></tr></thead><tbody>",
    );
    for (name, r) in rows {
        html += &format!(
            "<tr><th scope=\"row\">{}</th><td><span class=\"{1}\">{1}</span></td><td>{2} of {3}</td>\
             <td>{4}</td><td>{5}</td><td>{6:.2}</td><td class=\"text\">{7}</td></tr>",
            escape(name),
            r.status,
            r.matches_kept,
            r.matches,
            r.visible_vertices,
            r.gain.map_or("–".into(), |g| format!("{g:.3}")),
            r.seconds,
            escape(&r.reasons.join("; "))
        );
    }
    html + "</tbody></table></div>"
}

fn timing(rows: &[Row]) -> String {
    let mut names: Vec<&str> = Vec::new();
    for stage in rows.iter().flat_map(|(_, r)| &r.stages) {
        if !names.contains(&stage.name.as_str()) {
            names.push(&stage.name);
        }
    }
    let of = |r: &FrameReport, name: &str| -> f64 {
        r.stages.iter().filter(|s| s.name == name).map(|s| s.seconds).sum()
    };
    let series: Vec<Series> = names
        .iter()
        .map(|name| Series {
            label: name.to_string(),
            points: (0..).zip(rows).map(|(i, (_, r))| (f64::from(i), of(r, name))).collect(),
            ..Default::default()
        })
        .collect();
    let ticks: Vec<String> = rows.iter().map(|(n, _)| short(n)).collect();
    let plot = Plot {
        value: "Time, s",
        against: "frame",
        ticks: &ticks,
        by_frame: true,
        ..Plot::default()
    };
    format!("<h3>Time of every stage</h3>{}", lines(&plot, &series))
}

/// The number of `frame_012`.
pub fn short(name: &str) -> String {
    let digits = name.trim_start_matches(|c: char| !c.is_ascii_digit());
    if digits.is_empty() { name.to_string() } else { digits.to_string() }
}

/// The last stage of a frame that solved, and its frame.
type Solved<'a> = (&'a str, &'a Summary);

/// Costs of the terms: drawn, and before and after in figures.
fn costs(method: &str, rows: &[Row]) -> String {
    let solved = |r: &'_ FrameReport| r.stages.iter().rposition(|s| s.summary.is_some());
    let found: Vec<Solved> = rows
        .iter()
        .filter_map(|(n, r)| Some((n.as_str(), r.stages[solved(r)?].summary.as_ref()?)))
        .collect();
    let mut labels: Vec<&str> = Vec::new();
    for term in found.iter().flat_map(|(_, s)| &s.terms) {
        if !labels.contains(&term.label.as_str()) {
            labels.push(&term.label);
        }
    }
    if labels.is_empty() {
        return String::new();
    }
    format!(
        "<h3>Cost of every term after the last solve</h3>{}\
         <details><summary>Cost of every term, {method}, in figures</summary>{}</details>",
        cost_chart(&found, &labels),
        cost_table(&found, &labels)
    )
}

fn after(summary: &Summary, label: &str) -> Option<f64> {
    summary.term(label).map(|t| t.after)
}

/// Bars of one frame, lines over several.
fn cost_chart(found: &[Solved], labels: &[&str]) -> String {
    if let [(_, summary)] = found {
        let bar = |label: &&str| {
            let value = after(summary, label)?;
            Some(Bar { label: label.to_string(), value, strong: false })
        };
        return bars(
            "Weighted cost of every term",
            "",
            &labels.iter().filter_map(bar).collect::<Vec<_>>(),
        );
    }
    let ticks: Vec<String> = found.iter().map(|(n, _)| short(n)).collect();
    let of = |label: &&str| Series {
        label: label.to_string(),
        points: (0..)
            .zip(found)
            .filter_map(|(i, (_, s))| Some((f64::from(i), after(s, label)?)))
            .collect(),
        ..Default::default()
    };
    let series: Vec<Series> = labels.iter().map(of).collect();
    let plot = Plot {
        value: "Weighted cost, decades",
        against: "frame",
        ticks: &ticks,
        by_frame: true,
        decades: true,
        ..Plot::default()
    };
    lines(&plot, &series)
}

fn cost_table(found: &[Solved], labels: &[&str]) -> String {
    let mut html = String::from(
        "<div class=\"scroll\" tabindex=\"0\"><table><caption>Weighted cost before → after the last solve\
         </caption><thead><tr><th scope=\"col\">frame</th>",
    );
    for label in labels {
        html += &format!("<th scope=\"col\">{}</th>", escape(label));
    }
    html += "<th scope=\"col\">steps</th></tr></thead><tbody>";
    for (name, summary) in found {
        html += &format!("<tr><th scope=\"row\">{}</th>", escape(name));
        for label in labels {
            html += &match summary.term(label) {
                Some(t) => format!("<td>{} → {}</td>", figure(t.before), figure(t.after)),
                None => "<td>–</td>".into(),
            };
        }
        html += &format!("<td>{}</td></tr>", summary.iterations);
    }
    html + "</tbody></table></div>"
}

/// Three digits.
fn figure(v: f64) -> String {
    match v.abs() {
        0.0 => "0".into(),
        a if (1e-2..1e4).contains(&a) => {
            format!("{v:.*}", (2 - a.log10().floor() as i32).max(0) as usize)
        }
        _ => format!("{v:.2e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dsfms::solver::TermCost;

    #[test]
    fn costs_have_three_digits() {
        for (value, text) in
            [(0.0, "0"), (2.71234, "2.71"), (123.4, "123"), (0.0567, "0.0567"), (1.5e7, "1.50e7")]
        {
            assert_eq!(figure(value), text);
        }
    }

    #[test]
    fn a_single_frame_has_bars_and_several_have_lines() {
        let term = TermCost { label: "motion (eq. 3)".into(), before: 9.0, after: 2.0 };
        let summary = Summary {
            stop: dsfms::solver::Stop::Cost,
            iterations: 3,
            refused: 0,
            terms: vec![term],
            seconds: 0.0,
        };
        let one = cost_chart(&[("a", &summary)], &["motion (eq. 3)"]);
        assert!(one.contains(">2.00 <") && !one.contains("polyline"), "{one}");
        let two = cost_chart(&[("a", &summary), ("b", &summary)], &["motion (eq. 3)"]);
        assert!(two.contains("polyline"));
        assert!(cost_table(&[("a", &summary)], &["motion (eq. 3)"]).contains("9.00 → 2.00"));
    }

    #[test]
    fn short_names_are_numbers() {
        assert_eq!(short("frame_012"), "012");
        assert_eq!(short("left"), "left");
    }
}
