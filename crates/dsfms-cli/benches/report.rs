//! How fast a report opens and turns, in headless Chromium with software rendering:
//!
//!     cargo bench --bench report
//!
//! Prints size, first paint and frame rates; needs Chromium (Debian: `apt install chromium`).

#[path = "../tests/browser/cdp.rs"]
#[allow(dead_code, reason = "the tests use all of it")]
mod cdp;

use cdp::Browser;
use dsfms::camera::CameraModel;
use dsfms::geometry::{Isometry, Point3, Vector3};
use dsfms::io::camera::{CameraFile, write_camera};
use dsfms::io::matches::write_matches;
use dsfms::io::ply::{PlyExtras, write_ply};
use dsfms::light::LightModel;
use dsfms::synth::{Draw, Random, RenderOptions, correspond, patch, render};
use dsfms::template::LengthUnit;
use std::path::Path;
use std::process::{Command, Stdio};

const READY: &str = "document.querySelector('#viewer[data-ready]') !== null";
/// Seconds of turning.
const SECONDS: f64 = 4.0;

fn main() {
    let Some(program) = cdp::chromium() else {
        println!("chromium is not installed (Debian: apt install chromium)");
        return;
    };
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (vertices, frames) in [(1000, 20), (10_000, 1)] {
        let case = folder.path().join(format!("v{vertices}"));
        prepare(&case, vertices, frames);
        let page = case.join("out/report.html");
        let bytes = page.metadata().expect("the report").len();
        println!(
            "\n{frames} frames of {vertices} vertices: report.html {:.2} MB",
            bytes as f64 / 1e6
        );
        let mut browser = Browser::start(program, &case.join("profile"), [1440, 900]);
        for visit in ["first", "second"] {
            browser.open(&format!("file://{}", page.display()), READY);
            let paint = browser.eval(
                "performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? NaN",
            );
            let ready = browser.eval("performance.now()");
            println!(
                "{visit} visit: first paint {:.2} s, viewer ready within {:.2} s",
                1e-3 * paint.as_f64().unwrap_or(f64::NAN),
                1e-3 * ready.as_f64().unwrap_or(f64::NAN)
            );
        }
        let layers =
            browser.eval("[...document.getElementById('layer').options].map((o) => o.value)");
        for layer in layers.as_array().expect("layers") {
            let layer = layer.as_str().unwrap_or_default();
            let rate = rate(&mut browser, layer);
            let sharp = browser.eval("dsfms.sharpness()").as_f64().unwrap_or(f64::NAN);
            println!(
                "orbit, {layer}: {rate:.1} frames a second at {sharp:.2} of the pixels a side"
            );
        }
    }
}

/// Frames a second while the view turns.
fn rate(browser: &mut Browser, layer: &str) -> f64 {
    let turn = format!(
        "new Promise((done) => {{ const l = document.getElementById('layer'); l.value = '{layer}'; \
         l.dispatchEvent(new Event('change')); let n = -10, start = 0; \
         const step = (now) => {{ if (n === 0) start = now; n++; dsfms.orbit(0.03, 0); \
         if (n > 0 && now - start > {}) done((1000 * n) / (now - start)); else requestAnimationFrame(step); }}; \
         requestAnimationFrame(step); }})",
        1000.0 * SECONDS
    );
    browser.eval(&turn).as_f64().unwrap_or(f64::NAN)
}

/// A patch before a moving camera, rendered and reconstructed by rigid pose.
fn prepare(folder: &Path, vertices: usize, frames: usize) {
    std::fs::create_dir_all(folder.join("frames")).expect("a folder");
    std::fs::create_dir_all(folder.join("matches")).expect("a folder");
    let camera = CameraModel::pinhole([1280, 720], [1100.0, 1100.0], [639.5, 359.5]);
    let organ = patch(vertices, 4);
    let (mesh, extras) = (&organ.mesh, PlyExtras::default());
    write_ply(
        &folder.join("organ.ply"),
        &mesh.topology,
        &mesh.positions,
        LengthUnit::Millimetre,
        &extras,
    )
    .expect("a mesh");
    let file = CameraFile { camera: camera.clone(), tone: None, light: None, vignetting: None };
    write_camera(&folder.join("camera.json"), &file).expect("a camera");
    let faces = &mesh.topology.faces;
    let albedo = |v: u32| {
        let face = faces.iter().position(|f| f.contains(&v)).unwrap_or(0);
        let corner = faces[face].iter().position(|&c| c == v).unwrap_or(0);
        let mut weights = [0.0; 3];
        weights[corner] = 1.0;
        organ.albedo.at(face, weights)[0]
    };
    let rows: String =
        (0..mesh.positions.len() as u32).map(|v| format!("{}\n", albedo(v))).collect();
    std::fs::write(folder.join("albedo.csv"), format!("albedo\n{rows}")).expect("an albedo");
    for k in 0..frames {
        let t = k as f64 / frames as f64;
        let pose =
            Isometry::new(Vector3::new(2.0 * t, -t, 70.0), Vector3::new(0.1 * t, 0.2 * t, 0.3 * t));
        let posed: Vec<Point3> = mesh.positions.iter().map(|p| pose * p).collect();
        let shown = mesh.with_positions(posed.clone());
        let frame = render(
            &camera,
            &LightModel::Collinear,
            &shown,
            &organ.albedo,
            &RenderOptions::default(),
        );
        let [w, h] = frame.size;
        let picture = image::RgbImage::from_fn(w as u32, h as u32, |x, y| {
            image::Rgb(frame.rgb[y as usize * w + x as usize])
        });
        picture.save(folder.join(format!("frames/frame_{k:03}.png"))).expect("an image");
        let admitted = vec![true; posed.len()];
        let draw = Draw { count: 100, sigma_px: 1.0 };
        let found =
            correspond(&camera, mesh, &posed, &admitted, draw, &mut Random::new(3, k as u64));
        write_matches(&folder.join(format!("matches/frame_{k:03}.csv")), &found).expect("matches");
    }
    run(
        folder,
        &["template", "--mesh", "organ.ply", "--albedo", "albedo.csv", "-o", "organ.template"],
    );
    run(
        folder,
        &[
            "reconstruct",
            "organ.template",
            "frames",
            "--camera",
            "camera.json",
            "--matches",
            "matches",
            "--method",
            "dsfm",
            "-o",
            "out",
        ],
    );
}

fn run(folder: &Path, arguments: &[&str]) {
    let status = Command::new(env!("CARGO_BIN_EXE_dsfms"))
        .args(arguments)
        .arg("--quiet")
        .current_dir(folder)
        .stdout(Stdio::null())
        .status()
        .expect("dsfms runs");
    assert!(matches!(status.code(), Some(0 | 2)), "{arguments:?}: {status}");
}
