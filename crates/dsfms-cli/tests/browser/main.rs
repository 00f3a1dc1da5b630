//! The report and the viewer in a real browser. Skipped, saying so, where Chromium is not installed
//! (Debian: `apt install chromium`). With `DSFMS_SCREENSHOTS=DIR` the pictures are kept.

mod cdp;
#[path = "../common/mod.rs"]
mod common;

use cdp::Browser;
use common::Case;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

const READY: &str = "document.querySelector('#viewer[data-ready]') !== null";
/// Share of the canvas that is not background.
const COVERED: &str = "(() => { dsfms.render(); const gl = document.getElementById('gl').getContext('webgl2'); \
    const w = gl.drawingBufferWidth, h = gl.drawingBufferHeight, p = new Uint8Array(4 * w * h); \
    gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, p); let n = 0; \
    for (let i = 0; i < p.length; i += 4) if (p[i] !== p[0] || p[i + 1] !== p[1] || p[i + 2] !== p[2]) n++; \
    return n / (w * h); })()";

/// `two/rigid` and `two/dsfm` with two frames each; their reports.
fn reconstructed() -> Case {
    let case = Case::new();
    case.template();
    std::fs::copy(case.path("frames/organ_003.png"), case.path("frames/organ_004.png")).unwrap();
    std::fs::copy(case.path("organ.ply"), case.path("hidden.ply")).unwrap();
    for method in ["rigid", "dsfm"] {
        let out = format!("two/{method}");
        let arguments = ["frames", "--camera", "camera.json", "--matches", "matches.csv"];
        let code = case
            .reconstruct(&arguments)
            .args(["--structures", "hidden.ply", "--method", method, "-o", &out])
            .assert();
        assert!(matches!(code.get_output().status.code(), Some(0 | 2)));
        assert!(case.path(&format!("{out}/frame_003_structures.png")).is_file());
    }
    case
}

fn browser(case: &Case) -> Option<Browser> {
    let Some(program) = cdp::chromium() else {
        println!("skipped: chromium is not installed (Debian: apt install chromium)");
        return None;
    };
    Some(Browser::start(program, &case.path("profile"), [1400, 900]))
}

fn keep(browser: &mut Browser, name: &str) {
    let png = browser.screenshot();
    assert!(png.starts_with(b"\x89PNG"));
    if let Some(folder) = std::env::var_os("DSFMS_SCREENSHOTS") {
        std::fs::write(std::path::Path::new(&folder).join(format!("{name}.png")), png).unwrap();
    }
}

fn choose(browser: &mut Browser, id: &str, value: &str) {
    browser.eval(&format!(
        "(() => {{ const e = document.getElementById('{id}'); e.value = '{value}'; \
         for (const k of ['input', 'change']) e.dispatchEvent(new Event(k, {{ bubbles: true }})); }})()"
    ));
}

#[test]
fn a_report_plays_and_measures_and_asks_for_nothing() {
    let case = reconstructed();
    let Some(mut browser) = browser(&case) else { return };
    let url = format!("file://{}", case.path("two/dsfm/report.html").display());
    browser.open(&url, READY);
    let covered = browser.eval(COVERED).as_f64().unwrap();
    assert!((0.05..0.95).contains(&covered), "{covered} of the canvas is drawn on");
    keep(&mut browser, "report");

    // Every layer draws something.
    let layers = browser.eval("[...document.getElementById('layer').options].map((o) => o.value)");
    for layer in layers.as_array().unwrap() {
        choose(&mut browser, "layer", layer.as_str().unwrap());
        assert!(browser.eval(COVERED).as_f64().unwrap() > 0.05, "{layer}");
    }
    for layer in ["image", "albedo", "shape", "strain", "seen"] {
        assert!(layers.as_array().unwrap().iter().any(|l| l == layer), "{layers}");
    }

    browser.eval("document.getElementById('play').click()");
    browser.eval("new Promise((done) => setTimeout(done, 1500))");
    browser.eval("document.getElementById('play').click()");
    browser.eval("document.getElementById('next').focus()");
    choose(&mut browser, "frame", "1");
    assert_eq!(browser.eval("dsfms.state.frame"), 1);

    let structures = "dsfms.data.structures.length === 1 && dsfms.data.frames[0].surfaces[0].structures.length === 1";
    assert_eq!(browser.eval(structures), true);
    measure(&mut browser);
    browser.scheme("dark");
    browser.resize([390, 1600]);
    browser.eval("new Promise((done) => setTimeout(done, 300))");
    keep(&mut browser, "report-phone-dark");
    let wide = browser.eval("document.documentElement.scrollWidth <= innerWidth");
    assert_eq!(wide, true, "the page is wider than the phone");

    assert_eq!(browser.complaints(), Vec::<String>::new());
    assert_eq!(browser.requests(), [url]);
}

/// Two clicks on the surface give a distance, which the CSV repeats for every frame.
fn measure(browser: &mut Browser) {
    let at = browser.eval(
        "(() => { const b = document.getElementById('gl').getBoundingClientRect(); \
         return [b.x, b.y, b.width, b.height]; })()",
    );
    let [x, y, w, h] = [0, 1, 2, 3].map(|i| at[i].as_f64().unwrap());
    browser.click(x + 0.45 * w, y + 0.5 * h);
    browser.click(x + 0.55 * w, y + 0.45 * h);
    assert_eq!(browser.eval("dsfms.state.picks.length"), 2);
    let numbers = browser.eval(
        "dsfms.csv().trim().split('\\n').map((r) => r.split(',')).map((r) => [r[11], r[12]])",
    );
    let rows = numbers.as_array().unwrap();
    // A header, the shape at rest, two frames.
    assert_eq!(rows.len(), 4, "{numbers}");
    for row in &rows[1..] {
        let [straight, along] = [0, 1].map(|i| row[i].as_str().unwrap().parse::<f64>().unwrap());
        assert!(straight > 0.5 && (straight..1.3 * straight).contains(&along), "{numbers}");
    }
    keep(browser, "report-measured");
}

#[test]
fn the_viewer_compares_methods() {
    let case = reconstructed();
    let Some(mut browser) = browser(&case) else { return };
    let mut server = Command::new(env!("CARGO_BIN_EXE_dsfms"))
        .args(["view", "two", "--no-open"])
        .current_dir(case.folder.path())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut url = String::new();
    BufReader::new(server.stdout.take().unwrap()).read_line(&mut url).unwrap();
    let url = url.trim();
    assert!(url.starts_with("http://127.0.0.1:"), "{url}");
    browser.open(url, READY);
    browser.eval(
        "document.querySelectorAll('#method-boxes input').forEach((b) => b.checked || b.click())",
    );
    assert_eq!(browser.eval("dsfms.state.shown.length"), 2);
    assert_eq!(browser.eval("document.querySelectorAll('#labels span').length > 0"), true);
    assert!(browser.eval(COVERED).as_f64().unwrap() > 0.03);
    keep(&mut browser, "view");
    assert_eq!(browser.complaints(), Vec::<String>::new());
    assert!(browser.requests().iter().all(|r| r.starts_with(url)), "{:?}", browser.requests());
    server.kill().unwrap();
    server.wait().unwrap();
}
