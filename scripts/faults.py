#!/usr/bin/env python3
"""What is left when a run is cut short? Every command that writes files is killed, interrupted, given a full
disk, a read-only one and readers that go away; then it is run again.

    python3 scripts/faults.py --binary target/release/dsfms            # some five minutes
    python3 scripts/faults.py --binary target/release/dsfms --count 200

After each fault: every file under its final name is whole (parsed, and the same bytes as those of an undisturbed
run wherever two undisturbed runs give the same bytes); an older result that was finished is still there, old or new;
a file of the user in the folder is untouched; cases of an experiment that were done are kept; nothing panics. Then
the same command runs to its end, gives the same files, and leaves no partial ones.

Half of the moments of a kill are drawn over the whole run, half over its last quarter, where files are written. Full
and read-only disks are small tmpfs, which need root. `--count` is the number of kills, a quarter as many interrupts;
from 100 on, or where `--only` names it, the demo is one of the commands. Prints a table as Markdown, also when it is
stopped; ends with 1 where anything was found. Needs nothing but Python 3.11.
"""
import argparse
import json
import math
import os
import random
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import tomllib
import xml.dom.minidom
import zipfile
import zlib
from pathlib import Path

# What a run is allowed to leave under names of its own until the next run.
PARTIAL = (".partial-", ".old-template-", ".tmp")
# Finished stages of a template, with which the next run goes on.
STAGES = ".template.partial"
USERS = "the user's\n"
# Files of all frames.
FRAMES = ("frames.glb", "overlay.mp4", "vertices.npz")
# What must end with this script.
RUNNING = []


class Broken(Exception):
    """A file that is not whole."""


def need(truth, text):
    if not truth:
        raise Broken(text)


def whole_png(data):
    need(data[:8] == b"\x89PNG\r\n\x1a\n", "no PNG")
    at, kind, pixels = 8, b"", b""
    while kind != b"IEND":
        need(at + 12 <= len(data), "cut PNG")
        (length,) = struct.unpack(">I", data[at : at + 4])
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        (crc,) = struct.unpack(">I", data[at + 8 + length : at + 12 + length])
        need(zlib.crc32(kind + body) == crc, "checksum of a PNG")
        pixels += body if kind == b"IDAT" else b""
        at += 12 + length
    need(at == len(data) and len(zlib.decompress(pixels)) > 0, "PNG of another length")


def whole_ply(data):
    end = data.find(b"end_header\n")
    need(end > 0, "no PLY header")
    sizes = {"char": 1, "uchar": 1, "short": 2, "ushort": 2, "int": 4, "uint": 4, "float": 4, "double": 8}
    lines, length, count = data[:end].decode().splitlines(), 0, 0
    need("format binary_little_endian 1.0" in lines, "another PLY")
    for line in lines:
        words = line.split()
        if words[0] == "element":
            count = int(words[2])
        elif words[0] == "property" and words[1] == "list":
            length += count * (sizes[words[2]] + 3 * sizes[words[3]])
        elif words[0] == "property":
            length += count * sizes[words[1]]
    need(len(data) == end + 11 + length, "PLY of another length")


def whole_npz(path):
    with zipfile.ZipFile(path) as archive:
        need(archive.testzip() is None and archive.namelist(), "damaged npz")
        for name in archive.namelist():
            need(archive.read(name)[:6] == b"\x93NUMPY", f"{name} is no array")


def whole_mp4(data):
    at, kinds = 0, []
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        need(length >= 8, "box of no length")
        at, kinds = at + length, [*kinds, kind]
    need(at == len(data) and {b"ftyp", b"mdat", b"moov"} <= set(kinds), "cut mp4")


def whole_table(text):
    rows = [line for line in text.splitlines() if line and not line.startswith("#")]
    need(text.endswith("\n") and rows, "cut table")
    # Fields in quotes may hold commas.
    outside = ["".join(part for part in row.split('"')[::2]).count(",") for row in rows]
    need(len(set(outside)) == 1, "rows of several lengths")


def check_whole(path):
    """Raise Broken for a file that is not complete."""
    data, kind = path.read_bytes(), path.suffix
    try:
        need(data, "empty")
        if kind == ".png":
            whole_png(data)
        elif kind == ".ply":
            whole_ply(data)
        elif kind == ".npz":
            whole_npz(path)
        elif kind == ".json":
            json.loads(data)
        elif kind == ".toml":
            tomllib.loads(data.decode())
        elif kind == ".csv" and path.name != "cases.csv":
            whole_table(data.decode())
        elif kind in (".svg", ".vtp", ".pvd"):
            xml.dom.minidom.parseString(data)
        elif kind == ".stl":
            need(len(data) == 84 + 50 * struct.unpack("<I", data[80:84])[0], "STL of another length")
        elif kind == ".glb":
            need(struct.unpack("<I", data[8:12])[0] == len(data), "GLB of another length")
        elif kind == ".html":
            need(data.rstrip().endswith(b"</html>"), "cut page")
        elif kind == ".mp4":
            whole_mp4(data)
        elif kind in (".obj", ".mtl", ".md", ".txt"):
            need(data.endswith(b"\n"), "cut text")
    except Broken:
        raise
    except Exception as error:  # any parser may refuse in its own way
        raise Broken(f"{type(error).__name__}: {error}") from error


def is_partial(path, root):
    return any(part.startswith(PARTIAL) or part.endswith(STAGES) for part in path.relative_to(root).parts)


def files(root):
    """Final names in a folder and their content; of a file that changes by itself, its name."""
    if not root.exists():
        return {}
    found = sorted(p for p in root.rglob("*") if p.is_file() and not is_partial(p, root))
    return {str(p.relative_to(root)): p for p in found}


class Command:
    """A command of dsfms. Its arguments name the place of its output as {out}."""

    def __init__(self, name, arguments, codes=(0,), replaced=(), keeps_user=False, log=None):
        self.name = name
        self.arguments = arguments
        self.codes = codes
        self.replaced = replaced  # outputs of an older run that a newer one replaces in one step
        self.keeps_user = keeps_user
        self.log = log  # a file that grows by a line each case
        self.seconds = 0.0
        self.size = 0
        self.reference = {}

    def start(self, binary, out, **more):
        words = [str(binary)] + [w.replace("{out}", str(out)) for w in self.arguments]
        more.setdefault("stdout", subprocess.DEVNULL)
        process = subprocess.Popen(words, stderr=subprocess.PIPE, **more)
        RUNNING[:] = [process]
        return process

    def run(self, binary, out, **more):
        process = self.start(binary, out, **more)
        _, said = process.communicate()
        return process.returncode, said.decode(errors="replace")


def png(path, size, value):
    """A grey PNG of `value(x, y)`, 0 to 255."""
    rows = b"".join(b"\0" + bytes(value(x, y) for x in range(size[0])) for y in range(size[1]))

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = struct.pack(">IIBBBBB", *size, 8, 0, 0, 0, 0)
    data = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + data)


def chessboards(folder):
    """Six views of a board of 7 x 5 inner corners, tilted in several directions."""
    folder.mkdir()
    for k, (a, b) in enumerate([(0.5, 0.0), (-0.5, 0.1), (0.0, 0.5), (0.1, -0.5), (0.4, 0.4), (-0.4, 0.35)]):
        # Columns of the rotation: about x by a, then about y by b.
        ex = (math.cos(b), 0.0, -math.sin(b))
        ey = (math.sin(a) * math.sin(b), math.cos(a), math.sin(a) * math.cos(b))
        ez = (math.cos(a) * math.sin(b), -math.sin(a), math.cos(a) * math.cos(b))
        far = 14.0 + k % 3

        def value(x, y, ex=ex, ey=ey, ez=ez, far=far):
            total = 0
            for dx, dy in ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)):
                ray = ((x + dx - 159.5) / 420.0, (y + dy - 119.5) / 420.0, 1.0)
                depth = ez[2] * far / sum(e * r for e, r in zip(ez, ray))
                point = (depth * ray[0], depth * ray[1], depth - far)
                i = sum(e * p for e, p in zip(ex, point)) + 4.0
                j = sum(e * p for e, p in zip(ey, point)) + 3.0
                inside = 0 <= i < 8 and 0 <= j < 6
                total += 30 if inside and (int(i) + int(j)) % 2 == 0 else 225
            return total // 4

        png(folder / f"board_{k}.png", (320, 240), value)


def commands(work, binary, long):
    """Inputs in `work`, and what is run on them."""
    say(f"inputs in {work}")

    def make(*words):
        done = subprocess.run([str(binary), *words, "--quiet"], cwd=work, capture_output=True, text=True)
        if done.returncode not in (0, 2):
            sys.exit(f"{' '.join(words)}: {done.stderr}")

    make("synth", "--organ", "patch", "--vertices", "120", "--ext", "10", "--count", "1", "--seed", "3", "-o", "cases")
    make("synth", "--video", "--frames", "4", "--size", "320x180", "--vertices", "150", "--seed", "3", "-o", "clip")
    case = work / "cases/ext10/case_0000"
    make("template", "--mesh", str(case / "rest.obj"), "--albedo", str(case / "albedo.png"), "-o", "organ.template")
    (work / "frames").mkdir()
    for k in range(3):
        shutil.copy(case / "frame_000.png", work / f"frames/frame_{k:03}.png")
    some = work / "exploration"
    some.mkdir()
    for k in range(0, 24, 3):
        shutil.copy(work / f"clip/exploration/frame_{k:03}.png", some)
    chessboards(work / "boards")
    given = ["--camera", str(case / "camera.json"), "--matches", str(case / "matches.csv")]
    organ, clip, q = str(work / "organ.template"), work / "clip", ["--quiet"]
    make("reconstruct", organ, str(work / "frames"), *given, "-o", "done")
    formats = ["--formats", "vtp,obj,stl,glb"]
    meshes = [w for e in ("ply", "obj", "stl", "vtp", "glb") for w in ("--mesh", "{out}/m." + e)]
    found = [
        Command("calibrate", ["calibrate", str(work / "boards"), "--board", "7x5", "--square", "3mm", "-o",
                "{out}/camera.json"] + q, (0, 2), ("camera.json",)),
        Command("template of a mesh", ["template", "--mesh", str(case / "rest.obj"), "--albedo",
                str(case / "albedo.png"), "-o", "{out}/organ.template"] + q, (0, 2), ("organ.template",)),
        Command("template of frames", ["template", str(some), "--camera", str(clip / "camera.json"),
                "--vertices", "150", "-o", "{out}/organ.template"] + q, (0, 2), ("organ.template",)),
        Command("reconstruct", ["reconstruct", organ, str(work / "frames"), *given, *formats, "-o", "{out}"] + q,
                (0, 2), keeps_user=True),
        Command("track", ["track", str(clip / "organ.template"), str(clip / "frames"), "--camera",
                str(clip / "camera.json"), "--overlay", *formats, "-o", "{out}"] + q, (0, 2), keeps_user=True),
        Command("evaluate", ["evaluate", str(work / "done"), str(case / "truth"), "--camera",
                str(case / "camera.json"), "--json", "{out}/errors.json"] + q, (0, 1, 2), ("errors.json",)),
        Command("export", ["export", str(clip / "organ.template"), *meshes] + q, (0,),
                ("m.ply", "m.obj", "m.stl", "m.vtp", "m.glb")),
        Command("figure", ["figure", str(work / "done"), "-o", "{out}/plate.svg"] + q, (0,), ("plate.svg",)),
        Command("synth", ["synth", "--organ", "patch", "--vertices", "100", "--ext", "0,10", "--count", "3",
                "-o", "{out}"] + q, keeps_user=True),
        Command("synth --video", ["synth", "--video", "--frames", "3", "--size", "160x90", "--vertices", "100",
                "-o", "{out}"] + q, keeps_user=True),
        Command("experiment ext", ["experiment", "ext", "--vertices", "100", "--ext", "0,10", "--count", "2",
                "--methods", "rigid,dsfm", "-o", "{out}"] + q, keeps_user=True, log="cases.csv"),
        Command("experiment table1", ["experiment", "table1", "--vertices", "100", "-o", "{out}"] + q,
                keeps_user=True),
    ]
    if long:
        found.append(Command("demo", ["demo", "-o", "{out}"] + q, (0, 2), keeps_user=True))
    return found


def measure(binary, command, work):
    """Two undisturbed runs: how long, how much, and which files are the same bytes each time."""
    outs = [work / f"reference-{command.name.replace(' ', '-')}-{k}" for k in range(2)]
    for out in outs:
        out.mkdir()
        begin = time.monotonic()
        code, said = command.run(binary, out)
        command.seconds = time.monotonic() - begin
        if code not in command.codes:
            sys.exit(f"{command.name}: exit {code} without any fault: {said}")
        command.code = code
    first, second = files(outs[0]), files(outs[1])
    if set(first) != set(second):
        sys.exit(f"{command.name}: two runs leave other files: {set(first) ^ set(second)}")
    for path in first.values():
        check_whole(path)
    command.size = sum(p.stat().st_size for p in first.values())
    same = {n: p.read_bytes() for n, p in first.items()}
    command.reference = {n: (b if b == second[n].read_bytes() else None) for n, b in same.items()}
    shutil.rmtree(outs[1])
    command.older = outs[0]


class Score:
    def __init__(self):
        self.rows, self.findings, self.skipped = {}, [], []

    def count(self, fault, command, wrong):
        row = self.rows.setdefault(fault, {"runs": 0, "commands": set(), "found": 0})
        row["runs"] += 1
        row["commands"].add(command)
        row["found"] += bool(wrong)
        for text in wrong:
            self.findings.append(f"{fault}, {command}: {text}")
            say(f"  FOUND {fault}, {command}: {text}")


LISTS = ("frames.pvd",)


def named(path):
    """Files that a list of ParaView names."""
    sets = xml.dom.minidom.parse(str(path)).getElementsByTagName("DataSet")
    return [entry.getAttribute("file") for entry in sets]


def after_fault(command, out, said, prepared, shorter=()):
    """What is wrong in the folder right after the fault."""
    wrong = []
    if "panicked" in said:
        wrong.append(f"it panics: {said.strip()[:300]}")
    present = files(out)
    for name, path in present.items():
        if name == "notes.txt":
            continue
        try:
            check_whole(path)
        except Broken as error:
            wrong.append(f"{name} is not whole: {error}")
            continue
        expected = command.reference.get(name)
        if name in LISTS:
            # What a run that could not write every frame says of those it wrote.
            wrong.extend(f"{name} names {f}, which is not there" for f in named(path) if not (out / f).exists())
        elif name not in command.reference:
            wrong.append(f"{name} is no file of an undisturbed run")
        elif expected is not None and name not in (command.log, *shorter) and path.read_bytes() != expected:
            wrong.append(f"{name} has other bytes than after an undisturbed run")
    if prepared:
        for name in command.replaced:
            aside = [p / name for p in out.glob(".old-template-*")]
            if not any(p.exists() for p in [out / name, *aside]):
                wrong.append(f"the older {name} is gone, and no newer one is there")
        if command.keeps_user and (out / "notes.txt").read_text() != USERS:
            wrong.append("the file of the user was changed")
    return wrong


def after_rerun(binary, command, out, done):
    """What is wrong after the same command has been run to its end."""
    code, said = command.run(binary, out)
    if code != command.code:
        return [f"the rerun ends with {code}: {said.strip()[:300]}"]
    wrong, present = [], files(out)
    present.pop("notes.txt", None)
    if set(present) != set(command.reference):
        wrong.append(f"the rerun leaves other files: {sorted(set(present) ^ set(command.reference))[:5]}")
    for name, expected in command.reference.items():
        path = present.get(name)
        if path and name != command.log:
            check = [] if expected is None or path.read_bytes() == expected else ["other bytes"]
            try:
                check_whole(path)
            except Broken as error:
                check.append(str(error))
            wrong.extend(f"{name} after the rerun: {text}" for text in check)
    left = [p.name for p in out.rglob("*") if p.name.startswith(PARTIAL) or p.name.endswith(STAGES)]
    if left:
        wrong.append(f"the rerun leaves {left[:3]}")
    if command.log and not set(done) <= set(cases(out, command)):
        wrong.append("cases that were done are lost")
    return wrong


def cases(out, command):
    """Complete lines of the file that grows."""
    path = out / (command.log or "")
    if not command.log or not path.is_file():
        return []
    return [line for line in path.read_text().splitlines(keepends=True) if line.endswith("\n")]


def fresh(command, place, older):
    """An output folder: empty, or with a finished older run and a file of the user."""
    out = place / "out"
    if out.exists():
        shutil.rmtree(out)
    if older:
        shutil.copytree(command.older, out)
        if command.keeps_user:
            (out / "notes.txt").write_text(USERS)
    else:
        out.mkdir()
    return out


def killed(binary, command, place, number, how, draw):
    older = draw.random() < 0.5
    out = fresh(command, place, older)
    lowest = 0.0 if draw.random() < 0.5 else 0.75
    moment = command.seconds * draw.uniform(lowest, 1.05)
    process = command.start(binary, out, start_new_session=True)
    try:
        said = process.communicate(timeout=moment)[1]
    except subprocess.TimeoutExpired:
        process.send_signal(how)
        said = process.communicate()[1]
    said = said.decode(errors="replace")
    done = cases(out, command)
    # A run that is interrupted ends behind the frame in work: files that hold every frame hold those that were done.
    shorter = FRAMES if process.returncode == 130 else ()
    return after_fault(command, out, said, older, shorter) + after_rerun(binary, command, out, done)


def mounted(place, size, *more):
    subprocess.run(["mount", "-t", "tmpfs", "-o", ",".join([f"size={size}", *more]), "tmpfs", str(place)], check=True)


def full(binary, command, place, part, temporary):
    """The disk has room for a part of the output. What must fit nevertheless: the folder itself."""
    size = max(8192, int(command.size * part))
    mounted(place, size)
    try:
        out = place / "out"
        out.mkdir()
        environment = {**os.environ, **({"TMPDIR": str(place)} if temporary else {})}
        code, said = command.run(binary, out, env=environment)
        # `track` ends with the shapes of the frames that were done, and says so.
        wrong = after_fault(command, out, said, False, FRAMES if code == 1 else ())
        complete = set(files(out)) >= set(command.reference)
        if code in (0, 2) and code == command.code and not complete:
            wrong.append(f"exit {code}, but files are missing")
        elif not complete and not any(w in said for w in ("No space left", "cannot write", "cannot be written")):
            wrong.append(f"exit {code} without a word of the disk: {said.strip()[:200]}")
        subprocess.run(["mount", "-o", "remount,size=1g", str(place)], check=True)
        return wrong + after_rerun(binary, command, out, cases(out, command))
    finally:
        subprocess.run(["umount", str(place)], check=True)


def read_only(binary, command, place, older):
    mounted(place, "1g")
    try:
        out = fresh(command, place, older)
        before = {n: p.read_bytes() for n, p in files(out).items()}
        subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
        code, said = command.run(binary, out)
        wrong = [f"it panics: {said.strip()[:300]}"] if "panicked" in said else []
        if code in (0, 2) and not (older and command.log):
            wrong.append(f"exit {code} on a read-only disk")
        if code not in (0, 2) and not said.strip():
            wrong.append("no word of what is wrong")
        if before != {n: p.read_bytes() for n, p in files(out).items()}:
            wrong.append("files have changed")
        subprocess.run(["mount", "-o", "remount,rw", str(place)], check=True)
        return wrong + after_rerun(binary, command, out, cases(out, command))
    finally:
        subprocess.run(["umount", str(place)], check=True)


def reader_gone(binary, words, count, stream):
    """Standard output or standard error is a pipe whose reader leaves after so many bytes."""
    reading, writing = os.pipe()
    other = tempfile.TemporaryFile()
    # Ignored in Python; a shell leaves it as it is.
    places = {"stdout": writing, "stderr": other} if stream == "stdout" else {"stdout": other, "stderr": writing}
    process = subprocess.Popen([str(binary), *words], restore_signals=True, **places)
    os.close(writing)
    if count:
        os.read(reading, count)
    os.close(reading)
    code = process.wait(timeout=300)
    other.seek(0)
    said = other.read().decode(errors="replace")
    wrong = [f"it panics: {said.strip()[:300]}"] if "panicked" in said else []
    # Of a panic whose message went into the closed pipe, the exit code tells.
    if code in (101, -signal.SIGABRT, -signal.SIGSEGV):
        wrong.append(f"exit {code}")
    return wrong


def say(text):
    print(text, file=sys.stderr, flush=True)


def stopped(*_):
    for process in RUNNING:
        process.kill()
    sys.exit(1)


def attack(options, score):
    binary, draw = options.binary.resolve(), random.Random(options.seed)
    with tempfile.TemporaryDirectory(prefix="dsfms-faults-", ignore_cleanup_errors=True) as folder:
        work = Path(folder)
        everything = commands(work, binary, options.count >= 100 or "demo" in (options.only or ""))
        chosen = [c for c in everything if re.search(options.only or "", c.name)]
        for command in chosen:
            measure(binary, command, work)
            say(f"{command.name}: {command.seconds:.1f} s, {command.size} bytes, exit {command.code}")
        place = work / "place"
        place.mkdir()
        # Commands that take long are met as often as the others; their reruns take the time.
        for number in range(options.count):
            command = chosen[number % len(chosen)]
            wrong = killed(binary, command, place, number, signal.SIGKILL, draw)
            score.count("kill -9", command.name, wrong)
        for number in range(max(1, options.count // 4)):
            command = chosen[number % len(chosen)]
            wrong = killed(binary, command, place, number, signal.SIGINT, draw)
            score.count("SIGINT", command.name, wrong)
        shutil.rmtree(place)
        place.mkdir()
        if os.geteuid() == 0:
            parts = [0.0, 0.3, 0.7, 0.95] if options.count < 100 else [k / 12 for k in range(12)]
            for command in (c for c in chosen if c.seconds < 15 or options.count >= 100):
                for k, part in enumerate(parts):
                    wrong = full(binary, command, place, part, k % 2 == 1)
                    score.count("full disk", command.name, wrong)
                for older in (False, True):
                    wrong = read_only(binary, command, place, older)
                    score.count("read-only disk", command.name, wrong)
        else:
            score.skipped.append("full and read-only disks: only root can mount a tmpfs")
        organ, done = str(work / "organ.template"), str(work / "done")
        clip = work / "clip"
        raw = ["track", str(clip / "organ.template"), str(clip / "frames"), "--camera", str(clip / "camera.json"),
               "--no-report"]
        talk = [["--help"], ["options", "reconstruct"], ["options", "template"], ["inspect", organ],
                ["completions", "bash"], ["help", "track"],
                ["evaluate", done, str(work / "cases/ext10/case_0000/truth")]]
        for count in (0, 1, 200):
            for words in talk:
                score.count("SIGPIPE", words[0], reader_gone(binary, words, count, "stdout"))
            out = work / f"piped-{count}"
            wrong = reader_gone(binary, [*raw, "-o", str(out)], count, "stderr")
            for name, path in files(out).items():
                try:
                    check_whole(path)
                except Broken as error:
                    wrong.append(f"{name}: {error}")
            if not (out / "vertices.npz").is_file():
                wrong.append("the run ends with its progress")
            score.count("SIGPIPE", "track, its progress", wrong)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", type=Path, required=True, help="dsfms, as released")
    parser.add_argument("--count", type=int, default=36, help="kills; default 36")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", help="a regular expression of names of commands")
    options = parser.parse_args()
    # So that nothing stays mounted or goes on, and what was done is told.
    signal.signal(signal.SIGTERM, stopped)
    score, whole = Score(), True
    try:
        attack(options, score)
    except (SystemExit, KeyboardInterrupt) as end:
        if isinstance(getattr(end, "code", 1), str):
            raise
        whole = False
        score.skipped.append("what comes after the runs above: this run was stopped")
    print("| fault | runs | commands | runs with a finding |\n| --- | --- | --- | --- |")
    for fault, row in score.rows.items():
        print(f"| {fault} | {row['runs']} | {len(row['commands'])} | {row['found']} |")
    for text in score.skipped:
        print(f"\nskipped: {text}")
    for text in score.findings:
        print(f"- {text}")
    sys.exit(0 if whole and not score.findings else 1)


if __name__ == "__main__":
    main()
