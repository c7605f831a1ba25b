"""Keys that go together row by row: zip is the diagonal of a product, [sample] a design over its ranges."""

import math

import numpy as np
import pytest
from scipy.stats import qmc

from palpate.render.errors import PlanError
from palpate.render.sweeps.plan.loading import load_plans

SHORT = '[object]\nsource = "cube"\n'
CROSS = """
[object]
source = ["cube", "tube", "dog"]
fit = [0.08, 0.1, 0.12]
[motion]
seed = [1, 2, 3]
duration = [1.0, 2.0]
[sampling]
speed = [5.0, 6.0, 7.0]
"""


def load(folder, text, *overrides):
    path = folder / "plan.toml"
    path.write_text(text)
    return load_plans([path], overrides)


def refusal(folder, text, *overrides):
    with pytest.raises(PlanError) as caught:
        load(folder, text, *overrides)
    return str(caught.value).replace(f"{folder}/", "")


def rows(plan, *names):
    return [tuple(recipe.columns()[name] for name in names) for recipe in plan.recipes()]


def test_values_that_zip_lists_twice_stay_in_their_rows_and_equal_rows_are_one_recipe(tmp_path):
    text = 'zip = [["object.fit", "motion.seed"]]\n' + SHORT + "fit = [0.1, 0.2, 0.1]\n[motion]\nseed = [1, 1, {}]\n"
    plan = load(tmp_path, text.format(2))
    assert rows(plan, "object_fit", "seed") == [(0.1, 1), (0.2, 1), (0.1, 2)]
    plan = load(tmp_path, text.format(1))
    assert (plan.recipe_count, rows(plan, "object_fit", "seed")) == (2, [(0.1, 1), (0.2, 1)])


def test_drives_are_validated_only_where_sampling_and_array_come_together(tmp_path):
    text = 'keep = ["drives"]\n' + SHORT + "[sampling]\nupdate_rate = [10_000.0, 89.3023]\n"
    text += '[array]\nsource = ["emulator", "sonicsurface"]\n'
    assert "drives of stm cannot be played" in refusal(tmp_path, text)
    assert load(tmp_path, 'zip = [["sampling.update_rate", "array.source"]]\n' + text).recipe_count == 2


@pytest.mark.parametrize(
    ("zipped", "said"),
    [
        ('[["object.source", "hand.palm"]]', "zip: hand.palm has no values in a table of the plan"),
        ('[["object.source", "motion.duration"]]', "zip: motion.duration has 2 values, but object.source has 3"),
        (
            '[["object.source", "motion.sed"]]',
            "zip: must be a key of an axis, such as motion.seed, not 'motion.sed' (did",
        ),
        ('[["object.source"]]', "zip: must be a list of two keys or more, not ['object.source']"),
        ('["object.source"]', "zip: must be a list of two keys or more, not 'object.source'"),
        ("3", "zip: must be a list of lists of keys"),
        ('[["object.source", "motion.seed"], ["motion.seed", "object.fit"]]', "zip: motion.seed is listed before"),
    ],
)
def test_a_zip_that_cannot_be_is_refused(tmp_path, zipped, said):
    assert f"plan.toml:1: {said}" in refusal(tmp_path, f"zip = {zipped}\n{CROSS}")


def test_tables_of_one_axis_must_agree_in_each(tmp_path):
    text = 'zip = [["object.source", "object.fit"]]\n[[object]]\nsource = ["cube", "tube"]\nfit = 0.1\n'
    text += '[[object]]\nsource = "dog"\nfit = [0.1, 0.2]\n'
    assert "must have equally many values in each [[object]], not [1, 2] and [2, 1]" in refusal(tmp_path, text)


SAMPLE = '[sample]\nmethod = "{}"\ncount = {}\nseed = {}\n'
RANGES = (
    '[object]\nsource = ["cube", "tube"]\nfit = {from = 0.05, to = 0.25}\n[sampling]\nspeed = {from = 2, to = 10}\n'
)


def points(plan):
    """Rows of a plan in the unit square."""
    return np.array([((fit - 0.05) / 0.2, (speed - 2) / 8) for fit, speed in rows(plan, "object_fit", "speed")])


@pytest.mark.parametrize("method", ["sobol", "latin-hypercube", "random"])
def test_a_sample_is_one_design_for_every_value_of_the_other_axes(tmp_path, method):
    plan = load(tmp_path, SAMPLE.format(method, 64, 1) + RANGES)
    assert plan.recipe_count == 128
    cubes, tubes = (
        [row[1:] for row in rows(plan, "object", "object_fit", "speed") if row[0] == s] for s in ("cube", "tube")
    )
    assert cubes == tubes
    assert len(set(cubes)) == 64
    again = load(tmp_path, SAMPLE.format(method, 64, 1) + RANGES)
    assert [recipe.hash for recipe in again.recipes()] == [recipe.hash for recipe in plan.recipes()]
    assert rows(load(tmp_path, SAMPLE.format(method, 64, 2) + RANGES), "speed") != rows(plan, "speed")
    unit = points(plan)[:64]
    assert ((unit >= 0) & (unit <= 1)).all()
    discrepancy = qmc.discrepancy(np.clip(unit, 0, 1))
    assert discrepancy < (0.0005 if method == "sobol" else 0.02)
    if method != "random":  # each of 64 strips holds one point, along every axis
        assert [sorted(np.minimum(axis * 64, 63).astype(int)) for axis in unit.T] == [list(range(64))] * 2


def test_whole_numbers_and_equal_factors_are_drawn(tmp_path):
    text = SAMPLE.format("latin-hypercube", 400, 1) + SHORT
    text += "[motion]\nseed = {from = 1, to = 4}\nduration = {from = 0.01, to = 100, log = true}\n"
    drawn = rows(load(tmp_path, text), "seed", "duration")
    assert [sum(seed == k for seed, _ in drawn) for k in range(1, 5)] == [100] * 4
    decades = [math.floor(math.log10(duration)) for _, duration in drawn]
    assert [decades.count(k) for k in range(-2, 2)] == [100] * 4


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (SAMPLE.format("sobol", 100, 1) + RANGES, "sample.count: must be a power of two for sobol, not 100"),
        (SAMPLE.format("sobol", 100, 1) + RANGES, "write 64 or 128"),
        (SAMPLE.format("sobl", 8, 1) + RANGES, "sample.method: must be one of sobol, latin-hypercube, random"),
        (SAMPLE.format("random", 0, 1) + RANGES, "plan.toml:3: sample.count: must lie in 1..16384, not 0"),
        (SAMPLE.format("random", 8, 1) + SHORT, "plan.toml:1: sample: needs a range of from and to"),
        ("[sample]\ncount = 8\n" + RANGES, "plan.toml:1: sample.method: is missing"),
        ("sample = 3\n" + RANGES, "plan.toml:1: sample: must be a table, not 3"),
        (RANGES, "from and to alone need a table [sample]"),
        (SAMPLE.format("random", 8, 1) + RANGES.replace("to = 10", "to = 1"), "speed.from: must be at most `to`, 1"),
        (SAMPLE.format("random", 8, 1) + RANGES.replace("= 2,", "= 0,"), "speed.from: must lie in 0.001..100 m/s"),
        (
            'zip = [["sampling.speed", "object.source"]]\n' + SAMPLE.format("random", 2, 1) + RANGES,
            "plan.toml:1: zip: sampling.speed goes together with the other keys that [sample] draws already",
        ),
    ],
)  # fmt: skip
def test_a_sample_that_cannot_be_is_refused(tmp_path, text, said):
    assert said in refusal(tmp_path, text)
