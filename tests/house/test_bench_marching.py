"""The cases of the marching benchmark run, small, and give the same contours."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from marching import CASES, Size
from poses import random_poses
from turns import installed, measure_curves


@pytest.mark.exhaustive
def test_marching_cases_measure_the_same_contours(device):
    figures = {
        figure.case: figure
        for figure in measure_curves(installed(CASES), device, 1, random_poses(20), device, Size(48, 32))
    }
    ours = {"OC, bricks", "OC, rows", "CC, bricks", "floor"}
    assert ours <= set(figures)
    assert min(figure.microseconds for figure in figures.values()) > 0
    assert figures["CC, bricks"].length > figures["OC, bricks"].length > 0.05
    assert figures["OC, rows"].apart == 0
    for name in set(figures) - ours:
        assert figures[name].apart < 0.01 * figures["OC, bricks"].length, name
