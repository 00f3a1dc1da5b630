//! How well a synthetic clip was tracked: never a wrong surface as a good one, found again after
//! occlusion and cut, and as good in the deformed zone as the joint solve of single frames.
//!
//!     dsfms synth --video --organ uterus --seed 1 -o clip
//!     dsfms track clip/organ.template clip/frames --camera clip/camera.json -o out
//!     dsfms reconstruct clip/organ.template SOME_FRAMES --camera clip/camera.json \
//!         --method joint -o single
//!     cargo run --release --example video_marks -- clip out [single]
//!
//!     dsfms figure out/marks.csv --y visible_mm,zone_mm,single_zone_mm,limit_mm -o marks.svg
//!
//! Writes out/marks.csv (errors, status and event of every frame), prints the marks as Markdown.
//! Errors are means over the vertices that the camera sees, absolute, nothing aligned; of frames in
//! which it sees none (covered lens) over all.

use dsfms::geometry::median;
use dsfms::io::atomic::write_atomic;
use dsfms::io::clip_truth::{ClipTruth, read_clip_truth};
use dsfms::io::mesh::read_mesh;
use dsfms::track::shapes::read_shapes;
use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

const STATUS: [&str; 3] = ["ok", "degraded", "lost"];

/// Longest recovery after occlusion and cut, frames.
const RECOVERY: usize = 5;

/// Events that are told for each frame.
const SHOWN: [&str; 5] = ["occlusion", "cut", "tool", "pass", "exposure"];

/// An ok frame may be wrong by so many medians.
const WRONG: f64 = 2.0;

/// Error of one surface, mm.
#[derive(Clone, Copy)]
struct Measured {
    visible: f64,
    /// Of the visible part of the deformed zone, where something deforms.
    zone: Option<f64>,
}

struct Row {
    status: usize,
    tracked: Option<Measured>,
    single: Option<Measured>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [clip, out, single @ ..] = arguments.as_slice() else {
        return Err("usage: video_marks CLIP OUT [SINGLE]".into());
    };
    let truth = read_clip_truth(&clip.join("truth/clip.npz"))?;
    let (shapes, status) = read_shapes(&out.join("vertices.npz"))?;
    if shapes.len() != truth.frames() {
        let (found, expected) = (shapes.len(), truth.frames());
        return Err(format!("{found} frames were tracked, the clip has {expected}").into());
    }
    let mut rows = Vec::new();
    for (k, shape) in shapes.iter().enumerate() {
        let shape: Vec<[f64; 3]> = shape.iter().map(|p| [p.x, p.y, p.z]).collect();
        let path = single.first().map(|s| s.join(format!("frame_{k:03}.ply")));
        let alone = path.filter(|p| p.exists()).map(|p| read_mesh(&p)).transpose()?;
        let alone: Option<Vec<[f64; 3]>> =
            alone.map(|m| m.mesh.positions.iter().map(|p| [p.x, p.y, p.z]).collect());
        rows.push(Row {
            status: usize::from(status[k]).min(2),
            tracked: measure(&truth, k, &shape),
            single: alone.and_then(|shape| measure(&truth, k, &shape)),
        });
    }
    let events = read_events(&clip.join("truth/events.csv"))?;
    let mut errors: Vec<f64> = rows.iter().filter_map(|r| Some(r.tracked?.visible)).collect();
    let median = median(&mut errors).unwrap_or(f64::NAN);
    write_text(&out.join("marks.csv"), &csv(&rows, &events, WRONG * median))?;
    print!("{}", marks(&rows, &truth, &events, median));
    Ok(())
}

/// `None` where there is no surface.
fn measure(truth: &ClipTruth, k: usize, shape: &[[f64; 3]]) -> Option<Measured> {
    let distance = |v: usize| -> f64 {
        let true_vertex = truth.vertices[k][v].map(f64::from);
        (0..3).map(|c| (shape[v][c] - true_vertex[c]).powi(2)).sum::<f64>().sqrt()
    };
    let mean = |keep: &dyn Fn(usize) -> bool| {
        let errors: Vec<f64> = (0..shape.len()).filter(|&v| keep(v)).map(distance).collect();
        (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64)
    };
    if shape.len() != truth.vertices[k].len() || shape.iter().flatten().any(|c| c.is_nan()) {
        return None;
    }
    let visible = mean(&|v| truth.visible[k][v]).or_else(|| mean(&|_| true))?;
    Some(Measured { visible, zone: mean(&|v| truth.visible[k][v] && truth.zone[k][v]) })
}

/// Name, first and last frame.
type Event = (String, usize, usize);

fn read_events(path: &Path) -> Result<Vec<Event>, Box<dyn Error>> {
    let line = |line: &str| -> Result<Event, Box<dyn Error>> {
        let mut fields = line.split(',');
        let mut next = || fields.next().ok_or(format!("{}: {line:?}", path.display()));
        Ok((next()?.to_owned(), next()?.parse()?, next()?.parse()?))
    };
    std::fs::read_to_string(path)?.lines().skip(1).map(line).collect()
}

/// Frames from `start` until the first good surface, the frame itself counted as one.
fn recovery(rows: &[Row], start: usize, median: f64) -> Option<usize> {
    let good = |r: &Row| r.status == 0 && r.tracked.is_some_and(|t| t.visible <= WRONG * median);
    rows.get(start..)?.iter().position(good).map(|k| k + 1)
}

fn marks(rows: &[Row], truth: &ClipTruth, events: &[Event], median: f64) -> String {
    let mut text = "| mark | found | asked for |\n| --- | --- | --- |\n".to_owned();
    let mut line = |mark: &str, found: String, asked: &str| {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "| {mark} | {found} | {asked} |");
    };
    let count = |s: usize| rows.iter().filter(|r| r.status == s).count();
    line("ok / degraded / lost", format!("{} / {} / {}", count(0), count(1), count(2)), "");
    let covered: Vec<usize> =
        (0..rows.len()).filter(|&k| truth.visible[k].iter().all(|v| !v)).collect();
    let lost = covered.iter().filter(|&&k| rows[k].status == 2).count();
    line("covered frames lost", format!("{lost} of {}", covered.len()), "all");
    line("median error, mm", format!("{median:.3}"), "");
    let errors = |s: usize| {
        let list = rows.iter().filter(|r| r.status == s).filter_map(|r| Some(r.tracked?.visible));
        list.fold(0.0, f64::max)
    };
    line("largest error ok / degraded, mm", format!("{:.3} / {:.3}", errors(0), errors(1)), "");
    let wrong: Vec<String> = (0..rows.len())
        .filter(|&k| rows[k].status == 0)
        .filter(|k| {
            let error = rows[*k].tracked.map(|t| t.visible);
            covered.contains(k) || error.is_none_or(|e| e > WRONG * median)
        })
        .map(|k| k.to_string())
        .collect();
    let list = if wrong.len() > 12 { String::new() } else { wrong.join(" ") };
    line("ok frames above twice the median", format!("{} {list}", wrong.len()), "0");
    for (name, first, last) in events {
        let start = match name.as_str() {
            "occlusion" => last + 1,
            "cut" => *first,
            _ => continue,
        };
        let found = recovery(rows, start, median).map_or("never".into(), |n| n.to_string());
        line(&format!("frames until good after {name}"), found, &format!("<= {RECOVERY}"));
    }
    let zones = rows.iter().filter_map(|r| r.tracked?.zone);
    line("mean zone error, mm", format!("{:.3}", mean(zones)), "");
    let both: Vec<[f64; 2]> =
        rows.iter().filter_map(|r| Some([r.tracked?.zone?, r.single?.zone?])).collect();
    if !both.is_empty() {
        let [video, alone] = [0, 1].map(|i| mean(both.iter().map(|b| b[i])));
        let n = both.len();
        line(&format!("zone error on {n} frames, mm"), format!("{video:.3}"), "");
        line("the same, single frames by joint", format!("{alone:.3}"), "");
        line("ratio", format!("{:.2}", video / alone), "<= 1.10");
    }
    text
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / count
}

/// `limit`: above it an ok frame is wrong.
fn csv(rows: &[Row], events: &[Event], limit: f64) -> String {
    let event = |k: usize| {
        let found =
            events.iter().find(|(name, a, b)| SHOWN.contains(&&**name) && (*a..=*b).contains(&k));
        found.map_or("", |event| &event.0)
    };
    let number = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:.4}"));
    let line = |(k, r): (usize, &Row)| {
        let cells = [
            r.tracked.map(|t| t.visible),
            r.tracked.and_then(|t| t.zone),
            r.single.map(|t| t.visible),
            r.single.and_then(|t| t.zone),
        ];
        let (status, cells) = (STATUS[r.status], cells.map(number).join(","));
        format!("{k},{status},{cells},{limit:.4},{}\n", event(k))
    };
    let lines: String = rows.iter().enumerate().map(line).collect();
    let columns = "frame,status,visible_mm,zone_mm,single_visible_mm,single_zone_mm,limit_mm,event";
    format!("{columns}\n{lines}")
}

fn write_text(path: &Path, text: &str) -> Result<(), Box<dyn Error>> {
    Ok(write_atomic(path, |w| w.write_all(text.as_bytes()))?)
}
