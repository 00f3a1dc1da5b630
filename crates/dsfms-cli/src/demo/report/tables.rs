//! Errors by method and part of the surface: tables and plots.

use super::super::scene::{DeformedFrame, Scene};
use super::results::{FrameResult, Report};
use crate::chart::{Bar, Plot, Series, bars, lines};
use crate::demo::METHODS;
use crate::report::frames::short;
use dsfms::eval::{ErrorStats, Evaluation};
use dsfms::mesh::Mesh;
use dsfms::pipeline::Method;

/// A figure of a table.
pub type Statistic = fn(&ErrorStats) -> f64;

/// A part of the surface in the tables.
#[derive(Clone, Copy)]
pub enum Part {
    All,
    Visible,
    Zone,
}

impl Part {
    pub const ALL: [Self; 3] = [Self::All, Self::Visible, Self::Zone];

    pub fn name(self) -> &'static str {
        match self {
            Self::All => "whole template",
            Self::Visible => "visible",
            Self::Zone => "visible deformed zone",
        }
    }

    pub fn of(self, e: &Evaluation) -> Option<ErrorStats> {
        let v = e.vertices.as_ref()?;
        match self {
            Self::All => Some(v.all),
            Self::Visible => v.visible,
            Self::Zone => v.visible_zone,
        }
    }
}

impl Report<'_> {
    /// Error of one method over the frames: mean of the frames' values, and how many frames have
    /// one.
    pub fn mean(&self, k: usize, part: Part, value: Statistic) -> Option<(f64, usize)> {
        let values: Vec<f64> = self
            .frames
            .iter()
            .filter_map(|f| part.of(&f.methods[k].surface.as_ref()?.1))
            .map(|s| value(&s))
            .collect();
        let n = values.len();
        (n > 0).then(|| (values.iter().sum::<f64>() / n as f64, n))
    }
}

/// The section that compares the methods.
pub fn comparison(report: &Report) -> String {
    let chart: Vec<Bar> = METHODS
        .into_iter()
        .enumerate()
        .filter_map(|(k, m)| {
            let (value, _) = report.mean(k, Part::Zone, |s| s.rms)?;
            Some(Bar { label: m.name().into(), value, strong: m == Method::Joint })
        })
        .collect();
    format!(
        "<h2 id=\"methods\">Five methods</h2>\
         <p>The matches are the scene's 25 a frame, given on the true rest surface and moved to the \
         closest point of the template; those more than 2 mm off it are left out. All of them lie \
         outside the strongly deformed part. The deformed zone is made of the vertices that moved \
         by at least half of the largest visible displacement.</p>\
         {}\
         <h3>Visible deformed zone, rms, mean over the frames that have one</h3>{}{}\
         <p class=\"dim\">{:.0} s in all, of which {:.0} s for the template.</p>",
        mean_table(report),
        bars("Error in the visible deformed zone by method, mm", "mm", &chart),
        plots(report),
        report.seconds,
        report.template_seconds
    )
}

/// Error of the visible part by frame, and against how far the organ is stretched.
fn plots(report: &Report) -> String {
    let ticks: Vec<String> = report.frames.iter().map(|f| short(&f.name)).collect();
    let error =
        |k: usize, f: &FrameResult| Some(Part::Visible.of(&f.methods[k].surface.as_ref()?.1)?.mean);
    let stretch: Vec<f64> =
        report.scene.deformed.iter().map(|d| extension(report.scene, d)).collect();
    let series = |place: &dyn Fn(usize) -> f64| -> Vec<Series> {
        let of = |k: usize| {
            let found = report.frames.iter().enumerate();
            let mut points: Vec<(f64, f64)> =
                found.filter_map(|(i, f)| Some((place(i), error(k, f)?))).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            points
        };
        let named = METHODS.into_iter().enumerate();
        named
            .map(|(k, m)| Series { label: m.name().into(), points: of(k), ..Default::default() })
            .collect()
    };
    let value = "Mean error of the visible part, mm";
    fn plot<'a>(value: &'a str, against: &'a str, ticks: &'a [String]) -> Plot<'a> {
        Plot { value, against, ticks, by_frame: against == "frame", ..Plot::default() }
    }
    format!(
        "<div class=\"plots\">{}{}</div>",
        lines(&plot(value, "frame", &ticks), &series(&|i| i as f64)),
        lines(
            &plot(value, "mean absolute extension of the true edges, %", &[]),
            &series(&|i| stretch[i])
        )
    )
}

/// Mean of `| |edge| / |edge at rest| - 1 |` over the true mesh, per cent.
fn extension(scene: &Scene, deformed: &DeformedFrame) -> f64 {
    let edges = &scene.rest.topology.edges;
    let length = |mesh: &Mesh, e: &[u32; 2]| {
        (mesh.positions[e[0] as usize] - mesh.positions[e[1] as usize]).norm()
    };
    let of = |e| (length(&deformed.mesh, e) / length(&scene.rest, e) - 1.0).abs();
    100.0 * edges.iter().map(of).sum::<f64>() / edges.len().max(1) as f64
}

/// Rows of `(method, cells)`, the smallest value of every column marked.
pub fn error_table(caption: &str, cell: impl Fn(usize, Part, Statistic) -> Option<f64>) -> String {
    let columns: Vec<(Part, &str, Statistic)> = Part::ALL
        .into_iter()
        .flat_map(|p| [(p, "rms", (|s| s.rms) as Statistic), (p, "mean", |s| s.mean)])
        .collect();
    let values: Vec<Vec<Option<f64>>> = (0..METHODS.len())
        .map(|k| columns.iter().map(|&(part, _, value)| cell(k, part, value)).collect())
        .collect();
    let best = |c: usize| values.iter().filter_map(|row| row[c]).fold(f64::INFINITY, f64::min);
    let mut html = format!(
        "<div class=\"scroll\" tabindex=\"0\"><table><caption>{caption}</caption><thead><tr><th rowspan=\"2\" scope=\"col\">method</th>"
    );
    for part in Part::ALL {
        html += &format!("<th colspan=\"2\" scope=\"colgroup\">{}</th>", part.name());
    }
    html += "</tr><tr>";
    for (_, name, _) in &columns {
        html += &format!("<th scope=\"col\">{name}</th>");
    }
    html += "</tr></thead><tbody>";
    for (method, row) in METHODS.into_iter().zip(&values) {
        html += &format!("<tr><th scope=\"row\">{}</th>", method.name());
        for (c, value) in row.iter().enumerate() {
            html += &match value {
                Some(v) if *v <= best(c) => format!("<td class=\"best\">{v:.2}</td>"),
                Some(v) => format!("<td>{v:.2}</td>"),
                None => "<td>–</td>".into(),
            };
        }
        html += "</tr>";
    }
    html + "</tbody></table></div>"
}

fn mean_table(report: &Report) -> String {
    let caption = format!("3D error in mm, mean over {} frames; best in bold", report.frames.len());
    error_table(&caption, |k, part, value| report.mean(k, part, value).map(|m| m.0))
}
