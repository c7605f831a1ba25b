"""Tracks, routes and entries of random motions are the host's to the bit."""

import numpy as np
import pytest
import warp as wp
from contour_random import random_strokes
from contour_shapes import still
from sampling_oracle import entered_by_host

from palpate.kernels.sampling import course, cursor, doors, pieces, route, search
from palpate.kernels.sampling.entry import enter_poses
from palpate.render.sampling import contour_matching, drawing_turns
from palpate.render.sampling import route as host_route
from palpate.render.sampling import track as host_track
from palpate.render.sampling.batch_sampling import MotionSchedule
from palpate.render.sampling.contour_sampling import Gap, Order, Pace, SamplingStrategy, sample_contours
from palpate.render.sampling.kernel_plan import contours_of, plan_of

STRATEGIES = {
    "stm": SamplingStrategy(),
    "given": SamplingStrategy(order=Order(route="given")),
    "no-margin": SamplingStrategy(order=Order(margin=0.0)),
    "return": SamplingStrategy(gap=Gap("return")),
    "close": SamplingStrategy(gap=Gap("close")),
    "there-and-back": SamplingStrategy(gap=Gap("pendulum"), order=Order("pendulum")),
    "capped": SamplingStrategy(pace=Pace("capped")),
}


@pytest.mark.parametrize("name", STRATEGIES)
@pytest.mark.parametrize("seed", range(8))
def test_tracks_and_entries_are_the_hosts_to_the_bit(seed, name, device, monkeypatch):
    rng, strategy = np.random.default_rng(seed), STRATEGIES[name]
    batch = random_strokes(rng, 40, line_most=int(rng.integers(1, 8)), with_intensity=seed % 2 == 1)
    time, duration = np.arange(40) / 90, 40 / 90
    schedule = MotionSchedule.of(time, [0, 40], [duration], strategy, None)
    pose = wp.array(still(40), dtype=wp.transformd, device=device)
    drawn = enter_poses(contours_of(batch.to(device)), plan_of(strategy), schedule.on(device, strategy), pose)
    tracks, entries, nodes = drawn.tracks.numpy(), drawn.entries.numpy(), drawn.nodes
    expected = entered_by_host(batch, time, duration, strategy, monkeypatch)
    entered = np.flatnonzero(entries["drawn"])
    assert len(entered) == len(expected) > 5
    for pose, (track, knot, index, _) in zip(entered.tolist(), expected, strict=True):
        rows = slice(int(tracks[pose]["first"]), int(tracks[pose]["first"] + tracks[pose]["count"]))
        assert (nodes.knot.numpy()[rows] == track.knot).all()
        assert (nodes.point.numpy()[rows] == track.points).all()
        if track.intensity is not None:
            assert (nodes.intensity.numpy()[rows] == track.intensity).all()
        assert (tracks[pose]["one_sample"], tracks[pose]["repeat"]) == (track.one_sample, track.repeat_count)
        assert (entries[pose]["anchor"], entries[pose]["index"]) == (knot, index)
        first = int(batch.pose_start[pose])
        routes = drawn.routes.numpy()[first : first + tracks[pose]["pieces"]]
        assert routes["earlier"].tolist() == track.route.earlier.tolist()


def test_numbers_of_the_kernels_are_the_hosts():
    assert float(pieces.NEARNESS) == contour_matching.NEARNESS**2
    assert (int(search.STARTS), int(doors.STARTS_TRIED)) == (host_route.DOORS, host_route.STARTS_TRIED)
    assert doors.DOORS == search.DOOR_ROOM > 2 * host_route.PIECES_MOST
    assert int(search.SEARCHED_MOST) == host_route.SEARCHED_MOST
    assert (int(route.PIECES_MOST), int(route.INSERTED_MOST)) == (host_route.PIECES_MOST, host_route.INSERTED_MOST)
    assert float(route.JUMP_SLACK) == host_route.JUMP_SLACK
    assert float(course.SHARE_LEAST) == drawing_turns.SHARE_LEAST
    assert float(course.NOISE_SHARE) == host_track.NOISE_SHARE
    assert int(cursor.BLOCK_SAMPLES) == sample_contours.__kwdefaults__["block"]
