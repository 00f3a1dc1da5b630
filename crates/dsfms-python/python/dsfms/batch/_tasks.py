"""What a worker does: build a template, track a stretch. Neither knows of Ray."""

from __future__ import annotations

import io
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import dsfms

from ._manifest import Job
from ._picture import thumbnail
from ._store import Store, pack, unpack


@dataclass(frozen=True)
class Stretch:
    """Frames ``start`` to ``stop - 1`` of a video, tracked from ``start - overlap`` on."""

    job: Job
    start: int
    stop: int
    overlap: int

    @property
    def stem(self) -> str:
        """Name of its files, without folder and ending."""
        return f"video={self.job.name}/part-{self.start:07d}-{self.stop:07d}"

    @property
    def part(self) -> str:
        """The Parquet file; it is written last, so where it is the stretch is done."""
        return f"frames/{self.stem}.parquet"

    @property
    def label(self) -> str:
        """As reports name it."""
        return f"{self.job.name} frames {self.start} to {self.stop - 1}"


def template_name(job: Job) -> str:
    """The file of a built template."""
    return f"templates/{job.template_key}.tar"


def count(job: Job) -> int:
    """Frames of a video."""
    return dsfms.frame_count(job.video)


def build(job: Job, to: str) -> dict[str, Any]:
    """Build the template of a job and store it."""
    begin = time.monotonic()
    template = dsfms.build_template(
        job.exploration,
        job.camera,
        organ_masks=job.organ_masks or None,
        vertices=job.vertices,
        seed=job.seed,
    )
    with tempfile.TemporaryDirectory() as folder:
        template.save(Path(folder) / "template")
        Store(to).write(template_name(job), pack(Path(folder) / "template"))
    return {"seconds": time.monotonic() - begin}


def _template(job: Job, store: Store) -> dsfms.Template:
    if job.template:
        return dsfms.Template.load(job.template)
    with tempfile.TemporaryDirectory() as folder:
        unpack(store.read(template_name(job)), Path(folder))
        return dsfms.Template.load(folder)


#: Columns of measures, NaN where a frame has none.
_NUMBERS = ("residual_px", "photometric", "agreement", "depth_uncertainty")


def _row(number: int, surface: dsfms.Surface) -> dict[str, Any]:
    kept = surface.matches_kept
    return {
        "frame": number,
        "status": surface.status.value,
        "reasons": [str(reason) for reason in surface.reasons],
        "reason_kinds": [reason.kind.value for reason in surface.reasons],
        "pose": surface.pose.ravel().tolist(),
        "visible": int(surface.visible.sum()),
        "matches": len(kept),
        "matches_kept": int(kept.sum()),
        "residual_px": _residual(surface),
        "photometric": surface.photometric,
        "agreement": surface.agreement,
        "depth_uncertainty": surface.depth_uncertainty,
    }


def _lost(number: int) -> dict[str, Any]:
    """The row of a frame that cannot be decoded; columns that it does not name have no value."""
    return {
        "frame": number,
        "status": dsfms.Status.LOST.value,
        "reasons": ["the frame cannot be decoded"],
        "reason_kinds": [dsfms.ReasonKind.INPUT.value],
        "pose": [float("nan")] * 16,
        "visible": 0,
        "matches": 0,
        "matches_kept": 0,
    }


def _fill(rows: list[dict[str, Any]], shapes: list[NDArray[np.float64]], numbers: range, count: int) -> None:
    """Frames that cannot be decoded are lost under their own numbers."""
    rows.extend(_lost(number) for number in numbers)
    shapes.extend(np.full((count, 3), np.nan) for _ in numbers)


def _residual(surface: dsfms.Surface) -> float:
    """Median distance of the kept matches from the surface, px; NaN where there are none."""
    matches = surface.matches[surface.matches_kept]
    if len(matches) == 0 or surface.status is dsfms.Status.LOST:
        return float("nan")
    corners = surface.vertices[surface.faces[matches[:, 0].astype(np.int64)]]
    points = np.einsum("kc,kcx->kx", matches[:, 1:4], corners)
    away = np.linalg.norm(surface.camera.project(points) - matches[:, 4:6], axis=1)
    return float(np.nanmedian(away))


def _table(rows: list[dict[str, Any]]) -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as pq

    numbers = {name: pa.float64() for name in _NUMBERS}
    counts = {name: pa.int64() for name in ("visible", "matches", "matches_kept")}
    texts = pa.list_(pa.string())
    first = {"frame": pa.int64(), "status": pa.string(), "reasons": texts, "reason_kinds": texts}
    schema = pa.schema({**first, "pose": pa.list_(pa.float64(), 16), **counts, **numbers})
    rows = [dict.fromkeys(_NUMBERS, float("nan")) | row for row in rows]
    out = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(rows, schema=schema), out, compression="zstd")
    return out.getvalue()


def _arrays(numbers: list[int], shapes: list[NDArray[np.float64]]) -> bytes:
    out = io.BytesIO()
    stacked = np.stack(shapes).astype(np.float32)
    np.savez_compressed(out, frame=np.array(numbers, dtype=np.int64), vertices=stacked)
    return out.getvalue()


def track(stretch: Stretch, to: str) -> dict[str, Any]:
    """Track a stretch and store its files: vertices (with those of the overlap), picture, table."""
    begin = time.monotonic()
    store, job = Store(to), stretch.job
    template = _template(job, store)
    tracker = dsfms.Tracker(
        template, job.camera or None, method=job.method, options=job.options or None, seed=job.seed
    )
    first = max(0, stretch.start - stretch.overlap)
    rows: list[dict[str, Any]] = []
    shapes: list[NDArray[np.float64]] = []
    picture = b""
    middle = (stretch.start + stretch.stop) // 2
    frames = dsfms.Frames(job.video, first, stretch.stop)
    for image in frames:
        number = frames.number or 0
        _fill(rows, shapes, range(first + len(rows), number), len(template.vertices))
        surface = tracker.push(image)
        rows.append(_row(number, surface))
        shapes.append(surface.vertices)
        if number == middle or not picture:
            picture = thumbnail(image, surface)
    if not rows:
        raise RuntimeError(f"no frame of {stretch.label} can be decoded")
    _fill(rows, shapes, range(first + len(rows), stretch.stop), len(template.vertices))
    numbers = [row["frame"] for row in rows]
    inside = [row for row in rows if row["frame"] >= stretch.start]
    store.write(f"vertices/{stretch.stem}.npz", _arrays(numbers, shapes))
    store.write(f"thumbnails/{stretch.stem}.png", picture)
    store.write(stretch.part, _table(inside))
    return {"seconds": time.monotonic() - begin, "frames": len(rows)}


def described(job: Job) -> dict[str, Any]:
    """A job as plain values."""
    return asdict(job)
