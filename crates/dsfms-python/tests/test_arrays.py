"""Arrays of any kind go in; what does not fit is named."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import dsfms


class Tensor:
    """What a torch tensor on the CPU shows of itself: the array protocol."""

    def __init__(self, data: NDArray[Any]) -> None:
        self.data = data

    def __array__(self, dtype: Any = None, copy: Any = None) -> NDArray[Any]:
        return self.data


@pytest.fixture(scope="module")
def case() -> dsfms.Case:
    return dsfms.synthesize(vertices=120, matches=60, everywhere=True)


def solve(case: dsfms.Case, image: Any) -> NDArray[np.float64]:
    return dsfms.reconstruct(case.template, image, case.camera, method="dsfms", matches=case.matches).vertices


def test_every_kind_of_image_gives_the_same(case: dsfms.Case) -> None:
    expected = solve(case, case.image)
    wide = case.image.astype(np.uint16) * 257
    padded = np.zeros((*case.image.shape[:2], 8), np.uint8)
    padded[..., 1:7:2] = case.image
    kinds = {
        "uint16": wide,
        "float64": case.image / 255.0,
        "float32": (case.image / 255.0).astype(np.float32),
        "strides": padded[..., 1:7:2],
        "negative strides": np.ascontiguousarray(case.image[::-1, :, ::-1])[::-1, :, ::-1],
        "Fortran order": np.asfortranarray(case.image),
        "big endian": wide.astype(">u2").astype(np.uint16),
        "array protocol": Tensor(case.image),
        "torch-like strides": Tensor(np.moveaxis(np.ascontiguousarray(np.moveaxis(case.image, 2, 0)), 0, 2)),
    }
    for name, image in kinds.items():
        assert np.array_equal(solve(case, image), expected), name


@pytest.mark.parametrize(
    "bad",
    [
        np.zeros((576, 720), np.uint8),
        np.zeros((576, 720, 4), np.uint8),
        np.zeros((576, 720, 3), np.int32),
        np.zeros((0, 0, 3), np.uint8),
        np.zeros((100, 100, 3), np.uint8),
        np.full((576, 720, 3), np.nan),
        np.full((576, 720, 3), 128.0),
        object(),
    ],
    ids=["grey", "rgba", "int32", "empty", "size", "nan", "0 to 255 as float", "object"],
)
def test_a_wrong_image_is_named(case: dsfms.Case, bad: Any) -> None:
    with pytest.raises(ValueError, match="image: expected .*, found "):
        solve(case, bad)


def test_wrong_masks_and_matches_are_named(case: dsfms.Case) -> None:
    def call(**more: Any) -> None:
        dsfms.reconstruct(case.template, case.image, case.camera, **more)

    good = case.matches
    last = good.copy()
    last[3, 0] = 1e6
    for argument, value in [
        ("instrument_mask", np.zeros((10, 10), bool)),
        ("organ_mask", np.zeros((576, 720), np.float32)),
        ("matches", good[:, :5]),
        ("matches", np.where(good == good[0, 4], np.nan, good)),
        ("matches", last),
        ("matches", np.array([["a"] * 6])),
        ("options", "[register]\nnot_there = 1"),
        ("method", "magic"),
    ]:
        with pytest.raises(ValueError, match=f"^{argument}: expected .*, found "):
            call(**{"method": "dsfm", "matches": good, argument: value})


def test_masks_count(case: dsfms.Case) -> None:
    none = np.zeros((576, 720), np.uint8)
    everything = none == 0
    plain = dsfms.reconstruct(case.template, case.image, case.camera, method="dsfms", matches=case.matches)
    same = dsfms.reconstruct(case.template, case.image, case.camera, method="dsfms", matches=case.matches,
                             instrument_mask=none)  # fmt: skip
    assert np.array_equal(plain.vertices, same.vertices)
    hidden = dsfms.reconstruct(case.template, case.image, case.camera, method="dsfms", matches=case.matches,
                               instrument_mask=everything)  # fmt: skip
    assert hidden.visible.sum() < plain.visible.sum()
