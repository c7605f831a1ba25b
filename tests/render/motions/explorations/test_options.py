"""Options of explorations: what is refused, before a pose is made, with the value, the bound and options that help."""

import subprocess
import sys

import numpy as np
import pytest

import palpate.datasets
import palpate.render
from palpate.datasets.errors import MotionError
from palpate.render import MeshObject, exploration
from palpate.render.errors import StrategyError
from palpate.render.intersection.named_inputs import load_motion
from palpate.render.motions.explorations import explored
from palpate.render.motions.explorations.options import EXPLORATION_MODELS, POSE_BYTES, SECOND_BYTES
from palpate.render.terminal.wording import Wording

BOUNDS = np.array([[-0.065, -0.065, 0.135], [0.065, 0.065, 0.265]])


def test_explorations_are_of_render_alone():
    for name in ("exploration", "explorer_habits", "ExplorerHabits"):
        assert name in palpate.render.__all__
        assert not hasattr(palpate.datasets, name)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": "around", "bounds": BOUNDS[::-1]}, r"minimum before maximum.*\]\]$"),
        (
            {"model": "around", "bounds": BOUNDS + np.array([0, 0, 199.8])},
            r"within 100 m.*; at=\(0, 0, 0.2\) puts its middle over the array",
        ),
        ({"model": "around", "bounds": BOUNDS * np.nan}, "bounds must be finite"),
        ({"model": "around", "bounds": BOUNDS[0]}, r"bounds must have shape \[2, 3\], got \[3\]"),
        (
            {"model": "around", "bounds": BOUNDS - [0, 0, 0.3]},
            r"z = -0.035 m leaves a hand no room 0.06 m above the array; at=\(0, 0, 0.2\) puts",
        ),
        ({"model": "around", "duration": 0.0}, "duration must be finite and greater than 0, got 0.0"),
        ({"model": "around", "duration": float("inf")}, "duration must be finite"),
        ({"model": "around", "rate": -90.0}, "rate must be finite and greater than 0, got -90.0"),
        ({"model": "around", "seed": -1}, "seed must be an integer of 0 to 9223372036854775807, got -1"),
        ({"model": "around", "seed": 1.5}, "seed must be an integer"),
        (
            {"bounds": BOUNDS + np.array([0.5, 0, 0])},
            r"bounds: the object's box \(0.435 .* 0.265\) m does not meet the workspace \(-0.125",
        ),
        (
            {"model": "over-arrow"},
            r"model must be one of over-array, around, not 'over-arrow' \(did you mean 'over-array'",
        ),
        ({"explorer": -1}, "explorer must be an integer of 0 to 9223372036854775807, got -1"),
        ({"explorer": 1.5}, "explorer must be an integer"),
        ({"facing": 60}, "facing must lie in 0.0873..1.57 rad, not 60; 60 degrees are 1.047 rad"),
        ({"facing": float("nan")}, "facing must lie in"),
        ({"workspace": [0, 0, 0.1]}, r"workspace must have shape \[2, 3\], got \[3\]"),
        ({"workspace": [[0, 0, 0.1], [0.1, 0.1, 0.11]]}, "0.02 m apart at least along each axis"),
        ({"workspace": [[0, 0, 0.01], [0.1, 0.1, 0.2]]}, "workspace must begin at z = 0.06 m .* got 0.01 m"),
        ({"workspace": [[0, 0, 0.1], [100, 100, 110]]}, "workspace must be finite and within 2 m"),
        ({"model": "around", "explorer": 1}, "explorer is of the model over-array, not of around"),
        ({"model": "around", "facing": 1.0}, "facing is of the model over-array"),
    ],
)
def test_bad_arguments_are_refused_with_value_and_bound(change, message):
    arguments = {"bounds": BOUNDS, "duration": 1.0, **change}
    with pytest.raises(MotionError, match=message):
        exploration(arguments.pop("bounds"), **arguments)


def test_the_refusal_of_an_object_beside_the_workspace_names_options_that_join_them():
    """The box of BOUNDS half a metre aside, grown by the 60 mm that a palm of 85 mm reaches."""
    beside = BOUNDS + np.array([0.5, 0, 0])
    with pytest.raises(MotionError) as refused:
        exploration(beside, 1.0)
    options = Wording(["at", "workspace"])(str(refused.value))
    asked = (
        "--at 0 0 0.2 puts its middle over the array, --workspace 0.375 -0.125 0.075 0.625 0.125 0.325 the hand around"
    )
    assert asked in options
    workspace = [float(text) for text in asked.split("--workspace ")[1].split()[:6]]
    assert exploration(beside, 1.0, workspace=workspace).pose[:, 0].min() > 0.37
    with pytest.raises(MotionError, match=r"over the array$"):  # no workspace may be farther than 2 m
        exploration(BOUNDS + np.array([50.0, 0, 0]), 1.0)


@pytest.mark.parametrize("model", EXPLORATION_MODELS)
@pytest.mark.parametrize(("duration", "rate"), [(1e7, 90.0), (1e8, 1e-3)])
def test_an_exploration_beyond_memory_is_refused_before_it_is_made(model, duration, rate, monkeypatch):
    """By its poses, or by the path that its duration takes."""
    monkeypatch.setattr(explored, "explored_rows", pytest.fail)
    monkeypatch.setattr(explored, "control_points", pytest.fail)
    with pytest.raises(MotionError, match=r"\(duration .* s at rate .* Hz\) takes .* more than the 3000000000"):
        exploration(BOUNDS, duration=duration, rate=rate, seed=1, model=model)
    with pytest.raises(StrategyError, match="exploration: a motion of"):
        load_motion("exploration", MeshObject.load("cube"), {"duration": duration, "rate": rate, "model": model})


PEAK = """
import re, sys
from pathlib import Path
from palpate.render import exploration

model, duration, rate = sys.argv[1], *map(float, sys.argv[2:])
peak = lambda: 1024 * int(re.search(r"VmHWM: *([0-9]+)", Path("/proc/self/status").read_text().replace(chr(9), ""))[1])
exploration("cube", 1.0, model=model)
before = peak()
exploration("cube", duration, rate=rate, model=model)
print("taken", peak() - before)
"""


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("model", "duration", "rate"),
    [("over-array", 30.0, 1e5), ("around", 30.0, 1e5), ("over-array", 1e6, 1.0), ("around", 2e4, 1.0)],
)
def test_an_exploration_takes_as_much_memory_as_it_is_refused_for(model, duration, rate):
    words = [sys.executable, "-P", "-c", PEAK, model, str(duration), str(rate)]
    taken = int(subprocess.run(words, check=True, capture_output=True, text=True).stdout.split("taken ")[1])
    supposed = POSE_BYTES * duration * rate + SECOND_BYTES[model] * duration
    assert 0.5 * supposed < taken < 1.25 * supposed
