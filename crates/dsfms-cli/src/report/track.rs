//! The report of a video: written again and again while it is tracked, so that it can be watched.

use super::Page;
use super::clip;
use super::data::{
    PageData, ShownCamera, ShownFrame, ShownSurface, pixels, rows, shown_matches, unit_name,
};
use super::embed::{self, Cloud, escape};
use super::template::definition_list;
use crate::chart::{Plot, Series, lines, status_strip};
use crate::reasons::sentences;
use dsfms::camera::CameraModel;
use dsfms::image::Frame;
use dsfms::template::Template;
use dsfms::track::{Origin, Surface, TrackStatus, Tracked};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Most frames in the page: of more, every second, fourth, … is shown.
const MOST_FRAMES: usize = 96;
/// Most bytes of frames in the page.
const MOST_BYTES: usize = 11_000_000;
/// Longest side of an image in the page, px.
const LONGEST_SIDE: u32 = 640;
/// Most runs of frames in the table of events.
const MOST_EVENTS: usize = 100;
/// Least time between two writings.
const PAUSE: Duration = Duration::from_secs(2);
/// The writing takes at most this share of the time.
const SHARE: u32 = 10;

/// One frame in figures.
struct Row {
    number: usize,
    status: TrackStatus,
    reasons: Vec<String>,
    ms: f64,
    found: bool,
    stages: Vec<(&'static str, f64)>,
    /// Kept matches, residual in px, agreement.
    quality: Option<(usize, f64, f64)>,
}

/// A frame in the page and about how many bytes it takes there.
struct Shown {
    place: usize,
    bytes: usize,
    frame: ShownFrame,
}

/// Collects what the page shows.
pub struct TrackReport<'a> {
    path: PathBuf,
    name: String,
    template: &'a Template,
    camera: &'a CameraModel,
    method: &'static str,
    /// The page without frames.
    base: PageData,
    rows: Vec<Row>,
    shown: Vec<Shown>,
    /// Every Nth frame is shown.
    stride: usize,
    /// Writes every frame for `dsfms view`, once the page cannot hold them all.
    writer: Option<clip::Writer>,
    /// When the page may be written again.
    next: Instant,
}

impl<'a> TrackReport<'a> {
    /// A page at `path`, written after the first frame.
    pub fn new(
        path: PathBuf,
        name: String,
        template: &'a Template,
        camera: &'a CameraModel,
        method: &'static str,
    ) -> anyhow::Result<Self> {
        let mut base = PageData::of_template(template, 1.0, unit_name(template.unit))?;
        base.camera = Some(ShownCamera::of(camera));
        base.methods = vec![method.into()];
        let (rows, shown, next) = (Vec::new(), Vec::new(), Instant::now());
        Ok(Self {
            path,
            name,
            template,
            camera,
            method,
            base,
            rows,
            shown,
            stride: 1,
            writer: None,
            next,
        })
    }

    /// The next frame; the page is written where its time has come.
    pub fn add(
        &mut self,
        number: usize,
        frame: &Frame,
        tracked: &Tracked,
        ms: f64,
    ) -> anyhow::Result<()> {
        let place = self.rows.len();
        self.rows.push(Row {
            number,
            status: tracked.status,
            reasons: sentences(&tracked.reasons),
            ms,
            found: tracked.surface.as_ref().is_some_and(|s| s.origin == Origin::Found),
            stages: tracked.stages.clone(),
            quality: tracked
                .surface
                .as_ref()
                .map(|s| (s.matches_kept(), s.residual_px, s.agreement)),
        });
        if let Some(writer) = &self.writer {
            writer.add(frame, self.without_image(number, frame, tracked));
        }
        let due = Instant::now() >= self.next;
        let regular = place.is_multiple_of(self.stride);
        if !(regular || due) {
            return Ok(());
        }
        let shown = self.shown(number, frame, tracked)?;
        let bytes = serde_json::to_string(&shown)?.len();
        self.shown.push(Shown { place, bytes, frame: shown });
        if due {
            let start = Instant::now();
            self.page("running").write(&self.path)?;
            self.next = Instant::now() + PAUSE.max(SHARE * start.elapsed());
        }
        if regular {
            self.thin()?;
        } else {
            // The newest frame of a page that is watched; the next takes its place.
            self.shown.pop();
        }
        Ok(())
    }

    /// The last writing.
    pub fn finish(mut self) -> anyhow::Result<()> {
        let page = self.page("complete");
        let beside = self.writer.take().map_or(Ok(()), clip::Writer::finish);
        page.write(&self.path)?;
        beside
    }

    fn thin(&mut self) -> anyhow::Result<()> {
        let too_much = |shown: &[Shown]| {
            shown.len() > MOST_FRAMES || shown.iter().map(|s| s.bytes).sum::<usize>() > MOST_BYTES
        };
        while self.shown.len() > 2 && too_much(&self.shown) {
            if self.writer.is_none() {
                // What goes from the page is kept beside it, and all that comes.
                let output = self.path.parent().unwrap_or(std::path::Path::new("."));
                self.shown.iter().try_for_each(|s| clip::write(output, &s.frame))?;
                self.writer = Some(clip::Writer::start(output.into()));
            }
            self.stride *= 2;
            self.shown.retain(|s| s.place.is_multiple_of(self.stride));
        }
        Ok(())
    }

    fn shown(&self, number: usize, frame: &Frame, tracked: &Tracked) -> anyhow::Result<ShownFrame> {
        let image = embed::photograph_within(crate::draw::picture(frame), LONGEST_SIDE)?;
        Ok(ShownFrame { image: Some(image), ..self.without_image(number, frame, tracked) })
    }

    fn without_image(&self, number: usize, frame: &Frame, tracked: &Tracked) -> ShownFrame {
        let mut shown = ShownFrame::with(&format!("frame_{number:03}"), None, frame.size);
        shown.status.push(status_name(tracked.status));
        shown.surfaces.push(tracked.surface.as_ref().map(|s| self.surface(s)));
        shown
    }

    fn surface(&self, surface: &Surface) -> ShownSurface {
        let faces = &self.template.mesh.topology.faces;
        ShownSurface {
            positions: Some(Cloud::of(&surface.vertices)),
            pixels: Some(pixels(self.camera, &surface.vertices)),
            visible: Some(embed::flags(&surface.visible)),
            matches: shown_matches(self.camera, faces, &surface.vertices, &surface.matches),
            pose: Some(rows(&surface.pose, 1.0)),
            ..Default::default()
        }
    }

    fn page(&self, state: &str) -> Page {
        let mut data = self.base.clone();
        data.frames = self.shown.iter().map(|s| s.frame.clone()).collect();
        Page {
            title: format!("Tracking, {}", self.method),
            summary: self.summary(state),
            sections: self.sections(),
            data,
        }
    }

    fn summary(&self, state: &str) -> String {
        let count = |status| self.rows.iter().filter(|r| r.status == status).count();
        let [ok, degraded, lost] =
            [TrackStatus::Ok, TrackStatus::Degraded, TrackStatus::Lost].map(count);
        let mut times: Vec<f64> = self.rows.iter().map(|r| r.ms).collect();
        times.sort_unstable_by(f64::total_cmp);
        let at = |share: usize| times.get(times.len() * share / 100).copied().unwrap_or(f64::NAN);
        let (shown, all) = (self.shown.len(), self.rows.len());
        let found = self.rows.iter().filter(|r| r.found).count();
        definition_list(&[
            ("Template", self.name.clone()),
            ("Video", format!("{all} frames, {state}")),
            ("Status", format!("{ok} ok, {degraded} degraded, {lost} lost")),
            ("Way", format!("{found} frames by descriptors, the others from the frame before")),
            (
                "Time",
                format!("{:.0} ms a frame (median), {:.0} ms (99th percentile)", at(50), at(99)),
            ),
            ("Shown", self.held(shown)),
        ])
    }

    /// Which frames there are to look at.
    fn held(&self, shown: usize) -> String {
        match self.writer.is_some() || self.stride > 1 {
            true => format!(
                "{shown} frames in this file, evenly spaced, all of them in the plots and by dsfms view"
            ),
            false => "all frames".into(),
        }
    }

    fn sections(&self) -> String {
        let statuses: Vec<&str> = self.rows.iter().map(|r| r.status.label()).collect();
        let quality =
            |value: fn((usize, f64, f64)) -> f64| self.series("", move |r| r.quality.map(value));
        let plot = |value, series: &[Series]| {
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
            plot("Share of textured places that look like the template", &[quality(|q| q.2)]),
            self.events()
        )
    }

    /// Of the frames, where they are not 0, 1, ….
    fn numbers(&self) -> Option<Vec<String>> {
        let plain = self.rows.iter().enumerate().all(|(i, r)| r.number == i);
        (!plain).then(|| self.rows.iter().map(|r| r.number.to_string()).collect())
    }

    fn series(&self, label: &str, value: impl Fn(&Row) -> Option<f64>) -> Series {
        let point = |r: &Row| Some((r.number as f64, value(r)?));
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
            let of = |r: &Row| -> f64 {
                1e3 * r.stages.iter().filter(|s| s.0 == name).map(|s| s.1).sum::<f64>()
            };
            self.series(name, move |r| Some(of(r)))
        };
        let whole = self.series("whole frame", |r| Some(r.ms));
        std::iter::once(whole).chain(totals.iter().take(4).map(|t| stage(t.0))).collect()
    }

    /// Runs of frames that are not ok, with their reasons.
    fn events(&self) -> String {
        let same = |a: &Row, b: &Row| a.status == b.status && a.reasons == b.reasons;
        let runs: Vec<&[Row]> =
            self.rows.chunk_by(same).filter(|r| r[0].status != TrackStatus::Ok).collect();
        if runs.is_empty() {
            return "<p>Every frame is ok.</p>".into();
        }
        let mut html = String::from(
            "<div class=\"scroll\" tabindex=\"0\"><table><caption>Frames that are not ok</caption><thead><tr>\
             <th scope=\"col\">frames</th><th scope=\"col\" class=\"text\">status</th>\
             <th scope=\"col\" class=\"text\">why</th></tr></thead><tbody>",
        );
        for run in runs.iter().take(MOST_EVENTS) {
            let (first, last) = (run[0].number, run[run.len() - 1].number);
            let which =
                if first == last { format!("{first}") } else { format!("{first}–{last}") };
            html += &format!(
                "<tr><th scope=\"row\">{which}</th><td class=\"text\"><span class=\"{}\">{}</span></td>\
                 <td class=\"text\">{}</td></tr>",
                status_name(run[0].status),
                run[0].status.label(),
                escape(&run[0].reasons.join("; "))
            );
        }
        html += "</tbody></table></div>";
        if let Some(further) = runs.len().checked_sub(MOST_EVENTS).filter(|&n| n > 0) {
            html += &format!("<p class=\"dim\">{further} further runs are in summary.csv.</p>");
        }
        html
    }
}

/// As the page has it.
fn status_name(status: TrackStatus) -> &'static str {
    match status {
        TrackStatus::Lost => "failed",
        other => other.label(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dsfms::synth::{Case, CaseOptions, Draw};
    use dsfms::verdict::Reason;

    #[test]
    fn a_long_video_is_thinned_and_every_frame_is_plotted() {
        let case = Case::new(
            &CaseOptions {
                vertices: 100,
                extension: 0.02,
                light: dsfms::light::LightModel::Collinear,
                draw: Draw { count: 5, sigma_px: 1.0 },
                pull: true,
            },
            1,
        );
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.html");
        let mut report =
            TrackReport::new(path.clone(), "t".into(), &case.template, &case.camera, "dsfm")
                .unwrap();
        let frame = Frame { name: "f".into(), size: [4, 4], rgb: vec![[9; 3]; 16] };
        for k in 0..300 {
            let status = if k == 7 { TrackStatus::Lost } else { TrackStatus::Ok };
            let reasons =
                if k == 7 { vec![Reason::NoSurface { why: "<dark>".into() }] } else { Vec::new() };
            let tracked =
                Tracked { status, reasons, surface: None, stages: vec![("prepare", 0.001)] };
            report.add(k, &frame, &tracked, 5.0).unwrap();
            assert!(k > 0 || path.is_file(), "a run can be watched from its first frame");
        }
        assert_eq!(report.stride, 4);
        let places: Vec<usize> = report.shown.iter().map(|s| s.place).collect();
        assert_eq!((places.len(), places[0], places[74]), (75, 0, 296));
        report.finish().unwrap();
        // What the page leaves out is beside it, in order.
        let names = clip::names(&path);
        assert_eq!((names.len(), names[7].as_str()), (300, "frame_007"));
        assert!(clip::read(&path, "frame_007").unwrap().unwrap().contains("\"failed\""));
        let html = std::fs::read_to_string(path).unwrap();
        assert!(html.contains("300 frames, complete") && html.contains("&lt;dark&gt;"));
    }
}
