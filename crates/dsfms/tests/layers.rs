//! The layers of ARCHITECTURE.md: an arrow of `use` only ever points left.

#[path = "common/source.rs"]
mod source;

use source::{code, sources};
use std::fs;
use std::path::Path;

/// A module may use itself and what stands left of it.
const ORDER: [&str; 30] = [
    "options",
    "guard",
    "checkpoint",
    "geometry",
    "image",
    "mesh",
    "camera",
    "light",
    "raster",
    "solver",
    "energy",
    "video",
    "calibrate",
    "sfm",
    "dense",
    "template",
    "register",
    "refine",
    "sfs",
    "expected_error",
    "verdict",
    "structures",
    "voxels",
    "preoperative",
    "synth",
    "eval",
    "io",
    "pipeline",
    "track",
    "experiment",
];

#[test]
fn arrows_point_left() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut wrong = Vec::new();
    for path in sources(&root) {
        let relative = path.strip_prefix(&root).unwrap();
        let first = relative.components().next().unwrap().as_os_str().to_string_lossy();
        let module = first.trim_end_matches(".rs");
        if module == "lib" {
            continue;
        }
        // Tests may look anywhere.
        for line in code(&fs::read_to_string(&path).unwrap()).lines() {
            let word = |s: &str| {
                s.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap().to_string()
            };
            for used in line.split("crate::").skip(1).map(word) {
                if place(&used) > place(module) {
                    wrong.push(format!("{}: {}", relative.display(), line.trim()));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "an arrow to the right:\n{}", wrong.join("\n"));
}

fn place(module: &str) -> usize {
    let known = ORDER.iter().position(|m| *m == module);
    known.unwrap_or_else(|| panic!("module {module} is missing in tests/layers.rs"))
}
