"""The cases of the benchmarks of marching and of skin run, small, and give the same curves."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import marching
import skin
from turns import installed, measure_curves

from palpate.render.bench.cases import random_poses


@pytest.mark.exhaustive
def test_marching_cases_measure_the_same_contours(device):
    figures = {
        figure.case: figure
        for figure in measure_curves(
            installed(marching.CASES), device, 1, random_poses(20), device, marching.Size(48, 32)
        )
    }
    ours = {"OC", "CC", "floor"}
    assert ours <= set(figures)
    assert min(figure.microseconds for figure in figures.values()) > 0
    assert figures["CC"].length > figures["OC"].length > 0.05
    for name in set(figures) - ours:
        assert figures[name].apart < 0.01 * figures["OC"].length, name


@pytest.mark.exhaustive
def test_skin_cases_measure_the_same_curves(device):
    figures = {
        figure.case: figure for figure in measure_curves(installed(skin.CASES), device, 1, random_poses(12), device)
    }
    assert {"OC", "CC", "CC, rows", "floor", "floor, rows"} <= set(figures)
    assert min(figure.microseconds for figure in figures.values()) > 0
    assert figures["CC"].length >= figures["OC"].length > 0.3
    assert figures["OC"].apart == 0
    for name in set(figures) - {"OC", "CC", "CC, rows", "floor", "floor, rows"}:
        assert figures[name].apart < 0.02 * figures["OC"].length, name
