"""Cycles, routes, sections and entries of random motions are those of the sampler in NumPy, but for rounding."""

import numpy as np
import pytest
from contour_random import random_strokes
from numpy_sampler import continuity, contour_matching, drawing_turns, sampler
from numpy_sampler import cycle as numpy_cycle
from numpy_sampler import route as numpy_route
from sampling_cases import drawn_room, with_pauses, without_folds
from sampling_oracle import entered_by_numpy

from palpate.kernels.sampling import entry, focus, layout, pieces, route, segments, timing
from palpate.render.sampling import plan
from palpate.render.sampling.presets import preset
from palpate.render.sampling.strategy import Dwell, Gap, Order, Pace, SamplingStrategy, Sections

STRATEGIES = {
    "stm": SamplingStrategy(),
    "given": SamplingStrategy(order=Order(route="given")),
    "no-margin": SamplingStrategy(order=Order(margin=0.0)),
    "return": SamplingStrategy(gap=Gap("return")),
    "close": SamplingStrategy(gap=Gap("close")),
    "there-and-back": SamplingStrategy(gap=Gap("pendulum"), order=Order("pendulum")),
    "capped": SamplingStrategy(pace=Pace("capped")),
    "paused": SamplingStrategy(dwell=Dwell(time=0.003)),
    "stp": preset("stp"),
    "stp-return": preset("stp", gap=Gap("return")),
    "stp-there-and-back": preset("stp", gap=Gap("pendulum"), sections=Sections(5, 20.0)),
    "stp-close": preset("stp", gap=Gap("close"), sections=Sections(2)),
}


@pytest.mark.exhaustive(after=3)
@pytest.mark.parametrize("name", STRATEGIES)
def test_cycles_and_entries_are_those_of_the_sampler_in_numpy(name, device):
    strategy, count = STRATEGIES[name], 30
    time, duration = np.arange(count) / 90, count / 90
    for seed in range(4):
        rng = np.random.default_rng(seed)
        batch = random_strokes(rng, count, line_most=int(rng.integers(1, 8)), with_intensity=seed % 2 == 1)
        batch = with_pauses(rng, batch) if seed == 3 and strategy.sections is None else batch
        batch = without_folds(batch, strategy)
        room, _, _ = drawn_room(batch, time, duration, strategy, device, hold=0.1)
        arrays = {name: array.numpy() for name, array in room._arrays.items()}
        expected = entered_by_numpy(batch, time, duration, strategy)
        entered = np.flatnonzero(arrays["entries"]["drawn"][:count])
        assert len(entered) == len(expected) > 1
        for pose, (cycle, parameter, index) in zip(entered.tolist(), expected, strict=True):
            own, begin = arrays["cycles"][pose], arrays["entries"][pose]
            scale = own["period"] / cycle.period  # both in metres where arc length alone decides, else in seconds
            assert scale == pytest.approx(1.0, rel=1e-12)
            assert own["repeat"] == cycle.repeat_count
            assert own["one_sample"] == pytest.approx(cycle.one_sample, rel=1e-12)
            assert begin["anchor"] == pytest.approx(parameter, rel=1e-9, abs=1e-12)
            assert begin["index"] == index
            first = int(batch.pose_start[pose])
            routes = arrays["drawn"][first : first + own["pieces"]]
            assert routes["earlier"].tolist() == cycle.route.earlier.tolist()
            check = assert_same_nodes if strategy.sections is None else assert_same_sections
            check(arrays, own, cycle)


def assert_same_nodes(arrays, own, cycle):
    """A cycle has the nodes of NumPy's one."""
    rows = slice(int(own["first"]), int(own["first"] + own["count"]))
    assert arrays["parameter"][rows] == pytest.approx(cycle.parameter, rel=1e-12, abs=1e-12)
    assert arrays["point"][rows] == pytest.approx(cycle.points, rel=1e-12, abs=1e-12)
    if cycle.intensity is not None:
        assert arrays["level"][rows] == pytest.approx(cycle.intensity, rel=1e-9, abs=1e-9)


def assert_same_sections(arrays, own, cycle):
    """Sections begin, end and last as those of NumPy's cycle, which has the nodes of every pass."""
    first, count = int(own["section"]), int(own["sections"])
    rows = arrays["section"][first : first + count]
    assert [*rows["begin"], own["period"]] == pytest.approx(cycle.section.tolist(), rel=1e-12, abs=1e-12)
    assert ((rows["stop"] - rows["start"]) * rows["passes"]).sum() + count - 1 == len(cycle.step)
    at = np.searchsorted(cycle.parameter, cycle.section[:-1], side="right") - 1
    assert arrays["point"][own["first"] + rows["start"]] == pytest.approx(cycle.points[at], rel=1e-9, abs=1e-9)
    assert own["ordinary"] == pytest.approx(cycle.step_ordinary, rel=1e-9)


def test_numbers_of_the_kernels_are_those_of_the_sampler_in_numpy_and_of_the_plan():
    assert float(pieces.NEARNESS) == contour_matching.NEARNESS**2
    assert (int(route.STARTS), int(pieces.STARTS_TRIED)) == (numpy_route.STARTS, numpy_route.STARTS_TRIED)
    assert pieces.STARTS_MOST == route.START_ROOM > 2 * numpy_route.PIECES_MOST
    assert int(route.SEARCHED_MOST) == numpy_route.SEARCHED_MOST
    assert (int(route.PIECES_MOST), int(route.INSERTED_MOST)) == (numpy_route.PIECES_MOST, numpy_route.INSERTED_MOST)
    assert float(route.JUMP_SLACK) == numpy_route.JUMP_SLACK
    assert float(timing.SHARE_LEAST) == drawing_turns.SHARE_LEAST
    assert float(timing.NOISE_SHARE) == numpy_cycle.NOISE_SHARE
    assert float(focus.LENGTH_UNIT) == sampler.LENGTH_UNIT
    assert float(timing.NEAR_CUT) == numpy_cycle.NEAR_CUT
    assert int(timing.PASSES_MOST) == numpy_cycle.PASSES_MOST
    assert float(entry.WHOLE_SECTION) == continuity.WHOLE_SECTION
    assert float(layout.TICKS) == float(segments.TICKS) == plan.TICKS
