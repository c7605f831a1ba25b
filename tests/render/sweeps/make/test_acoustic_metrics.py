"""Noise and pressure as metrics of sweeps: the numbers that files of the same recipes give."""

import pytest
from command_line import answer, refused

from palpate.datasets.sweeps.table import load_table
from palpate.render import Palm, exploration, predict_noise, pressure_metrics, render
from palpate.render.sweeps.make.acoustic_metrics import NoiseMeter
from palpate.render.sweeps.report.table import METRICS

PLAN = """
metrics = ["contours", "noise", "pressure"]
[object]
source = "cube"
[motion]
duration = 1.5
seed = 3
[strategy]
source = ["oc", "cc"]
"""


@pytest.mark.exhaustive
def test_columns_are_what_files_give(tmp_path):
    (tmp_path / "plan.toml").write_text(PLAN)
    answer("sweep", tmp_path / "plan.toml", "--no-figure", "--device", "cpu")
    table = load_table(tmp_path / "plan.sweep" / "table.h5", constants=True)
    assert list(table["strategy"]) == ["oc", "cc"]
    motion = exploration("cube", duration=1.5, seed=3)
    for row, strategy in enumerate(table["strategy"]):
        path = render("cube", Palm(), motion, strategy).save(tmp_path / f"{strategy}.h5")
        for name, level in predict_noise(path).spectrum().levels().items():
            assert table[f"noise_{name}"][row] == pytest.approx(level, abs=1e-3)
        found = pressure_metrics(path).as_dict()
        for column in METRICS["pressure"]:
            assert table[column][row] == pytest.approx(found[column.removeprefix("pressure_")], rel=1e-5)
    assert table["noise_db_300_10k"][0] > table["noise_db_300_10k"][1]  # open contours click


@pytest.mark.exhaustive
def test_what_has_no_times_or_no_patches_has_no_values(tmp_path):
    (tmp_path / "plan.toml").write_text(
        'metrics = ["noise", "pressure"]\n[object]\nsource = "cube"\n[hand]\nsource = ["palm", "skin"]\n'
        '[motion]\nsource = "random"\ncount = 10\nseed = 1\n'
    )
    assert answer("sweep", tmp_path / "plan.toml", "--no-figure", "--device", "cpu")["recipes_failed"] == 0
    table = load_table(tmp_path / "plan.sweep" / "table.h5", constants=True)
    assert all(value is None or value != value for value in table["noise_dba"])


def test_metrics_that_are_none_are_refused_with_those_that_are(tmp_path):
    (tmp_path / "plan.toml").write_text('metrics = ["loudness"]\n[object]\nsource = "cube"\n')
    refused(2, "must be one of contours, frequency, sampling, noise, pressure", "sweep", tmp_path / "plan.toml")
    assert NoiseMeter.__doc__
