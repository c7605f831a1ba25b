"""Sampling metrics of a recipe: all focal points at once give what block by block gives."""

import numpy as np
import pytest

from palpate.render import MeshObject, Palm, Scene, exploration
from palpate.render.motions.numbers import NUMBERS
from palpate.render.sampling.presets import preset
from palpate.render.sampling.strategy import SamplingStrategy
from palpate.render.sweeps.make import sampling
from palpate.render.sweeps.make.sampling import RenderedContours, sample_recipe


class Collector:
    """Takes focal points and keeps them."""

    def __init__(self):
        self.blocks = []

    def take(self, focus):
        self.blocks.append(focus)


def sampled(strategy, *, counted=True):
    motion = exploration("tube", duration=2.0, rate=90.0)
    contours = RenderedContours(Scene.of(MeshObject.load("tube"), Palm(), "oc"), motion, "cpu")
    collector = Collector()
    numbers = sample_recipe(contours, motion, Palm(), strategy, [collector], counted=counted)
    assert numbers.pop("seconds")["sampling"] > 0
    return numbers, np.concatenate([block.position for block in collector.blocks])


@pytest.mark.parametrize("strategy", [SamplingStrategy(), preset("dtp"), preset("multi-focus")])
def test_all_at_once_and_block_by_block_are_the_same(strategy, monkeypatch):
    at_once, points = sampled(strategy)
    monkeypatch.setattr(sampling, "FOCI_AT_ONCE", 0)
    streamed, others = sampled(strategy)
    assert (points == others).all()
    assert set(at_once) == set(streamed) == {*NUMBERS, "samples"}
    assert at_once == streamed
    assert at_once["samples"] == len(points) == 20_000


@pytest.mark.parametrize("limit", [0, 5_000_000])
def test_without_counting_the_takers_have_their_focal_points(limit, monkeypatch):
    monkeypatch.setattr(sampling, "FOCI_AT_ONCE", limit)
    numbers, points = sampled(SamplingStrategy(), counted=False)
    assert (numbers, len(points)) == ({}, 20_000)


def test_contours_that_memory_may_not_hold_are_streamed_and_each_block_is_a_sign_of_progress(monkeypatch):
    motion = exploration("tube", duration=2.0, rate=90.0)
    ticks = []

    def run(limit):
        monkeypatch.setattr(sampling, "POINTS_AT_ONCE", limit)
        contours = RenderedContours(Scene.of(MeshObject.load("tube"), Palm(), "cc"), motion, "cpu")
        numbers = sample_recipe(contours, motion, Palm(), SamplingStrategy(), tick=lambda: ticks.append(limit))
        return {name: numbers[name] for name in NUMBERS}

    assert run(10**6) == pytest.approx(run(10), rel=1e-12)
    assert ticks == [10**6]


def test_several_focal_points_count_for_the_limit(monkeypatch):
    monkeypatch.setattr(sampling, "FOCI_AT_ONCE", 39_999)  # of two focal points, 20,000 samples
    made = []
    monkeypatch.setattr(sampling, "sample_motions", lambda *args, **options: made.append(args))
    sampled(preset("multi-focus"))
    assert made == []
