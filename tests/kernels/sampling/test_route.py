"""Routes over several polylines: every piece once and whole, and jumps as short as trying everything finds."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from contour_shapes import batch_of, circle, still
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.kernels.sampling.route import PIECES_MOST
from palpate.render.sampling.sampler import Sampler, laid_cycles, laid_jumps
from palpate.render.sampling.strategy import Gap, Order, SamplingStrategy

place = st.tuples(*[st.integers(-50, 50)] * 3).map(lambda p: np.array(p) * 1e-3)
opens = st.tuples(place, place).filter(lambda p: np.linalg.norm(p[0] - p[1]) > 1e-3).map(lambda p: (np.array(p), False))
loops = st.tuples(place, st.integers(3, 8), st.floats(0.005, 0.03)).map(
    lambda c: (circle(c[2], centre=c[0], count=c[1]), True)
)


def strategy_of(*, back=False, cyclic=True, route="shortest"):
    """back: open pieces end where they start. cyclic: the route is a cycle, else its last jump is not counted."""
    order = Order("loop" if cyclic else "pendulum", route=route)
    return SamplingStrategy(order=order, gap=Gap("pendulum" if back else "jump"))


def jump_total(lines, *, back=False, cyclic=True, route="shortest"):
    """Length of the jumps of a cycle [m]; where that goes there and back, of those there."""
    jumps = laid_jumps(batch_of([lines]), strategy_of(back=back, cyclic=cyclic, route=route))
    return float(np.linalg.norm(jumps[:, 1] - jumps[:, 0], axis=1).sum()) / (1 if cyclic else 2)


def best_of_all(lines, *, back=False, cyclic=True):
    """The shortest jumps over all orders and directions of open lines."""
    best = np.inf
    for order in itertools.permutations(range(1 if cyclic else 0, len(lines))):
        order = (0, *order) if cyclic else order
        for turned in itertools.product((False, True), repeat=len(lines)):
            ends = [lines[i][0][[-1, 0] if t else [0, -1]] for i, t in zip(order, turned, strict=True)]
            pairs = list(itertools.pairwise([*ends, ends[0]] if cyclic else ends))
            best = min(best, sum(math.dist(b[0], a[0] if back else a[1]) for a, b in pairs))
    return best


def drawn_pieces(batch, strategy):
    """The pieces as the next pose finds them, in the order in which they are drawn."""
    sampler = Sampler(strategy)
    sampler.draw(batch, still(1)[0], 1)
    return sampler.room.state.piece.numpy()[: batch.polyline_count]


@pytest.mark.exhaustive
@given(lines=st.lists(opens, min_size=2, max_size=4), back=st.booleans(), cyclic=st.booleans())
@settings(max_examples=60)
def test_up_to_four_open_pieces_are_joined_by_the_shortest_jumps_and_up_to_three_without_the_last(lines, back, cyclic):
    lines = lines if cyclic else lines[:3]
    found = jump_total(lines, back=back, cyclic=cyclic)
    assert found == pytest.approx(best_of_all(lines, back=back, cyclic=cyclic), abs=1e-7)


@pytest.mark.parametrize("cyclic", [True, False])
def test_three_open_pieces_are_joined_by_the_shortest_jumps(rng, cyclic):
    for _ in range(4):
        lines = [(rng.uniform(-0.05, 0.05, (2, 3)), False) for _ in range(3)]
        assert jump_total(lines, cyclic=cyclic) == pytest.approx(best_of_all(lines, cyclic=cyclic), abs=1e-7)


@pytest.mark.exhaustive
@given(one=loops, other=st.one_of(loops, opens))
@settings(max_examples=40)
def test_a_loop_is_entered_near_its_best_place(one, other):
    lines = [one, other]
    found = jump_total(lines)
    fine = [np.vstack([p, p[:1]]) if closed else p for p, closed in lines]
    spacing = sum(np.linalg.norm(np.diff(f, axis=0), axis=1).sum() for f in fine if len(f) > 2) / 32
    for k, (_, closed) in enumerate(lines):
        if closed:
            part = np.linspace(0, 1, 40, endpoint=False)[:, None]
            fine[k] = np.concatenate([a + part * (b - a) for a, b in itertools.pairwise(fine[k])])
    apart = np.linalg.norm(fine[0][:, None] - fine[1][None], axis=2)
    best = 2 * apart.min() if lines[1][1] else (apart[:, 0] + apart[:, -1]).min()
    assert best - 1e-3 <= found <= best + 2 * spacing


@pytest.mark.exhaustive
def test_nearest_neighbour_and_2_opt_are_close_to_the_optimum_on_average():
    random = np.random.default_rng(3)
    ratios = []
    for _ in range(12):
        lines = [(random.uniform(-0.05, 0.05, (2, 3)), False) for _ in range(5)]
        ratios.append(jump_total(lines) / best_of_all(lines))
    assert np.mean(ratios) < 1.03
    assert np.max(ratios) < 1.2


@pytest.mark.exhaustive
@given(lines=st.lists(st.one_of(opens, loops), min_size=1, max_size=9), back=st.booleans(), cyclic=st.booleans())
@settings(max_examples=50)
def test_every_piece_is_in_the_route_once_and_whole(lines, back, cyclic):
    found, given_ = (jump_total(lines, back=back, cyclic=cyclic, route=route) for route in ("shortest", "given"))
    assert found <= given_ + 1e-7
    batch, strategy = batch_of([lines]), strategy_of(back=back, cyclic=cyclic)
    assert sorted(drawn_pieces(batch, strategy)["line"].tolist()) == list(range(len(lines)))
    passes = (1 + np.array([back and not closed for _, closed in lines])) * (1 if cyclic else 2)
    cycle = strategy.samples_a_cycle(float(passes @ lengths(lines)))
    assert laid_cycles(batch, strategy)["samples"][0] == pytest.approx(cycle, abs=1)


def lengths(lines):
    """Of each line [m]."""
    return np.array(
        [np.linalg.norm(np.diff(np.vstack([p, p[:1]]) if c else p, axis=0), axis=1).sum() for p, c in lines]
    )


def test_intensity_goes_with_the_points_when_pieces_are_turned():
    lines = [(np.array([[0.0, 0, 0], [0.04, 0, 0]]), False), (np.array([[0.0, 0.01, 0], [0.04, 0.01, 0]]), False)]
    batch = batch_of([[*lines, (circle(0.01, centre=(0.08, 0, 0)), True)]])
    level = batch.points[:, 0] / 0.1  # intensity tells where a point is
    batch = replace(batch, intensity=level.astype(np.float32))
    position, intensity = Sampler("stm").draw(batch, still(1)[0], 250)  # 0.14 m are 204 samples
    assert intensity == pytest.approx(position[:, 0] / 0.1, abs=1e-6)
    runs = [np.sign(np.diff(position[np.abs(position[:, 1] - y) < 1e-7, 0])[3]) for y in (0.0, 0.01)]
    assert sorted(runs) == [-1, 1]  # one of the lines runs back


def rungs(count):
    return [(np.array([[0.0, 0, 1e-3 * i], [0.01, 0, 1e-3 * i]]), False) for i in range(count)]


def test_very_many_pieces_stay_in_the_order_given():
    most = int(PIECES_MOST)
    assert jump_total(rungs(most + 1)) == pytest.approx(jump_total(rungs(most + 1), route="given"))
    assert jump_total(rungs(most)) < 0.3 * jump_total(rungs(most), route="given")
    cycle = laid_cycles(batch_of([rungs(most + 1)]), SamplingStrategy())[0]
    assert cycle["count"] == 2 * (most + 1)
    assert cycle["samples"] == SamplingStrategy().samples_a_cycle(0.01 * (most + 1))
