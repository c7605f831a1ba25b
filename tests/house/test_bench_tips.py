"""The cases of the benchmark of tips run, small: what is round has as many points either way, a wedge has more."""

import sys
from pathlib import Path

import pytest
import warp as wp

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from tips import OBJECTS, marching

from palpate.render.bench.cases import random_poses


@pytest.mark.exhaustive
def test_only_what_has_tips_costs_points(device):
    pose = wp.array(random_poses(60)[:, None], dtype=wp.transform, device=device)
    count = {
        (name, tips): marching(OBJECTS[name], pose, device, tips=tips)().points.shape[0]
        for name in ("sphere of 50 mm", "wedge of 20 degrees")
        for tips in (True, False)
    }
    assert count["sphere of 50 mm", True] == count["sphere of 50 mm", False] > 0
    assert count["wedge of 20 degrees", True] > count["wedge of 20 degrees", False] > 0
