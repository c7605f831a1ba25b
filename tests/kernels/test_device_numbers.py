"""A device against carried numbers: float64 oracles, and the CPU to the bit; needs Warp, NumPy and pytest alone."""

import os
import zlib
from pathlib import Path

import numpy as np
import pytest
from drawing import Drawn, draw, exact_poses, patch_array, surface_on

TOLERANCE = 1e-5  # [m]
CONTOURS = [field for field in Drawn.__dataclass_fields__ if field != "length"]
FILE_VARIABLE = "PALPATE_DEVICE_NUMBERS"


@pytest.fixture(scope="module", params=["carried", "made here"])
def numbers(request, tmp_path_factory):
    """The file that was carried here, and a small one made here where oracles are installed."""
    path = os.environ.get(FILE_VARIABLE)
    if request.param == "made here":
        pytest.importorskip("shapely", reason="no oracle is installed: no numbers are made here")
        from device_numbers import make_numbers

        path = tmp_path_factory.mktemp("numbers") / "small.npz"
        make_numbers(path, small=True)
    elif not path:
        pytest.skip(
            f"{FILE_VARIABLE} is not set: no numbers were carried here (tests/cases/device_numbers.py makes them)"
        )
    elif not Path(path).is_file():
        pytest.fail(f"{FILE_VARIABLE}={path} is not a file")
    with np.load(path) as file:
        return dict(file)


@pytest.fixture(scope="module")
def drawn_again(numbers):
    """Every case of the numbers drawn on a device, once: {(object, strategy, method): Drawn}, by device."""
    kept = {}

    def drawn_on(device):
        if device not in kept:
            kept[device] = {}
            for name, strategy, method in cases_of(numbers):
                surface = surface_on((numbers[f"{name}/vertices"], numbers[f"{name}/faces"]), device)
                patch = patch_array(numbers[f"{name}/half"], device)
                drawn = draw(surface, numbers[f"{name}/poses"], patch, strategy, method)
                kept[device][name, strategy, method] = drawn
        return kept[device]

    return drawn_on


def cases_of(numbers):
    """(object, strategy, method) of every case."""
    return sorted({tuple(key.split("/")[:3]) for key in numbers if key.count("/") == 3})


@pytest.mark.exhaustive(after=1)
def test_lengths_are_those_of_the_oracle(numbers, drawn_again, device):
    compared, wrong = 0, []
    for (name, strategy, method), drawn in drawn_again(device).items():
        oracle, generic = numbers[f"{name}/{strategy}/oracle"], ~numbers[f"{name}/degenerate"]
        generic &= ~np.isnan(oracle)
        off = np.abs(drawn.length.sum(axis=1, dtype=np.float64) - oracle)[generic]
        # for each metre of contour: its points are rounded to float32, and so is their sum
        if (off > TOLERANCE * np.maximum(1.0, oracle[generic])).any():
            wrong.append((name, strategy, method, off.max()))
        compared += generic.sum()
    assert wrong == []
    assert compared > 10 * len(drawn_again(device))


def test_lengths_are_those_of_the_cpu_to_the_bit(numbers, drawn_again, device):
    wrong = []
    for case, drawn in drawn_again(device).items():
        expected = numbers["/".join(case) + "/length"]
        assert expected.dtype == drawn.length.dtype == np.float32
        different = (expected.view(np.uint32) != drawn.length.view(np.uint32)).any(axis=1)
        if different.any():
            wrong.append((*case, f"{different.sum()} of {len(different)} poses", np.flatnonzero(different)[:3]))
    assert wrong == []


def test_contours_are_those_of_the_cpu_to_the_bit(numbers, drawn_again, device):
    wrong = []
    for case, drawn in drawn_again(device).items():
        expected = {field: numbers["/".join(case) + f"/{field}"] for field in CONTOURS}
        kept = drawn.part(0, len(expected["section_start"]) - 1)
        for field, values in expected.items():
            found = getattr(kept, field)
            if found.dtype != values.dtype or found.tobytes() != values.tobytes():
                wrong.append((*case, field))
    assert wrong == []


@pytest.mark.stress
def test_many_poses_are_those_of_the_cpu_to_the_bit(numbers, device):
    count, chunk, seed = (int(numbers[f"many/{key}"]) for key in ("count", "chunk", "seed"))
    surface = surface_on((numbers["many/vertices"], numbers["many/faces"]), device)
    patch, poses = patch_array(numbers["many/half"], device), exact_poses(count, seed)
    length = draw(surface, poses, patch, "cc", None).length
    for k, first in enumerate(range(0, count, chunk)):
        part = np.ascontiguousarray(length[first : first + chunk])
        assert part.sum(dtype=np.float64) == pytest.approx(numbers["many/sum"][k], abs=TOLERANCE * chunk)
        assert zlib.crc32(part.tobytes()) == numbers["many/crc"][k], f"poses {first} to {first + len(part)}"
    assert k + 1 == len(numbers["many/crc"])


def test_poses_are_made_the_same_everywhere():
    poses = exact_poses(1000, 2)
    assert zlib.crc32(poses.tobytes()) == 151746929
    assert (exact_poses(10, 2) == poses[:10]).all()
