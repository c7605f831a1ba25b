"""Routes over several polylines: every piece once and whole, and jumps as short as trying everything finds."""

import itertools
import math

import numpy as np
import pytest
from contour_shapes import batch_of, circle
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.render.sampling.path import Path
from palpate.render.sampling.route import PIECES_MOST, jump_total, shortest_route
from palpate.render.sampling.strategy import SamplingStrategy
from palpate.render.sampling.track import lay_track, pieces_of

place = st.tuples(*[st.integers(-50, 50)] * 3).map(lambda p: np.array(p) * 1e-3)
opens = st.tuples(place, place).filter(lambda p: np.linalg.norm(p[0] - p[1]) > 1e-3).map(lambda p: (np.array(p), False))
loops = st.tuples(place, st.integers(3, 8), st.floats(0.005, 0.03)).map(
    lambda c: (circle(c[2], centre=c[0], count=c[1]), True)
)


def pieces_from(lines):
    return pieces_of(Path.of(batch_of([lines]), 0))


def lengths_of(pieces):
    """Lengths of loops and of open pieces, sorted."""
    length = [(p.closed, np.linalg.norm(np.diff(p.points, axis=0), axis=1).sum()) for p in pieces]
    return np.array(sorted(length), float)


def best_of_all(pieces, *, back=False, cyclic=True):
    """The shortest jumps over all orders and directions of open pieces."""
    best = np.inf
    for order in itertools.permutations(range(1 if cyclic else 0, len(pieces))):
        order = (0, *order) if cyclic else order
        for turned in itertools.product((False, True), repeat=len(pieces)):
            ends = [pieces[i].points[[-1, 0] if t else [0, -1]] for i, t in zip(order, turned, strict=True)]
            pairs = list(itertools.pairwise([*ends, ends[0]] if cyclic else ends))
            best = min(best, sum(math.dist(b[0], a[0] if back else a[1]) for a, b in pairs))
    return best


@pytest.mark.exhaustive
@given(lines=st.lists(opens, min_size=2, max_size=4), back=st.booleans(), cyclic=st.booleans())
@settings(max_examples=60, deadline=None)
def test_up_to_four_open_pieces_are_joined_by_the_shortest_jumps_and_up_to_three_without_the_last(lines, back, cyclic):
    pieces = pieces_from(lines if cyclic else lines[:3])
    found = jump_total(shortest_route(pieces, back=back, cyclic=cyclic), back=back, cyclic=cyclic)
    assert found == pytest.approx(best_of_all(pieces, back=back, cyclic=cyclic), abs=1e-9)


@pytest.mark.exhaustive
@given(one=loops, other=st.one_of(loops, opens))
@settings(max_examples=40, deadline=None)
def test_a_loop_is_entered_near_its_best_place(one, other):
    pieces = pieces_from([one, other])
    found = jump_total(shortest_route(pieces))
    fine = [p.points[:-1] if p.closed else p.points for p in pieces]
    for k, piece in enumerate(pieces):
        if piece.closed:
            part = np.linspace(0, 1, 40, endpoint=False)[:, None]
            fine[k] = np.concatenate([a + part * (b - a) for a, b in itertools.pairwise(piece.points)])
    apart = np.linalg.norm(fine[0][:, None] - fine[1][None], axis=2)
    best = 2 * apart.min() if pieces[1].closed else (apart[:, 0] + apart[:, -1]).min()
    spacing = sum(np.linalg.norm(np.diff(p.points, axis=0), axis=1).sum() for p in pieces if p.closed) / 32
    assert best - 1e-3 <= found <= best + 2 * spacing


@pytest.mark.exhaustive
def test_nearest_neighbour_and_2_opt_are_close_to_the_optimum_on_average():
    random = np.random.default_rng(3)
    ratios = []
    for _ in range(12):
        lines = [(random.uniform(-0.05, 0.05, (2, 3)), False) for _ in range(5)]
        pieces = pieces_from(lines)
        ratios.append(jump_total(shortest_route(pieces)) / best_of_all(pieces))
    assert np.mean(ratios) < 1.03
    assert np.max(ratios) < 1.2


@pytest.mark.exhaustive
@given(lines=st.lists(st.one_of(opens, loops), min_size=1, max_size=9), back=st.booleans(), cyclic=st.booleans())
@settings(max_examples=50, deadline=None)
def test_every_piece_is_in_the_route_once_and_whole(lines, back, cyclic):
    pieces = pieces_from(lines)
    route = shortest_route(pieces, back=back, cyclic=cyclic)
    given_, found = (jump_total(p, back=back, cyclic=cyclic) for p in (pieces, route))
    assert found <= given_ + 1e-9
    assert lengths_of(route) == pytest.approx(lengths_of(pieces), abs=1e-8)
    for piece in route:
        assert not piece.closed or piece.points[0] == pytest.approx(piece.points[-1], abs=1e-12)
    drawn = np.concatenate([p.points for p in route])
    for piece in pieces:
        apart = np.linalg.norm(piece.points[:, None] - drawn[None], axis=2)
        assert apart.min(axis=1).max() < 2e-9


def test_intensity_goes_with_the_points_when_pieces_are_turned():
    lines = [(np.array([[0.0, 0, 0], [0.04, 0, 0]]), False), (np.array([[0.0, 0.01, 0], [0.04, 0.01, 0]]), False)]
    batch = batch_of([[*lines, (circle(0.01, centre=(0.08, 0, 0)), True)]])
    level = batch.points[:, 0] / 0.1  # intensity tells where a point is
    batch = type(batch)(**{**batch.__dict__, "intensity": level.astype(np.float32)})
    route = shortest_route(pieces_of(Path.of(batch, 0)))
    for piece in route:
        assert piece.intensity == pytest.approx(piece.points[:, 0] / 0.1, abs=1e-6)
    turned = [p for p in route if not p.closed]
    assert turned[0].points[0, 0] != turned[1].points[0, 0]  # one of them runs back


def rungs(count):
    return [(np.array([[0.0, 0, 1e-3 * i], [0.01, 0, 1e-3 * i]]), False) for i in range(count)]


def test_very_many_pieces_stay_in_the_order_given():
    pieces = pieces_from(rungs(PIECES_MOST + 1))
    assert shortest_route(pieces) is pieces
    assert jump_total(shortest_route(pieces[:-1])) < 0.3 * jump_total(pieces[:-1])
    path = Path.of(batch_of([rungs(PIECES_MOST + 1)]), 0)
    track = lay_track(path, SamplingStrategy())
    assert track.points is path.points  # nothing is taken apart, however many they are
    assert track.seconds == pytest.approx(0.01 * (PIECES_MOST + 1) / 7.0)
