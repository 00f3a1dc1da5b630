#!/usr/bin/env python3
"""First paint and frames a second of the viewer, in headless Chromium with software rendering.

    scripts/viewer_speed.py target/release/dsfms            # a surface of 10,000 vertices by `dsfms view`
    scripts/viewer_speed.py target/release/dsfms OUT        # any output folder, template, mesh or report.html
    scripts/viewer_speed.py target/release/dsfms --lift     # on a busy machine, as root: Chromium before all others

Prints the machine's load with every figure: on a busy machine the rates say little, the processor time of a frame more. Chromium is found on the path.
"""

import argparse
import json
import math
import os
import subprocess
import tempfile
import threading
import time
from pathlib import Path

FLAGS = """--headless --no-sandbox --disable-quic --no-first-run --disable-background-networking
--disable-component-update --disable-sync --disable-dev-shm-usage --hide-scrollbars --use-gl=angle
--use-angle=swiftshader --enable-unsafe-swiftshader --window-size=1440,900 --remote-debugging-pipe""".split()
READY = "document.querySelector('#viewer[data-ready]') !== null"
PAINT = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? NaN"
LAYERS = "[...document.getElementById('layer').options].map((o) => o.value)"
# Sixty frames to get going (the page lowers its resolution where it cannot keep up), then three seconds.
ORBIT = """new Promise((done) => { const l = document.getElementById('layer'); l.value = '%s';
l.dispatchEvent(new Event('change')); let n = -60, start = 0; const step = (now) => { if (n === 0) start = now;
n++; dsfms.orbit(0.03, 0); if (n > 0 && now - start > 3000) done([(1000 * n) / (now - start), n + 60]);
else requestAnimationFrame(step); }; requestAnimationFrame(step); })"""


class Browser:
    """Chromium by its debugging pipe, on file descriptors 3 and 4."""

    def __init__(self, profile):
        down, self.write = os.pipe()
        self.read, up = os.pipe()
        command = f"exec chromium {' '.join(FLAGS)} --user-data-dir={profile} about:blank 3<&{down} 4>&{up}"
        self.child = subprocess.Popen(["sh", "-c", command], pass_fds=[down, up], stderr=subprocess.DEVNULL)
        os.close(down)
        os.close(up)
        self.next, self.session, self.rest = 0, None, b""
        pages = [t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page"]
        target = pages[0]["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self.call("Page.enable")

    def call(self, method, **parameters):
        self.next += 1
        message = {"id": self.next, "method": method, "params": parameters}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.write, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self.rest:
                part = os.read(self.read, 1 << 20)
                if not part:
                    raise SystemExit("Chromium ended")
                self.rest += part
            one, self.rest = self.rest.split(b"\0", 1)
            answer = json.loads(one)
            if answer.get("id") == self.next:
                return answer.get("result", {})

    def eval(self, expression):
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        return result.get("result", {}).get("value")

    def open(self, url, seconds=60):
        self.call("Page.navigate", url="about:blank")
        time.sleep(0.3)
        self.call("Page.navigate", url=url)
        end = time.time() + seconds
        while self.eval(READY) is not True:
            if time.time() > end:
                raise SystemExit(f"{url} does not become ready")
            time.sleep(0.1)


def surface(path, side=100):
    """A wavy square of side x side vertices, mm."""
    unit = [2 * i / (side - 1) - 1 for i in range(side)]
    rows = [(40 * x, 40 * y, 100 - 20 * math.exp(-3 * (x * x + y * y)) + 3 * math.sin(9 * x) * math.cos(7 * y))
            for y in unit for x in unit]
    corners = [v for r in range(side - 1) for v in range(r * side, r * side + side - 1)]
    faces = [f for v in corners for f in ((v, v + side, v + 1), (v + 1, v + side, v + side + 1))]
    head = ("ply\nformat ascii 1.0\ncomment unit mm\n"
            f"element vertex {len(rows)}\nproperty float x\nproperty float y\nproperty float z\n"
            f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n")
    body = [f"{x:.4f} {y:.4f} {z:.4f}" for x, y, z in rows] + [f"3 {a} {b} {c}" for a, b, c in faces]
    path.write_text(head + "\n".join(body) + "\n")


def threads(pid):
    for task in Path(f"/proc/{pid}/task").glob("*"):
        yield int(task.name)
        try:
            for child in (task / "children").read_text().split():
                yield from threads(int(child))
        except OSError:
            pass


def processor_time(pid):
    """Seconds that a process and its children have had of all cores."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        children = [child for task in Path(f"/proc/{pid}/task").glob("*") for child in (task / "children").read_text().split()]
    except OSError:
        return 0.0
    own = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return own + sum(map(processor_time, set(children)))


def lift(pid):
    while True:
        for task in list(threads(pid)):
            try:
                os.setpriority(os.PRIO_PROCESS, task, -15)
            except OSError:
                pass
        time.sleep(0.4)


def measure(url, raised):
    load = lambda: f"load {os.getloadavg()[0]:.0f}"
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        browser = Browser(profile)
        try:
            if raised:
                threading.Thread(target=lift, args=[browser.child.pid], daemon=True).start()
                time.sleep(1)
            for visit in ("first", "second", "third"):
                browser.open(url)
                paint, ready = browser.eval(PAINT) / 1000, browser.eval("performance.now()") / 1000
                print(f"{visit} visit: first paint {paint:.2f} s, viewer ready within {ready:.2f} s ({load()})", flush=True)
            print(browser.eval("dsfms.data.vertices"), "vertices")
            for layer in browser.eval(LAYERS):
                before = processor_time(browser.child.pid)
                (rate, frames), sharp = browser.eval(ORBIT % layer), browser.eval("dsfms.sharpness()")
                cost = 1000 * (processor_time(browser.child.pid) - before) / frames
                print(f"orbit, {layer}: {rate:.1f} frames a second, {cost:.0f} ms of processor time each, at {sharp:.2f} of the "
                      f"pixels a side ({load()})", flush=True)
        finally:
            browser.child.terminate()
            browser.child.wait()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dsfms")
    parser.add_argument("path", nargs="?")
    parser.add_argument("--lift", action="store_true")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = args.path or str(Path(folder) / "surface.ply")
        if not args.path:
            surface(Path(path))
        server = subprocess.Popen([args.dsfms, "view", path, "--no-open"], stdout=subprocess.PIPE, text=True)
        try:
            measure(server.stdout.readline().strip(), args.lift)
        finally:
            server.terminate()
            server.wait()


if __name__ == "__main__":
    main()
