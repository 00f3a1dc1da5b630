#!/usr/bin/env python3
"""Run every command that README.md and docs/guide print, as printed, and say which fail.

    scripts/guide_commands.py target/release/dsfms                  # all of them, some minutes
    scripts/guide_commands.py target/release/dsfms videos methods   # of these pages
    scripts/guide_commands.py target/release/dsfms --keep DIR       # in DIR, where the outputs stay

Commands run in a folder with what the pages speak of: the demo's scene under the names of a reader's own
recording, clips and a chessboard that are made for it (ffmpeg is needed). A command may end with 0 or with 2 (some
frames degraded). What needs a device, a network or another machine is named as left out.
"""

import argparse
import json
import os
import re
import shlex
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Commands that cannot run here, by a word of theirs, and why.
LEFT_OUT = {
    "v4l2:": "a capture device",
    "cargo": "builds, which .ci/run checks",
    "ssh ": "another machine",
    "pip install": "the network",
    "dsfms replay": "the run of a device before it",
    "> ~/": "the home folder",
    "--volume": "a CT of the organ",
    "experiment ext --count 100": "hours",
    "experiment table1": "an hour",
    "experiment ablation": "hours",
}
# Commands that go on until they are stopped.
SERVERS = ("dsfms view", "--view")
# Commands about the vertices of a mesh.
OF_MESH = ("tracks/", "--landmarks", "ct/structures")
# A page whose commands begin in the demo's folder.
IN_DEMO = "cd dsfms-demo"


def commands(page):
    """Headings and indented command lines of a page, continued lines joined, without comments."""
    joined = re.sub(r"\\\n\s*", " ", page.read_text())
    for line in joined.splitlines():
        # Below a heading of the README another reader begins.
        if line.startswith("## ") and page.stem == "README":
            yield line
        found = re.match(r"\s{4,}((?:dsfms|cargo|cd|ssh|pip) .*)", line)
        if found and "`" not in line:
            yield re.sub(r"\s{2,}#.*", "", found.group(1)).strip()


def png(path, width, height, grey):
    rows = b"".join(b"\0" + bytes(grey(x, y) for x in range(width)) for y in range(height))
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def corners(path, count):
    """Corners of some faces of a binary STL, mm."""
    data = path.read_bytes()
    faces = struct.unpack_from("<I", data, 80)[0]
    return [struct.unpack_from("<3f", data, 84 + 50 * (k * faces // count) + 12) for k in range(count)]


def film(folder, pattern, out, rate):
    subprocess.run(["ffmpeg", "-v", "error", "-y", "-framerate", str(rate), "-i", folder / pattern, "-c:v", "libx264",
                    "-crf", "8", "-pix_fmt", "yuv420p", out], check=True)


def prepare(dsfms, work):
    """The demo, and its scene under the names that the pages use."""
    quiet = lambda *arguments: subprocess.run([dsfms, *arguments, "--quiet"], cwd=work, check=True)
    quiet("demo")
    demo, scene = work / "dsfms-demo", work / "dsfms-demo/scene"
    for name, target in {
        "exploration": scene / "exploration", "masks": scene / "exploration_masks", "deformed": scene / "deformed",
        "instruments": scene / "instrument_masks", "truth": demo / "truth", "matches": scene / "matches",
        "tracks": scene / "matches", "camera.json": scene / "camera.json",
    }.items():
        (work / name).symlink_to(target)
    for name in ("organ.ply", "liver.ply", "rest.ply"):
        (work / name).symlink_to(scene / "truth/rest_world.ply")
    (work / "poses.json").symlink_to(scene / "truth/poses.json")
    for name in ("liver.stl", "organ.stl", "organ.obj", "tumour.stl", "vessels.stl"):
        quiet("template", "--mesh", "organ.ply", "-o", "bare.template")
        quiet("export", "bare.template", "--mesh", name)
    # A template in the frame of the mesh: matches and landmarks are of that mesh.
    quiet("template", "exploration", "--camera", "camera.json", "--mesh", "organ.ply", "--poses", "poses.json",
          "-o", "meshed.template")
    places = corners(work / "organ.stl", 7)
    lines = [",".join(map(str, p + p)) for p in places]
    (work / "pairs.csv").write_text("ct_x,ct_y,ct_z,template_x,template_y,template_z\n" + "\n".join(lines) + "\n")
    png(work / "albedo.png", 64, 64, lambda x, y: 120 + x)
    guess = json.loads((scene / "camera.json").read_text())
    guess = {key: guess[key] for key in ("width", "height", "fx", "fy", "cx", "cy")}
    guess["fx"] = guess["fy"] = round(1.05 * guess["fx"])
    (work / "guess.json").write_text(json.dumps(guess))
    quiet("synth", "--chessboard", "14x10", "--square", "3mm", "-o", "chessboard")
    # A video that begins with the organ at rest, of which one pose is known.
    (work / "frames").symlink_to(scene / "exploration")
    poses = json.loads((work / "poses.json").read_text())
    (work / "pose.json").write_text(json.dumps(poses["exploration"][:1]))
    film(scene / "exploration", "frame_%03d.jpg", work / "exploration.mp4", 5)
    film(scene / "deformed", "frame_%03d.jpg", work / "clip.mp4", 25)
    quiet("synth", "--video", "--frames", "12", "--size", "320x180", "--vertices", "300", "--seed", "3", "-o", "made")


def run(line, folder, path):
    """Exit code, seconds and last words of a command."""
    environment = {**os.environ, "PATH": f"{path}:{os.environ['PATH']}", "SSH_CONNECTION": "no browser"}
    start = time.time()
    child = subprocess.Popen(["bash", "-c", line], cwd=folder, env=environment, stdout=subprocess.PIPE,
                             stderr=subprocess.STDOUT, text=True, start_new_session=True)
    try:
        said, _ = child.communicate(timeout=10 if line.startswith(SERVERS[0]) else 1200)
    except subprocess.TimeoutExpired:
        os.killpg(child.pid, signal.SIGINT)
        said, _ = child.communicate()
        served = line.startswith(SERVERS[0]) and "http://127.0.0.1:" in said
        return (0 if served else 124), time.time() - start, said
    return child.returncode, time.time() - start, said


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dsfms", type=Path)
    parser.add_argument("pages", nargs="*", help="names of pages without .md; default all")
    parser.add_argument("--keep", type=Path)
    args = parser.parse_args()
    pages = [ROOT / "README.md", *sorted((ROOT / "docs/guide").glob("*.md"))]
    pages = [page for page in pages if not args.pages or page.stem in args.pages]
    work = (args.keep or Path(tempfile.mkdtemp())).resolve()
    work.mkdir(parents=True, exist_ok=True)
    (work / "bin").mkdir(exist_ok=True)
    program = work / "bin/dsfms"
    if not program.exists():
        program.symlink_to(args.dsfms.resolve())
        prepare(program, work)
    failed = 0
    for page in pages:
        folder = work
        for line in commands(page):
            if line.startswith("#"):
                folder = work
                continue
            reason = next((why for word, why in LEFT_OUT.items() if word in line), None)
            if line == IN_DEMO:
                folder = work / "dsfms-demo"
                print(f"ok   {page.stem}: {line}", flush=True)
                continue
            if line == "dsfms help COMMAND" or reason:
                print(f"-    {page.stem}: {line}   (left out: {reason})", flush=True)
                continue
            if folder == work:
                shutil.rmtree(work / "organ.template", ignore_errors=True)
                meshed = any(word in line for word in OF_MESH)
                template = "meshed.template" if meshed else "dsfms-demo/organ.template"
                shutil.copytree(work / template, work / "organ.template")
                # `calibrate` puts the camera of the chessboard in its place.
                (work / "camera.json").unlink()
                (work / "camera.json").symlink_to(work / "dsfms-demo/scene/camera.json")
            code, seconds, said = run(line, folder, program.parent)
            good = code in (0, 2)
            failed += not good
            print(f"{'ok ' if good else 'BAD'} {code} {seconds:5.0f} s  {page.stem}: {line}", flush=True)
            if not good:
                print("      " + "\n      ".join(said.strip().splitlines()[-6:]), flush=True)
    if not args.keep:
        shutil.rmtree(work, ignore_errors=True)
    sys.exit(f"{failed} commands fail" if failed else 0)


if __name__ == "__main__":
    main()
