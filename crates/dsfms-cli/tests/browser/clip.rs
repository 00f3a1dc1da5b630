//! Long clips in `dsfms view`: every frame, few of them held.

use super::*;
use std::path::Path;

const COUNT: usize = 10_000;

/// A square of nine vertices, its middle raised by `height` mm.
fn square(path: &Path, height: f64) {
    let points: Vec<Point3> = (0..9)
        .map(|v| {
            let lift = if v == 4 { height } else { 0.0 };
            Point3::new(f64::from(v % 3), f64::from(v / 3), 50.0 - lift)
        })
        .collect();
    let faces =
        [0u32, 1, 3, 4].into_iter().flat_map(|v| [[v, v + 3, v + 1], [v + 1, v + 3, v + 4]]);
    let topology = Topology::new(9, faces.collect()).unwrap();
    write_ply(path, &topology, &points, LengthUnit::Millimetre, &PlyExtras::default()).unwrap();
}

const HELD: &str = "dsfms.data.frames.filter((f) => f.surfaces).length";

#[test]
fn ten_thousand_frames_come_when_they_are_asked_for() {
    let case = Case::new();
    let Some(mut browser) = browser(&case) else { return };
    std::fs::create_dir(case.path("long")).unwrap();
    let of = |k: usize| case.path(&format!("long/frame_{k:05}.ply"));
    square(&of(0), 0.0);
    let flat = std::fs::read(of(0)).unwrap();
    for k in 1..COUNT {
        std::fs::write(of(k), &flat).unwrap();
    }
    square(&of(7_777), 2.5);
    let server = Server::start(&case, "long");
    browser.open(&server.url, READY);
    assert_eq!(browser.eval("dsfms.data.frames.length"), COUNT);
    assert!(browser.eval(HELD).as_u64().unwrap() <= 8);
    browser.key("End");
    browser.wait(&format!("dsfms.state.frame === {}", COUNT - 1));
    choose(&mut browser, "frame", "7777");
    browser.wait("dsfms.state.frame === 7777");
    assert_eq!(browser.eval("dsfms.data.frames[7777].name"), "frame_07777");
    browser.eval("dsfms.pickVertices([3, 5])");
    let along = browser.eval("dsfms.measures()[0].along.length").as_f64().unwrap();
    assert!((along - 2.0 * (1.0f64 + 2.5 * 2.5).sqrt()).abs() < 0.3 || along < 5.4, "{along}");
    assert!(along > 2.1, "the raised middle is of this frame: {along}");
    // Stepping does not fill the memory.
    choose(&mut browser, "frame", "0");
    browser.wait("dsfms.state.frame === 0");
    for k in 1..=130 {
        browser.eval(&format!("dsfms.go({k})"));
        browser.wait(&format!("dsfms.state.frame === {k}"));
    }
    assert!(browser.eval(HELD).as_u64().unwrap() <= 110);
    choose(&mut browser, "speed", "25");
    browser.key(" ");
    browser.wait("dsfms.state.frame > 140");
    browser.key(" ");
    assert_eq!(browser.complaints(), Vec::<String>::new());
    assert!(browser.requests().iter().all(|r| r.starts_with(&server.url)));
}

/// A report that holds two of fifty frames, the others beside it.
#[test]
fn frames_beside_a_report_are_looked_at_too() {
    let case = reconstructed();
    let Some(mut browser) = browser(&case) else { return };
    let html = std::fs::read_to_string(case.path("two/dsfm/report.html")).unwrap();
    let start = html.find("id=\"data\">").unwrap() + "id=\"data\">".len();
    let end = start + html[start..].find("</script>").unwrap();
    let data: serde_json::Value = serde_json::from_str(&html[start..end]).unwrap();
    std::fs::create_dir(case.path("two/dsfm/view")).unwrap();
    for k in 0..50 {
        let mut frame = data["frames"][k % 2].clone();
        frame["name"] = format!("frame_{k:03}").into();
        let path = case.path(&format!("two/dsfm/view/frame_{k:03}.json"));
        std::fs::write(path, frame.to_string()).unwrap();
    }
    let server = Server::start(&case, "two/dsfm");
    browser.open(&server.url, READY);
    assert_eq!(browser.eval("dsfms.data.frames.length"), 50);
    choose(&mut browser, "frame", "41");
    browser.wait("dsfms.state.frame === 41");
    let image = "document.getElementById('photo').src.startsWith('data:image/jpeg') \
        && document.getElementById('photo').alt.includes('frame_041')";
    assert_eq!(browser.eval(image), true);
    assert!(browser.eval(COVERED).as_f64().unwrap() > 0.05);
    // A frame that is gone is said to be, and the one before stays.
    std::fs::remove_file(case.path("two/dsfm/view/frame_020.json")).unwrap();
    choose(&mut browser, "frame", "20");
    browser.wait("document.getElementById('frame-name').textContent.includes('cannot be read')");
    assert_eq!(browser.eval("dsfms.state.frame"), 41);
    let status = browser.eval("fetch('frame/../report').then((r) => r.status)");
    assert_eq!(status, 404);
}
