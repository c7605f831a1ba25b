"""Baselines that people review: equal results give equal bytes, and what differs is what moved."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweep_rows import table

from palpate.datasets.sweeps.table import SUFFIXES, load_table
from palpate.datasets.sweeps.table_text import csv_content
from palpate.render.sweeps.report.baseline import baseline_table, write_baseline
from palpate.render.sweeps.report.compare import compare_tables, load_baseline, parse_tolerances

ROWS = [{"object": name, "seed": seed, "size": size, "length_mean": 0.1 + 0.01 * seed + len(name) / 1e3,
         "recipe_hash": f"{name} {seed} {size}", "seconds": 1.0 * seed}
        for name in ("cube", "tube") for seed in (1, 2, 10) for size in (None, 0.13)]  # fmt: skip


def written(path, columns, **options):
    """Bytes of a baseline."""
    write_baseline(path, columns, **options)
    return path.read_bytes()


@pytest.mark.parametrize("suffix", [".csv", *(pytest.param(s, marks=pytest.mark.exhaustive) for s in SUFFIXES[1:])])
@settings(max_examples=15)
@given(order=st.permutations(range(len(ROWS))))
def test_equal_results_give_equal_bytes_whatever_the_order_time_or_maker(tmp_path_factory, suffix, order):
    path = tmp_path_factory.mktemp("baseline") / f"b{suffix}"
    other = [ROWS[k] | {"seconds": 7.0 + k, "maker": "another"} for k in order]
    assert written(path, table(*ROWS)) == written(path, table(*other))


def test_the_baseline_of_this_repository_is_what_its_sweep_writes():
    """Its file is older than the code that reads it here: nothing of its form may change."""
    path = Path(__file__).parents[4] / ".ci/sweep-baseline.csv"
    columns = load_table(path)
    varying, constants = baseline_table(columns | {"complete": np.ones(len(columns["object"]), bool)})
    assert csv_content(varying, constants) == path.read_bytes()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_baseline_is_the_sweep_that_it_was_made_of(tmp_path, suffix):
    columns = table(*ROWS)
    assert write_baseline(tmp_path / f"b{suffix}", columns) == len(ROWS)
    found = compare_tables(load_baseline(tmp_path / f"b{suffix}"), columns, parse_tolerances(["0"]))
    assert found.is_kept
    assert found.value_count == 6 * len(ROWS)  # poses, length_mean, r, draw_frequency_actual, jumps_pose, area_mean
    assert found.sentences() == [f"nothing moved in {len(ROWS)} recipes compared with {tmp_path / f'b{suffix}'}"]


def test_rows_are_sorted_by_what_recipes_are_called_and_numbers_as_numbers():
    columns, constants = baseline_table(table(*reversed(ROWS)))
    assert columns["object"].tolist() == ["cube"] * 6 + ["tube"] * 6
    assert columns["seed"].tolist() == [1, 1, 2, 2, 10, 10] * 2
    assert np.isnan(columns["size"]).tolist() == [True, False] * 6
    assert constants == {"object_fit": None, "palm_width": 0.085, "palm_length": 0.085, "speed": 7.0}
    assert not {"seconds", "maker", "complete", "recipe"} & set(columns)
    assert {"hand", "strategy", "r", "recipe_hash"} < set(columns)  # these stay, though they do not vary


@settings(max_examples=15)
@given(st.lists(st.floats(-3e-6, 3e-6), min_size=len(ROWS), max_size=len(ROWS)))
def test_values_within_the_tolerance_stay_the_old_ones_and_others_do_not(tmp_path_factory, changes):
    path = tmp_path_factory.mktemp("baseline") / "b.csv"
    before = written(path, table(*ROWS)).splitlines()
    old = load_baseline(path)
    moved = [row | {"length_mean": row["length_mean"] * (1 + by)} for row, by in zip(ROWS, changes, strict=True)]
    count = len(compare_tables(old, table(*moved)).moved)
    after = written(path, table(*moved), old=old).splitlines()
    assert sum(one != other for one, other in zip(before, after, strict=True)) == count
    assert compare_tables(load_baseline(path), table(*moved)).is_kept
