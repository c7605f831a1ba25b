"""Lengths of units, by the speeds that were measured."""

from sweep_stand_ins import Memory, StandIn, count_poses

from palpate.render.sweeps.run.missing import Missing
from palpate.render.sweeps.run.unit_loop import FIRST_SHARE, RATE_FIRST, SECONDS, UnitCutter


def cutter_of(recipes, groups=("contours",)):
    missing = Missing(recipes, groups, done=Memory().done, pose_count=count_poses)
    return UnitCutter(missing.places(), missing.poses_by_family)


def poses(chunks):
    return sum(chunk.pose_count for chunk in chunks)


def test_the_first_unit_of_a_family_is_short_and_later_ones_take_as_long_as_planned():
    cutter = cutter_of([StandIn(motion=str(seed), poses=1000) for seed in range(1000)])
    first = cutter.take("cpu")
    assert poses(first) == RATE_FIRST["cpu"] * SECONDS["cpu"] * FIRST_SHARE
    cutter.learn(first[0].family, 5000, 0.125)
    assert poses(cutter.take("cpu")) == 40_000 * SECONDS["cpu"]


def test_a_unit_has_chunks_of_one_family_and_at_least_one_however_slow():
    cutter = cutter_of([StandIn("cube", poses=10), StandIn("tube", poses=10**5), StandIn("tube", "2", poses=10**5)])
    units = [cutter.take("cpu") for _ in range(3)]
    assert [[chunk.title for chunk in unit] for unit in units] == [
        ["cube 1x10 stm emulator"],
        ["tube 1x100000 stm emulator"],
        ["tube 2x100000 stm emulator"],
    ]
    assert cutter.is_empty
    assert cutter.take("cpu") == []


def test_seconds_left_are_of_what_was_not_given():
    cutter = cutter_of([StandIn(motion=str(seed), poses=1000) for seed in range(100)])
    unit = cutter.take("cpu")
    cutter.learn(unit[0].family, 1000, 0.5)
    assert cutter.seconds_left() == (100_000 - poses(unit)) / 2000
    while cutter.take("cpu"):
        pass
    assert cutter.seconds_left() == 0.0
