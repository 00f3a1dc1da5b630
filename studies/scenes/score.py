"""Score dsfms over generated scenes. usage: score.py SCENES [--half choose|held|drawn|all] [--roads mesh,auto] [--methods ...] [--json FILE]

Roads: `mesh` true rest mesh and poses, 25 sparse matches, instrument masks; `auto` the same template, frames and camera alone;
`frames` a template from the exploration frames alone (slow; distances between surfaces after one scale, of the zone the visible part;
--surface measures the other roads so too).
Templates and finished runs are cached under --work, keyed by binary, options and scene; --fresh ignores finished runs.
Per frame, mm: zone = vertices moved by at least half of what the visible one that moved most did; visible; hidden. Frame 0 is the
rest shape: its seen and hidden deviation is from the rigid pose of the same road. Needs numpy, scipy and pillow."""

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from PIL import Image

from measure import frame_errors, read_ply

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from wrong_as_good import encoded, linear  # noqa: E402

METHODS = "rigid,dsfm,dsfms,joint"
ROOT = Path(__file__).resolve().parents[2]


def digest(*things):
    """Short key of strings and file contents."""
    h = hashlib.sha1()
    for t in things:
        h.update(t.read_bytes() if isinstance(t, Path) else str(t).encode())
    return h.hexdigest()[:12]


def run(command, log):
    """Run a command (list) with its output in the file `log`; exit code and seconds of wall and processor time."""
    before, start = os.times(), time.time()
    with open(log, "w") as out:
        code = subprocess.run([str(c) for c in command], stdout=out, stderr=subprocess.STDOUT).returncode
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return code, time.time() - start, cpu


def template(a, scene, road):
    """Folder of the scene's template for a road, made once per binary that builds templates (--template-key)."""
    kind = "frames" if road == "frames" else "mesh"
    out = a.work / scene.name / f"{kind}-{a.template_key}.template"
    if not (out / "template.json").exists() and not any(out.glob("*")):
        out.parent.mkdir(parents=True, exist_ok=True)
        command = [
            a.binary,
            "template",
            scene / "exploration",
            "--camera",
            scene / "camera.json",
            "-q",
            "--threads",
            a.threads,
            "-o",
            out,
        ]
        if kind == "mesh":
            command += ["--mesh", scene / "ground_truth/rest_world.ply", "--poses", scene / "ground_truth/poses.json"]
        code, wall, cpu = run(command, out.with_suffix(".log"))
        print(f"  template {scene.name} {kind}: exit {code}, {wall:.0f} s, {cpu:.0f} s of processor time", flush=True)
        if not any(out.glob("*")):
            return None
    return out


def changed(a, scene, frames):
    """The frames as another recording has them, the same on every run: their linear light times exp(normal x --exposure), and
    with --grey their luma alone."""
    folder = a.work / scene.name / ("-".join(["exposure", f"{a.exposure:g}"] + ["grey"] * a.grey))
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for f in frames:
        out = folder / f"{f.stem}.png"
        if not out.exists():
            gain = np.exp(a.exposure * np.random.default_rng(int(digest(scene.name, f.name), 16)).normal())
            image = Image.fromarray(encoded(gain * linear(Image.open(f).convert("RGB"))))
            (image.convert("L").convert("RGB") if a.grey else image).save(out)
        made.append(out)
    return made


def given(a, scene):
    """Words for reconstruct: the 25 matches a frame and the instrument masks of a scene, under the names of its frames."""
    matches, masks = a.work / scene.name / "matches", a.work / scene.name / "instruments"
    for folder in (matches, masks):
        folder.mkdir(exist_ok=True)
    for f in (scene / "ground_truth/correspondences").glob("*_sparse25.csv"):
        shutil.copy(f, matches / f.name.replace("_sparse25", ""))
    for f in (scene / "deformed").glob("instrument_mask_*.png"):
        shutil.copy(f, masks / f.name.replace("instrument_mask", "frame"))
    return ["--matches", matches, "--instrument-masks", masks]


def reconstruct(a, scene, made, road, method):
    """Folder with the surfaces of one method on one road; cached."""
    key = digest(a.binary, a.options or "", road, " ".join(a.extra), *([a.exposure] if a.exposure else []), *["grey"] * a.grey)
    out = a.work / scene.name / f"{road}-{method}-{key}"
    if a.fresh:
        shutil.rmtree(out, ignore_errors=True)
    if not (out / "run.json").exists():
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        frames = sorted(p for p in (scene / "deformed").iterdir() if p.name.startswith("frame_"))
        if a.frames:
            frames = [f for f in frames if int(f.stem[-3:]) in a.frames]
        if a.exposure or a.grey:
            frames = changed(a, scene, frames)
        command = [
            a.binary,
            "reconstruct",
            made,
            *frames,
            "--camera",
            scene / "camera.json",
            "--method",
            method,
            "--no-report",
            "-q",
            "--threads",
            a.threads,
            "-o",
            out / "out",
        ]
        if a.options:
            command += ["--options", a.options]
        if road == "mesh":
            command += given(a, scene)
        code, wall, cpu = run(command + a.extra, out / "log.txt")
        (out / "run.json").write_text(json.dumps(dict(code=code, wall=wall, cpu=cpu, frames=len(frames))))
    return out


def score(a, scene, road, method, rigid):
    """Figures of one scene, road and method; `rigid` are the figures of the rigid pose on the same road."""
    made = template(a, scene, road)
    if made is None:
        return None
    out = reconstruct(a, scene, made, road, method)
    ran = json.loads((out / "run.json").read_text())
    frames, states = {}, dict(ok=0, degraded=0, failed=0)
    for i in range(len(list((scene / "ground_truth/deformed_meshes_cam").glob("frame_*.ply")))):
        told = out / f"out/frame_{i:03d}.json"
        state = json.loads(told.read_text()).get("status", "failed") if told.exists() else "failed"
        if a.frames and i not in a.frames:
            continue
        states[state] = states.get(state, 0) + 1
        ply = out / f"out/frame_{i:03d}.ply"
        if ply.exists():
            pose = Path(rigid["folder"]) / f"out/frame_{i:03d}.ply" if rigid and i == 0 else None
            pose = read_ply(pose)[0] if pose and pose.exists() else None
            vertices, faces = read_ply(ply)
            frames[i] = frame_errors(scene, i, vertices, pose, faces if road == "frames" or a.surface else None)
    mean = lambda k: float(np.mean([f[k] for i, f in frames.items() if i and f.get(k) is not None])) if frames else None
    figures = dict(
        zone=mean("zone"),
        visible=mean("visible"),
        hidden=mean("hidden"),
        rest_seen=frames.get(0, {}).get("rest_seen"),
        rest_hidden=frames.get(0, {}).get("rest_hidden"),
    )
    figures.update(states=states, seconds=ran["cpu"] / max(ran["frames"], 1), frames=frames, folder=str(out))
    if rigid:
        figures["ratio"] = {
            k: figures[k] / rigid[k] if figures[k] is not None and rigid[k] else None
            for k in ("zone", "visible", "hidden")
        }
    return figures


def show(v):
    """A figure as a cell."""
    return "     -" if v is None else f"{v:6.2f}"


HEAD = f"{'scene':26}{'method':7}  zone   vis   hid | rest seen hid | /rigid zone  vis   hid | s/frame  ok/deg/fail"


def line(name, method, r):
    """One row of the table."""
    q, s = r.get("ratio", {}), r["states"]
    cells = (
        " ".join(show(r[k]) for k in ("zone", "visible", "hidden"))
        + " | "
        + " ".join(show(r[k]) for k in ("rest_seen", "rest_hidden"))
    )
    ratios = " ".join(show(q.get(k)) for k in ("zone", "visible", "hidden"))
    states = "/".join(str(s.get(k, 0)) for k in ("ok", "degraded", "failed"))
    return f"{name:26}{method:7}{cells} | {ratios} | {r['seconds']:7.2f}  {states}"


def summary(results, method, pick):
    """Mean or worst of every figure over the scenes of one road and method."""
    rows = [r[method] for r in results.values() if r.get(method)]
    take = lambda values: (lambda v: float(pick(v)) if v else None)([x for x in values if x is not None])
    out = {k: take([r[k] for r in rows]) for k in ("zone", "visible", "hidden", "rest_seen", "rest_hidden", "seconds")}
    out["ratio"] = {k: take([r.get("ratio", {}).get(k) for r in rows]) for k in ("zone", "visible", "hidden")}
    out["states"] = {k: sum(r["states"].get(k, 0) for r in rows) for k in ("ok", "degraded", "failed")}
    return out


def arguments():
    """The command line."""
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("scenes", type=Path, help="folder that make.py filled, or one scene")
    ap.add_argument("--half", default="choose", choices=["choose", "held", "drawn", "all"])
    ap.add_argument("--only", default="", help="scenes whose name contains one of these words, comma separated")
    ap.add_argument("--roads", default="mesh,auto")
    ap.add_argument("--methods", default=METHODS)
    ap.add_argument("--frames", default="", help="only these deformed frames, as 0,4,8")
    ap.add_argument("--binary", type=Path, help="dsfms; default target/release/dsfms, built first")
    ap.add_argument("--exposure", type=float, default=0.0, help="spread of a log gain that every deformed frame gets")
    ap.add_argument("--grey", action="store_true", help="deformed frames by their luma alone (the template keeps its colours)")
    ap.add_argument("--options", type=Path, help="TOML for reconstruct --options")
    ap.add_argument("--extra", default="", help="further words for reconstruct, as one string")
    ap.add_argument("--template-key", default="a", help="change it to build the templates anew")
    ap.add_argument("--threads", default="1")
    ap.add_argument("--work", type=Path, default=Path("/tmp/dsfms-score"), help="cache of templates and runs")
    ap.add_argument("--fresh", action="store_true", help="run again what is cached (templates stay)")
    ap.add_argument("--surface", action="store_true", help="distances between surfaces on every road, as for `frames`")
    ap.add_argument("--json", type=Path)
    a = ap.parse_args()
    a.extra, a.frames = a.extra.split(), {int(x) for x in a.frames.split(",") if x}
    if not a.binary:
        subprocess.run(["cargo", "build", "--release"], cwd=ROOT, check=True)
        a.binary = ROOT / "target/release/dsfms"
    return a


def chosen(a):
    """The finished scenes that the command line names."""
    scenes = [a.scenes] if (a.scenes / "camera.json").exists() else sorted(p.parent for p in a.scenes.glob("*/DONE"))
    words = [w for w in a.only.split(",") if w]
    return [
        s
        for s in scenes
        if (a.half == "all" or f"-{a.half}-" in s.name or s == a.scenes)
        and (not words or any(w in s.name for w in words))
    ]


def main():
    a = arguments()
    everything = {}
    for road in a.roads.split(","):
        print(f"\n== {road}\n{HEAD}", flush=True)
        results = everything.setdefault(road, {})
        for scene in chosen(a):
            row = results.setdefault(scene.name, {})
            rigid = row["rigid"] = score(a, scene, road, "rigid", None)
            for method in a.methods.split(","):
                if method != "rigid":
                    row[method] = score(a, scene, road, method, rigid)
                print(
                    line(scene.name, method, row[method]) if row[method] else f"{scene.name:26}{method:7} no template",
                    flush=True,
                )
        for label, pick in (("MEAN", np.mean), ("WORST", np.max)):
            for method in a.methods.split(","):
                total = results.setdefault("-" + label, {})
                total[method] = summary({k: v for k, v in results.items() if k[0] != "-"}, method, pick)
                print(line(label, method, total[method]))
    if a.json:
        a.json.write_text(json.dumps(everything, indent=1))


if __name__ == "__main__":
    main()
