//! Whether the page can be read and reached: contrast, order of the focus, sizes of what is
//! touched; and the rules of axe-core, where `DSFMS_AXE` names its `axe.min.js`.

use super::*;

/// Texts whose contrast is below what WCAG 2 asks for (1.4.3).
const PALE: &str = r"(() => {
  const parse = (text) => {
    const n = text.match(/-?[\d.]+(e-?\d+)?/g).map(Number), unit = text.startsWith('color(') ? 255 : 1;
    return [n[0] * unit, n[1] * unit, n[2] * unit, n[3] ?? 1];
  };
  const over = (top, below) => [0, 1, 2].map((i) => top[3] * top[i] + (1 - top[3]) * below[i]).concat(1);
  const ground = (e) => {
    const layers = [];
    for (; e; e = e.parentElement) {
      const c = parse(getComputedStyle(e).backgroundColor);
      if (c[3] > 0) layers.push(c);
      if (c[3] >= 1) break;
    }
    return layers.reverse().reduce((below, top) => over(top, below), [255, 255, 255, 1]);
  };
  const light = (c) => c.slice(0, 3).map((v) => v / 255).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const pale = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode, e = node.parentElement, style = getComputedStyle(e);
    // A swatch is no text.
    if (!/[\p{L}\p{N}]/u.test(node.data) && e.closest('[aria-hidden=true]')) continue;
    if (!node.data.trim() || /SCRIPT|STYLE|OPTION|NOSCRIPT/.test(e.tagName) || !e.checkVisibility({ visibilityProperty: true })) continue;
    const below = ground(e), ink = over(parse(e.closest('svg') ? style.fill : style.color), below);
    const [a, b] = [light(ink), light(below)].sort((x, y) => y - x), ratio = (a + 0.05) / (b + 0.05);
    const large = parseFloat(style.fontSize) >= 24 || (parseFloat(style.fontSize) >= 18.6 && style.fontWeight >= 700);
    if (ratio < (large ? 3 : 4.5)) pale.push(`${node.data.trim().slice(0, 30)}: ${ratio.toFixed(2)}`);
  }
  return pale;
})()";

/// What axe-core finds; its own texts are left out.
const AXE: &str = "axe.run(document, { resultTypes: ['violations'], runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', \
    'wcag21aa', 'wcag22aa', 'best-practice'] }).then((r) => r.violations.map((v) => \
    `${v.id}: ${v.nodes.slice(0, 3).map((n) => n.html.slice(0, 120)).join(' | ')}`))";

#[test]
fn everything_can_be_read_and_reached() {
    let case = reconstructed();
    let Some(mut browser) = browser(&case) else { return };
    let url = format!("file://{}", case.path("two/dsfm/report.html").display());
    browser.open(&url, READY);
    choose(&mut browser, "layer", "strain");
    for scheme in ["light", "dark"] {
        browser.scheme(scheme);
        for size in [[1440, 900], [390, 844]] {
            browser.resize(size);
            browser.eval("new Promise((done) => setTimeout(done, 200))");
            assert_eq!(browser.eval(PALE), serde_json::json!([]), "{scheme} {size:?}");
        }
    }
    order(&mut browser);
    touchable(&mut browser);
    axe(&mut browser);
}

/// Tab goes through everything once, in the order of the page, and shows where it is.
fn order(browser: &mut Browser) {
    browser.resize([1440, 900]);
    browser.eval(
        "(() => { scrollTo(0, 0); window.seen = []; document.activeElement.blur(); \
         document.addEventListener('focusin', (e) => seen.push(e.target)); })()",
    );
    let count = browser.eval(
        "[...document.querySelectorAll('button,select,input,summary,[tabindex=\"0\"]')]\
         .filter((e) => e.checkVisibility({ visibilityProperty: true }) && !e.disabled).length",
    );
    for _ in 0..count.as_u64().unwrap() {
        browser.key("Tab");
        let shown = browser.eval("getComputedStyle(document.activeElement).outlineStyle");
        assert_ne!(shown, "none", "{}", browser.eval("document.activeElement.outerHTML"));
    }
    let ordered = "seen.every((e, i) => !i || seen[i - 1].compareDocumentPosition(e) & 4)";
    assert_eq!(browser.eval(ordered), true);
    let reached = browser.eval("new Set(seen).size").as_u64().unwrap();
    assert!(reached + 3 >= count.as_u64().unwrap() && reached > 25, "{reached} of {count}");
}

/// On a phone what is pressed is at least 24 px wide and high (WCAG 2.5.8).
fn touchable(browser: &mut Browser) {
    browser.resize([390, 844]);
    browser.call("Emulation.setTouchEmulationEnabled", serde_json::json!({"enabled": true}));
    let small = browser.eval(
        "[...document.querySelectorAll('button,select,input[type=number]')]\
         .filter((e) => e.checkVisibility() && (e.offsetWidth < 24 || e.offsetHeight < 24)).map((e) => e.id)",
    );
    assert_eq!(small, serde_json::json!([]));
}

fn axe(browser: &mut Browser) {
    let Some(path) = std::env::var_os("DSFMS_AXE") else {
        println!(
            "skipped: axe-core (npm install axe-core, DSFMS_AXE=node_modules/axe-core/axe.min.js)"
        );
        return;
    };
    let code = std::fs::read_to_string(path).unwrap();
    browser.resize([1440, 900]);
    browser.eval(&format!("{code};0"));
    for scheme in ["light", "dark"] {
        browser.scheme(scheme);
        browser.eval("new Promise((done) => setTimeout(done, 200))");
        assert_eq!(browser.eval(AXE), serde_json::json!([]), "{scheme}");
    }
}
