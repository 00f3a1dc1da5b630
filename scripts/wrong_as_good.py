#!/usr/bin/env python3
"""Is anything wrong shown as good? Disturbs frames of clips of known truth in some 75 ways and stretches of
them in 24, reconstructs and tracks them and scores the verdicts: status, true error in the deformed zone,
stated error.

    for s in "uterus 101" "liver 102" "patch 103"; do set -- $s
        dsfms synth --video --organ $1 --seed $2 --frames 100 --size 640x360 -o clips/$2; done
    python3 scripts/wrong_as_good.py --dsfms target/release/dsfms --out scored clips/101 clips/102 clips/103

Frames are disturbed where the organ is deformed most; occluders lie on the deformed zone. The zone is the
visible part of what moved by at least half of the largest displacement, its error the root mean square in mm,
absolute.

What is stated for the zone is the root mean square of the expected errors (`expected_error` of frame_NNN.ply) over
the same vertices, and its 90 % bound is `expected_error.bound` of frame_NNN.json times that. The bound is stated for
a single vertex: nine of ten are off by less than so many expected errors. The errors of one zone go together, as a
bulge is too flat as a whole. If each is the same multiple of its expected error, so is their root mean square of the
stated one, and the multiple stays below the bound in nine cases of ten; were they independent, the bound would be
kept more often than that.

Wrong as good: `ok`, an error above three medians of the undisturbed ok frames, and above the bound. Counted too: ok
frames whose error is more than twice what is stated, the share that is above the bound, which is to be a tenth, and
of both those above three medians. A stretch is of twelve frames, undisturbed up to the fifth; `track` states no
error, so there the three medians alone count. Prints tables as Markdown; scored/rows.json and clips.json hold every
frame. Needs numpy and pillow.
"""
import argparse
import io
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


def linear(image):
    a = np.asarray(image, float) / 255.0
    return np.where(a <= 0.04045, a / 12.92, ((a + 0.055) / 1.055) ** 2.4)


def encoded(a):
    a = np.clip(a, 0, 1)
    a = np.where(a <= 0.0031308, a * 12.92, 1.055 * a ** (1 / 2.4) - 0.055)
    return (a * 255 + 0.5).astype(np.uint8)


def read_table(path):
    """Fields of the vertices, and faces, of a binary PLY as dsfms writes it."""
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
    return table, rest["v"]


def read_ply(path):
    """Vertices and faces of a binary PLY as dsfms writes it."""
    table, faces = read_table(path)
    return places(table), faces


def places(table):
    return np.stack([table[c] for c in "xyz"], 1).astype(float)


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

    def stated(self, k, expected):
        """What the program says of the same vertices."""
        return float(np.sqrt((expected[self.measured(k)].astype(float) ** 2).mean()))

    def pixels(self, k):
        return self.project(self.vertices[k])

    def project(self, x):
        c = self.camera
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


def pictures(clip, other, k):
    """What is done to the picture of a frame, by name; not yet done."""
    image = clip.frame(k)
    h, w = shape = image.shape[:2]
    light = linear(image)
    y, x = np.mgrid[0:h, 0:w]
    foreign = other.frame(other.most_deformed(1)[0])
    clear = clip.clear()
    late = clip.frame(clear[(clear.index(k) + len(clear) // 2) % len(clear)])

    def painted(where, colour):
        return np.where(where[..., None], colour, image).astype(np.uint8)

    def blood(share):
        pool = hidden(clip, k, shape, share, True)[..., None]
        return encoded(np.where(pool, light * [0.25, 0.1, 0.1] + [0.08, 0, 0], light))

    def smoke(veil):
        cloud = (veil * (0.5 + 0.5 * np.sin(x / 67 + np.sin(y / 53))))[..., None]
        return encoded(light * (1 - cloud) + 0.35 * cloud)

    def blur(sigma):
        return np.asarray(Image.fromarray(image).filter(ImageFilter.GaussianBlur(sigma)))

    def noise():
        return np.clip(image + np.random.default_rng(k).normal(0, 20, image.shape), 0, 255).astype(np.uint8)

    def compressed():
        buffer = io.BytesIO()
        Image.fromarray(image).save(buffer, "JPEG", quality=5)
        return np.asarray(Image.open(buffer))

    def coarse(factor):
        return np.asarray(Image.fromarray(image).reduce(factor).resize((w, h), Image.BICUBIC))

    found = {
        "other organ": lambda: foreign,
        "mirrored": lambda: image[:, ::-1],
        "upside down": lambda: image[::-1],
        "cut: right half of another moment": lambda: painted(x > w / 2, late),
        "lower half grey (file cut off)": lambda: painted(y > h / 2, 128),
        "rows torn": lambda: np.where((y // 40 % 2 == 1)[..., None], np.roll(image, -60, 1), image),
        "white balance": lambda: encoded(light * [1.3, 1.0, 0.7]),
        "tone: linear values": lambda: (255 * light).astype(np.uint8),
        "noise of 20 grey values": noise,
        "grey picture": lambda: image.mean(2, keepdims=True).round().astype(np.uint8).repeat(3, 2),
        "JPEG of quality 5": compressed,
        "ghost: half of another moment": lambda: encoded((light + linear(late)) / 2),
        "interlaced with another moment": lambda: np.where((y % 2 == 1)[..., None], late, image),
    }
    for factor in (3, 6):
        found[f"resolution / {factor}"] = lambda f=factor: coarse(f)
    for veil in (0.4, 0.6, 0.8):
        found[f"fog {veil:.0%}"] = lambda v=veil: encoded(light * (1 - v) + 0.35 * v)
        found[f"smoke {veil:.0%}"] = lambda v=veil: smoke(v)
    for share in (0.3, 0.6):
        found[f"blood {share:.0%}"] = lambda s=share: blood(s)
    for sigma in (2, 4, 8):
        found[f"blur {sigma} px"] = lambda s=sigma: blur(s)
    for gain in (0.3, 3.0):
        found[f"exposure x {gain}"] = lambda g=gain: encoded(light * g)
    for share in (0.1, 0.3, 0.5, 0.7, 0.9):
        for name, disc in (("disc", True), ("side", False)):
            for kind, colour in (("grey", 120), ("dark", [18, 12, 12]), ("tissue", foreign)):
                found[f"occluder {kind} {name} {share:.0%}"] = lambda s=share, d=disc, c=colour: painted(
                    hidden(clip, k, shape, s, d), c
                )
    return found


def cameras(clip):
    c = clip.camera
    return {
        "focal length x 1.05": {**c, "fx": c["fx"] * 1.05, "fy": c["fy"] * 1.05},
        "focal length x 1.5": {**c, "fx": c["fx"] * 1.5, "fy": c["fy"] * 1.5},
        "focal length / 1.5": {**c, "fx": c["fx"] / 1.5, "fy": c["fy"] / 1.5},
        "principal point + 60 px": {**c, "cx": c["cx"] + 60},
        "distortion k1 = -0.3": {**c, "distortion_model": "brown_conrady", "distortion": {"k1": -0.3}},
    }


def given(clip, k):
    """Matches, degenerate and adversarial."""
    m, rng = clip.matches(k), np.random.default_rng(k)
    h, w = clip.frame(k).shape[:2]
    u, v, n = m[:, 4], m[:, 5], len(m)
    centre = clip.pixels(k)[clip.measured(k)].mean(0)
    away = np.hypot(u - centre[0], v - centre[1])

    def moved(where, by):
        found = m.copy()
        found[where, 4] += by
        return found

    through = v - np.median(v) - 0.4 * (u - np.median(u))
    slanted = m[np.abs(through) < 5]
    slanted[:, 4:] += rng.normal(0, 1, (len(slanted), 2))
    wild = m.copy()
    wild[::3, 4:] = rng.uniform(0, 1, (len(wild[::3]), 2)) * [w - 1, h - 1]
    return {
        "matches on a line": m[np.abs(v - np.median(v)) < 4],
        "matches on a slanted line, noise 1 px": slanted,
        "matches of one small patch": m[np.hypot(u - np.median(u), v - np.median(v)) < 0.05 * w],
        "four matches, 125 times each": np.repeat(m[:4], 125, 0),
        "matches on one half": m[u < np.median(u)],
        "25 matches far from the zone": m[away > 0.2 * w][:25],
        "matches shuffled": np.column_stack([m[:, :4], np.roll(m[:, 4:], n // 2, 0)]),
        "a third of the matches random": wild,
        "matches of the zone 15 px off": moved(away < 0.12 * w, 15),
        "all matches 10 px to the right": moved(np.ones(n, bool), 10),
    }


def disturbances(clip, other, k):
    """Name, picture and what else differs: camera, matches, template, masks."""
    image = clip.frame(k)
    for name, made in pictures(clip, other, k).items():
        yield name, made(), {}
    yield "other template", image, {"template": other}
    yield "instruments without masks", image, {"masked": False}
    for name, camera in cameras(clip).items():
        yield name, image, {"camera": camera}
    for name, matches in given(clip, k).items():
        yield name, image, {"matches": matches}


def put(folder, image, extra, clip, k):
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
    subprocess.run([str(c) for c in command + arguments.more], capture_output=True)
    return out


def outcome(clip, k, out, number):
    report = json.loads((out / f"frame_{number:03}.json").read_text())
    row = {"status": report["status"], "reasons": report["reasons"], "doubts": report.get("doubts", [])}
    row["evidence"] = report.get("evidence")
    surface = out / f"frame_{number:03}.ply"
    if report["status"] != "failed" and surface.exists():
        table = read_table(surface)[0]
        said = report.get("expected_error")
        same = len(table) == len(clip.vertices[k])
        row["error"] = clip.error(k, places(table)) if same else float("inf")
        # A method that states no error is held to the three medians alone.
        row["stated"] = clip.stated(k, table["expected_error"]) if same and said else 0.0
        row["bound"] = said["bound"] * row["stated"] if said else 0.0
    return row


def scored(clips, arguments):
    rows = []
    folder = Path(arguments.out)
    shutil.rmtree(folder / "work", ignore_errors=True)
    for i, clip in enumerate(clips):
        other, jobs = clips[(i + 1) % len(clips)], []
        work = folder / "work" / clip.name
        for k in clip.clear()[1 :: arguments.every]:
            jobs.append((UNDISTURBED, k, *put(work, clip.frame(k), {}, clip, k), clip))
        for k in clip.most_deformed(arguments.frames):
            for kind, image, extra in disturbances(clip, other, k):
                if arguments.only not in kind:
                    continue
                target = put(work, image, extra, clip, k)
                jobs.append((kind, k, *target, extra.get("template", clip)))
        for method in arguments.methods.split(","):
            outs = {g: solve(g, t.folder, method, arguments) for g, t in {j[2]: j[4] for j in jobs}.items()}
            for kind, k, group, number, _ in jobs:
                row = {"clip": clip.name, "frame": k, "kind": kind, "method": method}
                rows.append(row | outcome(clip, k, outs[group], number))
    return rows


# Stretches of a clip: what is done to each, dealt out to the clips in turn.
STRETCHES = [
    UNDISTURBED, "frozen", "other organ", "mirrored", "cut: right half of another moment", "rows torn", "fog 40%",
    "fog 80%", "smoke 60%", "blood 30%", "blood 60%", "blur 2 px", "blur 8 px", "exposure x 0.3", "white balance",
    "noise of 20 grey values", "occluder grey disc 50%", "occluder dark side 70%", "occluder tissue disc 30%",
    "occluder tissue side 90%", "focal length x 1.5", "instruments without masks",
    "ghost: half of another moment", "resolution / 3", "grey picture",
]  # fmt: skip
LENGTH, FROM = 12, 5


def stretch(clip, other, kind, folder):
    """Write twelve frames, the last seven disturbed; their numbers in the clip."""
    clear = clip.clear()
    middle = clear.index(clip.most_deformed(1)[0])
    first = min(max(0, middle - LENGTH * 2 // 3), len(clear) - LENGTH)
    numbers = clear[first : first + LENGTH]
    for part in ("frames", "masks"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    shown = []
    for i, k in enumerate(numbers):
        k = numbers[FROM] if kind == "frozen" and i > FROM else k
        made = pictures(clip, other, k).get(kind, lambda k=k: clip.frame(k)) if i >= FROM else lambda k=k: clip.frame(k)
        Image.fromarray(np.ascontiguousarray(made())).save(folder / f"frames/f_{i:03}.png", compress_level=1)
        shutil.copy(clip.mask(k), folder / f"masks/f_{i:03}.png")
        shown.append(k)
    (folder / "camera.json").write_text(json.dumps(cameras(clip).get(kind, clip.camera)))
    return shown


def tracked(clips, arguments):
    rows = []
    for i, kind in enumerate(STRETCHES):
        for clip in clips if kind == UNDISTURBED else [clips[i % len(clips)]]:
            other = clips[(clips.index(clip) + 1) % len(clips)]
            folder = Path(arguments.out, "work", "clips", f"{i:02}-{clip.name}")
            shown = stretch(clip, other, kind, folder)
            command = [arguments.dsfms, "track", clip.folder / "organ.template", folder / "frames"]
            command += ["--camera", folder / "camera.json", "--method", "joint", "--no-report", "-o", folder / "out"]
            if kind != "instruments without masks":
                command += ["--instrument-masks", folder / "masks"]
            subprocess.run([str(c) for c in command + arguments.more], capture_output=True)
            shapes = np.load(folder / "out/vertices.npz")
            for at, k in enumerate(shown):
                status = ["ok", "degraded", "failed"][int(shapes["status"][at])]
                # Another camera is another one from the first frame on.
                plain = at < FROM and kind not in cameras(clip)
                row = {"clip": clip.name, "frame": k, "kind": UNDISTURBED if plain else kind, "status": status}
                if status != "failed":
                    row["error"] = clip.error(k, shapes["vertices"][at].astype(float))
                rows.append(row | {"stretch": kind})
    return rows


def report_clips(rows):
    plain = [r for r in rows if r["kind"] == UNDISTURBED]
    usual = float(np.median([r["error"] for r in plain if r["status"] == "ok"]))
    bad = [r for r in rows if r["status"] == "ok" and r["error"] > WRONG * usual]
    alarms = sum(r["status"] != "ok" for r in plain)
    print(f"track: {len({r['stretch'] for r in rows}) - 1} disturbed stretches; median zone error of undisturbed ok "
          f"frames {usual:.2f} mm; false alarms {alarms} of {len(plain)}; **wrong as good: {len(bad)}**\n")
    for r in bad:
        print(f"- wrong {r['clip']} frame {r['frame']} {r['kind']}: {r['error']:.2f} mm")
    print("\n| stretch | clip | disturbed frames ok / degraded / lost | worst ok, mm |\n| --- | --- | --- | --- |")
    for kind in STRETCHES[1:]:
        of = [r for r in rows if r["kind"] == kind]
        counts = [sum(r["status"] == s for r in of) for s in ("ok", "degraded", "failed")]
        worst = max((r["error"] for r in of if r["status"] == "ok"), default=None)
        shown = f"{worst:.2f}" if worst is not None else ""
        print(f"| {kind} | {of[0]['clip']} | {counts[0]} / {counts[1]} / {counts[2]} | {shown} |")


def names(rows):
    counts = {}
    for r in rows:
        for d in r["doubts"] or ([{"reason": "no_pose"}] if r["status"] == "failed" else []):
            counts[d["reason"]] = counts.get(d["reason"], 0) + 1
    return ", ".join(f"{n} {c}" for n, c in sorted(counts.items(), key=lambda p: (-p[1], p[0]))[:4])


def calibration(method, plain, rest, wrong):
    """Ok frames whose zone error is more than twice what is stated, and above the bound."""
    print(f"| {method}, ok frames | frames | zone error over stated: median, 90 %, largest | above twice the stated "
          "(and three medians) | above the bound (and three medians) |\n| --- | --- | --- | --- | --- |")
    for name, of in ((UNDISTURBED, plain), ("disturbed", rest)):
        of = [r for r in of if r["status"] == "ok" and r["stated"] > 0]
        over = np.array([r["error"] / r["stated"] for r in of] or [np.nan])
        apart = np.array([r["error"] > wrong for r in of], bool)
        twice, above = over > 2, np.array([r["error"] > r["bound"] for r in of], bool)
        if len(of):
            print(f"| {name} | {len(of)} | {np.median(over):.2f}, {np.quantile(over, 0.9):.2f}, {over.max():.2f} | "
                  f"{twice.sum()} ({(twice & apart).sum()}) | {above.sum()} ({(above & apart).sum()}) |")
    print()


def report(rows, methods):
    frames = {(r["clip"], r["frame"], r["kind"]) for r in rows}
    disturbed = sum(f[2] != UNDISTURBED for f in frames)
    print(f"{disturbed} disturbed frames, {len(frames) - disturbed} undisturbed.\n")
    for method in methods:
        of = [r for r in rows if r["method"] == method]
        plain = [r for r in of if r["kind"] == UNDISTURBED]
        rest = [r for r in of if r["kind"] != UNDISTURBED]
        usual = float(np.median([r["error"] for r in plain if r["status"] == "ok"] or [np.nan]))
        bad = [r for r in of if r["status"] == "ok" and r["error"] > max(WRONG * usual, r["bound"])]
        alarms = [r for r in plain if r["status"] != "ok"]
        passed = sum(r["status"] == "ok" for r in rest)
        print(f"{method}: median zone error of undisturbed ok frames {usual:.2f} mm; false alarms {len(alarms)} of "
              f"{len(plain)}; {passed} of {len(rest)} disturbed frames ok; **wrong as good: {len(bad)}**\n")
        calibration(method, plain, rest, WRONG * usual)
        for r in alarms:
            print(f"- false alarm {r['clip']} frame {r['frame']}: {names([r])} (error {r.get('error', np.nan):.2f} mm)")
        for r in bad:
            print(f"- wrong {r['clip']} frame {r['frame']} {r['kind']}: {r['error']:.2f} mm, stated {r['stated']:.2f}, "
                  f"bound {r['bound']:.2f}")
        print()
    print("| disturbance |" + "".join(f" {m}: ok / degraded / failed | worst ok, mm (stated, bound) |" for m in methods)
          + " reasons |\n| --- |" + " --- |" * (2 * len(methods) + 1))
    for kind in dict.fromkeys(r["kind"] for r in rows):
        cells = []
        for method in methods:
            of = [r for r in rows if r["kind"] == kind and r["method"] == method]
            counts = [sum(r["status"] == s for r in of) for s in ("ok", "degraded", "failed")]
            worst = max((r for r in of if r["status"] == "ok"), key=lambda r: r["error"], default=None)
            shown = f"{worst['error']:.2f} ({worst['stated']:.2f}, {worst['bound']:.2f})" if worst else ""
            cells.append(f" {counts[0]} / {counts[1]} / {counts[2]} | {shown} |")
        print(f"| {kind} |{''.join(cells)} {names([r for r in rows if r['kind'] == kind])} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clips", nargs="+", help="folders of dsfms synth --video, two organs or more")
    parser.add_argument("--dsfms", default="dsfms")
    parser.add_argument("--out", default="scored")
    parser.add_argument("--options", help="TOML for reconstruct")
    parser.add_argument("--methods", default="joint,dsfm")
    parser.add_argument("--track", action="store_true", help="stretches of the clips too")
    parser.add_argument("--frames", type=int, default=2, help="frames of a clip that are disturbed")
    parser.add_argument("--every", type=int, default=4, help="every so-manieth frame is taken undisturbed")
    parser.add_argument("--only", default="", help="disturbances of frames whose name contains this")
    parser.add_argument("--threads", help="of the program")
    arguments = parser.parse_args()
    arguments.more = ["--threads", arguments.threads] if arguments.threads else []
    clips = [Clip(c) for c in arguments.clips]
    Path(arguments.out).mkdir(parents=True, exist_ok=True)
    if arguments.methods:
        rows = scored(clips, arguments)
        Path(arguments.out, "rows.json").write_text(json.dumps(rows, indent=1))
        report(rows, arguments.methods.split(","))
    if arguments.track:
        rows = tracked(clips, arguments)
        Path(arguments.out, "clips.json").write_text(json.dumps(rows, indent=1))
        print()
        report_clips(rows)


if __name__ == "__main__":
    main()
