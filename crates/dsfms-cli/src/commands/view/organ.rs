//! The page on which the organ of a template is drawn, and what it asks for.

use super::http::Answer;
use crate::commands::template::scene::{SCENE, SCRIBBLES};
use crate::report::embed::escape;
use anyhow::Context;
use dsfms::image::{Frame, Mask};
use dsfms::io::images::decode_bytes;
use dsfms::pipeline::{
    OrganGuess, OrganScene, OrganStroke, drawn_from, read_strokes, write_strokes,
};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Instant, SystemTime};

const PAGE: &str = include_str!("../../../assets/organ.html");
const STYLE: &str =
    concat!(include_str!("../../../assets/report.css"), include_str!("../../../assets/organ.css"));
const SCRIPT: &str = include_str!("../../../assets/organ.js");

/// The organ's page of a template; it is there where the template keeps by what the organ was told.
#[derive(Clone)]
pub struct Desk {
    folder: PathBuf,
    open: Arc<Mutex<Option<Arc<Opened>>>>,
    /// One part at a time is made: it takes all cores.
    work: Arc<Mutex<()>>,
}

/// A scene with its frames, and when its file was written.
struct Opened {
    written: Option<SystemTime>,
    scene: OrganScene,
    pictures: Vec<Frame>,
}

impl Desk {
    /// Of a template folder or of the page in it.
    pub fn of(path: &Path) -> Self {
        let folder = if path.is_dir() { Some(path) } else { path.parent() };
        let folder = folder.unwrap_or(path).to_path_buf();
        Self { folder, open: Arc::default(), work: Arc::default() }
    }

    /// Whether the template says by what its organ was told.
    pub fn is_there(&self) -> bool {
        self.folder.join(SCENE).is_file()
    }

    /// What is asked for by `GET`, under `organ`; `None` where there is no such thing.
    pub fn get(&self, wanted: &str) -> anyhow::Result<Option<Answer>> {
        if !self.is_there() {
            return Ok(None);
        }
        Ok(match wanted {
            "" => Some(Answer::ok("text/html; charset=utf-8", self.page())),
            "/scene" => Some(answer(&self.facts(&self.opened()?.scene))),
            other => match other.strip_prefix("/photo/").and_then(|n| n.parse::<usize>().ok()) {
                Some(frame) => photo(&self.opened()?.scene, frame),
                None => None,
            },
        })
    }

    /// What is sent by `POST`, under `organ`; `None` where nothing takes it.
    pub fn post(&self, wanted: &str, body: &str) -> anyhow::Result<Option<Answer>> {
        if !self.is_there() || !["/part", "/save"].contains(&wanted) {
            return Ok(None);
        }
        let strokes = match drawn_from(body) {
            Ok(strokes) => strokes,
            Err(why) => return Ok(Some(Answer::text("400 Bad Request", why))),
        };
        let opened = self.opened()?;
        let done = if wanted == "/part" {
            let _one = self.work.lock().unwrap_or_else(PoisonError::into_inner);
            opened.part(&strokes)
        } else {
            self.save(&opened.scene, &strokes)?
        };
        Ok(Some(match done {
            Ok(value) => answer(&value),
            Err(why) => Answer::text("400 Bad Request", why),
        }))
    }

    /// The scene, read again where its file has changed.
    fn opened(&self) -> anyhow::Result<Arc<Opened>> {
        let path = self.folder.join(SCENE);
        let written = path.metadata().and_then(|m| m.modified()).ok();
        // A poisoned lock only means that another thread panicked.
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        match open.as_ref().filter(|opened| opened.written == written) {
            Some(opened) => Ok(opened.clone()),
            None => Ok(open.insert(Arc::new(Opened::read(&path, written)?)).clone()),
        }
    }

    fn page(&self) -> String {
        let name = self.folder.file_name().unwrap_or_default().to_string_lossy();
        let parts = [("title", escape(&name)), ("style", STYLE.into()), ("script", SCRIPT.into())];
        crate::report::fill(PAGE, &parts.each_ref().map(|(name, text)| (*name, text.as_str())))
    }

    /// Frames, and the strokes to begin with: those that were saved last, else those of the
    /// template.
    fn facts(&self, scene: &OrganScene) -> Value {
        let saved = read_strokes(&self.folder.join(SCRIBBLES)).ok();
        json!({
            "frames": scene.names().collect::<Vec<_>>(),
            "size": scene.size(),
            "strokes": saved.as_deref().unwrap_or(scene.strokes()),
        })
    }

    /// Write strokes beside the template; what is wrong with them otherwise.
    fn save(
        &self,
        scene: &OrganScene,
        strokes: &[OrganStroke],
    ) -> anyhow::Result<Result<Value, String>> {
        if strokes.is_empty() {
            return Ok(Err("nothing is drawn".into()));
        }
        if let Some(stroke) = strokes.iter().find(|stroke| !scene.shows(stroke)) {
            return Ok(Err(format!("no frame is called {:?}", stroke.frame)));
        }
        let path = self.folder.join(SCRIBBLES);
        write_strokes(&path, strokes)?;
        let path = std::path::absolute(&path)?;
        Ok(Ok(json!({ "path": path.display().to_string() })))
    }
}

impl Opened {
    fn read(path: &Path, written: Option<SystemTime>) -> anyhow::Result<Self> {
        let scene = OrganScene::read(path)?;
        let pictures = (0..).zip(scene.names()).map(|(i, name)| picture(&scene, i, name));
        let pictures = pictures.collect::<anyhow::Result<_>>()?;
        Ok(Self { written, scene, pictures })
    }

    /// The part that strokes say is the organ; what is wrong with them otherwise.
    fn part(&self, strokes: &[OrganStroke]) -> Result<Value, String> {
        let begun = Instant::now();
        let guess = self.scene.part(&self.pictures, strokes).map_err(|error| error.to_string())?;
        Ok(shown(&guess, begun.elapsed().as_secs_f64()))
    }
}

fn picture(scene: &OrganScene, frame: usize, name: &str) -> anyhow::Result<Frame> {
    let bytes = scene.photo(frame).unwrap_or_default();
    let image = decode_bytes(bytes).map_err(anyhow::Error::msg);
    let image = image.with_context(|| format!("the picture of {name} in {SCENE}"))?.to_rgb8();
    let size = [image.width(), image.height()].map(|n| n as usize);
    anyhow::ensure!(size == scene.size(), "the picture of {name} in {SCENE} has another size");
    Ok(Frame { name: name.into(), size, rgb: image.pixels().map(|p| p.0).collect() })
}

fn photo(scene: &OrganScene, frame: usize) -> Option<Answer> {
    Some(Answer::ok("image/jpeg", scene.photo(frame)?))
}

fn answer(value: &Value) -> Answer {
    Answer::ok("application/json; charset=utf-8", value.to_string())
}

/// A part as the page draws it.
fn shown(guess: &OrganGuess, seconds: f64) -> Value {
    let frames = guess.masks.iter().zip(&guess.borders).map(|((name, mask), border)| {
        let border = border.iter().map(|b| {
            json!([b.pixel.x.round(), b.pixel.y.round(), (100.0 * b.confidence).round() / 100.0])
        });
        json!({ "name": name, "runs": runs(mask), "border": border.collect::<Vec<_>>() })
    });
    json!({
        "frames": frames.collect::<Vec<_>>(),
        "marked": guess.marked,
        "stepping": guess.stepping,
        "seconds": seconds,
    })
}

/// Lengths of the runs of a mask, row by row as one line, those of `false` and `true` in turn.
fn runs(mask: &Mask) -> Vec<usize> {
    let (mut runs, mut last) = (vec![0], false);
    for &on in &mask.data {
        if on != last {
            runs.push(0);
            last = on;
        }
        if let Some(run) = runs.last_mut() {
            *run += 1;
        }
    }
    runs
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use dsfms::camera::{CameraModel, Lens};
    use dsfms::dense::{DepthMap, PosedFrame};
    use dsfms::geometry::Isometry;

    const SIZE: [usize; 2] = [120, 90];

    /// A bright plate before a dark wall, as five cameras beside each other see it.
    pub fn scene() -> OrganScene {
        let camera = CameraModel {
            size: SIZE,
            focal: [100.0; 2],
            centre: [59.5, 44.5],
            lens: Lens::default(),
        };
        let pose = |i: usize| Isometry::translation(3.0 * (i as f64 - 2.0), 0.0, 0.0);
        let plate = |i: usize, p: usize| {
            let (u, v) = ((p % 120) as f64 - 59.5, (p / 120) as f64 - 44.5);
            (u - 7.5 * (i as f64 - 2.0)).abs() < 22.0 && v.abs() < 22.0
        };
        let (n, sides) = (SIZE[0] * SIZE[1], [60.0f32, 40.0]);
        let frame = |i: usize| {
            let rgb = (0..n).map(|p| [if plate(i, p) { 180 } else { 60 + (p % 5) as u8 }; 3]);
            Frame { name: format!("f_{i}"), size: SIZE, rgb: rgb.collect() }
        };
        let map = |i: usize| DepthMap {
            camera: camera.clone(),
            pose: pose(i),
            depth: (0..n).map(|p| sides[usize::from(plate(i, p))]).collect(),
            normal: vec![[0.0, 0.0, -1.0]; n],
            sigma: vec![0.05; n],
            confidence: vec![1.0; n],
        };
        let frames: Vec<Frame> = (0..5).map(frame).collect();
        let maps: Vec<DepthMap> = (0..5).map(map).collect();
        let views: Vec<PosedFrame> = (0..5)
            .map(|i| PosedFrame {
                frame: &frames[i],
                camera: &camera,
                pose: pose(i),
                valid: None,
                organ: None,
            })
            .collect();
        let scene = OrganScene::new(&views, &maps, &camera);
        crate::commands::template::scene::with_photos(scene, &frames).unwrap()
    }

    fn desk() -> (tempfile::TempDir, Desk) {
        let folder = tempfile::tempdir().unwrap();
        scene().write(&folder.path().join(SCENE)).unwrap();
        let desk = Desk::of(folder.path());
        (folder, desk)
    }

    fn posted(desk: &Desk, wanted: &str, strokes: &Value) -> (&'static str, Value) {
        let body = json!({ "strokes": strokes }).to_string();
        let answer = desk.post(wanted, &body).unwrap().unwrap();
        let text = String::from_utf8(answer.body).unwrap();
        (answer.status, serde_json::from_str(&text).unwrap_or(Value::String(text)))
    }

    /// Whether the part holds a pixel of a frame.
    fn holds(part: &Value, name: &str, x: usize, y: usize) -> bool {
        let frame = part["frames"].as_array().unwrap().iter().find(|f| f["name"] == name);
        let Some(frame) = frame else { return false };
        let mut at = y * SIZE[0] + x;
        for (k, run) in frame["runs"].as_array().unwrap().iter().enumerate() {
            let run = run.as_u64().unwrap() as usize;
            if at < run {
                return k % 2 == 1;
            }
            at -= run;
        }
        panic!("{x}, {y} lies beyond the mask");
    }

    #[test]
    fn strokes_give_another_part_and_are_saved_as_they_are() {
        let (folder, desk) = desk();
        let (status, part) = posted(&desk, "/part", &json!([]));
        assert_eq!(status, "200 OK");
        assert!(holds(&part, "f_2", 60, 45) && !holds(&part, "f_2", 5, 5));
        assert!(part["marked"].as_f64().unwrap() > 0.9, "{}", part["marked"]);
        let border = part["frames"][0]["border"].as_array().unwrap();
        assert!(border.len() > 50 && border[0][2].as_f64().is_some());
        // The wall instead of the plate.
        let strokes = json!([
            { "frame": "f_2", "organ": true, "px": [[5.0, 8.0], [110.0, 8.0]] },
            { "frame": "f_2", "organ": false, "px": [[60.0, 45.0]] },
        ]);
        let (status, part) = posted(&desk, "/part", &strokes);
        assert_eq!(status, "200 OK");
        for (name, shift) in [("f_0", 0), ("f_4", 30)] {
            assert!(holds(&part, name, 60, 8) && !holds(&part, name, 45 + shift, 45), "{name}");
        }
        assert_eq!(posted(&desk, "/save", &strokes).0, "200 OK");
        let saved = read_strokes(&folder.path().join(SCRIBBLES)).unwrap();
        assert_eq!(serde_json::to_value(&saved).unwrap(), strokes);
        let facts = desk.get("/scene").unwrap().unwrap();
        let facts: Value = serde_json::from_slice(&facts.body).unwrap();
        assert_eq!((&facts["strokes"], &facts["size"]), (&strokes, &json!(SIZE)));
        assert_eq!(facts["frames"].as_array().unwrap().len(), 5);
    }

    #[test]
    fn what_is_wrong_with_strokes_is_told() {
        let (folder, desk) = desk();
        let stroke = |frame: &str, px: Value| json!([{ "frame": frame, "organ": true, "px": px }]);
        for (wanted, strokes, told) in [
            ("/part", stroke("f_9", json!([[5, 5]])), "f_9"),
            ("/save", stroke("f_9", json!([[5, 5]])), "f_9"),
            ("/part", stroke("f_1", json!([[-500, 5]])), "f_1"),
            ("/part", stroke("f_1", json!([])), "stroke 0"),
            ("/part", json!(3), "strokes"),
            ("/save", json!([]), "nothing is drawn"),
        ] {
            let (status, text) = posted(&desk, wanted, &strokes);
            assert_eq!(status, "400 Bad Request", "{strokes}");
            assert!(text.as_str().unwrap().contains(told), "{strokes}: {text}");
        }
        assert!(!folder.path().join(SCRIBBLES).exists());
        assert!(desk.post("/other", "{}").unwrap().is_none());
        for wanted in ["/photo/9", "/photo/", "/photo/../organ.scene", "/x", "x"] {
            assert!(desk.get(wanted).unwrap().is_none(), "{wanted}");
        }
        assert_eq!(desk.get("/photo/4").unwrap().unwrap().kind, "image/jpeg");
        // Without the file there is no such page.
        std::fs::remove_file(folder.path().join(SCENE)).unwrap();
        assert!(desk.get("").unwrap().is_none());
        assert!(desk.post("/part", "{\"strokes\": []}").unwrap().is_none());
    }

    #[test]
    fn the_page_asks_only_its_own_server() {
        let (_folder, desk) = desk();
        let page = String::from_utf8(desk.get("").unwrap().unwrap().body).unwrap();
        assert!(page.contains("default-src 'none'") && page.contains("connect-src 'self'"));
        for word in ["http://", "https://", "@import", "{{"] {
            assert!(!page.contains(word), "{word}");
        }
    }

    #[test]
    fn runs_by_hand() {
        let mask = |on: [bool; 6]| Mask { size: [3, 2], data: on.to_vec() };
        assert_eq!(runs(&mask([false, true, true, true, false, false])), [1, 3, 2]);
        assert_eq!(runs(&mask([true; 6])), [0, 6]);
        assert_eq!(runs(&mask([false; 6])), [6]);
    }
}
