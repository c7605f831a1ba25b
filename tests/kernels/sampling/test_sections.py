"""Sections of random contours begin, end and last as the host's, which writes the nodes of every pass."""

import numpy as np
import pytest
import warp as wp
from contour_random import random_strokes
from contour_shapes import still
from sampling_oracle import entered_by_host

from palpate.kernels.sampling import entry, sections
from palpate.kernels.sampling.entry import enter_poses
from palpate.render.sampling import continuity
from palpate.render.sampling import track as host_track
from palpate.render.sampling.batch_sampling import MotionSchedule
from palpate.render.sampling.contour_sampling import Gap, Sections, preset
from palpate.render.sampling.kernel_plan import contours_of, plan_of

STRATEGIES = {
    "stp": preset("stp"),
    "return": preset("stp", gap=Gap("return")),
    "there-and-back": preset("stp", gap=Gap("pendulum"), sections=Sections(5, 20.0)),
    "close": preset("stp", gap=Gap("close"), sections=Sections(2)),
}


@pytest.mark.parametrize("name", STRATEGIES)
@pytest.mark.parametrize("seed", range(8))
def test_sections_are_the_hosts_to_the_bit(seed, name, device, monkeypatch):
    rng, strategy = np.random.default_rng(seed), STRATEGIES[name]
    batch = random_strokes(rng, 20, line_most=int(rng.integers(1, 8)), with_intensity=seed % 2 == 1)
    time, duration = np.arange(20) / 90, 20 / 90
    schedule = MotionSchedule.of(time, [0, 20], [duration], strategy, None)
    pose = wp.array(still(20), dtype=wp.transformd, device=device)
    drawn = enter_poses(contours_of(batch.to(device)), plan_of(strategy), schedule.on(device, strategy), pose)
    tracks, entries, nodes = drawn.tracks.numpy(), drawn.entries.numpy(), drawn.nodes
    expected = entered_by_host(batch, time, duration, strategy, monkeypatch)
    entered = np.flatnonzero(entries["drawn"])
    assert len(entered) == len(expected) > 1
    for pose, (track, knot, index, _) in zip(entered.tolist(), expected, strict=True):
        first, count = int(tracks[pose]["section"]), int(tracks[pose]["sections"])
        own = nodes.section.numpy()[first : first + count]
        assert [*own["begin"], tracks[pose]["period"]] == track.section.tolist()
        assert ((own["stop"] - own["start"]) * own["passes"]).sum() + count - 1 == len(track.step)
        at = np.searchsorted(track.knot, track.section[:-1], side="right") - 1
        assert (nodes.point.numpy()[tracks[pose]["first"] + own["start"]] == track.points[at]).all()
        assert tracks[pose]["ordinary"] == pytest.approx(track.step_ordinary, rel=1e-12)
        assert (tracks[pose]["one_sample"], tracks[pose]["repeat"]) == (track.one_sample, track.repeat_count)
        assert (entries[pose]["anchor"], entries[pose]["index"]) == (knot, index)


def test_numbers_of_sections_are_the_hosts():
    assert float(sections.NEAR_CUT) == host_track.NEAR_CUT
    assert int(sections.PASSES_MOST) == host_track.PASSES_MOST
    assert float(entry.WHOLE_SECTION) == continuity.WHOLE_SECTION
