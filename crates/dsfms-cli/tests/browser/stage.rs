//! The stage: all of it at once, keys, pointers, touch, values under the pointer, pictures, links.

use super::*;
use serde_json::json;

const FRAME: &str = "dsfms.state.frame";
/// What a link must bring back, to four digits.
const VIEW: &str = "JSON.stringify([dsfms.state.frame, dsfms.state.layer.id, dsfms.state.layer.limit, \
    Object.values(dsfms.lens).map((v) => v.toFixed(3)), dsfms.place().map((v) => (v + 1e-9).toFixed(2)), \
    document.getElementById('edges').checked, document.getElementById('cut-axis').value, \
    document.getElementById('opacity').value])";

fn number(browser: &mut Browser, expression: &str) -> f64 {
    browser.eval(expression).as_f64().unwrap_or_else(|| panic!("{expression}"))
}

/// Image, 3D view, layers, timeline and buttons are in the window, and nothing is wider than it.
fn fits(browser: &mut Browser, size: [u32; 2]) {
    browser.resize(size);
    browser.eval("scrollTo(0, 0)");
    browser.eval("new Promise((done) => setTimeout(done, 300))");
    for id in ["film", "gl", "layer", "time", "frame", "play", "full", "help"] {
        let [x, y, w, h] = browser.place(id);
        let inside = x >= 0.0 && y >= 0.0 && x + w <= size[0].into() && y + h <= size[1].into();
        assert!(inside && w > 10.0 && h > 5.0, "{id} at {size:?}: {x} {y} {w} {h}");
    }
    let [_, _, wide, high] = browser.place("film");
    let [_, _, w, h] = browser.place("gl");
    let share = (wide * high + w * h) / f64::from(size[0] * size[1]);
    assert!(share > 0.55, "image and 3D view take {share} of {size:?}");
    let wide = browser.eval("document.documentElement.scrollWidth <= innerWidth");
    assert_eq!(wide, true, "wider than the window at {size:?}");
    assert!(browser.eval(COVERED).as_f64().unwrap() > 0.02, "{size:?}");
    keep(browser, &format!("stage-{}x{}", size[0], size[1]));
}

#[test]
fn the_stage_fills_the_window_and_obeys_keys_pointers_and_links() {
    let case = reconstructed();
    let Some(mut browser) = browser(&case) else { return };
    let url = format!("file://{}", case.path("two/dsfm/report.html").display());
    browser.open(&url, READY);
    fits(&mut browser, [390, 844]);
    fits(&mut browser, [800, 1000]);
    fits(&mut browser, [1440, 900]);
    keys(&mut browser);
    image(&mut browser);
    hover(&mut browser);
    pictures(&mut browser);
    link(&mut browser, &url);
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

/// Without the focus on anything; never those of a field.
fn keys(browser: &mut Browser) {
    browser.key("ArrowRight");
    assert_eq!(browser.eval(FRAME), 1);
    browser.key("ArrowLeft");
    assert_eq!(browser.eval(FRAME), 0);
    browser.key(" ");
    assert_eq!(
        browser.eval("document.getElementById('play').getAttribute('aria-pressed')"),
        "true"
    );
    browser.key(" ");
    assert_eq!(browser.eval("dsfms.state.playing"), 0);
    browser.key("Home");
    for (key, id) in [("e", "edges"), ("s", "shading"), ("m", "matches"), ("w", "wipe")] {
        let checked = format!("document.getElementById('{id}').checked");
        let before = browser.eval(&checked);
        browser.key(key);
        assert_ne!(browser.eval(&checked), before, "{key}");
        browser.key(key);
        assert_eq!(browser.eval(&checked), before, "{key}");
    }
    browser.eval("document.getElementById('vertex-a').focus({ preventScroll: true })");
    browser.key("e");
    browser.key("ArrowRight");
    let kept = browser.eval("[document.getElementById('edges').checked, dsfms.state.frame]");
    assert_eq!(kept, json!([false, 0]), "a key was taken from a field");
    browser.eval("document.activeElement.blur()");
    browser.key("?");
    assert_eq!(browser.eval("document.getElementById('keys').open"), true);
    let listed = browser.eval("document.getElementById('keys').innerText");
    for key in ["Space", "full screen", "wipe"] {
        assert!(listed.as_str().unwrap().contains(key), "{listed}");
    }
    keep(browser, "stage-keys");
    browser.key("Escape");
    browser.wait("!document.getElementById('keys').open");
    browser.key("f");
    browser.wait("document.fullscreenElement && document.fullscreenElement.id === 'stage'");
    browser.key("f");
    browser.wait("!document.fullscreenElement");
}

/// Zoom and moving about by wheel, keys, mouse and fingers; the wipe.
fn image(browser: &mut Browser) {
    let [x, y, w, h] = browser.place("film");
    let middle = [x + 0.5 * w, y + 0.5 * h];
    let quarter = [x + 0.25 * w, y + 0.5 * h];
    browser.wheel(middle, -100.0);
    let wheel = number(browser, "dsfms.lens.zoom");
    assert!(wheel > 1.1, "{wheel}");
    browser.point(middle, false);
    browser.key("+");
    assert!(number(browser, "dsfms.lens.zoom") > wheel);
    browser.drag(middle, quarter);
    assert!(number(browser, "dsfms.lens.x") > 0.55);
    browser.key("0");
    assert_eq!(number(browser, "dsfms.lens.zoom"), 1.0);
    browser.key("w");
    browser.drag(middle, quarter);
    assert!((number(browser, "dsfms.lens.wipe") - 0.25).abs() < 0.02);
    let clip = browser.eval("document.getElementById('overlay').style.clipPath");
    assert!(clip.as_str().unwrap().contains("25"), "{clip}");
    keep(browser, "stage-wipe");
    browser.key("w");

    browser.call("Emulation.setTouchEmulationEnabled", json!({"enabled": true}));
    let pair = |[x, y]: [f64; 2], d: f64| vec![[x - d, y], [x + d, y]];
    browser.touch(&[pair(middle, 20.0), pair(middle, 40.0), pair(middle, 60.0)]);
    let pinched = number(browser, "dsfms.lens.zoom");
    assert!((2.0..4.0).contains(&pinched), "{pinched}");
    let before = number(browser, "dsfms.lens.x");
    browser.touch(&[vec![middle], vec![[middle[0] - 30.0, middle[1]]]]);
    assert!(number(browser, "dsfms.lens.x") > before, "one finger moves it");
    browser.eval("document.getElementById('film-fit').click()");

    let [x, y, w, h] = browser.place("gl");
    let middle = [x + 0.5 * w, y + 0.5 * h];
    let place = "dsfms.place().map((v) => v.toFixed(2)).join()";
    browser.touch(&[vec![middle]]);
    assert_eq!(browser.eval("dsfms.state.picks.length"), 1, "a tap picks a point");
    browser.eval("document.getElementById('clear').click()");
    let at_first = browser.eval(place);
    browser.touch(&[vec![middle], vec![[middle[0] + 40.0, middle[1]]]]);
    let turned = browser.eval(place);
    assert_ne!(turned, at_first, "a finger turns the view");
    browser.touch(&[pair(middle, 60.0), pair(middle, 50.0), pair(middle, 40.0)]);
    assert_ne!(browser.eval(place), turned, "two fingers zoom the view");
    browser.call("Emulation.setTouchEmulationEnabled", json!({"enabled": false}));
    browser.eval("document.querySelector('[data-view=camera]').click()");
}

/// Values on the surface, over the image, in the charts, and charts that follow and lead.
fn hover(browser: &mut Browser) {
    choose(browser, "layer", "expected_error");
    for pane in ["gl", "film"] {
        let [x, y, w, h] = browser.place(pane);
        browser.point([x + 0.5 * w, y + 0.45 * h], false);
        browser.point([x + 0.5 * w, y + 0.5 * h], false);
        let tip = if pane == "gl" { "tip" } else { "film-tip" };
        browser.wait(&format!("!document.getElementById('{tip}').hidden"));
        let text = browser.eval(&format!("document.getElementById('{tip}').innerText"));
        let text = text.as_str().unwrap();
        for word in ["vertex ", "expected error: ", " mm", "depth from the camera: "] {
            assert!(text.contains(word), "{pane}: {text}");
        }
    }
    // The expected error of a vertex is the one that the page holds.
    let residuals =
        "dsfms.data.frames[0].surfaces[0].matches.filter((m) => m[2]).every((m) => m.length === 5)";
    assert_eq!(browser.eval(residuals), true, "matches have a residual");

    let chart = "document.querySelector('svg[data-by=frame]:not(.strip)')";
    browser.eval(&format!("{chart}.scrollIntoView({{ block: 'center' }})"));
    let found = browser.eval(&format!(
        "(() => {{ const b = {chart}.getBoundingClientRect(); return [b.x, b.y, b.width, b.height]; }})()"
    ));
    let [x, y, w, h] = std::array::from_fn(|i| found[i].as_f64().unwrap());
    let right = [x + 0.75 * w, y + 0.4 * h];
    browser.point(right, false);
    let text = browser.eval(&format!("{chart}.parentElement.querySelector('.tip').innerText"));
    assert!(text.as_str().unwrap().starts_with("frame 004"), "{text}");
    let line = format!("{chart}.querySelector('.cursor.now').getAttribute('x1')");
    let before = browser.eval(&line);
    browser.click(right[0], right[1]);
    assert_eq!(browser.eval(FRAME), 1, "a click on a chart goes to its frame");
    assert_ne!(browser.eval(&line), before, "the line of a chart follows the frame");
    keep(browser, "stage-chart");
    browser.eval("scrollTo(0, 0)");
}

/// PNG of both panes, at least as fine as the screen.
fn pictures(browser: &mut Browser) {
    browser.eval(
        "(() => { window.saved = []; URL.createObjectURL = (b) => { \
         createImageBitmap(b).then((i) => saved.push([b.type, i.width, i.height])); return 'blob:none'; }; \
         HTMLAnchorElement.prototype.click = function () { saved.push(this.download); }; })()",
    );
    browser.key("p");
    browser.wait("saved.length === 2");
    browser.key("i");
    browser.wait("saved.length === 4");
    let saved = browser.eval("saved.map((s) => Array.isArray(s) ? s.join() : s).sort().join(' ')");
    let saved = saved.as_str().unwrap();
    assert!(saved.contains("_3d.png") && saved.contains("_image.png"), "{saved}");
    let [_, _, w, _] = browser.place("gl");
    assert!(saved.contains(&format!("image/png,{}", (2.0 * w).floor())), "{saved} for {w}");
    assert!(saved.contains("image/png,1600,1200"), "{saved}");
}

/// The address brings a view back, and one that means nothing does no harm.
fn link(browser: &mut Browser, url: &str) {
    choose(browser, "frame", "1");
    choose(browser, "layer", "strain");
    choose(browser, "limit", "7");
    choose(browser, "opacity", "35");
    choose(browser, "cut-axis", "view");
    browser.key("3");
    browser.key("e");
    let [x, y, w, h] = browser.place("film");
    browser.wheel([x + 0.3 * w, y + 0.5 * h], -120.0);
    let view = browser.eval(VIEW);
    browser.wait("location.hash === dsfms.link()");
    let hash = browser.eval("location.hash");
    browser.open("about:blank", "true");
    browser.open(&format!("{url}{}", hash.as_str().unwrap()), READY);
    assert_eq!(browser.eval(VIEW), view);
    let odd =
        "#view:frame=nowhere&layer=__proto__&eye=1,2&lens=x&picks=-1,9&cut=<b>&limit=-3&methods=||";
    browser.open("about:blank", "true");
    browser.open(&format!("{url}{odd}"), READY);
    assert_eq!(browser.eval(FRAME), 0);
    assert!(browser.eval(COVERED).as_f64().unwrap() > 0.05);
}
