"""The notebooks run from first to last cell. With DSFMS_KEEP_NOTEBOOKS=1 their pictures are kept."""

import os
from pathlib import Path

import pytest
from conftest import ROOT, SCENE

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")

NOTEBOOKS = ROOT / "docs/python/notebooks"


@pytest.mark.parametrize("name", ["first_surface", "own_recording", "experiment"])
def test_it_runs(name: str, scene: Path, clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keep = os.environ.get("DSFMS_KEEP_NOTEBOOKS") == "1"
    monkeypatch.setenv("DSFMS_SCENE", str(SCENE if keep else scene))
    monkeypatch.setenv("DSFMS_CLIP", str(clip))
    monkeypatch.setenv("DSFMS_CASES", "5" if keep else "1")
    path = NOTEBOOKS / f"{name}.ipynb"
    notebook = nbformat.read(path, as_version=4)
    client = nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3")
    client.execute()
    pictures = [
        output
        for cell in notebook.cells
        for output in cell.get("outputs", [])
        if "image/png" in output.get("data", {})
    ]
    assert pictures, "a notebook shows pictures"
    if keep:
        for cell in notebook.cells:
            cell.metadata.pop("execution", None)
        nbformat.write(notebook, path)


@pytest.mark.parametrize("name", ["first_surface", "own_recording", "experiment"])
def test_its_pictures_are_kept(name: str) -> None:
    text = (NOTEBOOKS / f"{name}.ipynb").read_text()
    assert '"image/png"' in text and '"output_type": "error"' not in text
