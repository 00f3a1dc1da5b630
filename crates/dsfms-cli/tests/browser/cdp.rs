//! Headless Chromium by its debugging pipe: the child's standard input and output become the file
//! descriptors 3 and 4 that `--remote-debugging-pipe` speaks on.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

/// Software rendering, and nothing that goes out by itself.
const FLAGS: &str = "--headless --no-sandbox --disable-quic --no-first-run \
    --disable-background-networking --disable-component-update --disable-sync \
    --disable-dev-shm-usage --hide-scrollbars --use-gl=angle --use-angle=swiftshader \
    --enable-unsafe-swiftshader --remote-debugging-pipe";

/// On a loaded machine the software renderer takes its time.
const PATIENCE: Duration = Duration::from_secs(240);

/// A browser with one page.
pub struct Browser {
    child: Child,
    pipe: ChildStdin,
    messages: Receiver<Value>,
    next: u64,
    session: Option<String>,
    /// Everything that the page told by itself.
    pub events: Vec<Value>,
}

/// The program, where it is installed.
pub fn chromium() -> Option<&'static str> {
    let runs = |name: &&str| {
        let quiet = Command::new(name)
            .arg("--version")
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
        quiet.is_ok_and(|s| s.success())
    };
    ["chromium", "chromium-browser", "google-chrome"].into_iter().find(runs)
}

impl Browser {
    /// Start it with an empty profile; window size in px.
    pub fn start(program: &str, profile: &Path, size: [u32; 2]) -> Self {
        let command = format!(
            "exec {program} {FLAGS} --user-data-dir='{}' about:blank 3<&0 4>&1 0</dev/null 1>/dev/null 2>/dev/null",
            profile.display()
        );
        let mut child = Command::new("sh")
            .args(["-c", &command])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let pipe = child.stdin.take().unwrap();
        let out = BufReader::new(child.stdout.take().unwrap());
        let (send, messages) = channel();
        std::thread::spawn(move || {
            for message in out.split(0).map_while(Result::ok) {
                let Ok(value) = serde_json::from_slice(&message) else { continue };
                if send.send(value).is_err() {
                    break;
                }
            }
        });
        let mut browser =
            Self { child, pipe, messages, next: 0, session: None, events: Vec::new() };
        let targets = browser.call("Target.getTargets", json!({}));
        let pages = targets["targetInfos"].as_array().unwrap();
        let page = pages.iter().find(|t| t["type"] == "page").unwrap()["targetId"].clone();
        let session =
            browser.call("Target.attachToTarget", json!({"targetId": page, "flatten": true}));
        browser.session = Some(session["sessionId"].as_str().unwrap().to_string());
        for domain in ["Page", "Runtime", "Network", "Log"] {
            browser.call(&format!("{domain}.enable"), json!({}));
        }
        browser.resize(size);
        browser
    }

    /// Another window size.
    pub fn resize(&mut self, [width, height]: [u32; 2]) {
        let metrics = json!({"width": width, "height": height, "deviceScaleFactor": 1,
            "mobile": width < 500});
        self.call("Emulation.setDeviceMetricsOverride", metrics);
    }

    /// Light or dark.
    pub fn scheme(&mut self, name: &str) {
        let feature = json!({"name": "prefers-color-scheme", "value": name});
        self.call("Emulation.setEmulatedMedia", json!({"features": [feature]}));
    }

    /// As on paper.
    pub fn print(&mut self) {
        self.call("Emulation.setEmulatedMedia", json!({"media": "print", "features": []}));
    }

    /// Send a command and wait for its result.
    pub fn call(&mut self, method: &str, parameters: Value) -> Value {
        self.request(method, parameters).unwrap_or_else(|error| panic!("{method}: {error}"))
    }

    /// Send a command and wait for its result, or for the error that the browser answers.
    fn request(&mut self, method: &str, parameters: Value) -> Result<Value, Value> {
        self.next += 1;
        let id = self.next;
        let mut message = json!({"id": id, "method": method, "params": parameters});
        if let Some(session) = &self.session {
            message["sessionId"] = session.clone().into();
        }
        self.pipe.write_all(message.to_string().as_bytes()).unwrap();
        self.pipe.write_all(&[0]).unwrap();
        let end = Instant::now() + PATIENCE;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let answer =
                self.messages.recv_timeout(left).unwrap_or_else(|e| panic!("{method}: {e}"));
            if answer["id"] == id {
                return match &answer["error"] {
                    Value::Null => Ok(answer["result"].clone()),
                    error => Err(error.clone()),
                };
            }
            self.events.push(answer);
        }
    }

    /// The value of an expression in the page; promises are awaited.
    pub fn eval(&mut self, expression: &str) -> Value {
        self.evaluate(expression).unwrap_or_else(|error| panic!("{expression}: {error}"))
    }

    /// The same, or the error that the browser answers, or that the page throws: a new page has no
    /// names yet.
    fn evaluate(&mut self, expression: &str) -> Result<Value, Value> {
        let parameters = json!({"expression": expression, "returnByValue": true,
            "awaitPromise": true});
        let result = self.request("Runtime.evaluate", parameters)?;
        match &result["exceptionDetails"] {
            Value::Null => Ok(result["result"]["value"].clone()),
            exception => Err(exception.clone()),
        }
    }

    /// Go to a page and wait until an expression in it is true.
    pub fn open(&mut self, url: &str, ready: &str) {
        self.call("Page.navigate", json!({"url": url}));
        self.wait(ready);
    }

    /// Load the page anew and wait until an expression in the new one is true.
    pub fn reload(&mut self, ready: &str) {
        // The old page answers until the new one is there.
        self.eval("window.isOld = true");
        self.call("Page.reload", json!({}));
        self.wait(&format!("!window.isOld && !!({ready})"));
    }

    /// Press and release the mouse.
    pub fn click(&mut self, x: f64, y: f64) {
        for kind in ["mousePressed", "mouseReleased"] {
            let event = json!({"type": kind, "x": x, "y": y, "button": "left", "clickCount": 1});
            self.call("Input.dispatchMouseEvent", event);
        }
    }

    /// Move the mouse, with the left button down or not.
    pub fn point(&mut self, [x, y]: [f64; 2], down: bool) {
        let (button, buttons) = if down { ("left", 1) } else { ("none", 0) };
        let event =
            json!({"type": "mouseMoved", "x": x, "y": y, "button": button, "buttons": buttons});
        self.call("Input.dispatchMouseEvent", event);
    }

    /// Drag with the left button.
    pub fn drag(&mut self, from: [f64; 2], to: [f64; 2]) {
        let event = |kind: &str, [x, y]: [f64; 2]| json!({"type": kind, "x": x, "y": y, "button": "left", "clickCount": 1});
        self.point(from, false);
        self.call("Input.dispatchMouseEvent", event("mousePressed", from));
        self.point(to, true);
        self.call("Input.dispatchMouseEvent", event("mouseReleased", to));
    }

    /// Turn the wheel; negative = away from the user.
    pub fn wheel(&mut self, [x, y]: [f64; 2], by: f64) {
        let event = json!({"type": "mouseWheel", "x": x, "y": y, "deltaX": 0, "deltaY": by});
        self.call("Input.dispatchMouseEvent", event);
    }

    /// Fingers go down at the first places, through the others, and up.
    pub fn touch(&mut self, places: &[Vec<[f64; 2]>]) {
        for (i, fingers) in places.iter().enumerate() {
            let kind = if i == 0 { "touchStart" } else { "touchMove" };
            let points: Vec<Value> = fingers
                .iter()
                .enumerate()
                .map(|(id, [x, y])| json!({"x": x, "y": y, "id": id}))
                .collect();
            self.call("Input.dispatchTouchEvent", json!({"type": kind, "touchPoints": points}));
        }
        self.call("Input.dispatchTouchEvent", json!({"type": "touchEnd", "touchPoints": []}));
    }

    /// Place and size of an element, px.
    pub fn place(&mut self, id: &str) -> [f64; 4] {
        let found = self.eval(&format!(
            "(() => {{ const b = document.getElementById('{id}').getBoundingClientRect(); \
             return [b.x, b.y, b.width, b.height]; }})()"
        ));
        std::array::from_fn(|i| found[i].as_f64().unwrap())
    }

    /// Wait until an expression is true.
    pub fn wait(&mut self, expression: &str) {
        let end = Instant::now() + PATIENCE;
        loop {
            match self.evaluate(expression) {
                Ok(Value::Bool(true)) => return,
                Ok(_) => {}
                // The page that was asked makes room for the next one, which has no names yet and
                // is asked again.
                Err(error) if error["message"].to_string().contains("navigated") => {}
                Err(error) if error.to_string().contains("is not defined") => {}
                Err(error) => panic!("{expression}: {error}"),
            }
            assert!(Instant::now() < end, "never true: {expression}");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Press and release a key by its name.
    pub fn key(&mut self, key: &str) {
        let text = if key.chars().count() == 1 { key } else { "" };
        // What the browser itself does with a key goes by its number.
        let code = match key {
            "Tab" => 9,
            "Escape" => 27,
            "ArrowLeft" => 37,
            "ArrowRight" => 39,
            _ => 0,
        };
        for kind in ["keyDown", "keyUp"] {
            let text = if kind == "keyDown" { text } else { "" };
            let event =
                json!({"type": kind, "key": key, "text": text, "windowsVirtualKeyCode": code});
            self.call("Input.dispatchKeyEvent", event);
        }
    }

    /// Roles and names of everything that a screen reader meets.
    pub fn spoken(&mut self) -> Vec<(String, String)> {
        let tree = self.call("Accessibility.getFullAXTree", json!({}));
        let text = |node: &Value, key: &str| node[key]["value"].as_str().unwrap_or("").to_string();
        let nodes = tree["nodes"].as_array().unwrap();
        nodes
            .iter()
            .filter(|n| n["ignored"] != true)
            .map(|n| (text(n, "role"), text(n, "name")))
            .collect()
    }

    /// A screenshot as PNG bytes.
    pub fn screenshot(&mut self) -> Vec<u8> {
        let shot = self.call("Page.captureScreenshot", json!({"format": "png"}));
        decode(shot["data"].as_str().unwrap())
    }

    /// What went wrong in the page: errors, warnings of three.js, refused requests.
    pub fn complaints(&self) -> Vec<String> {
        let bad = |e: &&Value| match e["method"].as_str() {
            Some("Runtime.exceptionThrown") => true,
            Some("Runtime.consoleAPICalled") => {
                matches!(e["params"]["type"].as_str(), Some("error" | "warning"))
            }
            Some("Log.entryAdded") => {
                // The software renderer says that it is slow.
                let text = e["params"]["entry"]["text"].as_str().unwrap_or_default();
                e["params"]["entry"]["level"] == "error"
                    || (e["params"]["entry"]["level"] == "warning" && !text.contains("GPU stall"))
            }
            _ => false,
        };
        self.events.iter().filter(bad).map(Value::to_string).collect()
    }

    /// Addresses that the page asked for, data inside it left out.
    pub fn requests(&self) -> Vec<String> {
        let url = |e: &Value| {
            let sent = e["method"] == "Network.requestWillBeSent";
            sent.then(|| e["params"]["request"]["url"].as_str().unwrap_or_default().to_string())
        };
        let own = |u: &String| !u.starts_with("data:") && !u.starts_with("blob:");
        self.events.iter().filter_map(url).filter(own).collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn decode(base64: &str) -> Vec<u8> {
    let digit = |c: u8| match c {
        b'A'..=b'Z' => c - b'A',
        b'a'..=b'z' => c - b'a' + 26,
        b'0'..=b'9' => c - b'0' + 52,
        b'+' => 62,
        _ => 63,
    };
    let mut out = Vec::new();
    for chunk in base64.trim_end_matches('=').as_bytes().chunks(4) {
        let word = chunk.iter().fold(0u32, |w, &c| w << 6 | u32::from(digit(c)))
            << (6 * (4 - chunk.len()));
        out.extend_from_slice(&word.to_be_bytes()[1..chunk.len()]);
    }
    out
}
