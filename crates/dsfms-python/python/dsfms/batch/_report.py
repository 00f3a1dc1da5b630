"""What a run leaves: failures by name, seams, an overview."""

from __future__ import annotations

import io
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from html import escape
from typing import Any
from urllib.parse import quote

import numpy as np

from ._manifest import Job
from ._picture import COLORS
from ._store import Store
from ._tasks import Stretch


@dataclass(frozen=True)
class Failure:
    """A task that failed as often as it was allowed to."""

    task: str
    error: str
    attempts: int


@dataclass(frozen=True)
class Seam:
    """Two stretches of a video where they overlap, lengths in the template's unit.

    `rms` and `largest` compare the vertices of frames that both have; `frames` counts these frames, and
    both are NaN where there are none.
    """

    video: str
    frame: int
    frames: int
    rms: float
    largest: float


@dataclass(frozen=True)
class Report:
    """The end of a run.

    Attributes
    ----------
    parts : int
        Stretches that are done, in this run or before.
    computed : int
        Stretches that were done in this run.
    retried : int
        Tasks that were tried again.
    failures : list of Failure
        Tasks that failed.
    seams : list of Seam
        Neighbouring stretches compared.
    statuses : dict
        Number of frames of every status.
    task_seconds : float
        Time within tasks of this run, summed.
    seconds : float
        Wall time of this run.
    overview : str
        Place of the HTML page.
    """

    parts: int
    computed: int
    retried: int
    failures: list[Failure]
    seams: list[Seam]
    statuses: dict[str, int]
    task_seconds: float
    seconds: float
    overview: str = field(default="")

    def plain(self) -> dict[str, Any]:
        """As plain values."""
        return asdict(self)


def _vertices(store: Store, stretch: Stretch) -> tuple[Any, Any]:
    with np.load(io.BytesIO(store.read(f"vertices/{stretch.stem}.npz"))) as arrays:
        return arrays["frame"], arrays["vertices"]


def seams(store: Store, done: Iterable[Stretch]) -> list[Seam]:
    """Every stretch that is done beside the one before it in the same video, in the frames that both tracked."""
    done = sorted(done, key=lambda s: (s.job.name, s.start))
    found: list[Seam] = []
    for before, after in zip(done, done[1:], strict=False):
        if before.job.name != after.job.name or before.stop != after.start or after.overlap == 0:
            continue
        (frames_a, shapes_a), (frames_b, shapes_b) = _vertices(store, before), _vertices(store, after)
        common, a, b = np.intersect1d(frames_a, frames_b, return_indices=True)
        away = np.linalg.norm(shapes_a[a] - shapes_b[b], axis=2)
        both = np.isfinite(away).all(axis=1)
        away = away[both]
        number = int(both.sum())
        rms = float(np.sqrt(np.mean(away**2))) if number else float("nan")
        largest = float(away.max()) if number else float("nan")
        found.append(Seam(after.job.name, after.start, int(len(common[both])), rms, largest))
    return found


def statuses(store: Store, stretch: Stretch) -> list[str]:
    """Status of every frame of a stretch that is done."""
    import pyarrow.parquet as pq

    table = pq.read_table(io.BytesIO(store.read(stretch.part)), columns=["status"])
    return [str(value) for value in table.column("status").to_pylist()]


def _bar(values: list[str]) -> str:
    """Runs of one status as a bar."""
    parts, start = [], 0
    for i in range(1, len(values) + 1):
        if i == len(values) or values[i] != values[start]:
            red, green, blue = COLORS[values[start]]
            width = 100 * (i - start) / len(values)
            parts.append(
                f"<i style='width:{width:.2f}%;background:rgb({red},{green},{blue})' "
                f"title='{values[start]}: {i - start} frames'></i>"
            )
            start = i
    return f"<span class='bar'>{''.join(parts)}</span>"


_STYLE = """
body{font:15px system-ui,sans-serif;margin:2em;color:#223}
table{border-collapse:collapse}td,th{padding:.4em .8em;border-bottom:1px solid #ddd;text-align:left}
.bar{display:flex;width:24em;height:1em;background:#ddd}.bar i{display:block;height:100%}
img{height:72px;margin-right:4px}.failed{color:#a22}
"""


def overview(
    store: Store, jobs: list[Job], stretches: list[Stretch], done: dict[Stretch, list[str]], report: Report
) -> str:
    """The page: one row a video with pictures, statuses, seams and links.

    `done` has the statuses of the frames of every stretch that is done.
    """
    rows = []
    of_video: dict[str, list[Stretch]] = defaultdict(list)
    for stretch in sorted(stretches, key=lambda s: s.start):
        of_video[stretch.job.name].append(stretch)
    worst_seam: dict[str, float] = {}
    for seam in report.seams:
        if seam.rms == seam.rms:
            worst_seam[seam.video] = max(seam.rms, worst_seam.get(seam.video, 0.0))
    errors: dict[str, list[str]] = defaultdict(list)
    for failure in report.failures:
        errors[failure.task.split(" ")[0]].append(failure.error)
    for job in jobs:
        own = of_video[job.name]
        finished = [s for s in own if s in done]
        values = [value for s in finished for value in done[s]]
        pictures = "".join(
            f"<img alt='' loading='lazy' src='thumbnails/{escape(quote(s.stem, safe='/='))}.png'>"
            for s in finished[:: max(1, len(finished) // 4)][:4]
        )
        counts = ", ".join(f"{n} {status}" for status, n in sorted(Counter(values).items()))
        worst = f"{worst_seam[job.name]:.3f}" if job.name in worst_seam else ""
        text = "<br>".join(f"<span class='failed'>{escape(error)}</span>" for error in errors[job.name])
        link = f"frames/video={escape(job.name)}/"
        rows.append(
            f"<tr><td><a href='{link}'>{escape(job.name)}</a></td><td>{pictures}</td>"
            f"<td>{_bar(values) if values else ''}{counts}{text}</td>"
            f"<td>{len(finished)} of {len(own)}</td><td>{worst}</td></tr>"
        )
    failed = f", <span class='failed'>{len(report.failures)} tasks failed</span>" if report.failures else ""
    page = (
        "<!doctype html><html lang='en'><meta charset='utf-8'><title>dsfms batch</title>"
        f"<style>{_STYLE}</style><h1>dsfms batch</h1><p>{len(jobs)} videos, {report.parts} stretches"
        f"{failed}. <a href='report.json'>report.json</a></p><table><tr><th>video</th><th>frames</th>"
        "<th>status</th><th>stretches</th><th>worst seam (rms)</th></tr>" + "".join(rows) + "</table></html>"
    )
    store.write("index.html", page.encode())
    return store.path("index.html")
