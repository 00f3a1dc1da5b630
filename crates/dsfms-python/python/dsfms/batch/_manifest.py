"""The manifest: one row a video."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

COLUMNS = (
    "video",
    "camera",
    "template",
    "exploration",
    "organ_masks",
    "name",
    "method",
    "vertices",
    "options",
    "seed",
)


@dataclass(frozen=True)
class Job:
    """One video.

    Attributes
    ----------
    name : str
        Names its partition; unique. Default the stem of the video, numbered where two agree.
    video : str
        A video, or a folder of images.
    camera : str
        Its camera file; empty: the template's own.
    template, exploration : str
        A template folder, or the frames to build one from; one of the two.
    organ_masks : str
        Organ masks of the exploration.
    method : str
        "dsfm" or "joint".
    vertices : int
        Of a template that is built.
    options : str
        TOML text for the tracker.
    seed : int
        Of every random draw.
    """

    name: str
    video: str
    camera: str = ""
    template: str = ""
    exploration: str = ""
    organ_masks: str = ""
    method: str = "joint"
    vertices: int = 1000
    options: str = ""
    seed: int = 0

    @property
    def template_key(self) -> str:
        """What a built template depends on, as a name; empty where one is given."""
        if self.template:
            return ""
        parts = [self.exploration, self.camera, self.organ_masks, self.vertices, self.seed]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]


def _rows(path: str) -> list[dict[str, Any]]:
    import pyarrow as pa
    import pyarrow.csv as csv
    import pyarrow.parquet as pq

    if not Path(path).is_file():
        raise FileNotFoundError(f"manifest: {path} does not exist")
    if path.endswith((".parquet", ".pq")):
        return pq.read_table(path).to_pylist()
    text = csv.ConvertOptions(column_types={name: pa.string() for name in COLUMNS})
    try:
        return csv.read_csv(path, convert_options=text).to_pylist()
    except pa.ArrowInvalid as error:
        raise ValueError(f"manifest: {path} is not a CSV file: {error}") from error


def _whole(row: int, column: str, value: Any, least: int) -> int:
    try:
        number = int(value)
    except ValueError:
        number = least - 1
    if number < least:
        raise ValueError(
            f"manifest: row {row}: {column}: expected a whole number from {least}, found {value!r}"
        )
    return number


def read_manifest(manifest: str | Path | Iterable[Mapping[str, Any]]) -> list[Job]:
    """Jobs of a CSV or Parquet file, or of rows.

    Relative paths are of the working directory.

    Raises
    ------
    ValueError
        A column that does not exist, a row without video or template; row and column are named.
    FileNotFoundError
        No such file.
    """
    rows: list[Mapping[str, Any]]
    rows = list(_rows(str(manifest)) if isinstance(manifest, str | Path) else manifest)
    if not rows:
        raise ValueError("manifest: expected one row a video, found none")
    jobs: list[Job] = []
    names: set[str] = set()
    for number, given in enumerate(rows, start=1):
        row = {key.strip(): value for key, value in given.items() if value not in (None, "")}
        unknown = sorted(set(row) - set(COLUMNS))
        if unknown:
            raise ValueError(
                f"manifest: row {number}: expected columns of {', '.join(COLUMNS)}; found {unknown[0]}"
            )
        if "video" not in row:
            raise ValueError(f"manifest: row {number}: video: expected a path, found nothing")
        if ("template" in row) == ("exploration" in row):
            raise ValueError(f"manifest: row {number}: expected either a template or an exploration")
        if "exploration" in row and "camera" not in row:
            raise ValueError(f"manifest: row {number}: camera: expected a file, for an exploration needs it")
        method = str(row.get("method", "joint"))
        if method not in ("dsfm", "joint"):
            raise ValueError(
                f"manifest: row {number}: method: expected dsfm or joint, found {method!r}"
            )
        stem = re.sub(r"[^\w.-]+", "_", str(row.get("name") or Path(str(row["video"])).stem))
        name, more = stem, 1
        while name in names:
            more += 1
            name = f"{stem}_{more}"
        names.add(name)
        text = {
            key: str(row.get(key, ""))
            for key in ("video", "camera", "template", "exploration", "organ_masks", "options")
        }
        jobs.append(
            Job(
                name=name,
                method=method,
                vertices=_whole(number, "vertices", row.get("vertices", 1000), 100),
                seed=_whole(number, "seed", row.get("seed", 0), 0),
                **text,
            )
        )
    return jobs
