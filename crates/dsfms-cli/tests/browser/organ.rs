//! The organ of a template, drawn by strokes.

use super::*;
use dsfms::camera::{CameraModel, Lens};
use dsfms::dense::{DepthMap, PosedFrame};
use dsfms::geometry::Isometry;
use dsfms::image::Frame;
use dsfms::pipeline::{OrganScene, read_strokes};
use image::ImageEncoder;

const SIZE: [usize; 2] = [160, 120];

/// Whether frame `i` shows a plate 1.5 times as near as the wall behind it.
fn plate(i: usize, pixel: usize) -> bool {
    let [u, v] = [(pixel % SIZE[0]) as f64 - 79.5, (pixel / SIZE[0]) as f64 - 59.5];
    (u - 10.0 * (i as f64 - 1.5)).abs() < 30.0 && v.abs() < 28.0
}

fn frame(i: usize) -> Frame {
    let colour = |p: usize| match plate(i, p) {
        true => [190, 110 + (p % 7) as u8, 100],
        false => [90 + (p % 5) as u8, 40, 40],
    };
    Frame {
        name: format!("frame_{i:03}"),
        size: SIZE,
        rgb: (0..SIZE[0] * SIZE[1]).map(colour).collect(),
    }
}

fn jpeg(frame: &Frame) -> Vec<u8> {
    let mut bytes = Vec::new();
    let [w, h] = frame.size.map(|n| n as u32);
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 92);
    let rgb = frame.rgb.as_flattened();
    encoder.write_image(rgb, w, h, image::ExtendedColorType::Rgb8).unwrap();
    bytes
}

/// `organ.template` of the case gets a scene of four frames.
fn put_scene(case: &Case) {
    let camera =
        CameraModel { size: SIZE, focal: [130.0; 2], centre: [79.5, 59.5], lens: Lens::default() };
    let n = SIZE[0] * SIZE[1];
    let map = |i: usize| DepthMap {
        camera: camera.clone(),
        pose: Isometry::translation(40.0 / 130.0 * 10.0 * (i as f64 - 1.5), 0.0, 0.0),
        depth: (0..n).map(|p| if plate(i, p) { 40.0 } else { 60.0 }).collect(),
        normal: vec![[0.0, 0.0, -1.0]; n],
        sigma: vec![0.1; n],
        confidence: vec![1.0; n],
    };
    let frames: Vec<Frame> = (0..4).map(frame).collect();
    let maps: Vec<DepthMap> = (0..4).map(map).collect();
    let view = |i: usize| PosedFrame {
        frame: &frames[i],
        camera: &camera,
        pose: maps[i].pose,
        valid: None,
        organ: None,
    };
    let views: Vec<PosedFrame> = (0..4).map(view).collect();
    let photo = |name: &str| -> Result<Vec<u8>, ()> {
        Ok(jpeg(frames.iter().find(|frame| frame.name == name).unwrap()))
    };
    let scene = OrganScene::new(&views, &maps, &camera).with_photos(photo).unwrap();
    scene.write(&case.path("organ.template/organ.scene")).unwrap();
}

const TOLD: &str = "document.getElementById('told').textContent";
/// Whether the part of a frame holds a pixel.
const HOLDS: &str = "(name, x, y) => { const part = organ.state.parts.get(name); let at = y * 160 + x, k = 0; \
    if (!part) return false; while (at >= part.runs[k]) at -= part.runs[k++]; return k % 2 === 1; }";

#[test]
fn strokes_over_a_frame_change_the_organ_in_all_frames_and_are_saved() {
    let case = Case::new();
    case.template();
    put_scene(&case);
    let Some(mut browser) = browser(&case) else { return };
    let server = Server::start(&case, "organ.template");
    browser.open(&server.url, READY);
    // The page of the template leads to that of its organ.
    browser.eval("document.getElementById('organ').click()");
    browser.wait("!!(window.organ && document.body.dataset.ready)");
    let holds = |browser: &mut Browser, name: &str, x: usize, y: usize| {
        browser.eval(&format!("({HOLDS})('{name}', {x}, {y})")) == true
    };
    assert!(holds(&mut browser, "frame_001", 79, 60) && !holds(&mut browser, "frame_001", 10, 8));
    keep(&mut browser, "organ-begun");
    // Over the wall as organ, over the plate as something else, in the second frame.
    browser.key("ArrowRight");
    let [x, y, w, h] = browser.place("frame");
    let scale = f64::min(w / 160.0, h / 120.0);
    let at = |u: f64, v: f64| [x + 0.5 * w + scale * (u - 79.5), y + 0.5 * h + scale * (v - 59.5)];
    browser.drag(at(8.0, 10.0), at(150.0, 10.0));
    browser.wait("!organ.state.pending");
    browser.key("n");
    browser.drag(at(70.0, 60.0), at(85.0, 62.0));
    browser.wait("!organ.state.pending && organ.state.strokes.length === 2");
    for name in ["frame_000", "frame_001", "frame_003"] {
        assert!(holds(&mut browser, name, 80, 8) && !holds(&mut browser, name, 80, 60), "{name}");
    }
    keep(&mut browser, "organ-drawn");
    browser.eval("document.getElementById('save').click()");
    browser.wait(&format!("{TOLD}.includes('organ_scribbles.json')"));
    let saved = read_strokes(&case.path("organ.template/organ_scribbles.json")).unwrap();
    assert_eq!(saved.len(), 2);
    let [own, other] = [&saved[0], &saved[1]];
    assert!(own.organ && !other.organ);
    for stroke in &saved {
        assert_eq!(stroke.frame.as_deref(), Some("frame_001"));
    }
    assert!((own.px[0].x - 8.0).abs() < 1.0 && (own.px[0].y - 10.0).abs() < 1.0, "{own:?}");
    assert!((own.px[own.px.len() - 1].x - 150.0).abs() < 1.0, "{own:?}");
    // What was saved is there again; undo takes one back; a stroke on nothing says so.
    browser
        .reload("window.organ && document.body.dataset.ready && organ.state.strokes.length === 2");
    assert!(holds(&mut browser, "frame_003", 80, 8));
    browser.key("z");
    browser.key("z");
    browser.wait("!organ.state.pending && !organ.state.strokes.length");
    assert!(holds(&mut browser, "frame_001", 79, 60) && !holds(&mut browser, "frame_001", 10, 8));
    browser.resize([390, 844]);
    let wide = browser.eval("document.documentElement.scrollWidth <= innerWidth");
    assert_eq!(wide, true, "wider than the phone");
    keep(&mut browser, "organ-phone");
    assert_eq!(browser.complaints(), Vec::<String>::new());
    let url = server.url.as_str();
    assert!(browser.requests().iter().all(|r| r.starts_with(url)), "{:?}", browser.requests());
}
