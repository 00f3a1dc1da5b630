//! Rows of clips of known truth (`dsfms synth --video`): every tenth frame, with the instrument
//! masks and nothing else given.

use super::scenes::{ROWS, Result, frames};
use super::{METHODS, ModelRows, append, judged};
use dsfms::Observation;
use dsfms::geometry::Point3;
use dsfms::io::clip_truth::read_clip_truth;
use dsfms::io::masks::{MaskKind, read_masks};
use dsfms::io::template::read_template;
use dsfms::pipeline::inputs::CameraInput;
use std::path::Path;

/// Every so-manieth frame counts: neighbours tell the same.
const EVERY: usize = 10;

/// The rows of some clips.
pub fn rows(clips: &[&str]) -> Result<ModelRows> {
    let (mut all, mut case) = (ModelRows::default(), 0);
    for clip in clips.iter().map(Path::new) {
        let template = read_template(&clip.join("organ.template"))?;
        let camera = CameraInput::read(&clip.join("camera.json"), None)?;
        let truth = read_clip_truth(&clip.join("truth/clip.npz"))?;
        let found = frames(clip, "frames/frame_*")?;
        let masks = clip.join("truth/instruments");
        let (masks, _) = read_masks(&found, &[], &masks, MaskKind::Instrument)?;
        let seen = |k: &usize| truth.visible[*k].contains(&true);
        for k in (EVERY / 2..found.len()).step_by(EVERY).filter(seen) {
            eprintln!("{} {}", clip.display(), found[k].name);
            let place = |p: &[f32; 3]| Point3::from(p.map(f64::from));
            let shape: Vec<Point3> = truth.vertices[k].iter().map(place).collect();
            let observation: Observation = camera.observation(&found[k]).instrument(masks.get(k));
            for method in METHODS {
                append(&mut all, judged(&template, &observation, &shape, method, case, ROWS));
            }
            case += 1;
        }
    }
    Ok(all)
}
