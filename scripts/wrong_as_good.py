#!/usr/bin/env python3
"""Is anything wrong shown as good? Disturbs frames of clips of known truth in some 70 ways, reconstructs them
and scores the verdicts: status, true error in the deformed zone, stated error.

    for s in "uterus 101" "liver 102" "patch 103"; do set -- $s
        dsfms synth --video --organ $1 --seed $2 --frames 100 --size 640x360 -o clips/$2; done
    python3 scripts/wrong_as_good.py --dsfms target/release/dsfms --out scored clips/101 clips/102 clips/103

Frames are disturbed where the organ is deformed most; occluders lie on the deformed zone. The zone is the
visible part of what moved by at least half of the largest displacement, its error the root mean square in mm,
absolute. The stated bound is that of frame_NNN.json: the 90th percentile of the expected error over the visible
vertices. Wrong as good: `ok`, an error above three medians of the undisturbed ok frames, and above the stated
bound. Prints the table as Markdown; scored/rows.json holds every frame. Needs numpy and pillow.
"""
import argparse
import json
import shutil
import subprocess
import zlib
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

UNDISTURBED = "undisturbed"
WRONG = 3.0  # an ok frame may be wrong by so many medians
APART = 15  # frames between two that are disturbed
FACES = {}


def linear(image):
    a = np.asarray(image, float) / 255.0
    return np.where(a <= 0.04045, a / 12.92, ((a + 0.055) / 1.055) ** 2.4)


def encoded(a):
    a = np.clip(a, 0, 1)
    a = np.where(a <= 0.0031308, a * 12.92, 1.055 * a ** (1 / 2.4) - 0.055)
    return (a * 255 + 0.5).astype(np.uint8)


def read_ply(path):
    """Vertices and faces of a binary PLY as dsfms writes it."""
    data = Path(path).read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    kinds = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4"}
    count, faces, fields = 0, 0, []
    for line in data[:end].decode().splitlines():
        words = line.split()
        if words[:2] == ["element", "vertex"]:
            count = int(words[2])
        if words[:2] == ["element", "face"]:
            faces = int(words[2])
        if words[0] == "property" and words[1] != "list":
            fields.append((words[2], kinds[words[1]]))
    table = np.frombuffer(data, np.dtype(fields), count, end)
    rest = np.frombuffer(data, np.dtype([("n", "u1"), ("v", "<i4", 3)]), faces, end + table.nbytes)
    return np.stack([table[c] for c in "xyz"], 1).astype(float), rest["v"]


class Clip:
    def __init__(self, folder):
        self.folder = Path(folder)
        self.name = self.folder.name
        truth = np.load(self.folder / "truth/clip.npz")
        self.vertices, self.visible = truth["vertices"].astype(float), truth["visible"].astype(bool)
        self.zone, self.moved = truth["zone"].astype(bool), truth["displacement"]
        self.camera = json.loads((self.folder / "camera.json").read_text())
        self.faces = read_ply(self.folder / "rest.ply")[1]

    def frame(self, k):
        return np.asarray(Image.open(self.folder / f"frames/frame_{k:03}.png").convert("RGB"))

    def mask(self, k):
        return self.folder / f"truth/instruments/frame_{k:03}.png"

    def clear(self):
        return [k for k in range(len(self.vertices)) if self.visible[k].any()]

    def most_deformed(self, count):
        kept = []
        for k in sorted(self.clear(), key=lambda k: -self.moved[k].max()):
            if all(abs(k - other) >= APART for other in kept):
                kept.append(k)
        return kept[:count]

    def measured(self, k):
        zone = self.zone[k] & self.visible[k]
        return zone if zone.any() else self.visible[k]

    def error(self, k, shape):
        away = shape[self.measured(k)] - self.vertices[k][self.measured(k)]
        return float(np.sqrt((away**2).sum(1).mean()))

    def pixels(self, k):
        c, x = self.camera, self.vertices[k]
        return np.stack([c["fx"] * x[:, 0] / x[:, 2] + c["cx"], c["fy"] * x[:, 1] / x[:, 2] + c["cy"]], 1)

    def matches(self, k, count=400):
        """Face, barycentrics and pixel of visible points inside faces, exact."""
        rng = np.random.default_rng(k)
        seen = self.visible[k][self.faces].all(1)
        faces = rng.choice(np.flatnonzero(seen), count)
        weights = rng.dirichlet([1, 1, 1], count)
        points = (self.vertices[k][self.faces[faces]] * weights[..., None]).sum(1)
        c = self.camera
        u = c["fx"] * points[:, 0] / points[:, 2] + c["cx"]
        v = c["fy"] * points[:, 1] / points[:, 2] + c["cy"]
        return np.column_stack([faces, weights, u, v])

    def outline(self, k, shape):
        """About where the organ appears: near a projected visible vertex."""
        near = np.zeros(shape, bool)
        for x, y in self.pixels(k)[self.visible[k]].round().astype(int):
            near[max(0, y - 9) : y + 10, max(0, x - 9) : x + 10] = True
        return near


def hidden(clip, k, shape, share, disc):
    """A share of the organ's outline: a disc about the deformed zone, or one side."""
    centre = clip.pixels(k)[clip.measured(k)].mean(0)
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]]
    order = np.hypot(x - centre[0], y - centre[1]) if disc else x * np.cos(k) + y * np.sin(k)
    return order <= np.quantile(order[clip.outline(k, shape)], share)


def disturbances(clip, other, k):
    """Name, picture and what else differs: camera, matches, template, masks."""
    image, shape = clip.frame(k), clip.frame(k).shape[:2]
    h, w = shape
    light = linear(image)
    y, x = np.mgrid[0:h, 0:w]
    foreign = other.frame(other.most_deformed(1)[0])
    late = clip.frame(clip.clear()[(clip.clear().index(k) + len(clip.clear()) // 2) % len(clip.clear())])

    def painted(where, colour):
        return np.where(where[..., None], colour, image).astype(np.uint8)

    yield "other organ", foreign, {}
    yield "other template", image, {"template": other}
    yield "mirrored", image[:, ::-1], {}
    yield "upside down", image[::-1], {}
    yield "instruments without masks", image, {"masked": False}
    yield "cut: right half of another moment", painted(x > w / 2, late), {}
    yield "lower half grey (file cut off)", painted(y > h / 2, 128), {}
    yield "rows torn", np.where((y // 40 % 2 == 1)[..., None], np.roll(image, -60, 1), image), {}
    for veil in (0.4, 0.6, 0.8):
        yield f"fog {veil:.0%}", encoded(light * (1 - veil) + 0.35 * veil), {}
        cloud = (veil * (0.5 + 0.5 * np.sin(x / 67 + np.sin(y / 53))))[..., None]
        yield f"smoke {veil:.0%}", encoded(light * (1 - cloud) + 0.35 * cloud), {}
    for share in (0.3, 0.6):
        pool = hidden(clip, k, shape, share, True)[..., None]
        blood = light * [0.25, 0.1, 0.1] + [0.08, 0, 0]
        yield f"blood {share:.0%}", encoded(np.where(pool, blood, light)), {}
    for sigma in (2, 4, 8):
        yield f"blur {sigma} px", np.asarray(Image.fromarray(image).filter(ImageFilter.GaussianBlur(sigma))), {}
    for gain in (0.3, 3.0):
        yield f"exposure x {gain}", encoded(light * gain), {}
    yield "white balance", encoded(light * [1.3, 1.0, 0.7]), {}
    yield "tone: linear values", (255 * light).astype(np.uint8), {}
    noise = np.random.default_rng(k).normal(0, 20, image.shape)
    yield "noise of 20 grey values", np.clip(image + noise, 0, 255).astype(np.uint8), {}
    for share in (0.1, 0.3, 0.5, 0.7, 0.9):
        for name, disc in (("disc", True), ("side", False)):
            where = hidden(clip, k, shape, share, disc)
            yield f"occluder grey {name} {share:.0%}", painted(where, 120), {}
            yield f"occluder dark {name} {share:.0%}", painted(where, [18, 12, 12]), {}
            yield f"occluder tissue {name} {share:.0%}", painted(where, foreign), {}
    c = clip.camera
    focal = lambda by: {"camera": {**c, "fx": c["fx"] * by, "fy": c["fy"] * by}}
    yield "focal length x 1.05", image, focal(1.05)
    yield "focal length x 1.5", image, focal(1.5)
    yield "focal length / 1.5", image, focal(1 / 1.5)
    yield "principal point + 60 px", image, {"camera": {**c, "cx": c["cx"] + 60}}
    yield "distortion k1 = -0.3", image, {"camera": {**c, "distortion": {"k1": -0.3}}}
    m, rng = clip.matches(k), np.random.default_rng(k)
    u, v, n = m[:, 4], m[:, 5], len(m)
    centre = clip.pixels(k)[clip.measured(k)].mean(0)
    away = np.hypot(u - centre[0], v - centre[1])

    def moved(where, by):
        found = m.copy()
        found[where, 4] += by
        return {"matches": found}

    slanted = m[np.abs(v - 0.3 * h - 0.4 * h * u / w) < 5] + rng.normal(0, 1, (n, 6))[: (np.abs(v - 0.3 * h - 0.4 * h * u / w) < 5).sum()] * [0, 0, 0, 0, 1, 1]
    yield "matches on a line", image, {"matches": m[np.abs(v - np.median(v)) < 4]}
    yield "matches on a slanted line, noise 1 px", image, {"matches": slanted}
    small = np.hypot(u - np.median(u), v - np.median(v)) < 0.05 * w
    yield "matches of one small patch", image, {"matches": m[small]}
    yield "four matches, 125 times each", image, {"matches": np.repeat(m[:4], 125, 0)}
    yield "matches on one half", image, {"matches": m[u < np.median(u)]}
    yield "25 matches far from the zone", image, {"matches": m[away > 0.2 * w][:25]}
    yield "matches shuffled", image, {"matches": np.column_stack([m[:, :4], np.roll(m[:, 4:], n // 2, 0)])}
    wild = m.copy()
    wild[::3, 4:] = rng.uniform(0, 1, (len(wild[::3]), 2)) * [w - 1, h - 1]
    yield "a third of the matches random", image, {"matches": wild}
    yield "matches of the zone 15 px off", image, moved(away < 0.12 * w, 15)
    yield "all matches 10 px to the right", image, moved(np.ones(n, bool), 10)


def put(folder, name, image, extra, clip, k):
    """Write one frame beside those that share template and camera; returns the group."""
    template = extra.get("template", clip).name
    camera = extra.get("camera", clip.camera)
    given = "matches" in extra
    masked = extra.get("masked", True)
    group = folder / f"{template}-{zlib.crc32(json.dumps(camera, sort_keys=True).encode())}-{given:d}{masked:d}"
    (group / "frames").mkdir(parents=True, exist_ok=True)
    number = len(list((group / "frames").iterdir()))
    stem = f"f_{number:04}"
    Image.fromarray(np.ascontiguousarray(image)).save(group / f"frames/{stem}.png", compress_level=1)
    (group / "camera.json").write_text(json.dumps(camera))
    if masked:
        (group / "masks").mkdir(exist_ok=True)
        shutil.copy(clip.mask(k), group / f"masks/{stem}.png")
    if given:
        rows = extra["matches"]
        rows = rows[(rows[:, 4] > 0) & (rows[:, 4] < image.shape[1] - 1)]
        rows = rows[(rows[:, 5] > 0) & (rows[:, 5] < image.shape[0] - 1)]
        (group / "matches").mkdir(exist_ok=True)
        text = "".join(f"{int(r[0])},{r[1]:.9f},{r[2]:.9f},{1 - r[1] - r[2]:.9f},{r[4]:.4f},{r[5]:.4f}\n" for r in rows)
        (group / f"matches/{stem}.csv").write_text("face,b1,b2,b3,x,y\n" + text)
    return group, number


def solve(group, template, method, arguments):
    out = group / f"out-{method}"
    command = [arguments.dsfms, "reconstruct", template / "organ.template", group / "frames"]
    command += ["--camera", group / "camera.json", "--method", method, "--no-report", "-o", out]
    for option in ("masks", "matches"):
        if (group / option).exists():
            command += ["--instrument-masks" if option == "masks" else "--matches", group / option]
    if arguments.options:
        command += ["--options", arguments.options]
    subprocess.run([str(c) for c in command], capture_output=True)
    return out


def outcome(clip, k, out, number):
    report = json.loads((out / f"frame_{number:03}.json").read_text())
    row = {"status": report["status"], "reasons": report["reasons"], "doubts": report.get("doubts", [])}
    surface = out / f"frame_{number:03}.ply"
    if report["status"] != "failed" and surface.exists():
        shape = read_ply(surface)[0]
        same = len(shape) == len(clip.vertices[k])
        row["error"] = clip.error(k, shape) if same else float("inf")
        row["stated"] = report.get("expected_error", {}).get("visible_p90", 0.0)
    return row


def scored(clips, arguments):
    rows = []
    folder = Path(arguments.out)
    shutil.rmtree(folder / "work", ignore_errors=True)
    for i, clip in enumerate(clips):
        other, jobs = clips[(i + 1) % len(clips)], []
        work = folder / "work" / clip.name
        for k in clip.clear()[1 :: arguments.every]:
            jobs.append((UNDISTURBED, k, *put(work, "", clip.frame(k), {}, clip, k), clip))
        for k in clip.most_deformed(arguments.frames):
            for kind, image, extra in disturbances(clip, other, k):
                target = put(work, kind, image, extra, clip, k)
                jobs.append((kind, k, *target, extra.get("template", clip)))
        for method in arguments.methods.split(","):
            outs = {g: solve(g, t.folder, method, arguments) for g, t in {j[2]: j[4] for j in jobs}.items()}
            for kind, k, group, number, _ in jobs:
                row = {"clip": clip.name, "frame": k, "kind": kind, "method": method}
                rows.append(row | outcome(clip, k, outs[group], number))
    return rows


def names(rows):
    counts = {}
    for r in rows:
        for d in r["doubts"] or ([{"reason": "no_pose"}] if r["status"] == "failed" else []):
            counts[d["reason"]] = counts.get(d["reason"], 0) + 1
    return ", ".join(f"{n} {c}" for n, c in sorted(counts.items(), key=lambda p: (-p[1], p[0]))[:4])


def report(rows, methods):
    frames = {(r["clip"], r["frame"], r["kind"]) for r in rows}
    disturbed = sum(f[2] != UNDISTURBED for f in frames)
    print(f"{disturbed} disturbed frames, {len(frames) - disturbed} undisturbed.\n")
    for method in methods:
        of = [r for r in rows if r["method"] == method]
        plain = [r for r in of if r["kind"] == UNDISTURBED]
        rest = [r for r in of if r["kind"] != UNDISTURBED]
        usual = float(np.median([r["error"] for r in plain if r["status"] == "ok"] or [np.nan]))
        bad = [r for r in of if r["status"] == "ok" and r["error"] > max(WRONG * usual, r["stated"])]
        alarms = [r for r in plain if r["status"] != "ok"]
        passed = sum(r["status"] == "ok" for r in rest)
        print(f"{method}: median zone error of undisturbed ok frames {usual:.2f} mm; false alarms {len(alarms)} of "
              f"{len(plain)}; {passed} of {len(rest)} disturbed frames ok; **wrong as good: {len(bad)}**\n")
        for r in alarms:
            print(f"- false alarm {r['clip']} frame {r['frame']}: {names([r])} (error {r.get('error', np.nan):.2f} mm)")
        for r in bad:
            print(f"- wrong {r['clip']} frame {r['frame']} {r['kind']}: {r['error']:.2f} mm, stated {r['stated']:.2f}")
        print()
    print("| disturbance |" + "".join(f" {m}: ok / degraded / failed | worst ok, mm (stated) |" for m in methods)
          + " reasons |\n| --- |" + " --- |" * (2 * len(methods) + 1))
    for kind in dict.fromkeys(r["kind"] for r in rows):
        cells = []
        for method in methods:
            of = [r for r in rows if r["kind"] == kind and r["method"] == method]
            counts = [sum(r["status"] == s for r in of) for s in ("ok", "degraded", "failed")]
            worst = max((r for r in of if r["status"] == "ok"), key=lambda r: r["error"], default=None)
            shown = f"{worst['error']:.2f} ({worst['stated']:.2f})" if worst else ""
            cells.append(f" {counts[0]} / {counts[1]} / {counts[2]} | {shown} |")
        print(f"| {kind} |{''.join(cells)} {names([r for r in rows if r['kind'] == kind])} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clips", nargs="+", help="folders of dsfms synth --video, two organs or more")
    parser.add_argument("--dsfms", default="dsfms")
    parser.add_argument("--out", default="scored")
    parser.add_argument("--options", help="TOML for reconstruct")
    parser.add_argument("--methods", default="joint,dsfm")
    parser.add_argument("--frames", type=int, default=2, help="frames of a clip that are disturbed")
    parser.add_argument("--every", type=int, default=4, help="every so-manieth frame is taken undisturbed")
    arguments = parser.parse_args()
    rows = scored([Clip(c) for c in arguments.clips], arguments)
    Path(arguments.out, "rows.json").write_text(json.dumps(rows, indent=1))
    report(rows, arguments.methods.split(","))


if __name__ == "__main__":
    main()
