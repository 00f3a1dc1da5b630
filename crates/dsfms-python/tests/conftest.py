"""What the tests share: the command line, the demo's scene, one template of it."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import dsfms
from dsfms.batch._picture import png

ROOT = Path(__file__).resolve().parents[3]
SCENE = ROOT / "crates/dsfms-cli/data/demo"
PROGRAM = Path(os.environ.get("DSFMS_PROGRAM", ROOT / "target/release/dsfms"))

# A tenth of the fused vertices, in a third of the time.
COARSE = "[dense]\ntarget_vertices = 6000"

Run = Callable[..., None]


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scene of ``dsfms demo`` at half its size."""
    half = tmp_path_factory.mktemp("scene")
    for kind in ("exploration", "exploration_masks", "deformed"):
        (half / kind).mkdir()
        for path in (SCENE / kind).iterdir():
            (half / kind / f"{path.stem}.png").write_bytes(png(halved(pixels(path))))
    camera = json.loads((SCENE / "camera.json").read_text())
    for name in ("width", "height", "fx", "fy"):
        camera[name] = camera[name] // 2 if name in ("width", "height") else camera[name] / 2
    # Pixel centres lie at integers: those of a pair of pixels at halves.
    camera["cx"], camera["cy"] = ((camera[name] - 0.5) / 2 for name in ("cx", "cy"))
    (half / "camera.json").write_text(json.dumps(camera))
    return half


@pytest.fixture(scope="session")
def program() -> Run:
    """The command line, built before: ``program("template", ...)``."""
    assert PROGRAM.is_file(), f"{PROGRAM} is missing; build it with cargo build --release"

    def run(*arguments: object) -> None:
        done = subprocess.run(
            [str(PROGRAM), "--quiet", *map(str, arguments)], capture_output=True, text=True, timeout=600
        )
        # 2: some frames are degraded.
        assert done.returncode in (0, 2), done.stderr

    return run


@pytest.fixture(scope="session")
def camera(scene: Path) -> dsfms.Camera:
    """Camera of the scene."""
    return dsfms.read_camera(scene / "camera.json")


@pytest.fixture(scope="session")
def template(scene: Path, camera: dsfms.Camera) -> dsfms.Template:
    """A small template of the scene, from its files."""
    return dsfms.build_template(
        scene / "exploration", camera, organ_masks=scene / "exploration_masks", vertices=300, options=COARSE
    )


@pytest.fixture(scope="session")
def image(scene: Path) -> NDArray[np.uint8]:
    """A deformed frame."""
    return pixels(first(scene / "deformed"))


@pytest.fixture(scope="session")
def surface(template: dsfms.Template, image: NDArray[np.uint8], camera: dsfms.Camera) -> dsfms.Surface:
    """Its surface by motion."""
    return dsfms.reconstruct(template, image, camera, method="dsfm")


@pytest.fixture(scope="session")
def clip(program: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip of 12 frames with its template."""
    folder = tmp_path_factory.mktemp("clip") / "clip"
    program("--seed", 1, "synth", "--video", "--organ", "uterus", "--frames", 12, "--size", "320x240",
            "--vertices", 150, "-o", folder)  # fmt: skip
    return folder


def first(folder: Path) -> Path:
    """The first image of a folder."""
    return sorted(p for p in folder.iterdir() if p.suffix in (".png", ".jpg"))[0]


def halved(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Means of four pixels."""
    height, width, channels = image.shape
    blocks = image.reshape(height // 2, 2, width // 2, 2, channels).astype(np.float64)
    return np.round(blocks.mean(axis=(1, 3))).astype(np.uint8)


def pixels(path: Path) -> NDArray[np.uint8]:
    """An image as an array, decoded as the command line does."""
    return next(dsfms.Frames(path))


def ply_vertices(path: Path) -> NDArray[np.float64]:
    """Vertices of a PLY file of the command line, binary little endian or text."""
    data = path.read_bytes()
    head, body = data.split(b"end_header\n", 1)
    lines = head.decode().splitlines()
    count = int(next(line for line in lines if line.startswith("element vertex")).split()[2])
    kinds = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4", "uint": "<u4"}
    fields: list[tuple[str, str]] = []
    for line in lines[lines.index(f"element vertex {count}") + 1 :]:
        if not line.startswith("property"):
            break
        _, kind, name = line.split()
        fields.append((name, kinds[kind]))
    if "format ascii 1.0" in lines:
        rows = np.loadtxt(body.decode().splitlines()[:count], ndmin=2)
        return rows[:, :3]
    table = np.frombuffer(body, dtype=fields, count=count)
    return np.stack([table["x"], table["y"], table["z"]], axis=1)
