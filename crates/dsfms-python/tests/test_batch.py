"""Many videos on a real Ray cluster of two nodes."""

import csv
import io
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Run

from dsfms import batch

ray = pytest.importorskip("ray")
pq = pytest.importorskip("pyarrow.parquet")

CLIPS = 12
FRAMES = 8


@pytest.fixture(scope="module")
def manifest(program: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve short clips, one that is no video, two that build their template, ten of one template."""
    folder = tmp_path_factory.mktemp("archive")
    program("--seed", 1, "synth", "--video", "--organ", "uterus", "--frames", CLIPS * FRAMES, "--size",
            "192x144", "--vertices", 150, "-o", folder / "clip")  # fmt: skip
    clip = folder / "clip"
    frames = sorted((clip / "frames").iterdir())
    rows: list[dict[str, Any]] = []
    for number in range(CLIPS):
        video = folder / f"clip_{number:02}"
        video.mkdir()
        for frame in frames[number * FRAMES : (number + 1) * FRAMES]:
            shutil.copy(frame, video / frame.name)
        rows.append({"video": video, "camera": clip / "camera.json", "template": clip / "organ.template"})
    broken = folder / "broken.mp4"
    broken.write_bytes(b"no video")
    rows.append({"video": broken, "camera": clip / "camera.json", "template": clip / "organ.template"})
    path = folder / "manifest.csv"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, ["video", "camera", "template"])
        writer.writeheader()
        writer.writerows(rows)
    return path


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """Two nodes of one core."""
    from ray.cluster_utils import Cluster

    nodes = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    nodes.add_node(num_cpus=1)
    ray.init(address=nodes.address, log_to_driver=False)
    assert len(ray.nodes()) == 2
    yield str(nodes.address)
    ray.shutdown()
    nodes.shutdown()


def kill_one_worker(killed: list[int], over: threading.Event) -> None:
    """Kill the first worker process that is seen at a stretch."""
    while not over.is_set():
        for entry in Path("/proc").iterdir():
            if not entry.name.isdigit():
                continue
            try:
                name = (entry / "cmdline").read_bytes()
            except OSError:
                continue
            if name.startswith(b"ray::dsfms clip_") and b"frames" in name:
                os.kill(int(entry.name), signal.SIGKILL)
                killed.append(int(entry.name))
                return
        time.sleep(0.01)


def parts(to: Path) -> dict[str, bytes]:
    """Tables and vertices of a run."""
    files = [p for kind in ("frames", "vertices") for p in (to / kind).rglob("*") if p.is_file()]
    return {str(p.relative_to(to)): p.read_bytes() for p in files}


@pytest.fixture(scope="module")
def finished(cluster: str, manifest: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A run during which a worker is killed."""
    to = tmp_path_factory.mktemp("out") / "run"
    killed: list[int] = []
    over = threading.Event()
    thread = threading.Thread(target=kill_one_worker, args=(killed, over))
    thread.start()
    steps: list[tuple[int, int, int]] = []
    report = batch.run(manifest, to, stretch=5, overlap=2, retries=1, progress=lambda *s: steps.append(s))
    over.set()
    thread.join()
    return to, report, killed, steps


def test_everything_but_the_broken_video_is_done(finished: Any) -> None:
    to, report, killed, steps = finished
    assert len(killed) == 1 and report.retried >= 2, "the killed worker and the broken video"
    assert report.parts == report.computed == 2 * CLIPS
    (failure,) = report.failures
    assert isinstance(report, batch.Report) and isinstance(failure, batch.Failure)
    assert failure.task.startswith("broken") and failure.attempts == 2 and "FileError" in failure.error
    assert sum(report.statuses.values()) == CLIPS * FRAMES
    assert steps[-1][0] + steps[-1][2] == steps[-1][1]
    table = pq.read_table(to / "frames")
    assert table.num_rows == CLIPS * FRAMES
    first = table.filter(__import__("pyarrow").compute.equal(table["video"], "clip_00")).to_pylist()
    assert sorted(row["frame"] for row in first) == list(range(FRAMES))
    assert all(len(row["pose"]) == 16 for row in first)
    good = [row for row in table.to_pylist() if row["status"] == "ok"]
    assert good and all(0 < row["photometric"] < 1 and 0 <= row["agreement"] <= 1 for row in good)
    with np.load(io.BytesIO((to / "vertices/video=clip_00/part-0000005-0000008.npz").read_bytes())) as arrays:
        assert arrays["frame"].tolist() == [3, 4, 5, 6, 7] and arrays["vertices"].dtype == np.float32


def test_seams_are_told(finished: Any) -> None:
    _, report, _, _ = finished
    assert len(report.seams) == CLIPS and all(isinstance(s, batch.Seam) for s in report.seams)
    compared = [s for s in report.seams if s.frames > 0]
    assert compared and all(0 <= s.rms <= s.largest for s in compared)


def test_the_overview_shows_every_video(finished: Any) -> None:
    to, report, _, _ = finished
    page = (to / "index.html").read_text()
    assert report.overview == str(to / "index.html")
    assert all(f"clip_{i:02}" in page for i in range(CLIPS)) and "FileError" in page
    pictures = re.findall("src='([^']+)'", page)
    assert len(pictures) == 2 * CLIPS and all((to / picture).stat().st_size > 0 for picture in pictures)


def test_the_same_call_goes_on_where_it_was(finished: Any, manifest: Path) -> None:
    to, _, _, _ = finished
    before = parts(to)
    lost = to / "frames/video=clip_03/part-0000000-0000005.parquet"
    lost.unlink()
    again = batch.run(manifest, to, stretch=5, overlap=2, retries=0)
    assert again.computed == 1 and again.parts == 2 * CLIPS
    assert parts(to) == before
    with pytest.raises(ValueError, match="holds another run"):
        batch.run(manifest, to, stretch=6, overlap=2)


def test_the_same_bits_on_one_worker_after_a_killed_driver(
    finished: Any, manifest: Path, tmp_path: Path
) -> None:
    """The command line, killed and called again, on a local Ray of its own with one core."""
    to = tmp_path / "run"
    command = [sys.executable, "-m", "dsfms", "batch", str(manifest), "--to", str(to), "--stretch", "5",
               "--overlap", "2", "--retries", "0", "--address", "local"]  # fmt: skip
    begun = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 300
    while time.monotonic() < deadline and len(list(to.rglob("*.parquet"))) < 3:
        time.sleep(0.1)
    begun.kill()
    begun.wait()
    done = len(list(to.rglob("*.parquet")))
    assert 3 <= done < 2 * CLIPS
    again = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert again.returncode == 2 and "failed: broken" in again.stderr, again.stderr
    assert parts(to) == parts(finished[0])


def test_a_template_is_built_once(cluster: str, scene: Path, tmp_path: Path) -> None:
    video = tmp_path / "deformed"
    video.mkdir()
    for path in sorted((scene / "deformed").iterdir())[:2]:
        shutil.copy(path, video / path.name)
    row = {"video": video, "exploration": scene / "exploration", "camera": scene / "camera.json",
           "organ_masks": scene / "exploration_masks", "vertices": 150}  # fmt: skip
    report = batch.run([row, {**row, "name": "again"}], tmp_path / "out")
    assert not report.failures and report.parts == 2
    assert len(list((tmp_path / "out/templates").iterdir())) == 1
    a, b = (tmp_path / f"out/frames/video={name}" for name in ("deformed", "again"))
    assert [p.read_bytes() for p in a.iterdir()] == [p.read_bytes() for p in b.iterdir()]


def test_a_template_that_cannot_be_built_stops_its_videos_alone(
    cluster: str, clip: Path, tmp_path: Path
) -> None:
    good = {"video": clip / "frames", "camera": clip / "camera.json", "template": clip / "organ.template"}
    bad = {"video": clip / "frames", "name": "bad", "exploration": tmp_path / "nothing", "camera": clip / "camera.json"}
    report = batch.run([bad, good], tmp_path / "out", retries=0, overlap=0)
    assert report.parts == 1 and len(report.failures) == 2
    assert any("FileError" in f.error for f in report.failures)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({"video": "a.mp4"}, "row 1: expected either a template or an exploration"),
        ({"video": "a.mp4", "template": "t", "colour": "red"}, "row 1: expected columns"),
        ({"template": "t"}, "row 1: video: expected a path"),
        ({"video": "a.mp4", "exploration": "e"}, "row 1: camera"),
        ({"video": "a.mp4", "template": "t", "method": "sfs"}, "method: expected dsfm or joint"),
        ({"video": "a.mp4", "template": "t", "seed": "x"}, "seed: expected a whole number"),
    ],
)
def test_a_wrong_manifest_is_named(row: dict[str, str], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        batch.read_manifest([row])


def test_names_are_unique() -> None:
    jobs = batch.read_manifest([{"video": "a/x.mp4", "template": "t"}, {"video": "b/x.mp4", "template": "t"}])
    assert [job.name for job in jobs] == ["x", "x_2"] and isinstance(jobs[0], batch.Job)


def test_progress_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    show = batch.terminal_line()
    show(1, 2, 0)
    show(2, 2, 0)
    assert capsys.readouterr().err.count("\n") == 1
