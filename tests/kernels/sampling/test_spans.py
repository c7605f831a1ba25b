"""Rooms of spans: memory is kept, grows with what is drawn, and loses nothing when it grows; states begin at rest."""

import numpy as np
import pytest
from contour_random import random_strokes
from contour_shapes import batch_of, circle, still

from palpate.kernels.sampling.spans import REST, SPARE, SpanRoom
from palpate.render.sampling.plan import plan_of
from palpate.render.sampling.strategy import Order, SamplingStrategy

PLAN = plan_of(SamplingStrategy(order=Order(margin=0.0)))


def rings(count):
    """A pose of so many rings in a row."""
    return [[(circle(0.008, (0.02 * k, 0.0, 0.2), 24), True) for k in range(count)]]


def drawn(room, batch, device, *, first=0, count=100, line_most=None):
    """A copy of the focal points of a pose in a room of one motion, at rest if it has no contours."""
    span = {"motion_start": [0, 1], "motion": [0], "first": [first], "number": [first], "count": [count], "row": [0]}
    span |= {"time": [0.0], "hold": [np.inf], "goes_on": [0]}
    schedule = {name: np.array(values) for name, values in span.items()}
    on = batch.to(device)
    most = batch.polyline_count if line_most is None else line_most
    position, _ = room.draw(PLAN, on.struct, schedule, still(1), line_most=most)
    return position.numpy()[:count, 0].copy()


def room_of(device, **options):
    return SpanRoom(1, 1, np.zeros(0, np.int64), device, **options)


def test_memory_is_taken_for_the_largest_span_and_kept(device):
    room = room_of(device)
    for count in (3, 5, 2):
        drawn(room, batch_of(rings(count)), device)
    grown, held = room.grown, {name: array.ptr for name, array in room._arrays.items()}
    for count in (1, 4, 5):
        drawn(room, batch_of(rings(count)), device, count=90)
    assert room.grown == grown
    assert {name: array.ptr for name, array in room._arrays.items()} == held
    drawn(room, batch_of(rings(5)), device, count=150)
    assert room.grown == grown + 2  # positions and intensities
    assert room._arrays["position"].shape[0] == SPARE * 150


def test_pieces_of_the_pose_before_are_known_although_their_room_grows(device):
    """The order of three rings is kept by the pose that has nine of them, with room for three until then."""
    grown, roomy = room_of(device), room_of(device)
    roomy._keep_pieces(20)
    small, large = batch_of([rings(3)[0][::-1]]), batch_of(rings(9))
    for room in (grown, roomy):
        drawn(room, small, device)
    found, expected = (drawn(room, large, device, first=100, count=600) for room in (grown, roomy))
    assert grown.state.room == 9
    assert (found == expected).all()
    states = [room.state.motion.numpy()[0] for room in (grown, roomy)]
    assert states[0] == states[1]
    assert (grown.state.seen.numpy()[:9] == roomy.state.seen.numpy()[:9]).all()


def test_several_motions_keep_their_own_pieces_when_the_room_grows(device):
    room = SpanRoom(3, 1, np.zeros(0, np.int64), device)
    room._keep_pieces(2)
    seen = np.arange(6)
    room.state.seen.assign(seen)
    room._keep_pieces(3)
    assert room.state.room == SPARE * 2
    assert room.state.seen.numpy().reshape(3, -1)[:, :2].tolist() == seen.reshape(3, 2).tolist()


def test_a_room_of_whole_motions_keeps_no_pieces_and_looks_for_none(device):
    room = room_of(device, goes_on=False)
    for _ in range(2):
        drawn(room, batch_of(rings(4)), device)
        assert room.state.room == room.state.motion.numpy()[0]["pieces"] == 0


def test_focal_points_rest_above_the_array_until_there_are_contours(device):
    room = room_of(device)
    assert (drawn(room, batch_of([[]]), device) == np.float32(REST)).all()
    state = room.state.motion.numpy()[0]
    assert (state["samples"], state["drawn"], state["steps"]["silent"]) == (100, 0, 100)
    ring = drawn(room, batch_of(rings(1)), device, first=100)
    assert (drawn(room, batch_of([[]]), device, first=200) == ring[-1]).all()


def test_a_span_without_samples_changes_no_state(device, rng):
    room = room_of(device)
    drawn(room, random_strokes(rng, 1), device)
    drawn(room, batch_of(rings(3)), device, first=100)
    before = room.state.motion.numpy()[0]
    drawn(room, batch_of(rings(2)), device, first=200, count=0)
    assert room.state.motion.numpy()[0] == before


def test_more_runs_than_are_laid_at_once_are_all_laid(device, monkeypatch):
    """Each motion of several polylines is a run; here two of seven are laid at a time."""
    monkeypatch.setattr("palpate.kernels.sampling.spans.RUNS_MOST", 2)
    room = SpanRoom(7, 1, np.zeros(0, np.int64), device, goes_on=False)
    batch, motions = batch_of(rings(3) * 7), np.arange(7)
    schedule = {"motion_start": np.arange(8), "motion": motions, "count": np.ones(7, np.int64), "goes_on": 0 * motions}
    room.lay(PLAN, batch.to(device).struct, schedule)
    cycles = room.cycles.numpy()[:7]
    assert cycles["pieces"].tolist() == [3] * 7
    assert cycles["period"] == pytest.approx(cycles["period"][0])
