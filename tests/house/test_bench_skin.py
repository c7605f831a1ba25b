"""The cases of the skin benchmark run, small, and give the same curves."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from poses import random_poses
from skin import CASES
from turns import installed, measure_curves


@pytest.mark.exhaustive
def test_skin_cases_measure_the_same_curves(device):
    figures = {figure.case: figure for figure in measure_curves(installed(CASES), device, 1, random_poses(12), device)}
    assert {"OC", "CC", "CC, rows", "floor", "floor, rows"} <= set(figures)
    assert min(figure.microseconds for figure in figures.values()) > 0
    assert figures["CC"].length >= figures["OC"].length > 0.3
    assert figures["OC"].apart == 0
    for name in set(figures) - {"OC", "CC", "CC, rows", "floor", "floor, rows"}:
        assert figures[name].apart < 0.02 * figures["OC"].length, name
