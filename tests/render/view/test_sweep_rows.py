"""Rows of a sweep's table in any order; the rendering of a row has the metrics that the row has."""

import numpy as np
import pytest

from palpate.render import ContourFile, sweep
from palpate.render.errors import ViewError
from palpate.render.view.sweep_rows import SweepRows, default_metrics

PLAN = """
[object]
source = ["cube", "tube"]
[motion]
duration = 0.5
seed = [1, 2]
[strategy]
source = ["oc", "cc"]
"""


def make_store(folder, plan):
    from typer.testing import CliRunner

    from palpate.render.cli.app import app

    (folder / "plan.toml").write_text(plan)
    done = CliRunner().invoke(app, ["sweep", str(folder / "plan.toml"), "--device", "cpu", "--workers", "1", "--quiet"])
    assert done.exit_code == 0, done.output
    return folder / "plan.sweep"


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return make_store(tmp_path_factory.mktemp("sweep"), PLAN)


def test_rows_sorted_and_searched(store):
    rows = SweepRows(store)
    assert rows.count == 8
    assert rows.axes == ["object", "seed", "strategy"]
    length = rows.columns["length_mean"]
    assert rows.ordered("length_mean").tolist() == np.argsort(length, kind="stable").tolist()
    falling = rows.ordered("r", falling=True)
    assert np.isnan(rows.columns["r"][falling[-4:]]).all()  # OC has none: missing ones are last
    assert np.isnan(rows.columns["r"][rows.ordered("r")[-4:]]).all()
    found = rows.ordered(containing="TUBE, seed 2")
    assert {rows.columns["object"][row] for row in found} == {"tube"}
    assert len(found) == 2
    assert len(rows.ordered("length_mean", containing="no such thing")) == 0
    assert default_metrics(rows.metrics)[0] == "length_mean"


def test_a_row_rendered_again_has_its_lengths(store, tmp_path):
    rows = SweepRows(store)
    with ContourFile(rows.file_of(5, tmp_path)) as file:
        assert file.metrics()["length"].mean() == pytest.approx(rows.columns["length_mean"][5], rel=1e-6)
        assert file.object()["name"] == rows.columns["object"][5]


@pytest.mark.exhaustive
def test_a_kept_contour_file_is_opened_where_it_lies(tmp_path):
    store = make_store(tmp_path, 'keep = ["contours"]\nobject.source = "cube"\nmotion.duration = 0.1\n')
    file = SweepRows(store).file_of(0, tmp_path / "unused")
    assert file.is_relative_to(store)
    with ContourFile(file) as opened:
        assert opened.object()["name"] == "cube"


def test_a_store_without_a_table_is_refused(tmp_path):
    (tmp_path / "plan.toml").write_text(PLAN)
    result = sweep(tmp_path / "plan.toml", {"object.source": "cube"}, device="cpu", workers=1)
    with pytest.raises(ViewError, match=r"has no table\.csv"):  # a script writes none
        SweepRows(result.store)
