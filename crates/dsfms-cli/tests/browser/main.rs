//! The report and the viewer in a real browser. Skipped, saying so, where Chromium is not installed
//! (Debian: `apt install chromium`). With `DSFMS_SCREENSHOTS=DIR` the pictures are kept.

mod access;
mod cdp;
mod clip;
#[path = "../common/mod.rs"]
mod common;
mod live;
mod organ;
mod stage;
mod template;
#[path = "../clip/mod.rs"]
mod video;

use cdp::Browser;
use common::Case;
use dsfms::geometry::Point3;
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::mesh::Topology;
use dsfms::template::LengthUnit;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

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
    // Each takes seconds where a loaded machine renders in software.
    if let Some(folder) = std::env::var_os("DSFMS_SCREENSHOTS") {
        let png = browser.screenshot();
        assert!(png.starts_with(b"\x89PNG"));
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
    keyboard(&mut browser);
    every_control_has_a_name(&mut browser);
    browser.scheme("dark");
    browser.resize([390, 1600]);
    browser.eval("new Promise((done) => setTimeout(done, 300))");
    keep(&mut browser, "report-phone-dark");
    let wide = browser.eval("document.documentElement.scrollWidth <= innerWidth");
    assert_eq!(wide, true, "the page is wider than the phone");
    browser.print();
    browser.resize([800, 1100]);
    browser.eval("new Promise((done) => setTimeout(done, 300))");
    keep(&mut browser, "report-print");
    let paper = "getComputedStyle(document.body).backgroundColor";
    assert_eq!(browser.eval(paper), "rgb(255, 255, 255)");
    assert!(browser.eval(COVERED).as_f64().unwrap() > 0.05);

    assert_eq!(browser.complaints(), Vec::<String>::new());
    assert_eq!(browser.requests(), [url]);
}

/// The 3D view and the frames by keys alone.
fn keyboard(browser: &mut Browser) {
    browser.eval("document.getElementById('gl').focus()");
    let place = "dsfms.place().map((v) => Math.round(1000 * v)).join()";
    let before = browser.eval(place);
    browser.key("ArrowRight");
    let turned = browser.eval(place);
    browser.key("+");
    let nearer = browser.eval(place);
    assert!(before != turned && turned != nearer, "{before} {turned} {nearer}");
    let frame = browser.eval("dsfms.state.frame").as_u64().unwrap();
    browser.key(".");
    assert_eq!(browser.eval("dsfms.state.frame").as_u64(), Some((frame + 1) % 2));
    browser.key(",");
    assert_eq!(browser.eval("dsfms.state.frame").as_u64(), Some(frame));
    browser.eval("document.getElementById('gl').blur()");
}

fn every_control_has_a_name(browser: &mut Browser) {
    let controls = [
        "button",
        "slider",
        "combobox",
        "spinbutton",
        "checkbox",
        "image",
        "img",
        "canvas",
        "table",
    ];
    let spoken = browser.spoken();
    let own: Vec<_> =
        spoken.iter().filter(|s| controls.contains(&s.0.to_lowercase().as_str())).collect();
    assert!(own.len() > 20, "{spoken:?}");
    let silent: Vec<_> = own.iter().filter(|s| s.1.is_empty()).collect();
    assert!(silent.is_empty(), "{silent:?}");
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
        "dsfms.csv().trim().split('\\n').map((r) => r.split(',')).map((r) => [r[11], r[13]])",
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
    let server = Server::start(&case, "two");
    let url = server.url.as_str();
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
}

/// `dsfms view`, until it is dropped.
struct Server {
    child: Child,
    url: String,
}

impl Server {
    fn start(case: &Case, path: &str) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_dsfms"))
            .args(["view", path, "--no-open"])
            .current_dir(case.folder.path())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut url = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut url).unwrap();
        let url = url.trim().to_string();
        assert!(url.starts_with("http://127.0.0.1:"), "{url}");
        Self { child, url }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A run that is still writing: new frames come into the open page, which stays what it is.
#[test]
fn the_viewer_follows_a_running_command() {
    let case = Case::new();
    case.template();
    let Some(mut browser) = browser(&case) else { return };
    let run = || {
        let arguments = ["frames", "--camera", "camera.json", "--matches", "matches.csv"];
        let code = case.reconstruct(&arguments).args(["--method", "rigid", "-o", "out"]).assert();
        assert!(matches!(code.get_output().status.code(), Some(0 | 2)));
    };
    run();
    let server = Server::start(&case, "out");
    browser.open(&server.url, READY);
    browser.eval("window.mark = 1");
    assert_eq!(browser.eval("dsfms.data.frames.length"), 1);
    std::fs::copy(case.path("frames/organ_003.png"), case.path("frames/organ_004.png")).unwrap();
    run();
    let grown = "dsfms.data.frames.length === 2 && dsfms.state.frame === 1 && window.mark === 1";
    let end = std::time::Instant::now() + std::time::Duration::from_secs(60);
    while browser.eval(grown) != true {
        assert!(std::time::Instant::now() < end, "the second frame did not appear in place");
        std::thread::sleep(std::time::Duration::from_millis(200));
    }
    let text = browser.eval("document.getElementById('summary').textContent");
    assert!(text.as_str().unwrap().contains("2 ok"), "{text}");
    assert!(browser.eval(COVERED).as_f64().unwrap() > 0.03);
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

/// What the page measures in a frame: straight, along, area, strain, and their deviations.
fn measure_in(browser: &mut Browser, frame: &str) -> [f64; 8] {
    choose(browser, "frame", frame);
    let found = browser.eval(
        "(() => { const m = dsfms.measures()[0], s = m.sd; return [m.straight, m.along.length, \
         m.area, m.strain, s.straight, s.along, s.area, s.strain]; })()",
    );
    std::array::from_fn(|i| found[i].as_f64().unwrap())
}

/// A square of 10 mm, flat at 50 mm, and the same a tenth longer along x: everything is known.
#[test]
fn measurements_have_the_values_they_must_have() {
    let case = Case::new();
    let Some(mut browser) = browser(&case) else { return };
    let side = 11u32;
    let at = |stretch: f64| -> Vec<Point3> {
        let place = |i: u32| f64::from(i) - 5.0;
        let points = (0..side).flat_map(|r| (0..side).map(move |c| (r, c)));
        points.map(|(r, c)| Point3::new(stretch * place(c), place(r), 50.0)).collect()
    };
    let faces = (0..side - 1).flat_map(|r| {
        (0..side - 1).flat_map(move |c| {
            let v = r * side + c;
            [[v, v + side, v + 1], [v + 1, v + side, v + side + 1]]
        })
    });
    let topology = Topology::new((side * side) as usize, faces.collect()).unwrap();
    let expected_error = vec![0.5; (side * side) as usize];
    for (k, stretch) in [1.0, 1.1].into_iter().enumerate() {
        let extras = PlyExtras { expected_error: Some(&expected_error), ..Default::default() };
        let path = case.path(&format!("flat/frame_00{k}.ply"));
        write_ply(&path, &topology, &at(stretch), LengthUnit::Millimetre, &extras).unwrap();
    }
    let server = Server::start(&case, "flat");
    browser.open(&server.url, READY);
    choose(&mut browser, "radius", "100");
    // Across the middle row; a square is a hundred.
    browser.eval("dsfms.pickVertices([55, 65])");
    let mut measure = |frame: &str| measure_in(&mut browser, frame);
    let (rest, now) = (measure("0"), measure("1"));
    // From corner to far side, across the edges: straight in the plane.
    browser.eval("dsfms.pickVertices([0, 114])");
    let slanted = measure_in(&mut browser, "0");
    assert!((slanted[0] - 116f64.sqrt()).abs() < 0.01, "{slanted:?}");
    assert!((1.0..1.012).contains(&(slanted[1] / slanted[0])), "{slanted:?}");
    browser.eval("dsfms.pickVertices([55, 65])");
    for (value, expected) in rest[..4].iter().zip([10.0, 10.0, 100.0, 0.0]) {
        assert!((value - expected).abs() < 0.01, "{rest:?}");
    }
    for (value, expected) in now[..4].iter().zip([11.0, 11.0, 110.0, 10.0]) {
        assert!((value - expected).abs() < 0.01, "{now:?}");
    }
    // Half a millimetre of expected error at every vertex, shared by neighbours and mostly along
    // the lines of sight, which lie across what is measured.
    for (sd, [least, most]) in
        now[4..].iter().zip([[0.02, 0.5], [0.02, 0.8], [0.2, 12.0], [0.1, 12.0]])
    {
        assert!((least..most).contains(sd), "{now:?}");
    }
    let rows = browser.eval("dsfms.csv().trim().split('\\n').map((r) => r.split(','))");
    let header = rows[0].as_array().unwrap();
    let column = |name: &str| {
        header.iter().position(|h| h == name).unwrap_or_else(|| panic!("{name}: {rows}"))
    };
    // The header, the reference, two frames.
    for (name, expected) in [
        ("straight_mm", 11.0),
        ("along_surface_mm", 11.0),
        ("patch_area_mm2", 110.0),
        ("patch_mean_strain_percent", 10.0),
        ("straight_sd_mm", now[4]),
        ("patch_area_sd_mm2", now[6]),
    ] {
        let value: f64 = rows[3][column(name)].as_str().unwrap().parse().unwrap();
        assert!((value - expected).abs() < 0.01, "{name}: {value}");
    }
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

#[test]
fn an_experiment_shows_its_plots_and_cases() {
    let case = Case::new();
    let Some(mut browser) = browser(&case) else { return };
    let run =
        "experiment ext --vertices 100 --ext 0,10 --count 1 --methods rigid,dsfm -q -o series";
    case.dsfms(&run.split(' ').collect::<Vec<_>>()).assert().success();
    browser.open(&format!("file://{}", case.path("series/report.html").display()), READY);
    assert_eq!(browser.eval("document.querySelectorAll('.plot svg').length >= 6"), true);
    assert_eq!(browser.eval("dsfms.data.frames.length"), 2);
    assert_eq!(browser.eval("dsfms.data.methods.join()"), "rigid,dsfm,truth");
    choose(&mut browser, "layer", "error");
    browser.eval(
        "document.querySelectorAll('#method-boxes input').forEach((b) => b.checked || b.click())",
    );
    assert!(browser.eval(COVERED).as_f64().unwrap() > 0.03);
    keep(&mut browser, "experiment");
    assert_eq!(browser.complaints(), Vec::<String>::new());
}
