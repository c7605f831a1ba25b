"""Plans while files change beside them: edited sources, and stages that go by the motion's row."""

import json
import os
import sys
from dataclasses import replace

import pytest
from sweep_recipes import made, random_motion, recipe_of, unit_of

from palpate.datasets.sweeps.result_row import payload_of
from palpate.render.stages import registry as stages
from palpate.render.sweeps.make.unit_making import make_unit
from palpate.render.sweeps.plan.loading import load_plans

BALL = """
import warp as wp

R = wp.constant(0.02)  # Python reads this, Warp what is below

@wp.func
def ball(x: wp.vec3) -> float:
    return wp.length(x - wp.vec3(0.0, 0.0, 0.2)) - 0.5 * (R + 0.02)
"""
STAGE = """
from dataclasses import replace

import numpy as np

from palpate.render.stages.registry import register_transform

SHARE = %s


def scaled(batch, setting):
    '''Larger by a share, and by the motion's row.'''
    by = np.repeat(SHARE + np.arange(batch.pose_count) + setting.first, np.diff(batch.polyline_start[batch.pose_start]))
    return replace(batch, points=(batch.points * by[:, None]).astype(np.float32))


register_transform("%s", scaled)
"""


@pytest.fixture
def own(tmp_path):
    """The file of a module of one stage, with a strategy `own.json` beside it; both are forgotten in the end."""
    name = f"edited_{tmp_path.name}"
    file = tmp_path / f"{name}.py"
    file.write_text(STAGE % ("1.0", name))
    strategy = {"modules": [name], "prune": ["outside"], "transform": [name]}
    (tmp_path / "own.json").write_text(json.dumps(strategy))
    yield file
    stages._ENTRIES.pop(name, None)


def plan_in(folder, source, strategy="cc"):
    around = "bounds = [-0.06, -0.06, 0.14, 0.06, 0.06, 0.26]\n" if ":" in source else ""
    motion = f'[motion]\nsource = "random"\ncount = 50\n[strategy]\nsource = "{strategy}"\n'
    (folder / "plan.toml").write_text(f'[object]\nsource = "{source}"\n{around}{motion}')
    return load_plans([folder / "plan.toml"], allow_code=True)


def edit(file, old, new):
    """Of the same size and, to the second that Python's cache goes by, the same age."""
    before, text = file.stat(), file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    assert file.stat().st_size == before.st_size
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))


def length_sum(folder, source):
    """Of the contours of the file's ball as it is now."""
    plan = plan_in(folder, source)
    unit = replace(unit_of(plan.recipes(), ("contours",)), granted=plan.granted)
    (row,) = make_unit(unit, "cpu").rows
    return payload_of(row.payload)["stat"]["length"][1]


@pytest.mark.exhaustive
def test_an_edited_function_is_another_object_in_the_same_process(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    (tmp_path / "shapes.py").write_text(BALL)
    before = length_sum(tmp_path, "shapes.py:ball")
    edit(tmp_path / "shapes.py", "0.02", "0.05")
    after = length_sum(tmp_path, "shapes.py:ball")
    (tmp_path / "new.py").write_text(BALL.replace("0.02", "0.05") + "# a file of its own\n")
    assert before != after == length_sum(tmp_path, "new.py:ball")


def test_a_plan_runs_an_edited_module_anew_and_units_of_the_old_plan_are_refused(tmp_path, own):
    (before,) = plan_in(tmp_path, "tube", "own.json").recipes()
    edit(own, "1.0", "2.0")
    (after,) = plan_in(tmp_path, "tube", "own.json").recipes()
    assert before.key("contours") != after.key("contours")
    (failed,) = make_unit(unit_of([before]), "cpu").failed
    assert "are not those of the plan" in failed.message
    assert len(made([after])) == 2


def test_stages_of_ones_own_see_the_rows_of_their_motion_whoever_shares_the_unit(tmp_path, own):
    recipes = [recipe_of("tube", motion=random_motion(60, seed=s), strategy=tmp_path / "own.json") for s in (1, 2)]
    together = made(recipes)
    assert len(together) == 4
    assert together == made(recipes[:1]) | made(recipes[1:])
