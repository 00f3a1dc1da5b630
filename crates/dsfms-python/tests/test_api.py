"""Every public name is documented and tested, and the stubs tell the truth."""

import ast
import importlib
import inspect
from pathlib import Path

import pytest

import dsfms

HERE = Path(__file__).parent
MODULES = ["dsfms", "dsfms.bridges", "dsfms.rerun", "dsfms.batch"]


def public() -> list[tuple[str, object]]:
    names: list[tuple[str, object]] = []
    for module in MODULES:
        loaded = importlib.import_module(module)
        for name in loaded.__all__:
            names.append((f"{module}.{name}", getattr(loaded, name)))
    return names


@pytest.mark.parametrize(("name", "item"), public(), ids=[name for name, _ in public()])
def test_it_has_a_docstring_and_a_test(name: str, item: object) -> None:
    short = name.rsplit(".", 1)[-1]
    if short != "__version__":
        assert inspect.getdoc(item), name
    tests = "\n".join(p.read_text() for p in HERE.glob("test_*.py"))
    assert f".{short}" in tests or f"import {short}" in tests or short == "__version__", name


@pytest.mark.parametrize("kind", [dsfms.Camera, dsfms.Template, dsfms.Surface, dsfms.Tracker])
def test_every_member_has_a_docstring_and_a_test(kind: type) -> None:
    tests = "\n".join(p.read_text() for p in HERE.glob("test_*.py"))
    for name, member in vars(kind).items():
        if not name.startswith("_"):
            assert inspect.getdoc(member), f"{kind.__name__}.{name}"
            assert f".{name}" in tests, f"{kind.__name__}.{name} has no test"


def test_the_stubs_name_what_is_there() -> None:
    from dsfms import _dsfms

    stubs = ast.parse((Path(dsfms.__file__).parent / "_dsfms.pyi").read_text())
    told = {n.name: n for n in stubs.body if isinstance(n, ast.ClassDef | ast.FunctionDef)}
    there = {name for name in dir(_dsfms) if not name.startswith("__")}
    assert there == set(told) - {"SupportsArray"}
    for name in ("Camera", "Template", "Surface", "Tracker"):
        members = {m.name for m in told[name].body if isinstance(m, ast.FunctionDef)}  # type: ignore[attr-defined]
        own = {m for m in vars(getattr(_dsfms, name)) if not m.startswith("_")}
        assert own == {m for m in members if not m.startswith("_")}, name


def test_version() -> None:
    from importlib.metadata import version

    assert dsfms.__version__ == version("dsfms")


def test_errors_are_one_hierarchy() -> None:
    kinds = [dsfms.FileError, dsfms.BuildError, dsfms.ReconstructionError, dsfms.TrackingError,
             dsfms.CalibrationError, dsfms.EvaluationError]  # fmt: skip
    assert all(issubclass(kind, dsfms.DsfmsError) for kind in kinds)
    assert issubclass(dsfms.DsfmsWarning, UserWarning)
