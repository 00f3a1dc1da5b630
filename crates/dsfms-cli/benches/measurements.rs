//! How often the true measure lies within the uncertainty that the report states, over random
//! measurements on synthetic cases, as the page itself computes both:
//!
//!     cargo bench --bench measurements [-- SERIES]
//!
//! Needs Chromium (Debian: `apt install chromium`). The shares and the smoothness in
//! `assets/viewer/uncertainty.js` were chosen on other cases.

#[path = "../tests/browser/cdp.rs"]
#[allow(dead_code, reason = "the tests use all of it")]
mod cdp;

use cdp::Browser;
use serde_json::Value;
use std::process::{Command, Stdio};

const READY: &str = "document.querySelector('#viewer[data-ready]') !== null";
const WHAT: [&str; 4] = ["straight", "along", "area", "strain"];

/// Errors over stated uncertainties of every method: random pairs and patches in every frame.
const JUDGE: &str = "(() => { let seed = 7; const uniform = () => (seed = (16807 * seed) % 2147483647) / 2147483647; \
    const out = {}; const n = dsfms.data.vertices, radius = document.getElementById('radius'); \
    for (let f = 0; f < dsfms.data.frames.length; f++) { dsfms.state.frame = f; \
      for (let i = 0; i < 12; i++) { \
        radius.value = i % 2 ? 5 : 10; \
        dsfms.pickVertices([Math.floor(n * uniform()), Math.floor(n * uniform())]); \
        const all = dsfms.measures(), truth = all[dsfms.data.truth]; \
        all.forEach((m, k) => { if (!m || !m.sd) return; const own = out[dsfms.data.methods[k]] ??= []; \
          own.push([m.straight - truth.straight, m.along.length - truth.along.length, m.area - truth.area, \
            m.strain - truth.strain].map((e, j) => e / [m.sd.straight, m.sd.along, m.sd.area, m.sd.strain][j])); }); } } \
    return out; })()";

fn main() {
    let Some(program) = cdp::chromium() else {
        println!("chromium is not installed (Debian: apt install chromium)");
        return;
    };
    let series = std::env::args().skip(1).find_map(|a| a.parse().ok()).unwrap_or(8);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut browser = Browser::start(program, &folder.path().join("profile"), [1400, 900]);
    let mut all: Vec<(String, [f64; 4])> = Vec::new();
    for k in 0..series {
        let (organ, light) =
            [("patch", "distant"), ("liver", "near"), ("uterus", "distant")][k % 3];
        let run = format!(
            "experiment ext --organ {organ} --light {light} --vertices 334 --ext 5,10,15 --count 1 \
             --seed {} --methods dsfm,dsfms,joint -q -o s{k}",
            5000 + k
        );
        let status = Command::new(env!("CARGO_BIN_EXE_dsfms"))
            .args(run.split(' '))
            .current_dir(folder.path())
            .stdout(Stdio::null())
            .status()
            .expect("dsfms runs");
        assert!(matches!(status.code(), Some(0 | 2)), "{run}: {status}");
        let page = folder.path().join(format!("s{k}/report.html"));
        browser.open(&format!("file://{}", page.display()), READY);
        let found = browser.eval(JUDGE);
        for (method, rows) in found.as_object().expect("methods") {
            let row = |r: &Value| std::array::from_fn(|i| r[i].as_f64().unwrap_or(f64::NAN));
            all.extend(rows.as_array().into_iter().flatten().map(|r| (method.clone(), row(r))));
        }
    }
    println!(
        "{series} series; share of errors within one and within two stated standard deviations\n"
    );
    println!("| method | measurements | {} |", WHAT.join(" | "));
    println!("|{}", " --- |".repeat(2 + WHAT.len()));
    for method in ["dsfm", "dsfms", "joint"] {
        let own: Vec<&[f64; 4]> = all.iter().filter(|a| a.0 == method).map(|a| &a.1).collect();
        let share = |i: usize, limit: f64| {
            let values: Vec<f64> =
                own.iter().map(|z| z[i].abs()).filter(|z| z.is_finite()).collect();
            values.iter().filter(|z| **z < limit).count() as f64 / values.len().max(1) as f64
        };
        let cells: Vec<String> =
            (0..4).map(|i| format!("{:.2}, {:.2}", share(i, 1.0), share(i, 2.0))).collect();
        println!("| {method} | {} | {} |", own.len(), cells.join(" | "));
    }
}
