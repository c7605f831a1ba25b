"""The up-down rule against a sequence worked by hand, and against the points that Levitt published."""

import itertools

import numpy as np
import pytest

from palpate.render.study.plan.block_designs import Staircase
from palpate.render.study.plan.study_plan import PlannedBlock, Question

QUESTION = Question(name="felt", text="Did you feel it?", kind="choice", options=("no", "yes"))


def staircase(level_count=21, **fields):
    sets = tuple((f"level {number}",) for number in range(level_count))
    block = PlannedBlock(name="b", design="staircase", question=QUESTION, questions=(QUESTION,), sets=sets, **fields)
    return Staircase(block)


def test_levels_and_reversals_are_those_worked_by_hand():
    track = staircase(down=2, steps=(4, 2, 1), start_level=0, reversals=4)
    answers = "+++++-++-++-"
    # Level of each trial, and reversals before it: two correct answers go 4 levels on; the first reversal (after "+-")
    # goes back by 2, the second goes on by 1, and the steps stay 1 from then on.
    by_hand = [(0, 0), (0, 0), (4, 0), (4, 0), (8, 0), (8, 0), (6, 1), (6, 1), (7, 2), (6, 3), (6, 3), (7, 4)]
    seen = []
    for answer in answers[:-1]:
        seen.append((track.level, track.reversals))
        assert not track.has_ended
        track.take(answer == "+")
    assert [*seen, (track.level, track.reversals)] == by_hand
    assert track.has_ended


def test_moves_beyond_the_ends_stay_there_and_are_counted():
    track = staircase(level_count=4, down=1, steps=(3,), reversals=99)
    seen = []
    for answer in "-++--":
        track.take(answer == "+")
        seen.append((track.level, track.clipped, track.reversals))
    assert seen == [(0, 1, 0), (3, 1, 1), (3, 2, 1), (0, 2, 2), (0, 3, 2)]


def test_it_ends_after_so_many_trials():
    track = staircase(trials_max=3)
    for _ in range(3):
        assert not track.has_ended
        track.take(False)
    assert track.has_ended
    assert track.reversals == 0


def share_correct_at_reversals(down, reversals):
    """Of an observer whose share of correct answers falls along a logistic function of the level, from 1 to 0."""
    track = staircase(level_count=401, down=down, start_level=200, reversals=reversals, trials_max=10**9)
    chance = 1 / (1 + np.exp((np.arange(401) - 200) / 20))
    uniform = np.random.default_rng(0).random(40 * reversals)
    levels, before = [], 0
    for own in itertools.takewhile(lambda _: not track.has_ended, uniform):
        level = track.level
        track.take(own < chance[level])
        if track.reversals > before:
            before = track.reversals
            levels.append(level)
    assert track.has_ended
    return chance[round(float(np.mean(levels[20:])))]


# H. Levitt (1971), Transformed up-down methods in psychoacoustics, J. Acoust. Soc. Am. 49(2), 467-477, table I.
@pytest.mark.parametrize(("down", "published"), [(1, 0.5), (2, 0.707), (3, 0.794), (4, 0.841)])
def test_it_converges_near_the_published_point(down, published):
    assert share_correct_at_reversals(down, 1000) == pytest.approx(published, abs=0.03)
