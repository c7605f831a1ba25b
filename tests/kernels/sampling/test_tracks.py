"""Tracks, routes, sections and entries of random motions are the host's to the bit."""

import numpy as np
import pytest
import warp as wp
from contour_random import random_strokes
from contour_shapes import still
from sampling_oracle import entered_by_host

from palpate.kernels.sampling import course, cursor, doors, entry, pieces, route, search, sections, steps
from palpate.kernels.sampling.entry import enter_poses
from palpate.render.sampling import continuity, contour_matching, drawing_turns, fading, sampler
from palpate.render.sampling import route as host_route
from palpate.render.sampling import track as host_track
from palpate.render.sampling.kernel_plan import plan_of
from palpate.render.sampling.presets import preset
from palpate.render.sampling.sampler import MotionSchedule
from palpate.render.sampling.strategy import Gap, Order, Pace, SamplingStrategy, Sections

STRATEGIES = {
    "stm": SamplingStrategy(),
    "given": SamplingStrategy(order=Order(route="given")),
    "no-margin": SamplingStrategy(order=Order(margin=0.0)),
    "return": SamplingStrategy(gap=Gap("return")),
    "close": SamplingStrategy(gap=Gap("close")),
    "there-and-back": SamplingStrategy(gap=Gap("pendulum"), order=Order("pendulum")),
    "capped": SamplingStrategy(pace=Pace("capped")),
    "stp": preset("stp"),
    "stp-return": preset("stp", gap=Gap("return")),
    "stp-there-and-back": preset("stp", gap=Gap("pendulum"), sections=Sections(5, 20.0)),
    "stp-close": preset("stp", gap=Gap("close"), sections=Sections(2)),
}


@pytest.mark.parametrize("name", STRATEGIES)
def test_tracks_and_entries_are_the_hosts_to_the_bit(name, device, monkeypatch):
    strategy, count = STRATEGIES[name], 30
    time, duration = np.arange(count) / 90, count / 90
    schedule = MotionSchedule.of(time, [0, count], [duration], strategy, None)
    still_pose = wp.array(still(count), dtype=wp.transformd, device=device)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        batch = random_strokes(rng, count, line_most=int(rng.integers(1, 8)), with_intensity=seed % 2 == 1)
        on = batch.to(device).as_struct()
        drawn = enter_poses(on, plan_of(strategy), schedule.on(device, strategy), still_pose)
        tracks, entries = drawn.tracks.numpy(), drawn.entries.numpy()
        with monkeypatch.context() as there:
            expected = entered_by_host(batch, time, duration, strategy, there)
        entered = np.flatnonzero(entries["drawn"])
        assert len(entered) == len(expected) > 1
        for pose, (track, knot, index, _) in zip(entered.tolist(), expected, strict=True):
            own = tracks[pose]
            assert (own["one_sample"], own["repeat"]) == (track.one_sample, track.repeat_count)
            assert (entries[pose]["anchor"], entries[pose]["index"]) == (knot, index)
            first = int(batch.pose_start[pose])
            routes = drawn.routes.numpy()[first : first + own["pieces"]]
            assert routes["earlier"].tolist() == track.route.earlier.tolist()
            check = assert_same_sections if name.startswith("stp") else assert_same_nodes
            check(drawn.nodes, own, track)


def assert_same_nodes(nodes, own, track):
    """A track has the host's nodes."""
    rows = slice(int(own["first"]), int(own["first"] + own["count"]))
    assert (nodes.knot.numpy()[rows] == track.knot).all()
    assert (nodes.point.numpy()[rows] == track.points).all()
    if track.intensity is not None:
        assert (nodes.intensity.numpy()[rows] == track.intensity).all()


def assert_same_sections(nodes, own, track):
    """Sections begin, end and last as the host's, which writes the nodes of every pass."""
    first, count = int(own["section"]), int(own["sections"])
    rows = nodes.section.numpy()[first : first + count]
    assert [*rows["begin"], own["period"]] == track.section.tolist()
    assert ((rows["stop"] - rows["start"]) * rows["passes"]).sum() + count - 1 == len(track.step)
    at = np.searchsorted(track.knot, track.section[:-1], side="right") - 1
    assert (nodes.point.numpy()[own["first"] + rows["start"]] == track.points[at]).all()
    assert own["ordinary"] == pytest.approx(track.step_ordinary, rel=1e-12)


def test_numbers_of_the_kernels_are_the_hosts():
    assert float(pieces.NEARNESS) == contour_matching.NEARNESS**2
    assert (int(search.STARTS), int(doors.STARTS_TRIED)) == (host_route.DOORS, host_route.STARTS_TRIED)
    assert doors.DOORS == search.DOOR_ROOM > 2 * host_route.PIECES_MOST
    assert int(search.SEARCHED_MOST) == host_route.SEARCHED_MOST
    assert (int(route.PIECES_MOST), int(route.INSERTED_MOST)) == (host_route.PIECES_MOST, host_route.INSERTED_MOST)
    assert float(route.JUMP_SLACK) == host_route.JUMP_SLACK
    assert float(course.SHARE_LEAST) == drawing_turns.SHARE_LEAST
    assert float(course.NOISE_SHARE) == host_track.NOISE_SHARE
    assert float(cursor.TICKS) == fading.TICKS
    assert float(steps.LENGTH_UNIT) == sampler.LENGTH_UNIT
    assert float(sections.NEAR_CUT) == host_track.NEAR_CUT
    assert int(sections.PASSES_MOST) == host_track.PASSES_MOST
    assert float(entry.WHOLE_SECTION) == continuity.WHOLE_SECTION
