"""A user's metric in a plan: it needs permission, its file is a part of its results' identity, faults name the key."""

import json
from dataclasses import replace

import pytest
from sweep_recipes import unit_of
from typer.testing import CliRunner

from palpate.datasets import SweepStore
from palpate.render import load_plans, run_sweep, tidy_columns
from palpate.render.cli.app import app
from palpate.render.errors import PlanError, UntrustedCodeError
from palpate.render.sweeps.make.unit_making import make_unit
from palpate.render.sweeps.plan.code_version import code_version
from palpate.render.sweeps.plan.loading import draft_plans
from palpate.render.sweeps.report.table import is_metric

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


def test_its_numbers_are_columns_of_the_table(folder):
    plan = plan_of(folder)
    code = {"granted": plan.granted, "user_metrics": tuple(plan.user_metrics.items())}
    result = make_unit(replace(unit_of(plan.recipes(), plan.groups), **code), "cpu")
    with SweepStore(folder / "store", code_version(), mode="write") as store:
        store.add(result.rows)
        columns = tidy_columns(plan.recipes(), store, plan.groups)
    names = [name for name in columns if name.startswith("metric_")]
    statistics = ("mean", "std", "max", "count")
    assert names == [f"metric_{own}_{s}" for own in ("longest", "kinds.hand", "kinds.object") for s in statistics]
    assert all(map(is_metric, names))
    assert columns["metric_longest_mean"] == pytest.approx(columns["length_mean"], rel=1e-6)
    assert columns["metric_longest_std"] == pytest.approx(columns["length_std"], rel=1e-5)
    assert columns["metric_kinds.hand_mean"] == pytest.approx(columns["length_hand_mean"], rel=1e-6)
    assert columns["metric_longest_count"] == [45] * 4


def test_an_edited_file_makes_its_own_results_again_and_no_other(folder):
    before = result_keys(plan_of(folder))
    assert (len(before), result_keys(plan_of(folder))) == (12, before)
    (folder / "mine.py").write_text(CODE.replace("length().astype(float)", "length() * 2.0"))
    after = result_keys(plan_of(folder))
    assert {group for group, _ in before & after} == {"contours"}
    assert len(after - before) == 8


def test_a_file_of_another_name_gives_the_same_results(folder):
    before = result_keys(plan_of(folder))
    (folder / "mine.py").rename(folder / "other.py")
    assert result_keys(plan_of(folder, 'metrics=["other.py:longest","contours"]')) < before


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


FAULTS = {
    "mine.py:none": r"no function 'none'",
    "mine.py:two": "one argument",
    "mine.py:number": "not a callable|one argument",
    "none.py:longest": "no such file",
    "no_such_module:longest": "no module",
    "mine.py:": "must be package.module:function or file.py:function",
}


@pytest.mark.parametrize("text", FAULTS)
def test_what_is_no_function_is_refused_by_key(folder, text):
    with pytest.raises(PlanError, match=rf"(plan\.toml:2|--set [^:]*).*metrics: .*({FAULTS[text]})"):
        load_plans([folder / "plan.toml"], [f'metrics=["contours","{text}"]'], allow_code=True)


def test_two_functions_of_one_name_are_refused(folder):
    (folder / "other.py").write_text(CODE + "\n")
    with pytest.raises(PlanError, match=r"mine\.py and .*other\.py both have a function 'longest'"):
        load_plans([folder / "plan.toml"], ['metrics=["mine.py:longest","other.py:longest"]'], allow_code=True)


@pytest.mark.exhaustive
def test_a_metric_that_ends_its_process_fails_its_recipes_only(folder):
    dies = "\ndef dies(contours):\n    if contours.length('hand').any():\n        import os\n\n        os._exit(3)\n"
    (folder / "mine.py").write_text(CODE + dies + "    return contours.length()\n")
    options = ["--allow-code", "--json", "--no-figure", "--set", 'metrics=["contours","mine.py:dies"]']
    options += ["--set", "motion.duration=4.0"]  # long enough to touch
    done = CliRunner().invoke(app, ["sweep", str(folder / "plan.toml"), "--device", "cpu", *options])
    told = json.loads(done.stdout)
    assert (done.exit_code, told["recipes"], told["recipes_failed"]) == (1, 4, 2)
    assert all(", cc," in failure["name"] for failure in told["failures"])


def test_trust_in_the_plan_permits_it_until_it_is_edited(folder):
    assert CliRunner().invoke(app, ["trust", str(folder / "plan.toml")]).exit_code == 0
    assert not (folder / "ran").exists()
    (folder / "mine.py").write_text(CODE + "# edited\n")
    with pytest.raises(UntrustedCodeError, match=r"mine\.py:kinds"):
        load_plans([folder / "plan.toml"])
    (folder / "mine.py").write_text(CODE)
    assert len(load_plans([folder / "plan.toml"]).groups) == 3
    assert (folder / "ran").exists()
