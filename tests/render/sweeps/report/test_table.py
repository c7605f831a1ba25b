"""A sweep's tidy table: merged parts, columns, what is missing, and its pace."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweep_rows import HandMadeStore, payload, recipe, statistic

from palpate.datasets.storage.schema import PRUNED_NAMES, removed_name
from palpate.datasets.sweeps.result_row import ResultRow
from palpate.datasets.sweeps.store import SweepStore
from palpate.datasets.sweeps.table import load_table, write_blocks
from palpate.render.sweeps.make.unit import CHUNK_POSES
from palpate.render.sweeps.report.table import (
    METRICS,
    Statistic,
    pose_blocks,
    tidy_columns,
)

GROUPS = ("contours", "frequency", "sampling")
LENGTHS = st.lists(st.floats(1e-3, 1.0), min_size=1, max_size=40)


def results(one, **parts):
    """Results of a recipe: payloads of each group."""
    return {(group.replace("_", "-"), one.key(group.replace("_", "-"))): own for group, own in parts.items()}


@given(values=LENGTHS, cuts=st.sets(st.integers(0, 40)))
def test_statistics_are_those_of_all_poses_however_they_are_cut(values, cuts):
    parts = [
        statistic(part.tolist()) for part in np.split(np.array(values), sorted(c for c in cuts if c < len(values)))
    ]
    merged = Statistic.merged(parts)
    assert merged.number == len(values)
    assert merged.mean == pytest.approx(np.mean(values), rel=1e-12)
    assert merged.most == max(values)
    assert merged.std == pytest.approx(np.std(values), rel=1e-6, abs=2e-6 * math.sqrt(np.mean(np.square(values))))


def test_rounding_is_no_deviation_and_nothing_has_none():
    assert Statistic.merged([statistic([0.1] * 1000)] * 7).std == 0.0
    empty = Statistic.merged([[0, 0.0, 0.0, None, None]])
    assert (empty.mean, empty.std, empty.most) == (None, None, None)


def test_a_row_has_the_recipe_then_metrics_then_who_made_it():
    one = recipe(count=CHUNK_POSES + 3)
    parts = [
        payload(
            CHUNK_POSES, length=[0.2, 0.4], length_object=[0.1, 0.3], polylines=[1, 3], area=[], removed_small=[0.01]
        ),
        payload(3, length=[0.6], length_object=[0.1], polylines=[2], area=[]),
    ]
    frequency = [payload(CHUNK_POSES, draw_frequency_nominal=[10, 20], draw_frequency_actual=[9]), payload(3)]
    counts = {"jumps_pose": 5, "revisit_rate": None, "seconds": {"sampling": 2.0}}
    store = HandMadeStore(results(one, contours=parts, frequency=frequency, sampling=[counts]))
    columns = tidy_columns([one], store, GROUPS)
    assert all(len(values) == 1 for values in columns.values())
    row = {name: values[0] for name, values in columns.items()}
    own, metrics = list(one.columns()), [name for group in GROUPS for name in METRICS.get(group, ())]
    last = ["complete", "recipe", "recipe_hash", "maker", "seconds", "seconds_draw", "seconds_find", "seconds_sampling"]
    assert list(row) == [*own, *metrics, *last]
    assert row["poses"] == CHUNK_POSES + 3
    assert row["poses_drawn"] == CHUNK_POSES + 1
    assert row["length_mean"] == pytest.approx(0.4)
    assert row["length_std"] == pytest.approx(math.sqrt(0.08 / 3))
    assert row["length_max"] == 0.6
    assert row["r"] == pytest.approx(1.2 / 0.5)
    assert (row["polylines_mean"], row["polylines_max"]) == (2, 3)
    assert row["area_mean"] is None
    assert row["removed_small_mean"] == 0.01
    assert row["draw_frequency_nominal"] == 15
    assert row["jumps_pose"] == 5
    assert row["complete"] is True
    assert row["seconds"] == pytest.approx(4 * 0.75 + 2)
    assert (row["recipe"], row["recipe_hash"], row["maker"]) == (one.to_json(), one.hash, "hand")


@pytest.mark.parametrize(("strategy", "has_r"), [("oc", False), ("cc", True), ("hatch", True)])
def test_r_is_there_where_the_strategy_closes(strategy, has_r):
    one = recipe(strategy=strategy)
    store = HandMadeStore(results(one, contours=[payload(length=[0.3], length_object=[0.2])]))
    assert tidy_columns([one], store, ["contours"])["r"] == [pytest.approx(1.5) if has_r else None]


def test_what_is_not_whole_has_no_metrics_and_says_so():
    half, none, whole = recipe(count=2 * CHUNK_POSES), recipe("cube"), recipe("rock")
    part = payload(CHUNK_POSES, length=[0.2])
    store = HandMadeStore(results(half, contours=[part]) | results(whole, contours=[part]))
    columns = tidy_columns([half, none, whole], store, ["contours"])
    assert columns["complete"] == [False, False, True]
    assert columns["length_mean"] == [None, None, pytest.approx(0.2)]
    assert columns["poses"] == [None, None, CHUNK_POSES]
    assert columns["seconds"] == [None, None, 0.75]
    assert tidy_columns([whole], store, ["contours", "frequency"])["complete"] == [False]


def test_a_real_store_gives_the_table_and_rows_of_poses(tmp_path):
    one, other, bare = recipe(), recipe("cube"), recipe("rock")
    lengths = {"pose": np.arange(3), "length": np.ones(3, np.float32)}
    pruned = {**lengths, "removed_small": np.full(3, 0.5, np.float32)}
    rows = [
        ResultRow.of("m", "contours", one.key("contours"), 0, payload(length=[0.25], area=[])),
        ResultRow.of("m", "poses", one.key("poses"), 0, {"poses": 3}, pruned),
        ResultRow.of("m", "poses", bare.key("poses"), 0, {"poses": 3}, lengths),
    ]
    with SweepStore(tmp_path / "store", "m", mode="write") as store:
        assert store.add(rows) == 3
        columns = tidy_columns([other, one], store, ["contours"])
        blocks = list(pose_blocks([other, one, bare], store))
        write_blocks(tmp_path / "poses.parquet", blocks)
    assert columns["maker"] == ["m", "m"]
    assert columns["length_mean"] == [None, 0.25]
    assert columns["complete"] == [False, True]
    assert [block["recipe"].tolist() for block in blocks] == [[1, 1, 1], [2, 2, 2]]
    assert set(blocks[0]) == set(blocks[1]) == {"recipe", "pose", "length", *map(removed_name, PRUNED_NAMES)}
    removed = load_table(tmp_path / "poses.parquet")["removed_small"]
    np.testing.assert_array_equal(removed, [0.5] * 3 + [np.nan] * 3)
