"""A sweep's table against an earlier one: tolerances, what moved, what is missing, and baselines that are none."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweep_rows import recipe, table

from palpate.datasets.sweeps.table import write_table
from palpate.render.errors import SweepError
from palpate.render.sweeps.report.compare import (
    DEFAULT,
    FLOORS,
    Baseline,
    compare_tables,
    load_baseline,
    parse_tolerances,
)

SEEDS = [{"seed": k, "length_mean": 0.1 + 0.01 * k} for k in range(4)]
MAGNITUDES = st.floats(1e-9, 1e9)


def against(old, new, *words):
    """Compare two tables."""
    return compare_tables(Baseline("old", {k: np.array(v) for k, v in old.items()}), new, parse_tolerances(words))


def test_the_same_table_has_not_moved():
    found = against(table(*SEEDS), table(*SEEDS))
    assert found.is_kept
    assert found.recipe_count == 4
    assert found.value_count == 4 * 6  # poses, length_mean, r, draw_frequency_actual, jumps_pose, area_mean
    assert found.sentences() == ["nothing moved in 4 recipes compared with old"]


@given(value=MAGNITUDES, sign=st.sampled_from([-1, 1]), amount=st.floats(1e-9, 0.5), far=st.booleans())
def test_a_relative_change_over_the_tolerance_is_found_and_below_never(value, sign, amount, far):
    new = value * (1 + sign * amount * (1.01 if far else 0.98))
    change = abs(new - value) / max(abs(new), abs(value))
    found = against(table({"length_mean": value}), table({"length_mean": new}), f"{amount!r}")
    is_tiny = abs(new - value) <= FLOORS["m"]
    assert found.is_kept == (change <= amount or is_tiny)
    if not far:
        assert found.is_kept
    if far and sign < 0 and not is_tiny:  # the old one is the greater
        assert not found.is_kept
        assert found.moved[0].change == pytest.approx(-1.01 * amount)


@given(
    moved=st.sets(st.tuples(st.integers(0, 3), st.sampled_from(["length_mean", "r", "jumps_pose"]))),
    order=st.permutations(range(4)),
)
def test_exactly_what_moved_is_told_whatever_the_order_of_rows(moved, order):
    old, new = table(*SEEDS), table(*SEEDS)
    for row, metric in moved:
        new[metric][row] *= 1.25
    shuffled = {name: [values[k] for k in order] for name, values in new.items()}
    found = against(old, shuffled)
    assert {(int(m.recipe_hash, 16), m.metric) for m in found.moved} == moved
    assert found.is_kept == (not moved)
    assert all(m.change == pytest.approx(0.2) for m in found.moved)


def test_the_default_takes_rounding_and_nothing_else():
    rounded = float(np.float32(0.1))  # 1.5e-8 off
    assert against(table({"length_mean": 0.1}), table({"length_mean": rounded})).is_kept
    assert not against(table({"length_mean": 0.1}), table({"length_mean": 0.1 * (1 + 1.1 * DEFAULT)})).is_kept


@pytest.mark.parametrize(("old", "new"), [(math.nan, 1.0), (1.0, math.nan), (1.0, None), (0.0, 1e-3)])
def test_what_appears_or_vanishes_has_moved_and_stands_first(old, new):
    found = against(table({"r": old}, {"r": 1.0}), table({"r": new}, {"r": 9.0}))
    assert [m.recipe_hash[-1] for m in found.moved] == ["0", "1"]
    assert "none" in "".join(found.rows()[0]) or new == 1e-3


@pytest.mark.parametrize(("metric", "floor"), [("length_mean", 1e-9), ("area_mean", 1e-12), ("dwell_spread", 1e-9),
                                                ("draw_frequency_actual", 1e-6)])  # fmt: skip
def test_rounding_about_zero_is_no_move_unless_the_tolerance_is_0(metric, floor):
    was, here, far = (table({metric: value}) for value in (0.0, 0.9 * floor, 1.1 * floor))
    assert against(was, here).is_kept
    assert against(was, here, "1e-3").is_kept
    assert [m.metric for m in against(was, far).moved] == [metric]
    assert [m.metric for m in against(was, here, "0").moved] == [metric]
    assert [m.metric for m in against(was, here, f"{metric}={0.5 * floor}abs").moved] == [metric]


def edited(*rows):
    """Tables before and after an edit of a file: recipes with other hashes, what is said of them the same."""
    return table(*rows), table(*(row | {"recipe_hash": f"new {k}"} for k, row in enumerate(rows)))


def test_recipes_of_an_edited_file_are_compared_by_name():
    old, new = edited(*SEEDS)
    found = against(old, new)
    assert found.is_kept
    assert (found.recipe_count, found.missing, found.added, len(found.changed)) == (4, (), (), 4)
    assert "4 recipes are compared by name: a file behind their names has changed: seed=0" in found.sentences()[1]
    new["length_mean"][2] *= 1.01
    found = against(old, new)
    assert not found.is_kept
    assert [(m.recipe_hash, m.recipe, m.metric) for m in found.moved] == [("new 2", "seed=2", "length_mean")]
    new["complete"][2] = False
    assert against(old, new).incomplete == ("seed=2",)


def test_what_has_changed_behind_its_name_is_named():
    one, other = (recipe(strategy="hatch", seed=seed) for seed in (1, 2))
    edits = [replace(r, strategy=r.strategy | {"described": {"raw": "section"}}) for r in (one, other)]
    old, new = (
        table(*({"seed": r.motion["seed"], "recipe": r.to_json(), "recipe_hash": r.hash} for r in recipes))
        for recipes in ((one, other), edits)
    )
    found = against(old, new)
    assert found.sources == ("strategy hatch",)
    assert found.sentences()[1].endswith("2 recipes are compared by name: the file behind this name has changed: "
                                         "strategy hatch")  # fmt: skip


def test_recipes_are_compared_by_name_only_if_one_is_gone_and_one_is_new():
    old, new = edited({"seed": 1}, {"seed": 1}, {"seed": 2})
    found = against(old, new)
    assert (found.recipe_count, len(found.missing), len(found.added)) == (1, 2, 2)
    assert found.changed == ("seed=2",)
    same, _ = edited({"seed": 1}, {"seed": 2})
    grown = table({"seed": 1}, {"seed": 2}, {"seed": 2, "recipe_hash": "new"})  # what it was is still there
    assert (against(same, grown).changed, len(against(same, grown).added)) == ((), 1)


def test_incomplete_results_fail_here_and_are_ignored_in_the_baseline():
    whole, part = table(*SEEDS), table(*SEEDS[:3], SEEDS[3] | {"complete": False, "length_mean": None})
    found = against(whole, part)
    assert not found.is_kept
    assert found.incomplete == ("seed=3",)
    assert found.moved == ()
    back = against(part, whole)
    assert back.is_kept
    assert back.added == ("seed=3",)


def test_the_largest_change_comes_first_and_twenty_are_shown():
    rows = [{"seed": k} for k in range(50)]
    new = table(*[row | {"length_mean": 0.2 * (1 + 0.001 * row["seed"])} for row in rows])
    found = against(table(*rows), new)
    assert len(found.moved) == 49
    shown = found.rows()
    assert len(shown) == 20
    assert shown[0] == ("seed=49", "length_mean", "0.2", "0.2098", "+4.9 %")
    assert len(json.loads(json.dumps(found.to_dict()))["moved"]) == 49


def test_a_tolerance_for_an_unknown_metric_is_refused_with_the_known_ones():
    with pytest.raises(SweepError, match=r"--tolerance lenght_mean: no such metric; known: area_mean, .*length_mean"):
        against(table(*SEEDS), table(*SEEDS), "lenght_mean=1")


@pytest.mark.parametrize("name", ["table.csv", "table.parquet"])
def test_a_baseline_is_a_table_or_the_folder_that_has_one(tmp_path, name):
    columns = table(*SEEDS) | {"r": [1.0, None, None, 2.0]}
    write_table(tmp_path / name, columns)
    for place in [tmp_path / name, *([tmp_path] if name == "table.csv" else [])]:
        found = compare_tables(load_baseline(place), columns)
        assert found.is_kept
        assert found.value_count == 24
        assert found.baseline == str(place)


def test_a_baseline_that_is_none_is_refused_in_one_sentence(tmp_path):
    with pytest.raises(SweepError, match=r"missing does not exist"):
        load_baseline(tmp_path / "missing")
    with pytest.raises(SweepError, match=r"has no table\.csv"):
        load_baseline(tmp_path)
    (tmp_path / "table.csv").write_bytes(b"a,b\n1\n")
    with pytest.raises(SweepError, match=r"baseline .*table\.csv:2: 1 values, expected 2"):
        load_baseline(tmp_path)
    write_table(tmp_path / "other.csv", {"a": [1.0]})
    with pytest.raises(SweepError, match="no table of a sweep"):
        load_baseline(tmp_path / "other.csv")
    twice = table({"recipe_hash": "a"}, {"recipe_hash": "a"})
    write_table(tmp_path / "twice.csv", twice)
    with pytest.raises(SweepError, match="more than once"):
        load_baseline(tmp_path / "twice.csv")
