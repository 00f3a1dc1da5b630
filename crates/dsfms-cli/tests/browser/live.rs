//! The page of a run that goes on: picture, verdict light, curves of the last frames.

use super::video::{CLIP, FRAMES, SIZE, frame};
use super::*;
use std::io::Write;
use std::process::{ChildStderr, ChildStdin};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Frames go in one after the other; black ones where that is asked for.
struct Feed {
    black: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    thread: std::thread::JoinHandle<()>,
}

impl Feed {
    fn start(mut to: ChildStdin) -> Self {
        let (black, stop) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
        let (dark, end) = (black.clone(), stop.clone());
        let thread = std::thread::spawn(move || {
            for k in 0.. {
                if end.load(Ordering::SeqCst) {
                    return;
                }
                let bytes = match dark.load(Ordering::SeqCst) {
                    true => vec![1; 3 * SIZE[0] * SIZE[1]],
                    // There and back, without a jump.
                    false => frame(if (k / FRAMES).is_multiple_of(2) {
                        k % FRAMES
                    } else {
                        FRAMES - 1 - k % FRAMES
                    })
                    .rgb
                    .concat(),
                };
                if to.write_all(&bytes).is_err() {
                    return;
                }
                std::thread::sleep(Duration::from_millis(300));
            }
        });
        Self { black, stop, thread }
    }

    fn end(self) {
        self.stop.store(true, Ordering::SeqCst);
        self.thread.join().unwrap();
    }
}

/// `dsfms track --view` of standard input, and where its page is.
fn running(case: &Case) -> (Child, String, BufReader<ChildStderr>) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_dsfms"))
        .current_dir(CLIP.path().join("clip"))
        .env("SSH_CONNECTION", "no browser")
        .args(["track", "organ.template", "-", "--size", "320x180", "--camera", "camera.json"])
        .args(["--view", "-q", "-o"])
        .arg(case.path("live"))
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let feed = child.stderr.take().unwrap();
    (child, String::new(), BufReader::new(feed))
}

const VERDICT: &str = "(() => { const v = document.getElementById('verdict'); return [!v.hidden, v.className, \
    v.querySelector('b').textContent, v.querySelector('span').textContent, \
    getComputedStyle(v.querySelector('i')).backgroundColor]; })()";

#[test]
fn a_running_video_shows_its_verdict_and_its_curves() {
    let case = Case::new();
    let Some(mut browser) = browser(&case) else { return };
    let (mut child, mut line, mut said) = running(&case);
    let feed = Feed::start(child.stdin.take().unwrap());
    said.read_line(&mut line).unwrap();
    let url = line.trim().strip_prefix("watch it at ").unwrap().to_owned();
    std::thread::spawn(move || std::io::copy(&mut said, &mut std::io::sink()));
    browser.open(&url, READY);
    let minutes = |browser: &mut Browser, what: &str| {
        for _ in 0..20 {
            let waited = format!(
                "new Promise((done) => {{ let n = 0; const look = () => {what} ? done(true) : \
                 ++n > 50 ? done(false) : setTimeout(look, 200); look(); }})"
            );
            if browser.eval(&waited) == true {
                return;
            }
        }
        panic!("{what} does not come: {}", browser.eval(VERDICT));
    };
    minutes(
        &mut browser,
        "dsfms.data.frames.length > 12 && document.getElementById('verdict').className !== 'failed'",
    );
    assert_eq!(
        browser.eval("dsfms.state.frame === dsfms.data.frames.length - 1"),
        true,
        "the newest frame is followed from the start"
    );
    let good = browser.eval(VERDICT);
    assert!(good[0] == true && (good[1] == "ok" || good[1] == "degraded"), "{good}");
    assert_eq!(good[1], good[2]);
    let charts = browser
        .eval("[...document.querySelectorAll('#curves figcaption')].map((c) => c.textContent)");
    assert!(charts[0].as_str().unwrap().starts_with("Latency, ms; last "), "{charts}");
    assert!(charts[0].as_str().unwrap().contains("from arrival to answer"), "{charts}");
    assert!(
        charts[1].as_str().unwrap().starts_with("Expected error of what is seen, mm"),
        "{charts}"
    );
    let values = browser.eval(
        "document.querySelectorAll('#curves svg.chart')[1].querySelector('[data-points]').dataset.points",
    );
    let first: f64 = values.as_str().unwrap().split([' ', ':']).nth(1).unwrap().parse().unwrap();
    assert!((1e-3..20.0).contains(&first), "an error in mm: {values}");
    // Every vertex has its own, as a layer.
    assert!(
        browser.eval(
            "[...document.getElementById('layer').options].some((o) => o.value === 'expected_error')"
        ) == true
    );
    for size in [[800, 1000], [1440, 900]] {
        browser.resize(size);
        browser.eval("new Promise((done) => setTimeout(done, 300))");
        for id in ["verdict", "film", "gl", "curves", "time"] {
            let [x, y, w, h] = browser.place(id);
            let inside = x >= 0.0 && y >= 0.0 && x + w <= size[0].into() && y + h <= size[1].into();
            assert!(inside && w > 10.0 && h > 5.0, "{id} at {size:?}: {x} {y} {w} {h}");
        }
        let [[_, _, a, b], [_, _, c, d]] = ["film", "gl"].map(|id| browser.place(id));
        let share = (a * b + c * d) / f64::from(size[0] * size[1]);
        assert!(share > 0.45, "image and 3D view take {share} of {size:?}");
        keep(&mut browser, &format!("live-{}x{}", size[0], size[1]));
    }
    // A picture that shows nothing: the light turns, and says why. On a slow machine, where
    // frames are left out, one may be lost for another reason before the first black one comes.
    feed.black.store(true, Ordering::SeqCst);
    minutes(&mut browser, "document.querySelector('#verdict span').textContent.includes('black')");
    let lost = browser.eval(VERDICT);
    assert!(lost[1] == "failed" && lost[2] == "lost" && lost[4] != good[4], "{lost}");
    keep(&mut browser, "live-lost");
    // The run ends: its curves give way to the charts of all frames.
    feed.end();
    child.wait().unwrap();
    // Browsers ask for an icon where a page waits for the first frame.
    let icon = |said: &String| said.contains("favicon.ico");
    let complaints: Vec<String> = browser.complaints().into_iter().filter(|c| !icon(c)).collect();
    assert_eq!(complaints, Vec::<String>::new());
    let report = format!("file://{}", case.path("live/report.html").display());
    browser.open(&report, READY);
    assert_eq!(browser.eval("document.getElementById('curves').children.length"), 0);
    let charts = browser.eval(
        "[...document.querySelectorAll('#sections figcaption')].map((c) => c.textContent).join()",
    );
    assert!(charts.as_str().unwrap().contains("Expected error of what is seen"), "{charts}");
}
