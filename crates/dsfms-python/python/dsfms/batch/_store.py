"""Files of a run at any fsspec location. A file appears whole or not at all."""

from __future__ import annotations

import io
import json
import tarfile
import uuid
from pathlib import Path
from typing import Any

import fsspec


class Store:
    """A folder, local or of any fsspec file system."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.fs, self.root = fsspec.core.url_to_fs(url)

    def path(self, name: str) -> str:
        """Full path of a file."""
        return f"{self.root.rstrip('/')}/{name}"

    def exists(self, name: str) -> bool:
        """Whether a file is there, whole."""
        return bool(self.fs.exists(self.path(name)))

    def names(self, folder: str) -> list[str]:
        """Files below a folder, relative to the store, sorted; not those that are being written."""
        if not self.exists(folder):
            return []
        found = self.fs.find(self.path(folder))
        start = len(self.path("")) if self.path("").startswith("/") else len(self.root.rstrip("/")) + 1
        names = [str(path)[start:] for path in found]
        return sorted(name for name in names if ".partial-" not in name)

    def write(self, name: str, data: bytes) -> None:
        """Write a file under another name and move it."""
        target = self.path(name)
        folder = target.rsplit("/", 1)[0]
        self.fs.makedirs(folder, exist_ok=True)
        partial = f"{folder}/.partial-{uuid.uuid4().hex}"
        with self.fs.open(partial, "wb") as file:
            file.write(data)
        self.fs.mv(partial, target)

    def read(self, name: str) -> bytes:
        """The bytes of a file."""
        with self.fs.open(self.path(name), "rb") as file:
            return bytes(file.read())

    def write_json(self, name: str, value: Any) -> None:
        """A JSON file."""
        self.write(name, (json.dumps(value, indent=1, sort_keys=True) + "\n").encode())

    def read_json(self, name: str) -> Any:
        """What a JSON file holds."""
        return json.loads(self.read(name))


def pack(folder: Path) -> bytes:
    """A folder as a tar file of the same bytes for the same files."""
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w") as tar:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                info = tarfile.TarInfo(str(path.relative_to(folder)))
                info.size = path.stat().st_size
                with path.open("rb") as file:
                    tar.addfile(info, file)
    return out.getvalue()


def unpack(data: bytes, folder: Path) -> None:
    """The files of `pack`."""
    with tarfile.open(fileobj=io.BytesIO(data)) as tar:
        tar.extractall(folder, filter="data")
