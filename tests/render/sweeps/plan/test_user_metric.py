"""A user's metric in a plan: it needs permission, its file is a part of its results' identity, faults name the key."""

import pytest
from typer.testing import CliRunner

from palpate.datasets import SweepStore
from palpate.render import load_plans, run_sweep, tidy_columns
from palpate.render.cli.app import app
from palpate.render.errors import UntrustedCodeError
from palpate.render.sweeps.plan.loading import draft_plans

CODE = """
import numpy as np
from pathlib import Path

Path(__file__).with_name("ran").touch()

def longest(contours):
    return contours.length().astype(float)

def kinds(contours):
    return {kind: contours.length(kind) for kind in ("object", "hand")}

def two(contours, other):
    return contours.length()

number = 3
"""
PLAN = """
metrics = ["contours", "mine.py:longest", "mine.py:kinds"]
[object]
source = ["tube", "cube"]
[motion]
duration = 0.5
[strategy]
source = ["oc", "cc"]
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    (tmp_path / "mine.py").write_text(CODE)
    (tmp_path / "plan.toml").write_text(PLAN)
    return tmp_path


def plan_of(folder, *overrides):
    return load_plans([folder / "plan.toml"], overrides, allow_code=True)


def result_keys(plan):
    return {(group, recipe.key(group)) for recipe in plan.recipes() for group in plan.groups}


def test_a_plan_runs_it_with_permission_only(folder):
    with pytest.raises(UntrustedCodeError, match=r"mine\.py:longest"):
        load_plans([folder / "plan.toml"])
    draft = draft_plans([folder / "plan.toml"])
    assert not (folder / "ran").exists()
    plan = draft.with_code(True)
    assert (folder / "ran").exists()
    assert plan.groups == draft.groups
    assert [group.split()[0::2] for group in plan.groups[1:]] == [["metric", "longest"], ["metric", "kinds"]]
    assert set(plan.user_metrics.values()) == {f"{folder}/mine.py:longest", f"{folder}/mine.py:kinds"}
    recipe = plan.recipes()[0]
    assert recipe.key(plan.groups[1]) == recipe.key("contours")


def test_an_edited_file_makes_its_own_results_again_and_no_other(folder):
    before = result_keys(plan_of(folder))
    assert (len(before), result_keys(plan_of(folder))) == (12, before)
    (folder / "mine.py").write_text(CODE.replace("length().astype(float)", "length() * 2.0"))
    after = result_keys(plan_of(folder))
    assert {group for group, _ in before & after} == {"contours"}
    assert len(after - before) == 8


@pytest.mark.exhaustive
def test_a_metric_that_fails_leaves_the_other_groups(folder):
    (folder / "mine.py").write_text(CODE + "\ndef some(contours):\n    return contours.length()[:1]\n")
    plan = plan_of(folder, 'metrics=["contours","mine.py:some"]')
    report = run_sweep(plan, folder / "store", device="cpu")
    assert len(report.failures) == 4
    with SweepStore(folder / "store", mode="read") as store:
        columns = tidy_columns(plan.recipes(), store, plan.groups)
    assert columns["complete"] == [False] * 4
    assert None not in columns["length_mean"]


def test_trust_in_the_plan_permits_it_until_it_is_edited(folder):
    assert CliRunner().invoke(app, ["trust", str(folder / "plan.toml")]).exit_code == 0
    assert not (folder / "ran").exists()
    (folder / "mine.py").write_text(CODE + "# edited\n")
    with pytest.raises(UntrustedCodeError, match=r"mine\.py:kinds"):
        load_plans([folder / "plan.toml"])
    (folder / "mine.py").write_text(CODE)
    assert len(load_plans([folder / "plan.toml"]).groups) == 3
    assert (folder / "ran").exists()
