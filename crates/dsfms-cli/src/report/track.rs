//! The report of a video: written again and again while it is tracked, so that it can be watched.

mod plots;

use super::Page;
use super::clip;
use super::data::{
    PageData, ShownCamera, ShownFrame, ShownSurface, pixels, rows, shown_matches, unit_name,
};
use super::embed::{self, Cloud, Numbers, escape};
use super::template::definition_list;
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
/// What is said of a run that goes on.
const RUNNING: &str = "running";
/// Frames of the curves beside the picture of a run that goes on.
const LATEST: usize = 100;
/// The writing takes at most this share of the time.
const SHARE: u32 = 10;

/// One frame in figures.
struct TrackRow {
    number: usize,
    status: TrackStatus,
    reasons: Vec<String>,
    ms: f64,
    answer_ms: Option<f64>,
    /// Mean of what is seen, length units.
    expected: Option<f64>,
    found: bool,
    stages: Vec<(&'static str, f64)>,
    /// Kept matches, residual in px, agreement.
    quality: Option<(usize, f64, f64)>,
}

/// One frame of the run.
#[derive(Clone, Copy)]
pub struct RunEntry<'t> {
    pub number: usize,
    pub frame: &'t Frame,
    pub tracked: &'t Tracked,
    /// What its solve took.
    pub ms: f64,
    /// From its arrival to its answer, where it came when it was made.
    pub answer_ms: Option<f64>,
    /// Of every vertex, length units, where it was asked for.
    pub expected: Option<&'t [f64]>,
}

/// A frame in the page and about how many bytes it takes there.
struct PagedFrame {
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
    rows: Vec<TrackRow>,
    shown: Vec<PagedFrame>,
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
        base.video = true;
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
    pub fn add(&mut self, entry: &RunEntry) -> anyhow::Result<()> {
        let &RunEntry { number, frame, tracked, ms, answer_ms, expected } = entry;
        let place = self.rows.len();
        let surface = tracked.surface.as_ref();
        self.rows.push(TrackRow {
            number,
            status: tracked.status,
            reasons: sentences(&tracked.reasons),
            ms,
            answer_ms,
            expected: surface.zip(expected).and_then(|(s, e)| seen_mean(&s.visible, e)),
            found: surface.is_some_and(|s| s.origin == Origin::Found),
            stages: tracked.stages.clone(),
            quality: surface.map(|s| (s.matches_kept(), s.residual_px, s.agreement)),
        });
        if let Some(writer) = &self.writer {
            writer.add(frame, self.without_image(entry));
        }
        let due = Instant::now() >= self.next;
        let regular = place.is_multiple_of(self.stride);
        if !(regular || due) {
            return Ok(());
        }
        let shown = self.shown(entry)?;
        let bytes = serde_json::to_string(&shown)?.len();
        self.shown.push(PagedFrame { place, bytes, frame: shown });
        if due {
            let start = Instant::now();
            self.page(RUNNING).write(&self.path)?;
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
        let too_much = |shown: &[PagedFrame]| {
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

    fn shown(&self, entry: &RunEntry) -> anyhow::Result<ShownFrame> {
        let image = embed::thumbnail(entry.frame, LONGEST_SIDE)?;
        Ok(ShownFrame { image: Some(image), ..self.without_image(entry) })
    }

    fn without_image(&self, entry: &RunEntry) -> ShownFrame {
        let &RunEntry { number, frame, tracked, expected, .. } = entry;
        let mut shown = ShownFrame::with(&format!("frame_{number:03}"), None, frame.size);
        shown.status.push(status_name(tracked.status));
        shown.reasons.push(sentences(&tracked.reasons));
        shown.surfaces.push(tracked.surface.as_ref().map(|s| self.surface(s, expected)));
        shown
    }

    fn surface(&self, surface: &Surface, expected: Option<&[f64]>) -> ShownSurface {
        let faces = &self.template.mesh.topology.faces;
        ShownSurface {
            positions: Some(Cloud::of(&surface.vertices)),
            pixels: Some(pixels(self.camera, &surface.vertices)),
            visible: Some(embed::flags(&surface.visible)),
            expected_error: expected.map(Numbers::of),
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
            curves: if state == RUNNING { self.curves() } else { String::new() },
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

    /// Runs of frames that are not ok, with their reasons.
    fn events(&self) -> String {
        let same = |a: &TrackRow, b: &TrackRow| a.status == b.status && a.reasons == b.reasons;
        let runs: Vec<&[TrackRow]> =
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

/// Mean of the values of what is seen.
fn seen_mean(visible: &[bool], values: &[f64]) -> Option<f64> {
    let seen = || visible.iter().zip(values).filter(|v| *v.0).map(|v| *v.1);
    let count = seen().count();
    (count > 0).then(|| seen().sum::<f64>() / count as f64)
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
            let reasons = if k == 7 {
                vec![Reason::NoSurface { why: "<dark>".to_owned().into() }]
            } else {
                Vec::new()
            };
            let tracked = Tracked {
                status,
                reasons,
                surface: None,
                camera: None,
                answered: false,
                stages: vec![("prepare", 0.001)],
            };
            let (answer_ms, frame, tracked) = (Some(9.0), &frame, &tracked);
            let entry = RunEntry { number: k, frame, tracked, ms: 5.0, answer_ms, expected: None };
            report.add(&entry).unwrap();
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
