//! The demo's report: four methods against the truth.

use super::scene::{DeformedFrame, Scene};
use super::truth::{FrameTruth, Tie};
use crate::commands::demo::METHODS;
use crate::commands::reconstruct::method_name;
use crate::draw::{self, SideView};
use crate::outputs::FrameReport;
use crate::report::Page;
use crate::report::chart::{Bar, Series, bars, lines};
use crate::report::data::{PageData, ShownFrame, ShownSurface, pixels};
use crate::report::embed::{self, Cloud, escape, jpeg};
use crate::report::frames::short;
use dsfms::camera::CameraModel;
use dsfms::eval::{ErrorStats, Evaluation};
use dsfms::mesh::Mesh;
use dsfms::pipeline::{BuiltTemplate, Method, Reconstruction};
use dsfms::register::Match;
use dsfms::template::statistics::template_statistics;

/// Error at which the colour ramp ends, mm.
const RAMP_MM: f64 = 3.0;
const SIDE_SIZE: [usize; 2] = [360, 320];

/// One method on one frame.
pub struct MethodResult {
    pub report: FrameReport,
    /// `None` where it failed.
    pub surface: Option<(Reconstruction, Evaluation)>,
}

/// One deformed frame.
pub struct FrameResult {
    pub name: String,
    pub matches: Vec<Match>,
    /// Matches of the scene, before those off the template were left out.
    pub given_matches: usize,
    pub truth: FrameTruth,
    /// In the order of [`METHODS`].
    pub methods: Vec<MethodResult>,
}

impl FrameResult {
    pub fn new(deformed: &DeformedFrame, matches: Vec<Match>, truth: FrameTruth) -> Self {
        let (name, given_matches) = (deformed.frame.name.clone(), deformed.matches.len());
        Self { name, matches, given_matches, truth, methods: Vec::new() }
    }

    /// Add the result of the next method.
    pub fn add(
        &mut self,
        method: Method,
        outcome: (FrameReport, Option<(Reconstruction, Evaluation)>),
    ) {
        debug_assert_eq!(METHODS[self.methods.len()], method);
        let (report, surface) = outcome;
        self.methods.push(MethodResult { report, surface });
    }
}

/// All that the report shows.
pub struct Report<'a> {
    pub scene: &'a Scene,
    pub built: &'a BuiltTemplate,
    pub tie: &'a Tie,
    pub frames: &'a [FrameResult],
    pub template_seconds: f64,
    pub seconds: f64,
}

/// A figure of a table.
type Statistic = fn(&ErrorStats) -> f64;

/// A part of the surface in the tables.
#[derive(Clone, Copy)]
enum Part {
    All,
    Visible,
    Zone,
}

impl Part {
    const ALL: [Self; 3] = [Self::All, Self::Visible, Self::Zone];

    fn name(self) -> &'static str {
        match self {
            Self::All => "whole template",
            Self::Visible => "visible",
            Self::Zone => "visible deformed zone",
        }
    }

    fn of(self, e: &Evaluation) -> Option<ErrorStats> {
        let v = e.vertices.as_ref()?;
        match self {
            Self::All => Some(v.all),
            Self::Visible => v.visible,
            Self::Zone => v.visible_zone,
        }
    }
}

impl Report<'_> {
    /// Error of one method over the frames: mean of the frames' values, and how many frames have one.
    fn mean(&self, k: usize, part: Part, value: Statistic) -> Option<(f64, usize)> {
        let values: Vec<f64> = self
            .frames
            .iter()
            .filter_map(|f| part.of(&f.methods[k].surface.as_ref()?.1))
            .map(|s| value(&s))
            .collect();
        let n = values.len();
        (n > 0).then(|| (values.iter().sum::<f64>() / n as f64, n))
    }

    /// The table for the terminal.
    pub fn text(&self) -> String {
        let mut text = format!(
            "camera centres {:.3} mm rms from the truth ({} of {} frames), template surface {:.3} mm rms\n",
            self.tie.centres.rms,
            self.tie.centres.count,
            self.scene.exploration.len(),
            self.tie.surface.rms
        );
        text += "3D error in mm, mean over frames (rms / mean)\n";
        text += &format!("{:<8}", "");
        for part in Part::ALL {
            text += &format!("{:>24}", part.name());
        }
        text.push('\n');
        for (k, method) in METHODS.into_iter().enumerate() {
            text += &format!("{:<8}", method_name(method));
            for part in Part::ALL {
                let cell = match (self.mean(k, part, |s| s.rms), self.mean(k, part, |s| s.mean)) {
                    (Some((rms, _)), Some((mean, _))) => format!("{rms:.2} / {mean:.2}"),
                    _ => "-".into(),
                };
                text += &format!("{cell:>24}");
            }
            text.push('\n');
        }
        text += &format!(
            "{:.0} s in all, of which template {:.0} s\n",
            self.seconds, self.template_seconds
        );
        text
    }
}

/// The page.
pub fn page(report: &Report) -> anyhow::Result<Page> {
    let mut sections = comparison(report);
    sections += &template_section(report)?;
    for (i, frame) in report.frames.iter().enumerate() {
        sections += &frame_section(report, i, frame)?;
    }
    let title = "A deforming organ from one laparoscope".into();
    Ok(Page { title, summary: overview(report), sections, data: data(report)? })
}

/// Everything in mm, the truth beside the methods.
fn data(report: &Report) -> anyhow::Result<PageData> {
    let camera = &report.scene.camera.file.camera;
    let scale = report.tie.world_from_template.scaling();
    let mut data = PageData::of_template(&report.built.template, scale, "mm")?;
    data.methods = METHODS.into_iter().map(|m| method_name(m).to_string()).collect();
    data.truth = Some(data.methods.len());
    data.methods.push("truth".into());
    data.chosen = METHODS.len() - 1;
    for (frame, deformed) in report.frames.iter().zip(&report.scene.deformed) {
        let mut shown = ShownFrame::new(&frame.name, &deformed.frame)?;
        for method in &frame.methods {
            let surface = method.surface.as_ref().map(|s| &s.0);
            shown.add(&method.report, surface, camera, scale);
        }
        shown.surfaces.push(Some(true_surface(&frame.truth, camera)));
        shown.status.push("ok");
        data.frames.push(shown);
    }
    Ok(data)
}

fn true_surface(truth: &FrameTruth, camera: &CameraModel) -> ShownSurface {
    ShownSurface {
        positions: Some(Cloud::of(&truth.mesh.positions)),
        pixels: Some(pixels(camera, &truth.mesh.positions)),
        visible: Some(embed::flags(&truth.visible)),
        ..Default::default()
    }
}

fn overview(report: &Report) -> String {
    let links: String = report
        .frames
        .iter()
        .map(|f| format!("<a href=\"#{0}\">{0}</a>", escape(&f.name)))
        .collect();
    format!(
        "<p>The template was built from {} exploration frames of an organ-like body at rest. Every \
         deformed frame was then reconstructed by rigid pose, shape from shading (sfs), motion \
         (dsfm, eq. 3) and motion with shading (dsfms, eq. 4), and compared with the truth of this \
         path-traced scene. Errors are distances between every template vertex and its true place, \
         in mm, without any alignment of the deformed shapes: one similarity, from the camera \
         centres of the exploration to the true ones, gives the template its scale and frame.</p>\
         <nav aria-label=\"Sections\"><a href=\"#viewer\">viewer</a><a href=\"#methods\">methods</a>\
         <a href=\"#template\">template</a>{links}</nav>",
        report.scene.exploration.len()
    )
}

fn comparison(report: &Report) -> String {
    let chart: Vec<Bar> = METHODS
        .into_iter()
        .enumerate()
        .filter_map(|(k, m)| {
            let (value, _) = report.mean(k, Part::Zone, |s| s.rms)?;
            Some(Bar { label: method_name(m).into(), value, strong: m == Method::Dsfms })
        })
        .collect();
    format!(
        "<h2 id=\"methods\">Four methods</h2>\
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
        named.map(|(k, m)| Series { label: method_name(m).into(), points: of(k) }).collect()
    };
    let title = "Mean error of the visible part, mm";
    format!(
        "<div class=\"plots\">{}{}</div>",
        lines(title, "frame", &ticks, &series(&|i| i as f64)),
        lines(title, "mean absolute extension of the true edges, %", &[], &series(&|i| stretch[i]))
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
fn error_table(caption: &str, cell: impl Fn(usize, Part, Statistic) -> Option<f64>) -> String {
    let columns: Vec<(Part, &str, Statistic)> = Part::ALL
        .into_iter()
        .flat_map(|p| [(p, "rms", (|s| s.rms) as Statistic), (p, "mean", |s| s.mean)])
        .collect();
    let values: Vec<Vec<Option<f64>>> = (0..METHODS.len())
        .map(|k| columns.iter().map(|&(part, _, value)| cell(k, part, value)).collect())
        .collect();
    let best = |c: usize| values.iter().filter_map(|row| row[c]).fold(f64::INFINITY, f64::min);
    let mut html = format!(
        "<div class=\"scroll\"><table><caption>{caption}</caption><thead><tr><th rowspan=\"2\" scope=\"col\">method</th>"
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
        html += &format!("<tr><th scope=\"row\">{}</th>", method_name(method));
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

fn template_section(report: &Report) -> anyhow::Result<String> {
    let template = &report.built.template;
    let s = template_statistics(template);
    let mut html = String::from("<h2 id=\"template\">Template</h2><p>");
    html += &format!(
        "{} of {} exploration frames registered; camera centres {:.3} mm rms (at most {:.3}) from the \
         truth after similarity alignment; {} vertices, {:.2} mm rms (median {:.2}, at most {:.2}) from \
         the true surface.",
        s.frames,
        report.scene.exploration.len(),
        report.tie.centres.rms,
        report.tie.centres.max,
        s.vertices,
        report.tie.surface.rms,
        report.tie.surface.median,
        report.tie.surface.max
    );
    if let Some(f) = &s.flattening {
        html += &format!(
            " Conformal flattening: quasi-conformal ratio {:.3} (median), {:.3} (95th percentile).",
            f.quasi_conformal_median, f.quasi_conformal_p95
        );
    }
    html += " <a href=\"organ.template/report.html\">The template in 3D among its cameras</a>.";
    html += "</p><div class=\"grid\">";
    if let Some(frame) = report.scene.exploration.first() {
        let photo = jpeg(&draw::picture(frame))?;
        html += &card("Exploration frame 0", &photo, "First exploration frame");
    }
    let mm = report.tie.in_mm(&in_first_camera(report));
    let colour: Vec<[u8; 3]> =
        report.tie.distances().iter().map(|&d| draw::error_colour(d, RAMP_MM)).collect();
    let side = SideView::of(&mm, SIDE_SIZE).render(&template.mesh.topology, &mm, Some(&colour));
    html += &card(
        "Side view, coloured by the distance from the true surface",
        &jpeg(&side)?,
        "Template from the side",
    );
    html += "</div><p class=\"dim\">Colours of all side views: 0 to 3 mm</p><div class=\"ramp\" role=\"img\" aria-label=\"Colour ramp from dark blue, 0 mm, to yellow, 3 mm\"></div>";
    Ok(html)
}

/// Template vertices in the axes of its first view.
fn in_first_camera(report: &Report) -> Vec<dsfms::geometry::Point3> {
    let template = &report.built.template;
    let pose = template.views.first().map(|v| v.camera_from_template).unwrap_or_default();
    template.mesh.positions.iter().map(|p| pose * p).collect()
}

fn frame_section(report: &Report, i: usize, frame: &FrameResult) -> anyhow::Result<String> {
    let deformed = &report.scene.deformed[i];
    let topology = &report.built.template.mesh.topology;
    let view = SideView::of(&frame.truth.mesh.positions, SIDE_SIZE);
    let name = escape(&frame.name);
    let mut html = format!("<h2 id=\"{name}\">{name}</h2>");
    html += &error_table("3D error in mm; best in bold", |k, part, value| {
        part.of(&frame.methods[k].surface.as_ref()?.1).map(|s| value(&s))
    });
    html += &format!(
        "<p class=\"dim\">{} of {} matches lie on the template. Overlays: visible edges of the mesh; \
         green dots are matches that were kept, red ones were refused.</p><div class=\"grid\">",
        frame.matches.len(),
        frame.given_matches
    );
    html += "<div class=\"card\"><h3>Image and truth</h3>";
    html += &figure(
        &jpeg(&draw::picture(&deformed.frame))?,
        &format!("{name}, the image"),
        "The image",
    );
    let truth = view.render(topology, &frame.truth.mesh.positions, None);
    html += &figure(
        &jpeg(&truth)?,
        &format!("{name}, true shape from the side"),
        "True shape from the side",
    );
    html += "</div>";
    for (k, method) in METHODS.into_iter().enumerate() {
        html += &method_card(report, frame, deformed, &view, k, method)?;
    }
    Ok(html + "</div>")
}

fn method_card(
    report: &Report,
    frame: &FrameResult,
    deformed: &DeformedFrame,
    view: &SideView,
    k: usize,
    method: Method,
) -> anyhow::Result<String> {
    let result = &frame.methods[k];
    let status = result.report.status;
    let (name, method) = (escape(&frame.name), method_name(method));
    let mut html =
        format!("<div class=\"card\"><h3>{method} <span class=\"{status}\">{status}</span></h3>");
    if let Some((surface, _)) = &result.surface {
        let topology = &report.built.template.mesh.topology;
        let camera = &report.scene.camera.file.camera;
        let overlay = draw::overlay(
            &deformed.frame,
            camera,
            topology,
            &surface.vertices,
            &surface.visible,
            &surface.matches,
        );
        html += &figure(
            &jpeg(&overlay)?,
            &format!("{name}, mesh of {method} over the image"),
            "Mesh over the image",
        );
        let mm = report.tie.in_mm(&surface.vertices);
        let error = |(a, b): (&dsfms::geometry::Point3, &dsfms::geometry::Point3)| {
            draw::error_colour((a - b).norm(), RAMP_MM)
        };
        let colour: Vec<[u8; 3]> = mm.iter().zip(&frame.truth.mesh.positions).map(error).collect();
        let side = view.render(topology, &mm, Some(&colour));
        html += &figure(
            &jpeg(&side)?,
            &format!("{name}, shape by {method} from the side, coloured by its error"),
            "From the side, coloured by error",
        );
    }
    for reason in &result.report.reasons {
        html += &format!("<p class=\"dim\">{}</p>", escape(reason));
    }
    Ok(html + "</div>")
}

fn card(caption: &str, source: &str, alt: &str) -> String {
    format!("<div class=\"card\">{}</div>", figure(source, alt, caption))
}

fn figure(source: &str, alt: &str, caption: &str) -> String {
    format!(
        "<figure><img loading=\"lazy\" src=\"{source}\" alt=\"{alt}\"><figcaption>{caption}</figcaption></figure>"
    )
}
