//! A template among its cameras: frusta that are clicked, the camera's path, sparse points.

use super::*;
use serde_json::{Value, json};

/// Two posed frames make a template with two cameras; sparse points are put into its page.
fn page(case: &Case) -> String {
    std::fs::copy(case.path("frames/organ_003.png"), case.path("frames/organ_004.png")).unwrap();
    let rows = json!([[1, 0, 0], [0, 1, 0], [0, 0, 1]]);
    let pose = |image: &str, x: f64| json!({ "image": image, "R": rows, "t": [x, -0.5, 75.0] });
    let poses = json!({ "exploration": [pose("organ_003.png", 1.0), pose("organ_004.png", -9.0)] });
    std::fs::write(case.path("poses.json"), poses.to_string()).unwrap();
    let arguments = "template frames --mesh organ.ply --camera camera.json --poses poses.json -q \
        -o posed.template";
    let done = case.dsfms(&arguments.split_whitespace().collect::<Vec<_>>()).output().unwrap();
    let report = case.path("posed.template/report.html");
    assert!(report.is_file(), "{}", String::from_utf8_lossy(&done.stderr));
    let html = std::fs::read_to_string(&report).unwrap();
    let start = html.find("id=\"data\">").unwrap() + "id=\"data\">".len();
    let end = start + html[start..].find("</script>").unwrap();
    let mut data: Value = serde_json::from_str(&html[start..end]).unwrap();
    data["points"] = data["rest"].clone();
    let count = data["vertices"].as_u64().unwrap() as usize;
    let base64 = |bytes: Vec<u8>| dsfms::io::base64::base64(&bytes);
    let numbers = |high: u16| {
        let words = (0..count).flat_map(|i| ((i % high as usize) as u16).to_le_bytes()).collect();
        json!({ "low": 2.0, "step": 1.0, "codes": base64(words) })
    };
    let red: Vec<u8> = [255u8, 0, 0].repeat(count);
    data["point_values"] = json!({ "rgb": base64(red), "error": numbers(5), "track": numbers(9) });
    std::fs::write(&report, [&html[..start], &data.to_string(), &html[end..]].concat()).unwrap();
    format!("file://{}", report.display())
}

/// Share of the drawing that is pure red.
const RED: &str = "(() => { dsfms.render(); const gl = document.getElementById('gl').getContext('webgl2'); \
    const w = gl.drawingBufferWidth, h = gl.drawingBufferHeight, p = new Uint8Array(4 * w * h); \
    gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, p); let n = 0; \
    for (let i = 0; i < p.length; i += 4) if (p[i] > 240 && p[i + 1] < 15 && p[i + 2] < 15) n++; \
    return n / (w * h); })()";

#[test]
fn a_click_on_a_camera_goes_to_its_frame_and_points_have_colours() {
    let case = Case::new();
    let Some(mut browser) = browser(&case) else { return };
    let url = page(&case);
    browser.open(&url, READY);
    assert_eq!(browser.eval("dsfms.data.frames.filter((f) => f.pose).length"), 2);
    assert_eq!(browser.eval("document.getElementById('path').offsetParent !== null"), true);
    browser.key("5");
    // The apex of the camera that is not the current one.
    let apex = browser.eval("dsfms.cameraPlace(1)");
    let [x, y] = [0, 1].map(|i| apex[i].as_f64().unwrap());
    browser.point([x - 1.0, y], false);
    browser.point([x, y], false);
    browser.wait("document.getElementById('tip').innerText.startsWith('camera of ')");
    browser.click(x, y);
    assert_eq!(browser.eval("dsfms.state.frame"), 1);
    assert_eq!(browser.eval(RED).as_f64(), Some(0.0));
    browser.eval("document.getElementById('points').click()");
    let red = browser.eval(RED).as_f64().unwrap();
    assert!(red > 1e-4, "{red}: the points have their own colour");
    let kinds = browser
        .eval("[...document.getElementById('points-by').options].map((o) => o.value).join()");
    assert_eq!(kinds, "rgb,error,track,plain");
    choose(&mut browser, "points-by", "error");
    assert_eq!(browser.eval(RED).as_f64(), Some(0.0));
    keep(&mut browser, "template-cameras");
    // The cut takes the surface away and leaves the points.
    browser.eval("document.getElementById('points').click()");
    browser.key("1");
    let whole = browser.eval(COVERED).as_f64().unwrap();
    choose(&mut browser, "cut-axis", "x");
    let half = browser.eval(COVERED).as_f64().unwrap();
    choose(&mut browser, "cut", "100");
    let none = browser.eval(COVERED).as_f64().unwrap();
    assert!(half < 0.9 * whole && half > 0.1 * whole && none < 0.2 * half, "{whole} {half} {none}");
    assert_eq!(browser.complaints(), Vec::<String>::new());
}
