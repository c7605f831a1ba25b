"""Sampling metrics of a recipe: block by block they are those of the whole motion at once."""

import numpy as np
import pytest

from palpate.render import MeshObject, Palm, Scene, exploration
from palpate.render.motions.numbers import NUMBERS, dwell_grid, sampling_numbers
from palpate.render.sampling import sampler
from palpate.render.sampling.metrics import dwell_maps
from palpate.render.sampling.presets import preset
from palpate.render.sampling.sampler import sample_motions
from palpate.render.sampling.strategy import SamplingStrategy
from palpate.render.sweeps.make import sampling
from palpate.render.sweeps.make.sampling import RenderedContours, sample_recipe


def sampled(strategy, *, counted=True):
    motion = exploration("tube", duration=2.0, rate=90.0)
    contours = RenderedContours(Scene.of(MeshObject.load("tube"), Palm(), "oc"), motion, "cpu")
    blocks = []
    numbers = sample_recipe(contours, motion, Palm(), strategy, [blocks.append], counted=counted)
    assert numbers.pop("seconds")["sampling"] > 0
    return numbers, np.concatenate([block.position for block in blocks])


def whole(strategy):
    """The same motion in one call, and its numbers."""
    motion = exploration("tube", duration=2.0, rate=90.0)
    batch = Scene.of(MeshObject.load("tube"), Palm(), "oc").contours(motion.pose, 0, "cpu")[0]
    samples = sample_motions(batch, motion.pose, motion.time, [0, len(motion)], [2.0], strategy)
    (dwell,) = dwell_maps(samples, strategy.update_rate, **dwell_grid(Palm()))
    return sampling_numbers(samples.counts[0], dwell, strategy.update_rate), samples.focus(0).position


@pytest.mark.parametrize("span", [600, 1 << 16])
@pytest.mark.parametrize("strategy", [SamplingStrategy(), preset("dtp"), preset("multi-focus")])
def test_numbers_and_focal_points_are_those_of_the_whole_motion_however_it_is_cut(strategy, span, monkeypatch):
    monkeypatch.setattr(sampling, "SPAN_SAMPLES", span)
    monkeypatch.setattr(sampler, "SPAN_SAMPLES", span)
    numbers, points = sampled(strategy)
    expected, others = whole(strategy)
    assert (points == others).all()
    assert numbers == {name: expected[name] for name in numbers}
    assert set(numbers) == {*NUMBERS, "samples"}
    assert numbers["samples"] == len(points) == 20_000


def test_without_counting_the_takers_have_their_focal_points():
    numbers, points = sampled(SamplingStrategy(), counted=False)
    assert (numbers, len(points)) == ({}, 20_000)
