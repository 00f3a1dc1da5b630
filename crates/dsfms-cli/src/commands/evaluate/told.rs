//! What `dsfms evaluate` says: errors, their unit, and what could not be measured.

use dsfms::eval::{Alignment, ErrorStats, Evaluation};
use dsfms::mesh::Mesh;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// One reconstruction.
#[derive(Serialize)]
pub struct Told {
    /// Unit of all lengths.
    pub unit: &'static str,
    #[serde(flatten)]
    pub errors: Evaluation,
    /// What, and why.
    pub not_computed: BTreeMap<&'static str, String>,
}

/// What is known of a pair of meshes.
pub struct Gaps<'a> {
    pub found: &'a Mesh,
    pub truth: &'a Mesh,
    pub visible: bool,
    pub zone: Option<&'a [bool]>,
    /// `--rest` was given.
    pub rest: bool,
    pub camera: bool,
}

impl Gaps<'_> {
    /// What cannot be measured, and why.
    pub fn reasons(&self) -> BTreeMap<&'static str, String> {
        let mut reasons = BTreeMap::new();
        if self.found.topology != self.truth.topology {
            let count = |mesh: &Mesh| {
                format!("{} vertices, {} faces", mesh.positions.len(), mesh.topology.faces.len())
            };
            let why = format!(
                "other vertices or faces than the truth ({}; truth {}): distances between the surfaces only",
                count(self.found),
                count(self.truth)
            );
            reasons.insert("vertex, zone, edge and reprojection errors", why);
            return reasons;
        }
        if !self.visible {
            let why = "no TRUTH_vertices.npz, and the reconstruction has no `visible`";
            reasons.insert("visible and hidden part", why.into());
        }
        let zone = match self.zone {
            None if self.rest => Some("--rest has other vertices than the truth"),
            None => Some("no TRUTH_vertices.npz, and no --rest"),
            Some(zone) if !zone.contains(&true) => Some("nothing moved"),
            Some(_) => None,
        };
        reasons.extend(zone.map(|why| ("deformed zone", why.to_string())));
        if !self.camera {
            reasons.insert("reprojection error", "no --camera".into());
        }
        reasons
    }
}

/// All results, their means, and what is missing.
pub fn table(results: &BTreeMap<String, Told>) -> String {
    let mut text = String::new();
    if let Some(first) = results.values().next() {
        let alignment = match first.errors.alignment {
            Alignment::None => "none: absolute errors",
            Alignment::Rigid => "rigid: rotation and translation are fitted and taken out",
            Alignment::Similarity => {
                "similarity: rotation, translation and scale are fitted and taken out"
            }
        };
        let _ = writeln!(text, "unit {}; alignment {alignment}", units(results));
    }
    let _ = write!(text, "{:<22}{:<20}", "mesh", "part");
    for column in ["count", "rms", "mean", "median", "p90", "max"] {
        let _ = write!(text, "{column:>9}");
    }
    text.push('\n');
    for (name, told) in results {
        for (part, stats) in parts(&told.errors) {
            row(&mut text, name, part, &stats);
        }
        if let Some(rms) = told.errors.edge_length_rms {
            let _ = writeln!(text, "{name:<22}{:<20}{:>9}{rms:>9.3}", "edge length", "");
        }
    }
    if results.len() > 1 {
        means(&mut text, results);
    }
    gaps(&mut text, results);
    text
}

fn row(text: &mut String, name: &str, part: &str, s: &ErrorStats) {
    let _ = write!(text, "{name:<22}{part:<20}{:>9}", s.count);
    for value in [s.rms, s.mean, s.median, s.p90, s.max] {
        let _ = write!(text, "{value:>9.3}");
    }
    text.push('\n');
}

fn units(results: &BTreeMap<String, Told>) -> String {
    let mut units: Vec<&str> = results.values().map(|told| told.unit).collect();
    units.sort_unstable();
    units.dedup();
    units.join(" and ")
}

/// Mean over the meshes of every figure of every part; `count` is that of the meshes.
fn means(text: &mut String, results: &BTreeMap<String, Told>) {
    let mut sums: Vec<(&str, Vec<ErrorStats>)> = Vec::new();
    for (part, stats) in results.values().flat_map(|told| parts(&told.errors)) {
        match sums.iter_mut().find(|(name, _)| *name == part) {
            Some((_, list)) => list.push(stats),
            None => sums.push((part, vec![stats])),
        }
    }
    for (part, list) in sums {
        let mean =
            |value: fn(&ErrorStats) -> f64| list.iter().map(value).sum::<f64>() / list.len() as f64;
        let stats = ErrorStats {
            count: list.len(),
            rms: mean(|s| s.rms),
            mean: mean(|s| s.mean),
            median: mean(|s| s.median),
            p90: mean(|s| s.p90),
            max: mean(|s| s.max),
        };
        row(text, "mean of the meshes", part, &stats);
    }
}

/// What is missing, once for all meshes of which the same is true.
fn gaps(text: &mut String, results: &BTreeMap<String, Told>) {
    let mut known: BTreeMap<(&str, &str), usize> = BTreeMap::new();
    for (what, why) in results.values().flat_map(|told| &told.not_computed) {
        *known.entry((what, why)).or_default() += 1;
    }
    for ((what, why), count) in known {
        let of = match count == results.len() {
            true => String::new(),
            false => format!(" of {count} of {} meshes", results.len()),
        };
        let _ = writeln!(text, "not computed: {what}{of}: {why}");
    }
}

/// The rows that are known of a mesh.
fn parts(e: &Evaluation) -> Vec<(&'static str, ErrorStats)> {
    let v = e.vertices.as_ref();
    [
        ("all", v.map(|v| v.all)),
        ("visible", v.and_then(|v| v.visible)),
        ("hidden", v.and_then(|v| v.hidden)),
        ("zone", v.and_then(|v| v.zone)),
        ("visible zone", v.and_then(|v| v.visible_zone)),
        ("reprojection px", e.reprojection_px),
        ("to true surface", Some(e.found_to_truth)),
        ("from true surface", Some(e.truth_to_found)),
    ]
    .into_iter()
    .filter_map(|(name, stats)| Some((name, stats?)))
    .collect()
}
