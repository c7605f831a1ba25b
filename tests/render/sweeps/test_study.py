"""Sweeps from Python: overrides, the table in pandas and xarray, the best row, and a search by Optuna."""

import tomllib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.render import sweep
from palpate.render.errors import SweepError
from palpate.render.sweeps.study import toml_text

PLAN = """
metrics = ["contours"]
[object]
source = ["sphere", "cube"]
[motion]
source = "random"
count = 40
[strategy]
source = ["oc", "cc"]
"""
PLAIN = (
    st.booleans() | st.integers(-(2**60), 2**60) | st.floats(allow_nan=False) | st.text(st.characters(codec="utf-8"))
)
VALUES = st.recursive(PLAIN, lambda own: st.lists(own, max_size=3) | st.dictionaries(st.text("ab -", max_size=3), own))


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(PLAN)
    return path


@settings(max_examples=15)
@given(value=VALUES)
def test_values_are_written_as_toml_reads_them(value):
    assert tomllib.loads(f"x = {toml_text('x', value)}")["x"] == value


def test_a_sweep_is_made_once_and_its_table_is_tidy(plan):
    result = sweep(plan, {"motion.seed": [1, 2, 3], "object.fit": 0.07})
    again = sweep(plan, {"motion.seed": [1, 2, 3], "object.fit": 0.07})
    assert (result.report.rows, again.report.rows) == (12, 0)
    assert result.store == plan.with_suffix(".sweep")
    assert result.failures == ()
    frame = result.to_pandas()
    assert frame.shape == (12, len(result.columns))
    assert frame["object_fit"].tolist() == [0.07] * 12
    assert frame["complete"].all()
    np.testing.assert_array_equal(frame["length_mean"], again.columns["length_mean"])


def test_axes_that_vary_are_dimensions_and_nothing_moves(plan):
    result = sweep(plan, {"motion.seed": [2, 1], "object.source": "cube", "object.fit": [0.07, 0.05]})
    data = result.to_xarray()
    assert dict(data.sizes) == {"object_fit": 2, "seed": 2, "strategy": 2}
    assert data["seed"].values.tolist() == [1, 2]
    assert data["length_mean"].attrs == {"units": "m"}
    assert data.attrs["hand"] == "palm"
    columns = result.columns
    for row, value in enumerate(columns["length_mean"]):
        at = {name: columns[name][row] for name in data.sizes}
        assert data["length_mean"].sel(at).item() == value
    assert np.isnan(data["r"].sel(strategy="oc")).all()
    assert data["complete"].all()


@pytest.mark.exhaustive
def test_a_sparse_design_has_one_row_a_recipe(plan):
    fits = [{"source": "sphere", "fit": 0.05 + k / 1000, "scale": 1 + k % 7 / 10} for k in range(20)]
    data = sweep(plan, {"object": fits}, workers=1).to_xarray()
    assert dict(data.sizes) == {"object_fit": 20, "strategy": 2}  # the size decides the scale
    places = [{"source": "sphere", "fit": 0.05 + k // 2 / 1000, "at": [0, 0, 0.2 + k % 40 / 999]} for k in range(80)]
    data = sweep(plan, {"object": places, "strategy.source": "oc"}, workers=1).to_xarray()
    assert dict(data.sizes) == {"recipe": 80}
    assert data["object_fit"].dims == data["object_at_z"].dims == ("recipe",)


def test_the_best_row_is_the_largest_or_the_smallest(plan):
    result = sweep(plan, {"motion.seed": [1, 2, 3]})
    most, least = result.best("length_mean"), result.best("length_mean", largest=False)
    assert most["length_mean"] == result.columns["length_mean"].max()
    assert least["length_mean"] == result.columns["length_mean"].min()
    assert (most["strategy"], least["strategy"], least["r"]) == ("cc", "oc", None)
    assert result.units["length_mean"] == "m"
    for name in ("object", "none"):
        with pytest.raises(SweepError, match=rf"'{name}' is no metric of this table; known: poses, "):
            result.best(name)
    with pytest.raises(SweepError, match="no recipe has a value of r;"):
        sweep(plan, {"strategy.source": "oc"}).best("r")
