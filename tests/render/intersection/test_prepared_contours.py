"""Prepared contours: those of `render`, bit for bit, however often memory is taken anew."""

import numpy as np
import pytest
from drawing import searching_by

from palpate.kernels.section.room import RoomSize
from palpate.render import (
    IntersectionStrategy,
    Palm,
    PoseError,
    PreparedContours,
    StrategyError,
    flat_hand,
    render,
    static_pose,
)
from palpate.render.bench.cases import random_poses
from palpate.render.intersection import prepared_contours

COUNT = 200


def assert_same(batch, wanted):
    for name, values in wanted.by_name().items():
        np.testing.assert_array_equal(batch.numpy().by_name()[name], values, err_msg=name)


@pytest.mark.parametrize(
    ("thing", "search", "strategy", "hand"),
    [("tube", "scan", "cc", Palm()), ("tube", "scan", "own", flat_hand()), ("dog", "tree", "oc", Palm())],
)
def test_batches_are_those_of_render(thing, search, strategy, hand):
    if strategy == "own":  # without a stage, as those of planes are joined
        strategy = IntersectionStrategy(prune=(), transform=())
    with searching_by(search):
        prepared = PreparedContours(thing, hand, strategy, COUNT)
    assert prepared._room is not None
    for seed in range(2):
        poses = random_poses(COUNT, seed)
        assert_same(prepared.at(poses), render(thing, hand, poses, strategy))


@pytest.fixture
def tiny(monkeypatch):
    """Rooms begin with hardly any memory."""
    monkeypatch.setattr(RoomSize, "for_sections", lambda _: RoomSize(pieces=1, events=2, points=8))


def test_memory_grows_until_a_batch_fits(tiny):
    poses = random_poses(COUNT)
    prepared = PreparedContours("dog", "palm", "cc", COUNT)
    assert_same(prepared.at(poses), render("dog", "palm", poses, "cc"))
    grown = prepared.grown
    assert grown > 1
    assert_same(prepared.at(poses), render("dog", "palm", poses, "cc"))
    assert prepared.grown == grown


def test_a_batch_that_needs_too_much_is_rendered_without_it(tiny, monkeypatch):
    poses = random_poses(COUNT)
    prepared = PreparedContours("dog", "palm", "cc", COUNT)
    grown = prepared.grown
    monkeypatch.setattr(prepared_contours, "ROOM_MOST", 0)
    assert_same(prepared.at(poses), render("dog", "palm", poses, "cc"))
    assert prepared.grown == grown


@pytest.mark.parametrize("most", [0, 10**5])  # no room at all; one that is too small and may not grow
def test_what_is_too_large_from_the_start_is_rendered_without_a_room(tiny, monkeypatch, most):
    monkeypatch.setattr(prepared_contours, "ROOM_MOST", most)
    poses = random_poses(COUNT)
    prepared = PreparedContours("tube", "palm", "cc", COUNT)
    assert_same(prepared.at(poses), render("tube", "palm", poses, "cc"))


@pytest.mark.filterwarnings("ignore:no pose has a contour")
def test_batches_without_contours_and_with_them_follow_each_other():
    prepared = PreparedContours("tube", "palm", "cc", 3)
    far = np.tile(static_pose([0, 0, 3.0]).pose, (3, 1))
    for poses in (random_poses(3), far, random_poses(3, 5), far):
        assert_same(prepared.at(poses), render("tube", "palm", poses, "cc"))


def test_strategies_with_stages_are_rendered_as_usual():
    poses = random_poses(5)
    prepared = PreparedContours("tube", "palm", "smooth", 5)
    assert_same(prepared.at(poses), render("tube", "palm", poses, "smooth"))


def test_what_cannot_be_prepared_is_refused():
    for count in (0, 1.5, "2", True, 2**20 + 1, float("nan"), float("inf")):
        with pytest.raises(StrategyError, match=r"pose_count must be a whole number of 1\.\.1048576"):
            PreparedContours("cube", "palm", "cc", count)
    prepared = PreparedContours("cube", "palm", "cc", 2)
    assert repr(prepared) == "PreparedContours(cube on Palm(width=0.085, length=0.085), 2 poses)"
    with pytest.raises(PoseError, match="there must be 2 poses, for which this was prepared, not 3"):
        prepared.at(random_poses(3))
    with pytest.raises(PoseError, match="shape"):
        prepared.at(np.zeros(7))
