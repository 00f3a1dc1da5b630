"""The examples run, and pyright finds nothing in its strict mode."""

import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT

EXAMPLES = ROOT / "crates/dsfms-python/examples"


def run(name: str, *arguments: object) -> str:
    command = [sys.executable, str(EXAMPLES / name), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_first_surface(scene: Path) -> None:
    out = run("first_surface.py", scene)
    assert out.startswith(("ok", "degraded")) and ", 3)" in out


def test_follow_a_video(clip: Path) -> None:
    out = run("follow_a_video.py", clip / "organ.template", clip / "frames", clip / "camera.json")
    assert len(out.splitlines()) == 12 and "median depth" in out


def test_error_against_extension() -> None:
    out = run("error_against_extension.py").splitlines()
    assert len(out) == 3 and all("joint" in line for line in out)


def test_pyright_strict() -> None:
    pytest.importorskip("pyright")
    command = [sys.executable, "-m", "pyright", "--project", str(ROOT), "--pythonpath", sys.executable]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=ROOT)
    assert done.returncode == 0, done.stdout
    assert "0 errors, 0 warnings" in done.stdout
